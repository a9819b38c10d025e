"""The margin of a scene to the protective separation distance, for comparison.

The margin of a tick is the least, over all spheres of the arm's cover and all obstacles, of

    distance between their surfaces - Sp,    Sp = Sh + Sr + Ss + C + Zd + Zr

with the terms of `armguard.pairs.separation` [Separation]_. A person walks at one speed until the
arm rests; a sphere goes on at its present speed towards them for the reaction time, and brakes at a
constant rate from then on. Positions and velocities count with what they may be off by, ages with
what bodies may have done since within their own bounds. The direction is that of the measured
positions, as the rule has it: it compares, and it proves nothing.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.free_body import displacement_at, length_above, top_speed
from armguard.contact.gjk import nearest_on_hull
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.obstacles.table import Marks, States
from armguard.pairs.evaluate import TickState
from armguard.pairs.scene import ArmArrays
from armguard.pairs.separation import separation_of
from armguard.robot.kinematics import SphereTree
from armguard.settings.declarations import read_number
from armguard.settings.separation_rule import SeparationRule


class _Terms(NamedTuple):
    """What the rule says of a tick and all of its pairs."""

    now: float
    """Time of the tick on the obstacles' clock, in [s]."""
    arm_age: float
    """Age of the joint state, in [s]."""
    braking: float
    """How long braking takes, T_s, in [s]."""
    response: float
    """From the tick until its STOP brakes, T_r, in [s]."""
    human_speed: float
    """Of every obstacle that is not static, v_h, in [m/s]."""
    own_speed: bool
    """Whether its own speed bound counts instead."""
    intrusion: float
    """C, in [m]."""
    human_uncertainty: float
    """Zd, in [m]."""
    robot_uncertainty: float
    """Zr, in [m]."""


class SeparationMargin:
    """The rule for one arm.

    Args:
        rule: Its parameters.
        response_time: From a tick until its STOP brakes, T_r, in [s]: period, latency and reaction.

    Raises:
        ArmguardError: The time is negative, infinite or none.
    """

    def __init__(self, rule: SeparationRule, response_time: float) -> None:
        if not isinstance(rule, SeparationRule):
            raise ArmguardError("separation", f"is {rule!r}", expected="a SeparationRule")
        if not 0.0 <= read_number(response_time) < math.inf:
            raise ArmguardError(
                "response_time", f"is {response_time!r}", expected="a finite number from 0 on"
            )
        self.rule = rule
        self.response_time = float(response_time)
        own_speed = rule.human_speed is None
        self._numbers = (
            self.response_time,
            0.0 if own_speed else float(rule.human_speed or 0.0),
            own_speed,
            rule.intrusion_distance,
            rule.human_uncertainty,
            rule.robot_uncertainty,
        )
        self._every_pair: BoolArray = np.zeros(0, dtype=np.bool_)

    def compile(self, state: TickState) -> None:
        """Run the kernel once, so that it is not compiled in a tick."""
        self.margin(state, 0.0)

    def margin(self, state: TickState, stop_time: float, watched: BoolArray | None = None) -> float:
        """Distance to spare before the rule says stop, in [m]; below 0 it does.

        Args:
            state: The tick's numbers.
            stop_time: Stop time from the tick, in [s]: the response time plus the time of braking.
            watched: Which pairs count, by obstacle row × links + link; those beyond its end do.
                None: all. Shape (n,).

        Returns:
            inf without pairs; -inf where an obstacle's whereabouts are unknown or a number is none.
            Obstacles for which the table had no room are not in it.
        """
        braking = stop_time - self.response_time
        if not stop_time < math.inf:
            return -math.inf
        least: float = _least_margin(
            state.handle,
            self._every_pair if watched is None else watched,
            _Terms(state.now, float(state.arm_age), max(braking, 0.0), *self._numbers),
        )
        return least


