"""Smooth joint trajectories through waypoints: a quintic from rest to rest for each segment.

A quintic has closed-form maxima, so that each segment is given the shortest duration that keeps
every joint within its limits, exactly, and no search or sampling is needed. All joints of a
segment share one time law: the path between waypoints is straight in joint space and never leaves
the box that they span.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Iterable

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.robot.robot import Robot

Array = NDArray[np.float64]

PEAK_SPEED = 15.0 / 8.0
"""Largest slope of the blend 10 u³ - 15 u⁴ + 6 u⁵ on [0, 1], at u = 1/2."""

PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""Largest curvature of the blend on [0, 1], at u = 1/2 ± 1/√12."""

RANDOM_MARGIN = 0.05
"""Share of a joint's range that random waypoints keep away from either limit."""

_STRETCH = 1.0 + 1e-9
"""Durations are longer by this much, so that rounding cannot break a limit."""

_ATTEMPTS = 1000
"""Random waypoints from one start, which may be a dead end."""
_STARTS = 10
_CHECKS_PER_SEGMENT = 12


class JointTrajectory:
    """A way through joint waypoints, resting at each, within stated fractions of the limits.

    Speeds stay within `speed_fraction` of the velocity limits, accelerations within
    `acceleration_fraction` of the lesser of the acceleration limit and the guaranteed braking
    deceleration. The latter has a use: a joint that brakes at its guaranteed deceleration, from
    anywhere on a segment, rests before it passes the waypoint ahead
    (v² / 2b <= distance to it, since p'² / (2 (1 - p)) < 10/√3 for the blend p).

    Args:
        robot: The arm whose limits apply.
        waypoints: Joint positions, within the position limits, in [rad] or [m]. Shape (n, nv).
        speed_fraction: In (0, 1].
        acceleration_fraction: In (0, 1].
        loop: Whether it returns to the first waypoint and starts again; else it holds at its end.

    Attributes:
        waypoints: As given, the first one repeated at the end of a loop. Shape (m, nv).
        stops: Times at which the waypoints are reached, in [s]. Shape (m,).
        duration: Of one pass, in [s].
        loop: As given.

    Raises:
        ArmguardError: A waypoint or a fraction is out of bounds.
    """

    def __init__(
        self,
        robot: Robot,
        waypoints: ArrayLike,
        *,
        speed_fraction: float = 0.3,
        acceleration_fraction: float = 0.5,
        loop: bool = False,
    ) -> None:
        speed_fraction = _check_fraction("speed_fraction", speed_fraction)
        acceleration_fraction = _check_fraction("acceleration_fraction", acceleration_fraction)
        points = _check_waypoints(robot, waypoints)
        if loop:
            points = np.concatenate([points, points[:1]])
        self.robot = robot
        self.waypoints = points
        self.loop = loop
        self.speed_fraction = speed_fraction
        self.acceleration_fraction = acceleration_fraction
        self._moves = np.diff(points, axis=0)
        self._durations = _compute_durations(
            self._moves,
            speed_fraction * robot.velocity_limit,
            acceleration_fraction
            * np.minimum(
                robot.acceleration_limit, robot.brakes.gentlest_stop(np.zeros(len(robot.joints)))
            ),
        )
        self.stops: Array = np.concatenate([[0.0], np.cumsum(self._durations)])
        self.duration = float(self.stops[-1])

    def sample(self, time: float) -> tuple[Array, Array]:
        """The state at a time.

        Args:
            time: In [s] from the start; the first waypoint before 0.

        Returns:
            Positions in [rad] or [m] and their derivatives with respect to time. Shapes (nv,).
        """
        time, segment = self._locate(time)
        if segment == len(self._moves):
            return self.waypoints[-1].copy(), np.zeros(self.waypoints.shape[1])
        duration = self._durations[segment]
        u = min(max((time - self.stops[segment]) / duration, 0.0), 1.0)
        blend = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        slope = 30.0 * u * u * (1.0 - u) ** 2
        move = self._moves[segment]
        return self.waypoints[segment] + blend * move, (slope / duration) * move

    def next_stop(self, time: float) -> tuple[float, Array]:
        """When it next rests at a waypoint, in [s] modulo the loop, and there. Shape (nv,)."""
        _, segment = self._locate(time)
        stop = min(segment + 1, len(self._moves))
        return float(self.stops[stop]), self.waypoints[stop].copy()

    def _locate(self, time: float) -> tuple[float, int]:
        """Time within one pass, and its segment; as many as there are segments once it holds."""
        if not math.isfinite(time):
            raise ArmguardError("trajectory time", f"{time} is not finite")
        if self.loop and time > 0.0 and self.duration > 0.0:
            time = math.fmod(time, self.duration)
        return time, int(np.searchsorted(self.stops[1:], max(time, 0.0), side="right"))


