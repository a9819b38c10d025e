"""Another arm as obstacles: converts its joint states to moving balls with bounds.

Two arms in one cell have a monitor each, and each is the other's obstacle. Each monitor assumes
only limits of the other arm's joints, and plans that its controller has shared. It does not use the
other monitor's verdicts, so that its certificates hold even if the other monitor fails.

Every leaf of a link's cover, cut to a coarse level, is an obstacle: a ball whose centre p(q) is
known from the joint state, and whose bounds are those of its own link. With R_j the reach of the
centre about joint j (`bounds.levers`), R(i, j) that about the more distal of two joints, and dq, dv
the errors of the joint state:

- position error: sum_j R_j dq_j, and what the arm's placement is off by;
- speed: V = sum_j R_j vmax_j;
- by the robot's limits, the velocity is J(q) v, up to the sum over joints that
  `velocity_error_terms` has, and the acceleration at most
  A = sum_j R_j amax_j + sum_ij R(i, j) vmax_i vmax_j.

Operating limits (v°, a°) say more. A joint speeds up by a° at most, but brakes as hard as it can,
so a bound on the ball's acceleration would have to count with amax. A bound on its velocity
need not. At a time t after the state the joint's velocity is between min(0, v) - dv - a° t and
max(0, v) + dv + a° t, that is, v/2 up to |v|/2 + dv + a° t. The Jacobian's columns have changed by
no more than sum_i R(i, j) (dq_i + v°_i t), and are no longer than R_j. So, along every direction m,

    m·(dp/dt) <= m·J(q) v/2 + sum_j R_j (|v_j|/2 + dv_j)
                 + sum_ij R(i, j) dq_i (|v_j| + dv_j + a°_j t)
                 + t (sum_j R_j a°_j + sum_ij R(i, j) v°_i v°_j).

This is the law of a body with half the measured velocity, an error that contains the other half,
and an acceleration in which amax does not occur. Integrated, and cut off at V, it is the
displacement that every contact time in armguard rests on, so a braking arm keeps to it however hard
it brakes. It looks forward only: it says nothing of the time before the state, so a state must not
be stamped later than the monitor's clock.

Operating limits are a premise here as elsewhere, and every state is tested against them and all
states before it, as those of the watched arm are (`bounds.operating_history`). A break is a fault
of the arm's source, so a STOP, and from then on the robot's limits count, until all states of
`SUSPENDED_FOR` have kept to the operating limits again; plans shared before it count no more.
It is found late: a joint faster than v° with the first state that shows it by more than dv; one
that speeds up by A > a° when it is faster than it could be by 2 dv, after 2 dv / (A - a°), or 4 dv
/ (A - a°) where the error goes from one end to the other meanwhile. Until then the balls may leave
what their rows allow. The table would not find it: with errors of |v|/2 hardly a sample contradicts
the one before.

A plan that the arm has shared says more still, as long as it is promised: the velocity of a joint
either way is at most max(0, ±v) + dv + l + b t at every t, with b <= a° (`pairs.shared_plan`). The
law above needs no more of a° than that, so it holds with b in its place, and with l added to dv.
A state that is faster than the plan allows is a break like any other.

Links that nothing moves (the base) stand still: `add_fixed` puts the box around each
into the table. It is not counted on that the arm's monitor would stop it.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from typing import NamedTuple

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from armguard.bounds.operating_history import OperatingHistory
from armguard.bounds.planned.plan import Plan
from armguard.bounds.sums import (
    compute_levers,
    sum_accelerations,
    sum_levers,
    velocity_error_terms,
    widened_ranges,
)
from armguard.exceptions import ArmguardError, ObstacleError
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.broken_bounds import MAXIMUM_ACCEL, MAXIMUM_SPEED
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.shared_plan import SharedPlan, read_shared_plan
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits, read_operating
from armguard.robot.robot import Robot
from armguard.robot.wrap_angle import find_continuous

LEVEL = 1
"""Of the cover, as far as it is used: some four balls a link."""

SUSPENDED_FOR = 2.0
"""How long the robot's limits count after a joint broke its operating limits, in [s]."""