@kernel
def _find_direction(
    x: float, y: float, z: float, points: FloatArray, velocities: FloatArray, count: int
) -> tuple[float, float, float, float]:
    """Direction from a point to a hull, and a distance that the hull is surely away.

    No direction where the point may be inside.
    """
    dx, dy, dz = nearest_on_hull(x, y, z, points, velocities, count, 0.0)
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    nx, ny, nz = dx / length, dy / length, dz / length
    # However good the direction is, nothing of the hull is less far along it.
    least = math.inf
    for k in range(count):
        ax, ay, az = points[k, 0], points[k, 1], points[k, 2]
        along = nx * (ax - x) + ny * (ay - y) + nz * (az - z)
        along -= SUM_ROUNDING * (abs(ax) + abs(ay) + abs(az) + abs(x) + abs(y) + abs(z))
        if math.isnan(along):
            return nx, ny, nz, along
        least = min(least, along)
    if count < 1:
        least = math.nan
    elif least <= 0.0:
        nx = ny = nz = least = 0.0
    return nx, ny, nz, least


@kernel
def _fill_balls(tree: SphereTree, arm: ArmArrays, arm_age: float, balls: FloatArray) -> None:
    """Balls around the leaves of each link, then around all of them. Shape (L + 1, 6).

    Centre and radius, then the greatest speed that counts and the greatest error of any leaf.
    """
    count = tree.root.shape[0]
    balls[:] = 0.0
    for link in range(count):
        for axis in range(3):
            balls[link, axis] = arm.centers[tree.root[link], axis]
            balls[count, axis] += arm.centers[tree.root[link], axis] / count
    link = 0
    for i in range(tree.radius.shape[0]):
        if link + 1 < count and i == tree.root[link + 1]:
            link += 1
        if tree.first_child[i] >= 0:
            continue
        pace = length_above(arm.velocities[i, 0], arm.velocities[i, 1], arm.velocities[i, 2])
        top = top_speed(pace, arm.speed[i], arm.velocity_error[i])
        error = arm.position_error[i]
        error += displacement_at(pace, arm.velocity_error[i], arm.accel[i], top, abs(arm_age))
        fastest = pace + arm.velocity_error[i]
        if arm_age != 0.0:
            fastest += arm.accel[i] * abs(arm_age)
        fastest = min(fastest, top)
        for ball in (link, count):
            away = length_above(
                arm.centers[i, 0] - balls[ball, 0],
                arm.centers[i, 1] - balls[ball, 1],
                arm.centers[i, 2] - balls[ball, 2],
            )
            for column, value in ((3, away + tree.radius[i]), (4, fastest), (5, error)):
                # What is no number stays so.
                if value > balls[ball, column] or math.isnan(value):
                    balls[ball, column] = value