def random_trajectory(
    robot: Robot,
    seed: int,
    duration: float,
    *,
    speed_fraction: float = 0.3,
    acceleration_fraction: float = 0.5,
    accept: Callable[[Array], bool] | None = None,
) -> JointTrajectory:
    """A looping trajectory through random waypoints within the position limits.

    Args:
        robot: The arm.
        seed: The same seed gives the same trajectory.
        duration: The loop lasts at least this long, in [s].
        speed_fraction: As for `JointTrajectory`.
        acceleration_fraction: As for `JointTrajectory`.
        accept: Whether a configuration, shape (nv,), is wanted; asked at waypoints and at points
            between them. None: all are.

    Raises:
        ArmguardError: `accept` refuses nearly everything, or an argument is out of bounds.
    """
    if not (0.0 < duration < math.inf):
        raise ArmguardError("duration", f"is {duration}", expected="a positive time in [s]")
    random = np.random.default_rng(seed)
    lower, upper = _random_range(robot)
    waypoints: list[Array] = []
    for attempt in range(_STARTS * _ATTEMPTS):
        if attempt % _ATTEMPTS == 0:
            waypoints.clear()
        candidate = random.uniform(lower, upper)
        if accept is not None and not _accepts_way(accept, [*waypoints[-1:], candidate]):
            continue
        waypoints.append(candidate)
        if len(waypoints) < 2 or (
            accept is not None and not _accepts_way(accept, [candidate, waypoints[0]])
        ):
            continue
        trajectory = JointTrajectory(
            robot,
            waypoints,
            speed_fraction=speed_fraction,
            acceleration_fraction=acceleration_fraction,
            loop=True,
        )
        if trajectory.duration >= duration:
            return trajectory
    raise ArmguardError(
        "random trajectory",
        f"{_STARTS} times {_ATTEMPTS} random waypoints did not make one of {duration} s",
        remedy="shorten it, or accept more configurations",
    )


def keeps_within(robot: Robot, lower: ArrayLike, upper: ArrayLike) -> Callable[[Array], bool]:
    """A test for `random_trajectory`: every part of every moving link is inside a box.

    Args:
        robot: The arm.
        lower: Corner of the box in the frame of the arm's base, in [m]; -inf is allowed.
            Shape (3,).
        upper: The opposite corner; inf is allowed. Shape (3,).
    """
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    if not (low.shape == high.shape == (3,) and (low < high).all()):
        raise ArmguardError("box", f"from {low} to {high}", expected="two corners (x, y, z)")
    data = robot.model.createData()
    hulls = [(robot.joint_index(link), robot.hull(link)) for link in robot.links]

    def accept(q: Array) -> bool:
        pinocchio.forwardKinematics(robot.model, data, q)
        for joint, vertices in hulls:
            placement = data.oMi[joint]
            points = vertices @ placement.rotation.T + placement.translation
            if not ((points >= low).all() and (points <= high).all()):
                return False
        return True

    return accept


def plan_work(
    robot: Robot,
    seed: int,
    duration: float,
    boxes: Iterable[tuple[ArrayLike, ArrayLike]],
    *,
    speed_fraction: float,
    acceleration_fraction: float,
) -> JointTrajectory:
    """A random trajectory within the first box that the arm can work in; anywhere if in none.

    Args:
        robot: The arm.
        seed: The same seed gives the same trajectory.
        duration: The loop lasts at least this long, in [s].
        boxes: Two corners each, as for `keeps_within`.
        speed_fraction: As for `JointTrajectory`.
        acceleration_fraction: As for `JointTrajectory`.
    """
    plan = functools.partial(
        random_trajectory,
        robot,
        seed,
        duration,
        speed_fraction=speed_fraction,
        acceleration_fraction=acceleration_fraction,
    )
    for box in boxes:
        with contextlib.suppress(ArmguardError):
            return plan(accept=keeps_within(robot, *box))
    return plan()


def _accepts_way(accept: Callable[[Array], bool], ends: list[Array]) -> bool:
    steps = np.linspace(0.0, 1.0, _CHECKS_PER_SEGMENT)
    return all(accept(ends[0] + step * (ends[-1] - ends[0])) for step in steps)


def _random_range(robot: Robot) -> tuple[Array, Array]:
    """Position limits less a margin; one turn for a continuous joint. Shapes (nv,)."""
    lower = np.where(np.isfinite(robot.lower_position_limit), robot.lower_position_limit, -np.pi)
    upper = np.where(np.isfinite(robot.upper_position_limit), robot.upper_position_limit, np.pi)
    margin = RANDOM_MARGIN * (upper - lower)
    return lower + margin, upper - margin


def _compute_durations(moves: Array, speed: Array, acceleration: Array) -> Array:
    """Shortest time of each segment, in [s]; 0 where nothing moves. Shape (segments,)."""
    distance = np.abs(moves)
    for_speed = PEAK_SPEED * distance / speed
    for_acceleration = np.sqrt(PEAK_ACCELERATION * distance / acceleration)
    shortest: Array = _STRETCH * np.maximum(for_speed, for_acceleration).max(axis=1)
    return shortest


def _check_fraction(name: str, value: float) -> float:
    if not (0.0 < value <= 1.0):
        raise ArmguardError(name, f"is {value}", expected="a fraction in (0, 1]")
    return value


def _check_waypoints(robot: Robot, waypoints: ArrayLike) -> Array:
    points = np.array(waypoints, dtype=np.float64)
    width = len(robot.velocity_limit)
    if points.ndim != 2 or points.shape[1] != width or len(points) == 0:
        raise ArmguardError(
            "waypoints", f"have the shape {points.shape}", expected=f"(n, {width}), n > 0"
        )
    within = (points >= robot.lower_position_limit) & (points <= robot.upper_position_limit)
    bad = np.argwhere(~(within & np.isfinite(points)))
    if len(bad):
        row, joint = (int(index) for index in bad[0])
        raise ArmguardError(
            f"waypoint {row}",
            f"puts joint {joint} at {points[row, joint]:g}",
            expected=f"{robot.lower_position_limit[joint]:g} to "
            f"{robot.upper_position_limit[joint]:g}",
        )
    return points