_TIMES: FloatArray = np.array([0.2, 0.3, 0.5, 1e9])
"""By which a ball is taken to be at its bound on speed, in [s]; the best counts."""

_TIMES_AND_HALVES: FloatArray = np.concatenate([_TIMES, 0.5 * _TIMES])

_PLANS = 2
"""Shared plans that count at once; of more, the first are forgotten. Each costs time to test."""


class _Bounds(NamedTuple):
    """What the balls of an arm can do, one value a ball; the limits that they rest on are named."""

    share: float
    """Of the measured velocity that is stated."""
    rate: FloatArray
    """What velocity errors grow by with joint speeds, [m] or 1. Shape (n, nv)."""
    at_rest: FloatArray
    """Velocity errors at rest, [m/s]. Shape (n,)."""
    accel: FloatArray
    """[m/s²]. Shape (n,)."""
    speed: FloatArray
    """[m/s]. Shape (n,)."""


class _Terms(NamedTuple):
    """What bounds of an arm's balls are made of that no state changes."""

    rate: FloatArray
    """What velocity errors grow by with joint speeds, [m] or 1. Shape (n, nv)."""
    at_rest: FloatArray
    """Velocity errors at rest, [m/s]. Shape (n,)."""
    reaching: FloatArray
    """Levers, with what the Jacobian's columns are off by, [m] or 1. Shape (n, nv)."""
    turning: FloatArray
    """Levers about the more distal of two joints, R(i, j), [m] or 1. Shape (n, nv, nv)."""
    speed: FloatArray
    """[m/s]. Shape (n,)."""
    velocity: FloatArray
    """Operating velocities of joints, in [rad]/[s] or [m]/[s]. Shape (nv, 1)."""