@kernel
def _bodies_margin(
    accepted: States,
    refused: States,
    marks: Marks,
    watched: BoolArray,
    tree: SphereTree,
    arm: ArmArrays,
    balls: FloatArray,
    terms: _Terms,
) -> float:
    """The least margin of all states of bodies that may be true; inf without any.

    -inf where anything is no number.
    """
    now, arm_age, braking, response, human_speed, own_speed, intrusion, _, _ = terms
    human_uncertainty, robot_uncertainty = terms.human_uncertainty, terms.robot_uncertainty
    best = math.inf
    count = tree.root.shape[0]
    for row in range(marks.alive.shape[0]):
        if not marks.alive[row]:
            continue
        for number in possible_states(marks, row):
            bodies, place, age = state_at(accepted, refused, marks, row, number, now)
            # What the body adds to the distance, whichever sphere of the arm it is near.
            points, velocities = bodies.points[place], bodies.velocities[place]
            corners, body_radius = bodies.point_count[place], bodies.radius[place]
            walks = 0.0
            offsets = human_uncertainty + robot_uncertainty + bodies.position_error[place]
            # Bodies that nobody has reported come out of an entrance, which has a speed.
            if number > 0 or not marks.static[row] or bodies.speed[place] > 0.0:
                error, pace = bodies.velocity_error[place], 0.0
                for k in range(corners):
                    pace = max(
                        pace, length_above(velocities[k, 0], velocities[k, 1], velocities[k, 2])
                    )
                top = top_speed(pace, bodies.speed[place], error)
                walks = top if own_speed else human_speed
                offsets += intrusion + displacement_at(
                    pace, error, bodies.accel[place], top, abs(age)
                )
            # Balls first, the whole arm's before those of its links: most need no sphere evaluated.
            for step in range(count + 1):
                ball = step - 1 if step > 0 else count
                pair = row * count + ball
                if ball < count and pair < watched.shape[0] and not watched[pair]:
                    continue
                _, _, _, room = _find_direction(
                    balls[ball, 0], balls[ball, 1], balls[ball, 2], points, velocities, corners
                )
                away = separation_of(
                    balls[ball, 4], response, braking, walks, offsets + balls[ball, 5]
                )
                if room - (balls[ball, 3] + body_radius + away) * (1.0 + SUM_ROUNDING) >= best:
                    # No leaf in this ball can be nearer than that.
                    if ball == count:
                        break
                    continue
                if ball == count:
                    continue
                # Then the leaves of a link that is near enough to matter.
                last = tree.root[ball + 1] if ball + 1 < count else tree.radius.shape[0]
                for i in range(tree.root[ball], last):
                    if tree.first_child[i] >= 0:
                        continue
                    nx, ny, nz, room = _find_direction(
                        arm.centers[i, 0], arm.centers[i, 1], arm.centers[i, 2],
                        points, velocities, corners,
                    )  # fmt: skip
                    ux, uy, uz = arm.velocities[i, 0], arm.velocities[i, 1], arm.velocities[i, 2]
                    speed = length_above(ux, uy, uz)
                    top = top_speed(speed, arm.speed[i], arm.velocity_error[i])
                    stale = displacement_at(
                        speed, arm.velocity_error[i], arm.accel[i], top, abs(arm_age)
                    )
                    # The sphere's speed towards the body, at its greatest since the stamp.
                    towards = nx * ux + ny * uy + nz * uz + SUM_ROUNDING * speed
                    if nx == 0.0 and ny == 0.0 and nz == 0.0:
                        towards = speed  # inside the body, every direction is towards it
                    towards += arm.velocity_error[i]
                    if arm_age != 0.0:
                        towards += arm.accel[i] * abs(arm_age)
                    if not math.isnan(towards):
                        towards = min(max(towards, 0.0), top)
                    away = separation_of(
                        towards, response, braking, walks, offsets + arm.position_error[i] + stale
                    )
                    margin = room - (tree.radius[i] + body_radius + away) * (1.0 + SUM_ROUNDING)
                    if not margin > -math.inf:
                        return -math.inf
                    best = min(best, margin)
    return best


@kernel
def _is_unknown(row: int, count: int, marks: Marks, watched: BoolArray) -> bool:
    """Whether an obstacle that counts, with any of so many links, could be anywhere."""
    if not marks.alive[row] or is_known(marks, row):
        return False
    for pair in range(row * count, (row + 1) * count):
        if pair >= watched.shape[0] or watched[pair]:
            return True
    return False


@kernel
def _least_margin(handle: Any, watched: BoolArray, terms: _Terms) -> float:
    """Least margin over all rows of the scene that the handle holds."""
    scene = handle.content
    tree, arm, marks = scene.tree, scene.arm, scene.marks
    count = tree.root.shape[0]
    for row in range(marks.alive.shape[0]):
        if _is_unknown(row, count, marks, watched):
            return -math.inf
    balls = np.empty((count + 1, 6))
    _fill_balls(tree, arm, terms.arm_age, balls)
    return _bodies_margin(scene.bodies, scene.refused, marks, watched, tree, arm, balls, terms)
