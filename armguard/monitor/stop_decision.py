"""The stop decision: whether the arm can still stop, and how fast it may move on.

The contact time assumes the worst motion of the arm; a verdict needs less. The arm moves on for one
more tick, and brakes if the next verdict is a STOP. If it is then proved to be at rest before any
contact, it need not stop now. So every STOP is in time, because the tick before still had this
proof.
"""

from __future__ import annotations

import math

from armguard.bounds.joint_table import JointTable
from armguard.monitor.kept_speeds import KeptSpeeds
from armguard.robot.stop_time import ALL_COVERED
from armguard.scheduling.certificates import ASKABLE, ENDING, IN_VAIN, PROVED
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.scheduling.timing_wheel import NOBODY
from armguard.settings.settings import Settings

STEP = 1.0 / 32.0
"""Resolution of the search for a speed scale."""

RAISE_PAUSE = 10e-3
"""How long no higher scale is tried after one was found unsafe, in [s]."""

LONGEST_PROMISE = 30e-3
"""Greatest time for which a scale promises that the arm may move on, in [s]. A promise for the
whole delay of a slow brake would leave no speed near a person (docs/usefulness.md)."""

PROVING = 10e-3
"""Intended validity of the proof that a STOP is in time, in [s]; a longer one holds for fewer
motions."""

SCALE_PROVING = 14e-3
"""Intended validity of the proof of a speed scale below 1, in [s]. Slow joints do not move far in
this time, so it costs little speed."""

CAUTIOUS_TIME = 1.0
"""How long after a fall of the scale a higher one must be proved for `RISE_PROVING`, in [s]."""

RISE_PROVING = 50e-3
"""For how long a higher scale must be proved after a fall before it is given out, [s]: one and a
half periods of a camera at 30 Hz. What is known of an obstacle gets vaguer until its next message,
and a scale that is proved for less falls again before that. Without a fall no more than
`SCALE_PROVING` is asked: the whole speed is often safe where a part of it cannot be proved for so
long (`benchmarks/bench_scale.py`)."""

SHORT = 1.5e-3
"""For how long that is proved of a scale which cannot be proved for so long, [s]: a scale is as
high as can be, so that for some obstacle there is hardly any time to spare."""

SOON = 2.5e-3
"""How long before its end a proof is renewed by a tick that has had nothing else to do, in [s]:
else renewals of both kinds, and evaluations, would now and then all fall to one tick. Beside a
person at 1.1 m in `bench_near`, 1 % of ticks would take more than 96 evaluations instead of 70."""