class ArmObstacles:
    """The links of an arm as obstacles of another arm.

    It must be used in the thread of the monitor whose table it writes. Make one for each arm that
    is watched against this one.

    Attributes:
        robot: The arm.
        name: Name of the arm in its cell, and of the source of its obstacles.
        ids: Ids of its obstacles: name of the arm, link, and number of the ball.
        radius: Radii of its balls, in [m]. Shape (n,).
    """

    def __init__(
        self,
        robot: Robot,
        name: str | None = None,
        *,
        base_placement: pinocchio.SE3 | None = None,
        placement_error: float = 0.0,
        operating: OperatingLimits | str | None = None,
        level: int = LEVEL,
    ) -> None:
        """Compute bounds of the arm's links; takes some tens of milliseconds.

        Bodies attached to the robot later are included with its next state.

        Args:
            robot: The arm.
            name: Name of the arm, unique in its cell; None: the robot's name.
            base_placement: Placement of its base in the world; None: they coincide.
            placement_error: Greatest error of any of its points relative to the other arm, because
                of errors in the placements of both bases, in [m].
            operating: Operating limits that its controller enforces; "published": those of its
                description; None: only the robot's limits count.
            level: Finest level of the cover to use, from 0, one ball per link. Finer levels have
                smaller balls, and need more time.

        Raises:
            ArmguardError: An argument is malformed, or the operating limits do not fit the robot.
        """
        name = robot.name if name is None else name
        if not isinstance(name, str) or not name:
            raise ArmguardError("name of an arm", f"is {name!r}", expected="a name")
        if not 0.0 <= placement_error < math.inf:
            raise ArmguardError(
                "placement_error",
                f"is {placement_error!r}",
                expected="a finite length, at least 0, in [m]",
            )
        self.robot, self.name = robot, name
        self._base, self._placement_error = base_placement, float(placement_error)
        limits = read_operating(robot, operating)
        self._operating = None if limits is None else limits.resolve(robot)
        self._history: OperatingHistory | None = None
        if limits is not None:
            in_force = LimitsInForce(robot, limits)
            self._history = OperatingHistory(robot, in_force, SUSPENDED_FOR)
        self._level = level
        self._plans: deque[SharedPlan] = deque(maxlen=_PLANS)
        self._last_stamp = self._suspended_until = -math.inf
        self._has_published = False
        self._is_changed = False
        self._read_links()
        self._compile()

    def _read_links(self) -> None:
        """Take the links that the robot has now, and bound what their balls can do."""
        robot = copy.copy(self.robot)
        deepest = max(robot.cover.levels(link) for link in robot.links) - 1
        level = self._level
        if isinstance(level, bool) or not isinstance(level, int) or not level >= 0:
            raise ArmguardError("level", f"is {level!r}", expected="a level of the cover, from 0")
        robot.cover = robot.cover.cut(min(level, deepest))
        self._revision = robot.revision
        self._kinematics = Kinematics(robot, self._base)
        spheres = self._kinematics.spheres
        self._leaf = np.flatnonzero(spheres.child_count == 0)
        link_of = spheres.link[self._leaf]
        self.ids = [
            f"{self.name} {link} {number}"
            for place, link in enumerate(robot.links)
            for number in range(int(np.count_nonzero(link_of == place)))
        ]
        self.radius: FloatArray = spheres.radius[self._leaf]
        lever = np.concatenate(
            [
                compute_levers(robot, link, spheres.local[self._leaf][link_of == place])
                for place, link in enumerate(robot.links)
            ]
        )
        self._position_error = sum_levers(lever, robot.position_error) + self._placement_error
        self._position_error *= 1.0 + SUM_ROUNDING
        self._limits = widened_ranges(robot)
        self._fastest = robot.velocity_limit + robot.velocity_error
        velocity, acceleration = self._speeding
        self._hardware = _bound_by_hardware(
            robot, lever, robot.velocity_limit, robot.acceleration_limit
        )
        self._terms = _find_terms(robot, lever, velocity)
        if (acceleration < robot.acceleration_limit).any():
            # By the greatest speeds that there are: it does not depend on the state.
            still = np.zeros_like(velocity)
            self._usual = _bound_by_operating(self._terms, velocity, acceleration, still)
        else:
            self._usual = _bound_by_hardware(robot, lever, velocity, acceleration)

    @property
    def _speeding(self) -> tuple[FloatArray, FloatArray]:
        """Velocities that joints keep to, and accelerations with which they speed up. (nv,)."""
        if self._operating is not None:
            return self._operating
        return self.robot.velocity_limit, self.robot.acceleration_limit

    def _compile(self) -> None:
        """Tell a table of no one's a state, so that the first one in a loop takes no longer."""
        joints = len(self._fastest)
        middle = np.clip(0.0, self._limits[:, 0], self._limits[:, 1])
        self.publish(Obstacles(sources=[self.name]), 0.0, middle, np.zeros(joints))
        self._has_published = False
        self._last_stamp = self._suspended_until = -math.inf
        if self._history is not None:
            self._history.reset()

    def add_fixed(self, obstacles: Obstacles) -> None:
        """Add the fixed links of the arm, such as its base, to a table as statics.

        Each link becomes the box around it, along the axes of the arm's base. The robot's
        `fixed_points` lists these links. A link without collision geometry is not among them: add
        it with `add_static`.

        Args:
            obstacles: The table of another arm's monitor.

        Raises:
            ObstacleError: An id is in use: it was added before, or two arms have the same name.
        """
        base = pinocchio.SE3.Identity() if self._base is None else self._base
        for link, points in self.robot.fixed_points().items():
            low, high = points.min(axis=0), points.max(axis=0)
            corners = np.array([np.where(_CORNERS[k], high, low) for k in range(8)])
            corners = corners @ base.rotation.T + base.translation
            obstacles.add_static(f"{self.name} {link}", corners, self._placement_error)

    def take_plan(self, plan: Plan, until: float, clock_error: float = 0.0) -> None:
        """Use a plan that the arm's controller has shared, for tighter bounds on the arm.

        Premise: from the plan's stamp to `until`, the arm only follows the plan, on time or slower,
        or stops, at any moment and in any way. This cannot be revoked. A new plan can be shared
        meanwhile, but may deviate only after `until`. After that, and without a plan, only joint
        limits count. A joint state that is faster than the plan allows is a violation, and ends the
        use of all shared plans.

        Args:
            plan: In the order of `robot.joints`, with a `velocity_tracking_error`; it ends at rest,
                or not before `until`.
            until: End of this premise, in [s] on the clock of the joint states.
            clock_error: Greatest error of that clock relative to the monitor's, either way, in [s].

        Raises:
            ArmguardError: The plan cannot be used; earlier plans still count.
        """
        robot = self.robot
        continuous = find_continuous(robot.lower_position_limit, robot.upper_position_limit)
        turning = np.where(continuous, self._fastest, np.inf)
        self._plans.append(read_shared_plan(plan, until, turning, clock_error))

    def publish(self, obstacles: Obstacles, stamp: float, q: ArrayLike, v: ArrayLike) -> None:
        """Update a table with the arm's state; the arm's name becomes a required source.

        An impossible state (a value that is not finite, a joint beyond its limits and errors) does
        not raise: the table refuses its balls, and the level is STOP. A state that breaks operating
        limits is accepted, and gives a STOP that names the joint.

        Args:
            obstacles: The table of another arm's monitor, always the same.
            stamp: Time of measurement, in [s]; not after the monitor's next step.
            q: Joint positions in the order of `robot.joints`, in [rad] or [m]. Shape (nv,).
            v: Their velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).

        Raises:
            ObstacleError: The state does not have one value per joint, or another source has this
                name; a fault is left, as for every malformed call.
        """
        if not self._has_published:
            self._take_name(obstacles, stamp)
        if self.robot.revision != self._revision:
            self._read_links()
            self._is_changed = True
        count = len(self._fastest)
        try:
            position, velocity = np.array(q, dtype=np.float64), np.array(v, dtype=np.float64)
        except (TypeError, ValueError):
            position = velocity = np.zeros(0)
        if position.shape != (count,) or velocity.shape != (count,):
            problem = f"is q = {q!r}, v = {v!r}"
            obstacles.leave_malformed(self.name, "joint state", problem, stamp)
            raise ObstacleError(
                f"joint state of arm {self.name!r}", problem, expected=f"{count} values each"
            )
        if not self._is_possible(position, np.abs(velocity)):
            # Then its balls are nowhere, and the table refuses them.
            position[:] = velocity[:] = math.nan
        elif stamp >= self._last_stamp:
            self._last_stamp = stamp
            self._test(obstacles, stamp, position, velocity)
        kinematics, speeds = self._kinematics, np.abs(velocity)
        kinematics.compute(position, velocity)
        bounds = self._find_bounds(stamp, velocity)
        obstacles.update(
            self.ids,
            stamp,
            kinematics.centers[self._leaf],
            bounds.share * kinematics.velocities[self._leaf],
            self.radius,
            bounds.accel,
            bounds.speed,
            self._position_error,
            (bounds.rate @ speeds + bounds.at_rest) * (1.0 + SUM_ROUNDING),
            source=self.name,
            snapshot=self._is_changed,
            region="",
        )
        self._is_changed = False

    def _find_bounds(self, stamp: float, velocity: FloatArray) -> _Bounds:
        """What the balls can do from a state on."""
        if not stamp > self._suspended_until:
            return self._hardware
        promised = [plan for plan in self._plans if plan.start <= stamp < plan.until]
        if not promised:
            return self._usual
        plan = max(promised, key=lambda one: one.until)
        fastest = np.maximum(np.stack([velocity, -velocity]), 0.0) + self.robot.velocity_error
        lift, slope = plan.narrow(stamp, fastest, *self._speeding)
        return _bound_by_operating(self._terms, fastest.max(axis=0), slope, lift)

    def _test(
        self, obstacles: Obstacles, stamp: float, position: FloatArray, velocity: FloatArray
    ) -> None:
        """Put the hardware's limits in force and leave a fault after a violation."""
        history = self._history
        if history is not None and not history.accept(stamp, position, velocity):
            joint, detail = history.describe_break(velocity)
            self._tell_break(obstacles, stamp, joint, f"breaks its operating limits: {detail}")
        while self._plans and self._plans[0].until < stamp:
            self._plans.popleft()
        for plan in self._plans:
            if not plan.start <= stamp <= plan.until:
                continue
            excess = plan.find_excess(stamp, velocity, self.robot.velocity_error)
            j = int(np.argmax(excess))
            if not excess[j] <= 0.0:
                self._tell_break(
                    obstacles,
                    stamp,
                    self.robot.joints[j],
                    f"leaves the plan that was shared: at {velocity[j]:.4g} it is faster than that "
                    f"allows by {excess[j]:.2g}, in rad/s or m/s",
                )
                break

    def _tell_break(self, obstacles: Obstacles, stamp: float, joint: str, detail: str) -> None:
        """Use no operating limits and plans for a while, and leave a fault that says why."""
        self._suspended_until = max(self._suspended_until, stamp + SUSPENDED_FOR)
        self._plans.clear()
        obstacles.leave_broken(self.name, joint, detail, stamp)

    def _is_possible(self, q: FloatArray, speeds: FloatArray) -> bool:
        """Whether joints can be in such a state; what is not finite cannot."""
        is_inside: BoolArray = (q >= self._limits[:, 0]) & (q <= self._limits[:, 1])
        return bool((is_inside & (speeds <= self._fastest)).all())

    def _take_name(self, obstacles: Obstacles, stamp: float) -> None:
        """Refuse a name that another source of the table has."""
        for name, messages, _, _ in obstacles.heard_sources:
            if name == self.name and messages:
                problem = "has the name of a source that has spoken already"
                obstacles.leave_malformed(name, "name", problem, stamp)
                raise ObstacleError(f"arm {name!r}", problem, expected="a name of its own")
        self._has_published = True


