"""The exact check of flagged pairs: those that could come too near before their next visit.

It uses the link's true geometry instead of its spheres, and speed bounds only: coarser in time, but
a whole link costs one distance. The bound holds for every point of the link, also where a sphere's
centre stands still while the link turns inside it.

All flagged pairs are checked in every tick, most of them from afar: the ball around a link gives a
distance that is too small by a few centimetres, and a contact time that is good enough for a pair
that decides nothing. The hull is measured where that time is within the stopping time, and wherever
the pair might be the most imminent of all: so the earliest contact is that of the true geometry.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.isotropic import IsotropicMotion
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import pack
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import TERM_ROUNDING
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.obstacles.reference_states import expire, keep_reference_state
from armguard.obstacles.table import States
from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_gap import LinkHulls, hull_gap
from armguard.pairs.scene import DISTANCE, Scene


class FlaggedData(NamedTuple):
    """What the check knows of the links; fixed, or written in place."""

    hulls: LinkHulls
    surface_speed: FloatArray
    """Bound on the speed of any point of each link, [m/s]. Shape (links,)."""
    surface_position_error: FloatArray
    """What any point of each link may be off by, [m]. Shape (links,)."""


class KeptCertificates(NamedTuple):
    """What is kept of the certificates of all pairs, by pair."""

    expiry: FloatArray
    """When each ends, in [s] since the epoch."""
    ticks: IntArray
    """Tick of each pair's last evaluation."""
    bound: NDArray[np.int8]
    """What each rests on."""
    revision: IntArray
    """Of the state that each rests on."""
    proved: FloatArray
    """Room to work in: what is proved of each flagged pair in this tick, in [s] since the epoch.
    NaN everywhere, and so it is left."""


class CheckMoment(NamedTuple):
    """The tick in which flagged pairs are checked."""

    now: float
    """On the obstacles' clock, in [s]."""
    arm_age: float
    """Age of the joint state, in [s]."""
    time: float
    """In [s] since the monitor's epoch."""
    tick: int
    """Its number."""
    stop_time: float
    """In [s]; what could be touched within is measured exactly."""


class Body(NamedTuple):
    """One state of an obstacle, as far as distances from afar and closing speeds go."""

    x: float
    """Its first point, [m], world."""
    y: float
    z: float
    size: float
    """How far from there it extends, [m]."""
    speed: float
    """How fast it may be, [m/s]."""
    lost: float
    """How much nearer it may be by now, errors included, [m]."""


@merged_kernel
def _describe_body(bodies: States, place: int, age: float) -> Body:
    """One state of an obstacle, so many seconds old."""
    spread = fastest = 0.0
    for k in range(bodies.point_count[place]):
        away = square = 0.0
        for axis in range(3):
            away += (bodies.points[place, k, axis] - bodies.points[place, 0, axis]) ** 2
            square += bodies.velocities[place, k, axis] ** 2
        spread, fastest = max(spread, away), max(fastest, square)
    speed = max(bodies.speed[place], math.sqrt(fastest) + bodies.velocity_error[place])
    lost = bodies.position_error[place]
    if age != 0.0:
        lost += speed * abs(age)
    points = bodies.points
    return Body(
        points[place, 0, 0],
        points[place, 0, 1],
        points[place, 0, 2],
        math.sqrt(spread) + bodies.radius[place],
        speed,
        lost,
    )


@merged_kernel
def _ball_gap(scene: Scene, link: int, body: Body) -> float:
    """Distance in [m] from the ball around a link to an obstacle, at the least."""
    root = scene.tree.root[link]
    cx, cy, cz = (
        scene.arm.centers[root, 0],
        scene.arm.centers[root, 1],
        scene.arm.centers[root, 2],
    )
    x, y, z = body.x - cx, body.y - cy, body.z - cz
    away = math.sqrt(x * x + y * y + z * z)
    taken = body.size + scene.tree.radius[root]
    return away - taken - TERM_ROUNDING * (2.0 * (away + abs(cx) + abs(cy) + abs(cz)) + taken)


@merged_kernel
def _time_from_gap(
    scene: Scene, data: FlaggedData, link: int, body: Body, arm_age: float, distance: float
) -> float:
    """Time from now in [s] before which a distance in [m] cannot be closed."""
    arm_speed = data.surface_speed[link]
    errors = body.lost + data.surface_position_error[link] + arm_speed * abs(arm_age)
    gap = distance - scene.settings.margin - errors
    if not gap > 0.0:
        return 0.0
    closing = body.speed + arm_speed
    return gap / closing if closing > 0.0 else math.inf


@kernel
def _exact_time(
    scene: Scene, data: FlaggedData, row: int, link: int, now: float, arm_age: float
) -> float:
    """Contact time of a link's hull and an obstacle, over all states of it that may be true."""
    if not is_known(scene.marks, row):
        return 0.0
    soonest = math.inf
    for number in possible_states(scene.marks, row):
        bodies, place, age = state_at(scene.bodies, scene.refused, scene.marks, row, number, now)
        distance = hull_gap(
            data.hulls,
            link,
            scene.placement,
            bodies.points[place],
            bodies.point_count[place],
            bodies.radius[place],
        )
        body = _describe_body(bodies, place, age)
        soonest = min(soonest, _time_from_gap(scene, data, link, body, arm_age, distance))
    return soonest