class StopDecision:
    """Decides whether the arm is at rest before contact, with the scheduler's table of braking.

    Args:
        scheduler: Knows the pairs.
        settings: Settings, which say when verdicts are obeyed and when brakes engage.

    Attributes:
        evaluated: Evaluations so far.
        left: Number of undecided obstacles, for which the budget did not suffice, since this was
            last set to 0.
        offending: The pair that made the last decision a STOP; NOBODY if there was none, or if
            brakes are not stated for the joints' speeds.
        thrown: The joint for which the last decision failed, whatever is near, because its stop may
            throw it back faster than its brakes are stated for; `ALL_COVERED` if there is none.
        limiting: The pair that limits the scale, if it is known.
        braking_delay: Times from a tick until brakes engage after its verdict, or after the next
            one, in [s].
        looks_ahead: Time of the STOP in the proof of a scale, in [s] from its tick.
    """

    def __init__(self, scheduler: Scheduler, settings: Settings) -> None:
        response_time = settings.response_time
        self.evaluated = self.left = 0
        self._scheduler = scheduler
        self._response_time = response_time
        # For how long a STOP is proved to be in time at once, in [s]; 0: for the tick at hand.
        self._proving = PROVING if response_time < 0.5 * PROVING else 0.0
        self.braking_delay = settings.braking_delay
        self.looks_ahead = response_time + min(self.braking_delay, LONGEST_PROMISE)
        self._kept = KeptSpeeds()
        self.reset()

    def reset(self) -> None:
        """Drop earlier decisions."""
        self.offending = self.limiting = NOBODY
        self.thrown = ALL_COVERED
        self._unsafe_in = -9
        self._raise_at = self._fell_at = -math.inf
        self._kept.reset()

    def rests(self, tick: Tick) -> bool:
        """Whether the arm is proved to be at rest before contact if it brakes after the next tick.

        First it tries a proof for a STOP in any of the next ticks. Such a proof holds for several
        ticks, so most ticks find all obstacles already proved.
        """
        scheduler, braking = self._scheduler, self._scheduler.arm.motion.braking
        q, v, age, response_time = tick.q, tick.v, tick.arm_age, self._response_time
        self.offending = NOBODY
        self.thrown = braking.find_uncovered(q, v, age, response_time)
        if self.thrown != ALL_COVERED:
            return False
        known = scheduler.recall_stops(tick, tick.stop_time, soon=SOON)
        if known == PROVED:
            return True
        proving = self._proving
        # While the arm stops, nothing is gained by a proof that lasts.
        may_last = known != IN_VAIN and proving > 0.0 and tick.number != self._unsafe_in + 1
        if may_last and braking.covers(q, v, age, response_time + proving):
            left = self.left
            table = braking.tabulate(q, v, age, response_time + proving)
            if self._is_free(tick, table, proving, 0.0, tick.stop_time, pause=proving):
                return True
            # What this left over is asked again, of a STOP in this tick alone.
            self.left = left
        if known == ENDING:
            # Of this tick it was proved before, whether it could be renewed or not.
            return True
        if self._is_free(tick, braking.tabulate(q, v, age, response_time), 0.0):
            return True
        self._unsafe_in = tick.number
        return False

    def find_scale(self, tick: Tick, given: float, most: float) -> float:
        """The fraction of their operating velocities at which joints may move on, at most `most`.

        An arm with slower joints may move on for as long as a STOP takes to reach the brakes, at
        most `LONGEST_PROMISE`. It is proved to be at rest before contact if the next verdict after
        that is a STOP. A faster arm must slow down; the level says whether it must stop.

        The returned scale was proved in this tick or in earlier ones. A scale of 1 can use any
        lasting proof; a lower scale uses proofs that hold for an arm that has kept the scale since.
        The search begins at the last published scale, so most ticks need no new proof. Otherwise it
        tries a lasting proof, then a shorter one, then one for this tick alone. If the last scale
        is no longer safe, it bisects. A higher scale must be proved for some time ahead, so that it
        need not fall again at once, which would make the arm jerk.

        Args:
            tick: The tick.
            given: The last published scale.
            most: The greatest scale to consider.
        """
        found = min(given, most)
        if found < most and not tick.time < self._raise_at:
            if self._may_rise(tick, most):
                self.limiting = NOBODY
                return most
            self.limiting = self.offending
            self._raise_at = tick.time + RAISE_PAUSE
        if not self._is_safe(tick, found, lasts=True):
            # Invariant: `found` is safe, for an arm that may be told to stop now; `high` is not.
            self.limiting = self.offending
            found, high = 0.0, found
            scale = high - STEP
            while scale > 0.0 and high - found > STEP:
                if self._is_safe(tick, scale):
                    found = scale
                else:
                    high = scale
                    self.limiting = self.offending
                scale = 0.5 * (found + high)
            self._raise_at = tick.time + RAISE_PAUSE
            self._fell_at = tick.time
        return found

    def _may_rise(self, tick: Tick, scale: float) -> bool:
        """Whether a higher scale than the last one is safe, for a while if it is below 1."""
        if scale == 1.0:
            return self._is_whole_safe(tick, lasts=True)
        braking = self._scheduler.arm.motion.braking
        is_cautious = tick.time < self._fell_at + CAUTIOUS_TIME
        horizon = self.looks_ahead + (RISE_PROVING if is_cautious else SCALE_PROVING)
        table = braking.tabulate(tick.q, tick.v, tick.arm_age, horizon, pace=scale)
        return self._is_free(tick, table)

    def _is_safe(self, tick: Tick, scale: float, *, lasts: bool = False) -> bool:
        """Whether an arm that keeps a scale is at rest before contact; a scale of 0 is always safe.

        With `lasts`, it is proved for some ticks at once if possible.
        """
        if scale == 0.0:
            return True
        if scale == 1.0:
            return self._is_whole_safe(tick, lasts=lasts)
        return self._is_paced_safe(tick, scale, lasts=lasts)

    def _is_paced_safe(self, tick: Tick, scale: float, *, lasts: bool) -> bool:
        """Whether an arm whose joints keep a scale is at rest before contact.

        A proof for a STOP some ticks later holds as long as the joints are known to have kept the
        scale since.
        """
        scheduler, braking = self._scheduler, self._scheduler.arm.motion.braking
        q, v, age = tick.q, tick.v, tick.arm_age
        later, since = self.looks_ahead - self._response_time, math.inf
        if lasts and self._proving > 0.0:
            since = self._kept.follow(tick, scale, braking, self._response_time, self.looks_ahead)
        if since == math.inf:
            table = braking.tabulate(q, v, age, self.looks_ahead, pace=scale)
            return self._is_free(tick, table)
        stop_time = self._kept.stop_time
        known = scheduler.recall_stops(tick, stop_time, later, since, soon=SOON)
        if known == PROVED or self._is_proved_ahead(tick, scale, known, stop_time, since):
            return True
        table = braking.tabulate(q, v, age, self.looks_ahead, pace=scale)
        return self._is_free(tick, table, 0.0, later, kept_since=since)

    def _is_whole_safe(self, tick: Tick, *, lasts: bool) -> bool:
        """Whether an arm at any speed is at rest before contact.

        A proof for a later STOP also covers every earlier STOP, so it answers `rests` as well. The
        exception is a stop from speeds that brakes are not stated for, whose table proves nothing.
        """
        scheduler, braking = self._scheduler, self._scheduler.arm.motion.braking
        later = self.looks_ahead - self._response_time
        soon = SOON if lasts else 0.0
        known = scheduler.recall_stops(tick, tick.late_stop_time, later, soon=soon)
        if known == PROVED:
            return True
        # What is tried now and then must not keep `rests` from asking for proofs of its own.
        if lasts and self._is_proved_ahead(tick, 1.0, known, tick.late_stop_time):
            return True
        q, v, age = tick.q, tick.v, tick.arm_age
        table = braking.tabulate(q, v, age, self.looks_ahead)
        lasting = later if braking.covers(q, v, age, self.looks_ahead) else -1.0
        return self._is_free(tick, table, lasting, later)

    def _is_proved_ahead(
        self,
        tick: Tick,
        scale: float,
        known: int,
        stop_time: float,
        kept_since: float | None = None,
    ) -> bool:
        """Whether earlier proofs cover a scale for some ticks ahead."""
        braking = self._scheduler.arm.motion.braking
        q, v, age = tick.q, tick.v, tick.arm_age
        later = self.looks_ahead - self._response_time
        longest = PROVING if kept_since is None else SCALE_PROVING
        tries = {ENDING: (longest,), ASKABLE: (longest, SHORT), IN_VAIN: (SHORT,)}[known]
        for proving in tries if self._proving > 0.0 else ():
            horizon = self.looks_ahead + proving
            if scale == 1.0 and not braking.covers(q, v, age, horizon):
                continue
            left = self.left
            table = braking.tabulate(q, v, age, horizon, pace=scale)
            is_free = self._is_free(
                tick,
                table,
                later + proving,
                later,
                stop_time,
                pause=proving if proving == longest else 0.0,
                kept_since=kept_since,
            )
            if is_free:
                return True
            self.left = left
        # Of this tick it was proved before, whether it could be renewed or not.
        return known == ENDING

    def _is_free(
        self,
        tick: Tick,
        table: JointTable,
        lasting: float = -1.0,
        until: float = 0.0,
        stop_time: float | None = None,
        *,
        pause: float = 0.0,
        kept_since: float | None = None,
    ) -> bool:
        """Whether the arm is at rest before contact, by a table, or by that of a later STOP.

        For a later STOP, `stop_time` is when an arm with a STOP by `until` is at rest.
        """
        end = float(table.time[-1])
        unsafe = self._scheduler.find_unsafe(
            tick,
            end,
            within=end if stop_time is None else stop_time + (lasting - until),
            lasting=lasting,
            until=until,
            pause=pause,
            kept_since=kept_since,
        )
        self.evaluated += unsafe.evaluated
        self.left = max(self.left, unsafe.left)
        self.offending = unsafe.pair
        return unsafe.pair == NOBODY
