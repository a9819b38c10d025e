"""Whether the arm can still stop, and how fast it may go on.

The contact time allows for everything that the arm could do; a verdict needs less. Its arm goes on
for one more tick and, should the next verdict be STOP, brakes: if it surely rests before anything
can touch it, there is no need to stop now. A STOP that is obeyed is in time, for it is given while
the tick before still had that proof.
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
"""To what a speed scale is found, at least."""

RAISE_PAUSE = 10e-3
"""How long after a higher scale was found unsafe none is tried, in [s]."""

LONGEST_PROMISE = 30e-3
"""For how long a scale promises that the arm may go on, at most, in [s]: by its delays alone a slow
brake would make a promise that leaves no speed wherever a person is near (docs/usefulness.md)."""

PROVING = 10e-3
"""For how long the proof that a STOP is in time should last, [s]: longer is proved of less."""

SCALE_PROVING = 14e-3
"""For how long the proof of a speed scale below 1 should last, [s]: joints that keep to it get less
far, so that hardly less is proved."""

CAUTIOUS_TIME = 1.0
"""For how long after a fall of the scale a higher one must be proved for `RISE_PROVING`, [s]."""

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
    """Asks a scheduler whether the arm rests in time, by its table of braking.

    Args:
        scheduler: Knows the pairs.
        settings: When verdicts are obeyed, and from when on brakes engage.

    Attributes:
        evaluated: Evaluations so far.
        left: Obstacles that were not decided about, where the user's budget was spent since this
            was set to 0 last.
        offending: The pair for which the last question was denied; NOBODY where none was, or brakes
            are not stated for what joints can do.
        thrown: The joint for which the last question was denied, whatever is near: its stop may
            throw it back faster than its brakes are stated for. `ALL_COVERED` if there is none.
        limiting: The pair that keeps the scale below what was asked for, as far as that is known.
        braking_delay: From a tick until brakes bite that its verdict, or the next one, calls for,
            in [s].
        looks_ahead: When the arm is told to stop in the proof of a scale, in [s] from its tick.
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
        """Forget what was asked before."""
        self.offending = self.limiting = NOBODY
        self.thrown = ALL_COVERED
        self._unsafe_in = -9
        self._raise_at = self._fell_at = -math.inf
        self._kept.reset()

    def rests(self, tick: Tick) -> bool:
        """Whether the arm surely rests before contact, braking only after the next tick.

        What an arm can do that is told to stop in one of the next ticks is proved first: that
        holds for each of them, so that most ticks find all obstacles proved already.
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
        """The fraction of their operating velocities at which joints may go on, at most `most`.

        An arm whose joints are no faster may go on so for as long as a STOP takes to reach the
        brakes, at most `LONGEST_PROMISE`, and surely rests before contact if the next verdict
        after that tells it to stop. A faster one is to slow down; whether it has to stop, is what
        the level says.

        What this returns was proved in this very tick, or in earlier ones: of the whole, by proofs
        that last; of less, by such as hold for an arm that has kept to it since. The search begins
        at what was given out last, so most ticks take no question: few ask for a proof that lasts,
        for a shorter one where that is not to be had, and at last of this tick alone; only where
        the last scale is safe no more, it is a bisection. A higher one has to be proved for some
        time ahead: a scale that had to fall again at once would make the arm jerk.

        Args:
            tick: The tick.
            given: The scale that was given out last.
            most: The most that is asked for.
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
        """Whether an arm that keeps to a scale rests in time; at 0 it rests already.

        What `lasts` is proved for some ticks at once, where it can be.
        """
        if scale == 0.0:
            return True
        if scale == 1.0:
            return self._is_whole_safe(tick, lasts=lasts)
        return self._is_paced_safe(tick, scale, lasts=lasts)

    def _is_paced_safe(self, tick: Tick, scale: float, *, lasts: bool) -> bool:
        """Whether an arm whose joints keep to a scale rests in time.

        One that does so for some ticks on end can be told to stop that much later as well; what is
        proved of that holds for as long as joints have surely been no faster.
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
        """Whether an arm at any speed rests in time.

        An arm that can be told to stop so much later can be told to at any time before, so what
        this proves answers `rests` as well: unless brakes are not stated for what joints can do by
        then, since the table of such a stop proves nothing.
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
        """Whether a scale is proved for some ticks at once, by what is known of it from earlier."""
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
        """Whether the arm rests before contact, by a table, or one of a STOP that comes later.

        Of the latter, `stop_time` is when the arm rests that is told to stop by `until`.
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