@kernel
def _contact_time(
    handle: Any, data_handle: Any, row: int, link: int, now: float, arm_age: float
) -> float:
    return _exact_time(handle.content, data_handle.content, row, link, now, arm_age)


@merged_kernel
def _extend(
    scene: Scene,
    pair: int,
    links: int,
    end: float,
    kept: KeptCertificates,
    reference_states: Any,
) -> None:
    """Enter a proof that ends later than the certificate that a pair has."""
    kept.expiry[pair] = end
    kept.bound[pair] = DISTANCE
    row = pair // links
    # It rests on the present state, no longer on the one behind the last evaluation.
    if kept.revision[pair] != scene.marks.revision[row]:
        kept.revision[pair] = scene.marks.revision[row]
        keep_reference_state(scene.bodies, States(*reference_states), scene.marks, row, pair)


@kernel
def _check(
    handle: Any,
    data_handle: Any,
    flagged: IntArray,
    pairs: IntArray,
    links: int,
    moment: CheckMoment,
    kept: KeptCertificates,
    *reference_states: Any,
) -> int:
    """Extend the certificates of flagged pairs by distance over closing speed.

    Args:
        handle: On the `Scene`.
        data_handle: On `FlaggedData`.
        flagged: Pairs that are flagged, row × links + link. Shape (f,).
        pairs: All pairs, ascending: obstacle by obstacle. Shape (m,).
        links: How many links there are.
        moment: The tick.
        kept: What is kept of all pairs; written.
        reference_states: States that certificates rest on; written.

    Returns:
        How many pairs were measured exactly.
    """
    scene, data = handle.content, data_handle.content
    marks = scene.marks
    now, arm_age, time, tick, stop_time = moment
    expiry, ticks, proved = kept.expiry, kept.ticks, kept.proved
    if flagged.shape[0] == 0:
        return 0
    for pair in flagged:
        ticks[pair] = tick
        proved[pair] = 0.0
    # From afar: what each pair's own certificate and the ball around its link prove. Obstacle by
    # obstacle, in the order of memory; pairs that are not flagged have no number there.
    body = Body(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    last, is_believed = -1, False
    first = -1
    for pair in pairs:
        if math.isnan(proved[pair]):
            continue
        row, link = pair // links, pair % links
        if row != last:
            last = row
            is_believed = is_known(marks, row) and not marks.refused[row]
            if is_believed:
                age = 0.0 if marks.static[row] else now - scene.bodies.stamp[row]
                body = _describe_body(scene.bodies, row, age)
        end = expiry[pair]
        if is_believed:
            distance = _ball_gap(scene, link, body)
            found = _time_from_gap(scene, data, link, body, arm_age, distance)
            end = max(end, expire(time, found))
        proved[pair] = end
        if first < 0 or not end >= proved[first]:
            first = pair
    if first < 0:
        return 0
    # From near: the most imminent of them, then all that could still be sooner or stop the arm.
    exact = expire(time, _exact_time(scene, data, first // links, first % links, now, arm_age))
    proved[first] = max(proved[first], exact)
    earliest = proved[first]
    latest = time + stop_time
    measured = 1
    for pair in pairs:
        if math.isnan(proved[pair]):
            continue
        if pair != first and not (proved[pair] > latest and proved[pair] >= earliest):
            exact = expire(
                time, _exact_time(scene, data, pair // links, pair % links, now, arm_age)
            )
            measured += 1
            proved[pair] = max(proved[pair], exact)
            earliest = min(earliest, proved[pair])
        # A certificate that decides nothing is as good as a later one.
        if proved[pair] > expiry[pair] and not expiry[pair] > max(earliest, latest):
            _extend(scene, pair, links, proved[pair], kept, reference_states)
        proved[pair] = math.nan
    return measured


class FlaggedCheck:
    """Contact times of pairs from true distance and fastest closing speed.

    Args:
        hulls: Of the links.
        motion: Whose bounds on the links' surfaces are read.
        state: The tick's numbers.

    Attributes:
        state: The tick's numbers.
    """

    def __init__(self, hulls: LinkHulls, motion: IsotropicMotion, state: TickState) -> None:
        data = FlaggedData(hulls, motion.surface_speed, motion.surface_position_error)
        self._data = pack(data)
        self.state = state

    def contact_time(self, row: int, link: int) -> float:
        """Time from now in [s] before which there is no contact; 0 where that is unknown.

        Args:
            row: Of the obstacle in its table.
            link: Index in `robot.links`.
        """
        state = self.state
        found: float = _contact_time(
            state.handle, self._data, row, link, state.now, float(state.arm_age)
        )
        return found

    def extend(
        self,
        flagged: IntArray,
        pairs: IntArray,
        links: int,
        now: float,
        tick: int,
        stop_time: float,
        kept: KeptCertificates,
        reference_states: States,
    ) -> int:
        """Check flagged pairs; see `_check`.

        Args:
            flagged: Pairs that are flagged. Shape (f,).
            pairs: All pairs, ascending. Shape (m,).
            links: How many links there are.
            now: In [s] since the epoch.
            tick: Number of the present tick.
            stop_time: In [s]; what could be touched within is measured exactly.
            kept: What is kept of all pairs; written.
            reference_states: States that certificates rest on; written.

        Returns:
            How many pairs were measured exactly.
        """
        state = self.state
        moment = CheckMoment(state.now, float(state.arm_age), now, tick, stop_time)
        measured: int = _check(
            state.handle, self._data, flagged, pairs, links, moment, kept, *reference_states
        )
        return measured