_CORNERS = np.array([[bool(k & 1), bool(k & 2), bool(k & 4)] for k in range(8)])


def _bound_by_hardware(
    robot: Robot, lever: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> _Bounds:
    """What balls do whose joints keep to a velocity, and to an acceleration in all they do."""
    return _Bounds(
        1.0,
        *velocity_error_terms(lever, robot.position_error, robot.velocity_error),
        _bounded(sum_accelerations(lever, velocity, acceleration), MAXIMUM_ACCEL),
        _bounded(sum_levers(lever, velocity), MAXIMUM_SPEED),
    )


def _find_terms(robot: Robot, lever: FloatArray, velocity: FloatArray) -> _Terms:
    """What bounds are made of where joints speed up less hard than they brake."""
    rate, at_rest = velocity_error_terms(lever, robot.position_error, robot.velocity_error)
    joints = np.arange(lever.shape[1])
    both = (lever > 0.0)[:, :, None] & (lever > 0.0)[:, None, :]
    return _Terms(
        (rate + 0.5 * lever) * (1.0 + SUM_ROUNDING),
        at_rest,
        lever + rate,
        np.where(both, lever[:, np.maximum.outer(joints, joints)], 0.0),
        _bounded(sum_levers(lever, velocity), MAXIMUM_SPEED),
        velocity[:, None],
    )


def _bound_by_operating(
    terms: _Terms, fastest: FloatArray, slope: FloatArray, lift: FloatArray
) -> _Bounds:
    """What balls do whose joints speed up by so much at most, and brake as hard as they can.

    Args:
        terms: Of the balls.
        fastest: Greatest true speeds that the state allows, either way. Shape (nv,).
        slope: How much faster joints get a second, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        lift: What they may be faster by at once, beside the velocity error. Shape (nv,).
    """
    rate, at_rest, reaching, turning, speed, velocity = terms
    error = (at_rest + reaching @ lift) * (1.0 + SUM_ROUNDING)
    # For each time: joints' greatest speeds at it, and greatest mean speeds until it.
    top = np.minimum(velocity, (fastest + lift)[:, None] + slope[:, None] * _TIMES_AND_HALVES)
    at, until = top[:, : len(_TIMES)], top[:, len(_TIMES) :]
    accel = ((turning @ at) * until).sum(axis=1) + (reaching @ slope)[:, None]
    accel = np.maximum(accel, (speed - error)[:, None] / _TIMES).min(axis=1)
    return _Bounds(0.5, rate, error, _bounded(accel * (1.0 + SUM_ROUNDING), MAXIMUM_ACCEL), speed)


def _bounded(bound: FloatArray, most: float) -> FloatArray:
    """Bounds that a table takes: beyond the largest, there is none."""
    return np.where(bound <= most, bound, np.inf)
