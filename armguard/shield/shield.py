"""A shield: computes motions from goals and joint states, each proved until rest.

Each command is a motion that ends at rest, and that the monitor has proved as a whole, as a
committed piece. In each step the shield offers the monitor candidates for the next motion, the best
first, each with its own stop. The first proved candidate is the next command. If none is proved,
the arm follows its present motion to its end, where it is at rest, still on its path if it has one.
So the arm is always on a proved motion, whatever is late, lost or refused.

The first candidate continues for `look_ahead` before it stops. While it is proved, the arm moves at
full pace. When it is not, there is still time to slow down gently, on motions with a shorter
continuation. So the hardest stop, which every command contains, is seldom executed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.bounds.planned.plan import Plan
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.monitor.monitor import Monitor
from armguard.robot.brakes import find_gentlest_stop
from armguard.robot.wrap_angle import align_turns, find_continuous
from armguard.shield.changes import MotionError
from armguard.shield.command import Command
from armguard.shield.motion import Motion, Rest, Samples
from armguard.shield.path import MotionLimits, Path
from armguard.shield.tasks import FollowPaths, FollowPoints, KeepVelocity, Task
from armguard.verdict import BRAKE, Effect, PlanChoice, Reason, ReasonKind, Verdict, find_weightiest

GRAIN = 0.01
"""Longest time between samples of a command, in [s]."""

LEAST_GRAIN = 1e-6
"""Samples that are closer in time than this are one, in [s]."""


class _Piece(NamedTuple):
    """A committed piece: motions, each from a time on in [s], and their samples until rest."""

    motions: tuple[tuple[float, Motion], ...]
    samples: Samples

    @property
    def end(self) -> float:
        """Time at which the arm is at rest at its end, in [s]."""
        return self.motions[-1][1].end

    def find_motion(self, time: float) -> Motion:
        """The motion of the arm at a time."""
        found = self.motions[0][1]
        for begin, motion in self.motions:
            if begin <= time:
                found = motion
        return found


class Shield:
    """Moves an arm only along proved motions.

    Args:
        monitor: A monitor with `motion="planned"`; the shield steps it.
        jerk: Greatest jerk of each joint, in [rad]/[s³] or [m]/[s³]. One number, or shape (nv,).
        rate: Rate of the steps, in [Hz].
        look_ahead: How long a proved motion must continue at the requested pace before its stop, in
            [s]. A shorter time gets more work done; a longer one brakes more gently
            (docs/shield.md).
        chunk_period: Time between points of a chunk, in [s]; None: one period of the steps.
        tracking_error: Greatest distance of joints from a command, in [rad] or [m]. One number, or
            (nv,).
        velocity_tracking_error: The same for velocities, in [rad]/[s] or [m]/[s].

    Attributes:
        limits: Limits of commands. Braking is that which is guaranteed with the monitor's payload;
            after a change of the payload, the arm comes to rest first.

    Raises:
        ArmguardError: An argument is out of range, or the monitor was made for another motion.
    """

    def __init__(
        self,
        monitor: Monitor,
        *,
        jerk: ArrayLike,
        rate: float = 250.0,
        look_ahead: float = 0.03,
        chunk_period: float | None = None,
        tracking_error: ArrayLike = 0.001,
        velocity_tracking_error: ArrayLike = 0.01,
    ) -> None:
        settings, robot = monitor.settings, monitor.robot
        if settings.motion != "planned":
            raise ArmguardError(
                "monitor", f"was made with motion={settings.motion!r}", expected='motion="planned"'
            )
        joints = len(robot.joints)
        self._monitor = monitor
        self._period = period = 1.0 / _read("rate", rate, 1)[0]
        self._latency = settings.latency
        self._errors = (
            _read("tracking_error", tracking_error, joints),
            _read("velocity_tracking_error", velocity_tracking_error, joints),
        )
        in_force = settings.put_in_force(robot)
        self.limits = MotionLimits(
            in_force.operating_velocity.copy(),
            in_force.operating_acceleration.copy(),
            robot.acceleration_limit.copy(),
            _read("jerk", jerk, joints),
        )
        self._look_ahead = max(period, _read("look_ahead", look_ahead, 1)[0])
        self._apart = period if chunk_period is None else _read("chunk_period", chunk_period, 1)[0]
        self._paths: FollowPaths | None = None
        self._task: Task | None = None
        self._follow_payload()
        self._piece: _Piece | None = None
        self._now = 0.0
        self._has_left = False
        at_rest = robot.rest_velocity_error
        self._at_rest = at_rest + self._errors[1]
        self._error = error = robot.position_error + self._errors[0]
        # An arm that is measured as slow as one at rest is faster by an error at most. In this time
        # it goes no farther than a plan allows beside the error of its measured position, which
        # covers errors of the stamp.
        self._oldest = float((self._errors[0] / (self._at_rest + at_rest)).min())
        self._within = robot.lower_position_limit - error, robot.upper_position_limit + error
        self._continuous = find_continuous(robot.lower_position_limit, robot.upper_position_limit)
        empty = np.empty((0, joints))
        self._nowhere = Samples(np.empty(0), empty, empty, empty)

    def set_path(self, path: Path | Sequence[Path] | None) -> None:
        """Follow a path from now on, or the one of several with the most provable progress.

        A moving arm comes to rest first. A path must begin where the arm is at rest.

        Args:
            path: One path, or several that begin at the same place; earlier ones are preferred.
                None: there is nothing to do, and the arm stays at rest.

        Raises:
            ArmguardError: The list is empty, or a path has other joints or is not from rest to
                rest.
        """
        if path is None:
            self._paths = self._task = None
            return
        paths = [path] if isinstance(path, Path) else list(path)
        if not paths:
            raise ArmguardError("path", "is none", expected="one or several")
        self._paths = FollowPaths(paths, self.limits, self._period, self._look_ahead)
        self._task = self._paths

    @property
    def progress(self) -> float:
        """Progress of the arm on its path, 0 to 1; 0 without a path."""
        paths = self._paths
        return 0.0 if paths is None else min(1.0, paths.progress / paths.duration)

    def sample_path(self, count: int) -> FloatArray:
        """Sample the rest of the path that the arm is on.

        Args:
            count: Number of samples, >= 1.

        Returns:
            Joint positions, in [rad] or [m]. Shape (count, nv); (0, nv) without a path.
        """
        return self._nowhere.q if self._paths is None else self._paths.sample_rest(count)

    def reset(self) -> None:
        """Drop the motion of the arm, and reset the monitor; the arm must be at rest."""
        self._monitor.reset()
        self._piece = None
        self._has_left = False
        self._points.drop()

    def step(
        self,
        now: float,
        q: ArrayLike,
        v: ArrayLike,
        stamp: float | None = None,
        *,
        velocity: ArrayLike | None = None,
        chunk: ArrayLike | None = None,
    ) -> Command:
        """Judge a joint state, and find the motion to follow from now on.

        Without a velocity or a chunk, the arm continues its path, or the points of the last chunk.
        Never raises on bad data, see `Monitor.step`.

        Args:
            now: Time of this step, in [s].
            q: Joint positions in the order of `robot.joints`, in [rad] or [m]. Shape (nv,).
            v: Joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            stamp: Time of measurement, in [s]; None: `now`.
            velocity: Joint velocities to keep until the next step, in [rad]/[s] or [m]/[s]; scaled
                down as a whole if beyond limits. Shape (nv,).
            chunk: The next joint positions, the first one `chunk_period` from now, in [rad] or [m].
                Shape (k, nv).
        """
        verdict = self._monitor.step(now if stamp is None else stamp, q, v, now)
        time = _read_numbers(now)
        if time is None or time.shape != ():
            return self._go_on(verdict, _refuse("now", "is not a finite number"))
        now = self._now = float(time)
        measured = time if stamp is None else _read_numbers(stamp)
        age = math.inf if measured is None else float(np.max(now - measured, initial=-math.inf))
        is_old = not age <= self._oldest
        piece = self._find_piece(now, q, v, verdict, is_old=is_old)
        if self._payload != self._monitor.payload and (piece is None or piece.end <= now):
            self._follow_payload()
        reason = self._choose_task(velocity, chunk)
        if piece is None:
            if is_old:
                unknown = _refuse(
                    "joint state",
                    f"is {age:.3g} s old: where the arm rests is known for {self._oldest:.3g} s",
                )
                return self._go_on(verdict, reason or unknown)
            unknown = _refuse("arm", "has no known position of rest")
            return self._go_on(verdict, reason or find_weightiest(verdict.reasons) or unknown)
        begin, is_new = now + self._latency, False
        if self._task is not None and not self._has_left:
            shown: list[_Piece] = []
            try:
                choice = self._monitor.fastest(self._show(self._task, piece, now, begin, shown))
            except MotionError as error:
                choice, reason = PlanChoice(None, ()), _refuse(error.offender, error.problem)
            if choice.verdicts and not choice.verdicts[0].safe:
                reason = reason or choice.verdicts[0].reasons[0]
            if choice.number is not None:
                piece, is_new = shown[choice.number], True
        if self._has_left and reason is None:
            reason = find_weightiest(verdict.reasons) or _refuse("arm", "has not come to rest yet")
        self._piece = piece
        motion = piece.find_motion(begin)
        samples = piece.samples
        # Rounding may leave it a little outside.
        scale = 0.0 if self._task is None else self._task.find_scale(motion, begin)
        scale = min(max(scale, 0.0), 1.0)
        executed = self._points.count_passed(motion) if self._task is self._points else 0
        return Command(
            *samples,
            is_new,
            float(samples.times[-1]),
            scale,
            bool(samples.times[-1] > now and samples.v.any()),
            BRAKE if self._has_left else None,
            verdict,
            reason,
            verdict.contact_speed,
            executed,
        )

    def _go_on(self, verdict: Verdict, reason: Reason | None) -> Command:
        """The command for the arm's present motion, in a step that finds no new one.

        Without a valid time, it is unknown whether the motion is still proved.
        """
        piece = self._piece
        samples = self._nowhere if piece is None else piece.samples
        end = self._now if piece is None else float(samples.times[-1])
        moves = bool(end > self._now and samples.v.any())
        return Command(
            *samples, False, end, 0.0, moves, BRAKE, verdict, reason, verdict.contact_speed
        )

    def _follow_payload(self) -> None:
        """Use the braking that is guaranteed with the monitor's payload; for an arm at rest."""
        monitor, robot, limits = self._monitor, self._monitor.robot, self.limits
        self._payload = monitor.payload
        brakes = robot.brakes.make_curves(self._payload)
        # A joint whose brakes are stated by stopping times may guarantee less at lower speeds.
        guaranteed = np.minimum(
            find_gentlest_stop(brakes, limits.velocity),
            find_gentlest_stop(brakes, np.zeros_like(limits.velocity)),
        )
        braking = np.minimum(robot.acceleration_limit, guaranteed)
        self.limits = limits = limits._replace(braking=braking)
        bounds = limits, robot.lower_position_limit, robot.upper_position_limit
        times = self._period, self._look_ahead
        self._velocity = KeepVelocity(*bounds, *times)
        self._points = FollowPoints(*bounds, *times, self._apart)
        if self._paths is not None:
            self._paths.follow_limits(limits)
        self._task = self._paths

    def _choose_task(self, velocity: ArrayLike | None, chunk: ArrayLike | None) -> Reason | None:
        """Set the requested task; returns a reason if it cannot be used."""
        joints = len(self._velocity.velocity)
        if chunk is not None:
            points = _read_numbers(chunk)
            if points is None or not (
                points.ndim == 2 and points.shape[1] == joints and len(points)
            ):
                self._task = self._velocity
                self._velocity.velocity = np.zeros(joints)
                return _refuse("chunk", f"is no finite array of the shape (points, {joints})")
            self._points.take(points)
            self._task = self._points
        elif velocity is not None:
            wanted = _read_numbers(velocity)
            self._task = self._velocity
            if wanted is not None and wanted.shape == (joints,):
                self._velocity.velocity = wanted
            else:
                self._velocity.velocity = np.zeros(joints)
                return _refuse("velocity", f"is no finite array of the shape ({joints},)")
        elif self._task is self._velocity:
            # Nobody asks for the velocity any more.
            self._velocity.velocity = np.zeros(joints)
            self._task = self._paths or self._velocity
        return None

    def _find_piece(
        self, now: float, q: ArrayLike, v: ArrayLike, verdict: Verdict, *, is_old: bool
    ) -> _Piece | None:
        """The piece that the arm is on; None if the arm's state is unknown.

        An arm may brake by its own means after its motion is no longer proved, somebody may move an
        arm at rest, and commands may be lost. So after the motion has ended and the arm is at rest,
        its measured position counts. If that position agrees with the end of the motion within
        errors, the end still counts, so that the arm does not creep with each measurement. Joint
        states that the monitor does not believe do not count until a reset, and neither do old
        ones: an arm that was slow then may have moved on. An error of the stamps makes no moving
        arm count as one at rest. No motion begins beyond position limits.
        """
        piece = self._piece
        if piece is not None:
            self._has_left |= verdict.proved_until is None and now < piece.end
            if now < piece.samples.times[-1]:
                return piece
        if any(reason.kind.effect is Effect.LATCHED for reason in verdict.reasons):
            return piece
        if is_old:
            return piece
        place, speeds = _read_numbers(q), _read_numbers(v)
        shape = self.limits.velocity.shape
        if place is None or speeds is None or not place.shape == speeds.shape == shape:
            return piece
        if piece is not None:
            place = align_turns(place, piece.samples.q[-1], self._continuous)
        is_within = (place >= self._within[0]).all() and (place <= self._within[1]).all()
        if not (is_within and (np.abs(speeds) <= self._at_rest).all()):
            return piece
        self._has_left = False
        if piece is not None and (np.abs(place - piece.samples.q[-1]) <= self._error).all():
            return piece
        # What is measured beyond a limit by errors is nearer to the truth at the limit.
        robot = self._monitor.robot
        place = np.clip(place, robot.lower_position_limit, robot.upper_position_limit)
        rest = Rest(place, now)
        return _Piece(((now, rest),), rest.sample(np.array([now, now + self._period])))

    def _join(self, piece: _Piece, now: float, begin: float, motion: Motion) -> _Piece:
        """Join the arm's present piece until a time with another motion from then on.

        Cubic interpolation between samples differs slightly from motions along paths. There are
        samples at the times where the next step cuts this piece, so that it continues without a
        jump.
        """
        # A piece has to begin now, so that nothing that comes as good as now is a knot of its own.
        soon = now + LEAST_GRAIN
        going = [(at, one) for at, one in piece.motions if soon < at < begin]
        motions = [(now, piece.find_motion(soon)), *going, (begin, motion)]
        parts = []
        for k, (at, one) in enumerate(motions):
            knots = one.find_knots(at)
            if k + 1 < len(motions):
                knots = np.append(knots[knots < motions[k + 1][0]], motions[k + 1][0])
            else:
                cuts = np.array([now, begin]) + self._period
                knots = np.union1d(knots, cuts[(cuts > at) & (cuts < one.end)])
            knots = np.concatenate([[at], knots[knots - at > LEAST_GRAIN]])
            fill = [
                np.linspace(first, second, math.ceil((second - first) / GRAIN) + 1)[:-1]
                for first, second in itertools.pairwise(knots)
                if second - first > LEAST_GRAIN
            ]
            if k + 1 == len(motions):
                fill.append(knots[-1:] if fill else at + np.array([0.0, self._period]))
            parts.append(one.sample(np.concatenate(fill)) if fill else None)
        samples = Samples(*map(np.concatenate, zip(*(part for part in parts if part), strict=True)))
        samples.v[-1] = samples.a[-1] = 0.0
        return _Piece(tuple(motions), samples)

    def _show(
        self, task: Task, piece: _Piece, now: float, begin: float, shown: list[_Piece]
    ) -> Iterator[Plan]:
        """The motions that a task offers, as pieces to commit; each is noted when it is offered."""
        for motion in task.offer(piece.find_motion(begin), begin):
            candidate = self._join(piece, now, begin, motion)
            shown.append(candidate)
            times, q, v, _ = candidate.samples
            yield Plan(now, times - now, q, v, *self._errors)


def _read(name: str, value: ArrayLike, joints: int) -> FloatArray:
    """Read one number above 0 for each joint."""
    numbers = _read_numbers(value)
    if numbers is None or numbers.shape not in ((), (joints,)) or not (numbers > 0.0).all():
        expected = "a number above 0" + (f", or {joints} of them" if joints > 1 else "")
        raise ArmguardError(name, f"is {value!r}", expected=expected)
    return np.zeros(joints) + numbers


def _read_numbers(values: object) -> FloatArray | None:
    """A copy as an array; None if it is not an array of finite numbers."""
    try:
        array = np.array(values, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):  # the first for integers beyond all floats
        return None
    return array if np.isfinite(array).all() else None


def _refuse(subject: str, detail: str) -> Reason:
    return Reason(ReasonKind.PLAN_REFUSED, subject, detail)
