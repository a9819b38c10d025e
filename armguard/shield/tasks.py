"""Tasks of a shield: follow paths, keep velocities, or follow the points of a policy.

A task offers motions, the best first. Each motion continues the task for a while, and then stops.
The first motion continues for `look_ahead`. If it is refused, there is still time to slow down
gently, as the other motions do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol, TypeVar

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import LIMIT_SLACK
from armguard.shield.changes import JointChanges, MotionError, PaceChanges
from armguard.shield.motion import AlongPath, JointByJoint, Motion, Phase
from armguard.shield.path import SAME_PLACE, MotionLimits, Path, TimedPath

HOLD_SHARE = 0.5
"""Of the time to look ahead, for a motion that keeps its pace."""

GENTLE = 0.6
"""To this share of its pace a motion slows down where no more is proved."""

CREEPING = 0.02
"""A slower pace than this is not kept up, but stopped."""

FAR = 4.0
"""How many times farther ahead is looked where there are several paths to choose from."""

FARTHEST_BACK = 10.0
"""From no farther off its path, in [rad] and [m], an arm is led back to it."""

PASSED = 1.0
"""How far ahead on its path an arm may have come to rest that left it to brake, in [s]."""


class Task(Protocol):
    """A task of the arm."""

    def offer(self, motion: Motion, begin: float) -> Iterator[Motion]:
        """Motions that go on from another one at a time, the best first.

        Args:
            motion: What the arm is on by then.
            begin: When, in [s].
        """

    def find_scale(self, motion: Motion, time: float) -> float:
        """Pace of a motion at a time in [s], as a fraction of the requested one; 0 to 1."""


_Pace = TypeVar("_Pace", float, FloatArray)


def _vary_pace(
    wanted: _Pace, current: _Pace, look_ahead: float, period: float, share: float
) -> Iterator[tuple[_Pace, float]]:
    """Paces of a motion before its stop, and their durations in [s]; the best first.

    Args:
        wanted: What was asked for: a pace, or velocities.
        current: What the arm goes at.
        look_ahead: In [s].
        period: Of steps, in [s].
        share: Of full speed, that `current` is.
    """
    yield wanted, look_ahead
    if share > CREEPING:
        yield current, max(HOLD_SHARE * look_ahead, period)
        yield GENTLE * current, period


class FollowPaths:
    """Follows a path, or the one of several with the most provable progress.

    Args:
        paths: From where the arm rests; the first ones are preferred.
        limits: Limits of the joints.
        period: Of steps, in [s].
        look_ahead: In [s], >= period.

    Raises:
        ArmguardError: A path is of other joints, or does not begin and end at rest.
    """

    def __init__(
        self, paths: Sequence[Path], limits: MotionLimits, period: float, look_ahead: float
    ) -> None:
        self._period, self._look_ahead = period, look_ahead
        self._untimed = paths
        self._paths = self._time(limits)
        self._path = self._paths[0]
        self._place = 0.0
        self._back: TimedPath | None = None

    def follow_limits(self, limits: MotionLimits) -> None:
        """Go on within other limits, from where the arm rests."""
        number, before = self._paths.index(self._path), self._path
        q = before.evaluate(np.array([self._place]))[0][0]
        self._paths = self._time(limits)
        self._path = after = self._paths[number]
        # The clocks of both tell the same places in nearly the same proportions.
        about = self._place * after.duration / before.duration
        self._place, _ = after.find_nearest(q, about - PASSED, about + PASSED)
        self._back = None

    def _time(self, limits: MotionLimits) -> list[TimedPath]:
        self._limits, self._changes = limits, PaceChanges(limits)
        return [TimedPath(path, limits) for path in self._untimed]

    @property
    def progress(self) -> float:
        """How far the arm has come, in [s] of the clock of the path that it is on."""
        return self._place

    @property
    def duration(self) -> float:
        """Of the path that the arm is on, in [s] of its clock."""
        return self._path.duration

    def sample_rest(self, count: int) -> FloatArray:
        """Joint positions along what is left of the path, in [rad] or [m]. Shape (count, nv)."""
        return self._path.evaluate(np.linspace(self._place, self._path.duration, count))[0]

    def offer(self, motion: Motion, begin: float) -> Iterator[Motion]:
        """Motions that go on from another one at a time, the best first."""
        rests = motion.end <= begin
        if isinstance(motion, AlongPath):
            place = motion.find_place(begin)
            if motion.path in self._paths:
                self._path, self._place = motion.path, place[0]
            if not rests and place[0] < motion.path.duration:
                if motion.path is self._path or motion.path is self._back:
                    yield from self._vary(motion.path, place, begin)
                # On a path of another task it comes to rest first.
                return
        elif not rests:
            return
        starts = list(self._find_starts(motion, begin))
        if not starts:
            far = f"is more than {FARTHEST_BACK:g} rad or m from where a joint rests"
            raise MotionError("path", far)
        for lasting in (FAR * self._look_ahead, self._look_ahead)[len(starts) < 2 :]:
            for path, start in starts:
                if start < path.duration:
                    going = self._changes.go_and_stop(path, (start, 0.0, 0.0), begin, lasting, 1.0)
                    if going is not None:
                        yield going

    def find_scale(self, motion: Motion, time: float) -> float:
        """The pace along the path."""
        return motion.find_place(time)[1] if isinstance(motion, AlongPath) else 0.0

    def _find_starts(self, motion: Motion, time: float) -> Iterator[tuple[TimedPath, float]]:
        """From where a resting arm can go on: paths, and places on them in [s]."""
        rests_on = motion.path if isinstance(motion, AlongPath) else None
        if rests_on is self._path:
            yield self._path, self._place
            if len(self._paths) == 1:
                return
        q = motion.sample(np.array([time])).q[0]
        for path in self._paths:
            if path is rests_on:
                continue
            if path is self._path:
                place, apart = path.find_nearest(q, self._place, self._place + PASSED)
            else:
                place, apart = path.find_nearest(q, 0.0, path.duration)
            if apart <= SAME_PLACE:
                yield path, place
            elif path is self._path and apart <= FARTHEST_BACK:
                # Back to the path, straight on, from where it was left to brake.
                back = np.stack([q, path.evaluate(np.array([place]))[0][0]])
                self._back = TimedPath(Path(back), self._limits)
                yield self._back, 0.0

    def _vary(
        self, path: TimedPath, place: tuple[float, float, float], begin: float
    ) -> Iterator[Motion]:
        """At full pace, at the same one, and slowing down gently."""
        pace = place[1]
        for wanted, lasting in _vary_pace(1.0, pace, self._look_ahead, self._period, pace):
            going = self._changes.go_and_stop(path, place, begin, lasting, wanted)
            if going is not None:
                yield going


class KeepVelocity:
    """Moves the joints at a velocity while that is requested: jogging, or a policy.

    Args:
        limits: Limits of the joints.
        lower: Lower position limits, in [rad] or [m]. Shape (nv,).
        upper: Upper position limits, in [rad] or [m]. Shape (nv,).
        period: Of steps, in [s].
        look_ahead: In [s], >= period.
    """

    def __init__(
        self,
        limits: MotionLimits,
        lower: FloatArray,
        upper: FloatArray,
        period: float,
        look_ahead: float,
    ) -> None:
        self._limits, self._lower, self._upper = limits, lower, upper
        self._period, self._look_ahead = period, look_ahead
        self._changes = JointChanges(limits)
        self.velocity = np.zeros(len(lower))

    def offer(self, motion: Motion, begin: float) -> Iterator[Motion]:
        """Motions that go on from another one at a time, the best first."""
        state = motion.sample(np.array([begin]))
        wanted = self._clip(state.q[0])
        if motion.end <= begin and not wanted.any():
            return
        v = state.v[0]
        share = float(np.abs(v / self._limits.velocity).max())
        for velocity, lasting in _vary_pace(wanted, v, self._look_ahead, self._period, share):
            yield self._changes.go_and_stop(state, begin, lasting, velocity)

    def find_scale(self, motion: Motion, time: float) -> float:
        """The velocity as a fraction of the requested one."""
        asked = float(np.abs(self.velocity).max())
        v = motion.sample(np.array([time])).v[0]
        return min(1.0, float(np.abs(v).max()) / asked) if asked > 0.0 else 0.0

    def _clip(self, q: FloatArray) -> FloatArray:
        """The velocity, slower as a whole within limits, and joint by joint near position limits.

        With d left to a position limit and its guaranteed braking b, a joint goes at sqrt(b d / 2)
        at most, so that braking takes a quarter of the way; and slowly enough at the end to be
        slower in time, however long the jerk takes to build the braking up.
        """
        limits = self._limits
        excess = float(np.abs(self.velocity / limits.velocity).max())
        velocity = self.velocity / max(excess, 1.0)
        lag = 2.0 * (self._look_ahead + limits.braking / limits.jerk)
        for room, sign in ((self._upper - q, 1.0), (q - self._lower, -1.0)):
            left = np.maximum(room, 0.0)
            most = np.minimum(np.sqrt(0.5 * limits.braking * left), left / lag)
            velocity = np.where(sign * velocity > most, sign * most, velocity)
        return velocity


class FollowPoints:
    """Follows a policy's next positions as far as that is provable; further ones are dropped.

    Args:
        limits: Limits of the joints.
        lower: Lower position limits, in [rad] or [m]. Shape (nv,).
        upper: Upper position limits, in [rad] or [m]. Shape (nv,).
        period: Of steps, in [s].
        look_ahead: In [s], >= period.
        apart: Between points, in [s].
    """

    def __init__(
        self,
        limits: MotionLimits,
        lower: FloatArray,
        upper: FloatArray,
        period: float,
        look_ahead: float,
        apart: float,
    ) -> None:
        self._limits, self._lower, self._upper = limits, lower, upper
        self._period, self._look_ahead, self._apart = period, look_ahead, apart
        self._changes = JointChanges(limits)
        self._points: FloatArray | None = None
        self._phases: list[Phase] = []

    def take(self, points: FloatArray) -> None:
        """Follow other points from the next offer on. Shape (k, nv)."""
        self._points = np.clip(points, self._lower, self._upper)
        self._phases = []

    def drop(self) -> None:
        """Drop all points."""
        self._points = None

    def offer(self, motion: Motion, begin: float) -> Iterator[Motion]:
        """Motions that go on from another one at a time, the best first."""
        if self._phases and not self._is_followed(motion, begin):
            self._points = None
        if self._points is None:
            return
        if not self._phases:
            self._lay_out(motion, begin)
        if begin >= self._end:
            return
        for lasting in (self._look_ahead, self._period):
            yield self._changes.stop_after(self._phases, min(begin + lasting, self._end))
        # What could not be proved is dropped, and the arm stops.
        self._points = None

    def count_passed(self, motion: Motion) -> int:
        """Of how many points the time comes before a motion's stop begins.

        It still counts after the others were dropped.
        """
        begin = self._find_stop(motion)
        if begin is None:
            return 0
        passed = (begin - self._phases[0].begin) / self._apart
        return min(int(passed + LIMIT_SLACK), len(self._phases))

    def find_scale(self, motion: Motion, time: float) -> float:
        """1 while points are followed, else 0."""
        return 1.0 if self._is_followed(motion, time) else 0.0

    def _is_followed(self, motion: Motion, time: float) -> bool:
        """Whether a motion is still on the way from point to point at a time."""
        begin = self._find_stop(motion)
        return begin is not None and time <= begin

    def _find_stop(self, motion: Motion) -> float | None:
        """When a motion along the points begins to stop, in [s]; None for any other motion."""
        if not (self._phases and isinstance(motion, JointByJoint)):
            return None
        return motion.phases[-1].begin if motion.phases[0] is self._phases[0] else None

    def _lay_out(self, motion: Motion, begin: float) -> None:
        """Phases from point to point, each passed at the mean velocity around it."""
        assert self._points is not None, "there is something to lay out"
        points = self._points
        state = motion.sample(np.array([begin]))
        places = np.concatenate([state.q, points])
        after = np.concatenate([places[2:], places[-1:]])
        most = self._changes.top_speed
        passing = np.clip((after - places[:-1]) / (2.0 * self._apart), -most, most)
        passing[-1] = 0.0
        self._phases = []
        for k, (q, velocity) in enumerate(zip(points, passing, strict=True)):
            phase = self._changes.track(state, begin + k * self._apart, self._apart, q, velocity)
            self._phases.append(phase)
            state = JointByJoint([phase]).sample(np.array([phase.begin + self._apart]))
        # At the last one it rests, if it takes a little longer.
        self._end = phase.begin + float(phase.trajectory.duration)
