"""A shield: from goals and joint states to motions that are proved to their rest.

Each command is a motion that ends at rest, and that the monitor has proved as a whole, as a
committed piece. In each step the shield shows the monitor next motions, the best first, each with
its own stop. The first one that is proved is the next command. If none is, the arm goes on along
the motion that it has, which slows down and rests: on its path, where it follows one. So nothing
that is late, lost or refused leaves the arm on a motion that was not proved.

The first motion that is shown goes on for the time to look ahead. As long as that is proved, the
arm is as fast as it may be. Once it is not, there is still time to slow down gently, on motions
that are proved for less; so the hardest stop, which every command carries, is seldom run.
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
    """What is committed: motions, each from a time on in [s], and samples of them to the rest."""

    motions: tuple[tuple[float, Motion], ...]
    samples: Samples

    @property
    def end(self) -> float:
        """When the arm rests at its end, in [s]."""
        return self.motions[-1][1].end

    def find_motion(self, time: float) -> Motion:
        """What the arm is on at a time."""
        found = self.motions[0][1]
        for begin, motion in self.motions:
            if begin <= time:
                found = motion
        return found


class Shield:
    """Moves an arm along proved motions alone.

    Args:
        monitor: Made with `motion="planned"`; the shield steps it.
        jerk: The greatest one of each joint, in [rad]/[s³] or [m]/[s³]. One number, or shape (nv,).
        rate: Of the steps, in [Hz].
        look_ahead: For how long the arm must be able to go on as fast as it was asked to, in [s];
            less gets more work done, more brakes more gently (docs/shield.md).
        chunk_period: Between points of a chunk, in [s]; None: one period of the steps.
        tracking_error: How far joints may be off a command, in [rad] or [m]. One number, or (nv,).
        velocity_tracking_error: Alike, in [rad]/[s] or [m]/[s].

    Attributes:
        limits: That commands keep to. They brake as hard as is guaranteed under the monitor's
            payload; after that has changed, the arm comes to rest first.

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
        self._at_rest = robot.velocity_error + self._errors[1]
        self._error = error = robot.position_error + self._errors[0]
        # As slow as an arm at rest may be, it leaves where it was measured by these errors in time.
        self._oldest = float((error / self._at_rest).min())
        self._within = robot.lower_position_limit - error, robot.upper_position_limit + error
        self._continuous = find_continuous(robot.lower_position_limit, robot.upper_position_limit)
        empty = np.empty((0, joints))
        self._nowhere = Samples(np.empty(0), empty, empty, empty)

    def set_path(self, path: Path | Sequence[Path] | None) -> None:
        """Follow a path from now on, or that of several on which the most progress is provable.

        An arm that moves comes to rest first. A path begins where the arm rests.

        Args:
            path: One, or several that begin at the same place; the first ones are preferred. None:
                nothing is left to do, and the arm rests.

        Raises:
            ArmguardError: There is none, or one is of other joints or not from rest to rest.
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
        """How far the arm has come on its path, of 1; 0 without a path."""
        paths = self._paths
        return 0.0 if paths is None else min(1.0, paths.progress / paths.duration)

    def sample_path(self, count: int) -> FloatArray:
        """Where the arm is asked to go: along what is left of the path that it is on.

        Args:
            count: How many places, >= 1.

        Returns:
            Joint positions, in [rad] or [m]. Shape (count, nv); (0, nv) without a path.
        """
        return self._nowhere.q if self._paths is None else self._paths.sample_rest(count)

    def reset(self) -> None:
        """Forget the motion that the arm was on, and reset the monitor; the arm must rest."""
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

        Without a velocity or a chunk the arm goes on with its path, or with the points of the last
        chunk. Never raises on bad data, see `Monitor.step`.

        Args:
            now: Time of this step, in [s].
            q: Joint positions in the order of `robot.joints`, in [rad] or [m]. Shape (nv,).
            v: Joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            stamp: When they were measured, in [s]; `now` unless given.
            velocity: To be kept until the next step says otherwise, in [rad]/[s] or [m]/[s]; slower
                as a whole where it is beyond limits. Shape (nv,).
            chunk: The next positions, the first one a chunk's period from now, in [rad] or [m].
                Shape (k, nv).
        """
        verdict = self._monitor.step(now if stamp is None else stamp, q, v, now)
        time = _read_numbers(now)
        if time is None or time.shape != ():
            return self._go_on(verdict, _refuse("now", "is no finite number"))
        now = self._now = float(time)
        measured = time if stamp is None else _read_numbers(stamp)
        is_old = measured is None or not bool(np.all(now - measured <= self._oldest))
        piece = self._find_piece(now, q, v, verdict, is_old=is_old)
        if self._payload != self._monitor.payload and (piece is None or piece.end <= now):
            self._follow_payload()
        reason = self._choose_task(velocity, chunk)
        if piece is None:
            unknown = _refuse("arm", "is not known to rest anywhere")
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
        """The motion that the arm is on, if there is one, in a step that finds no other.

        Whether it is still proved is not known without a time.
        """
        piece = self._piece
        samples = self._nowhere if piece is None else piece.samples
        end = self._now if piece is None else float(samples.times[-1])
        moves = bool(end > self._now and samples.v.any())
        return Command(
            *samples, False, end, 0.0, moves, BRAKE, verdict, reason, verdict.contact_speed
        )

    def _follow_payload(self) -> None:
        """Keep to what brakes guarantee under the monitor's payload; for an arm that rests."""
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
        """Take what is asked for; a reason where it cannot be used."""
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
        """What the arm is on; None where nothing is known of where it is.

        An arm whose motion is not proved any more may brake by its own means, one that rests may be
        moved by somebody, and commands may be lost. So once the motion has ended and the arm rests,
        it is taken to be where it was measured, unless it may be at that end: a place to rest does
        not follow each measured one, and the arm does not creep. Nor does it follow joint states
        that the monitor does not believe, until a reset, nor old ones: an arm that was slow then
        may have gone on. No motion begins beyond position limits.
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
        """What the arm is on until a time, and then another motion.

        What is cubic between samples differs a little from motions along paths. There are samples
        where the next step cuts this piece, so that it goes on without a jump.
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
        """What a task offers, as pieces to be committed; each is noted as it is shown."""
        for motion in task.offer(piece.find_motion(begin), begin):
            candidate = self._join(piece, now, begin, motion)
            shown.append(candidate)
            times, q, v, _ = candidate.samples
            yield Plan(now, times - now, q, v, *self._errors)


def _read(name: str, value: ArrayLike, joints: int) -> FloatArray:
    """A number for each joint, above 0."""
    numbers = _read_numbers(value)
    if numbers is None or numbers.shape not in ((), (joints,)) or not (numbers > 0.0).all():
        expected = "a number above 0" + (f", or {joints} of them" if joints > 1 else "")
        raise ArmguardError(name, f"is {value!r}", expected=expected)
    return np.zeros(joints) + numbers


def _read_numbers(values: object) -> FloatArray | None:
    """An array of its own; None where it is none, or not finite."""
    try:
        array = np.array(values, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):  # the first for integers beyond all floats
        return None
    return array if np.isfinite(array).all() else None


def _refuse(subject: str, detail: str) -> Reason:
    return Reason(ReasonKind.PLAN_REFUSED, subject, detail)
