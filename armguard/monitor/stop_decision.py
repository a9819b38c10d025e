"""Whether the arm can still stop, and how fast it may go on.

The contact time allows for everything that the arm could do; a verdict needs less. Its arm goes on
for one more tick and, should the next verdict be STOP, brakes: if it surely rests before anything
can touch it, there is no need to stop now. A STOP that is obeyed is in time, for it is given while
the tick before still had that proof.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.scheduling.timing_wheel import NOBODY

IsFree = Callable[[Tick, float, float, float], bool]
"""Says of a tick whether the arm surely rests before contact if it goes on as before for some time,
keeps to a scale for some more, in [s], and is told to stop then."""

HALVINGS = 5
"""Of the interval in which the speed scale is sought."""

PROVING = 10e-3
"""For how long the proof that a STOP is in time should last, [s]: longer is proved of less."""

STEP, PAUSE = 1e-3, 10e-3
"""How long a step of the search may take, and how long there is none after its end, [s]."""


class StopDecision:
    """Asks a scheduler whether the arm rests in time, by its table of braking.

    Args:
        scheduler: Knows the pairs.
        period: Of ticks, in [s].
        response_time: Period plus latency, in [s]: until the verdict after this one is obeyed.
        going_on: How long a speed scale must be safe, in [s].
        rise_delay: How long a higher scale must have been safe before it is given out, in [s].

    Attributes:
        evaluated: Evaluations so far.
        left: Obstacles that were not decided about, where the user's budget was spent since this
            was set to 0 last.
        held: Scales below the whole that were found in the last `rise_delay`, each with its time;
            the least first.
        looks_ahead: How long from its tick on an arm goes on in the proof of a scale, in [s].
    """

    def __init__(
        self,
        scheduler: Scheduler,
        period: float,
        response_time: float,
        going_on: float,
        rise_delay: float,
    ) -> None:
        self.evaluated = self.left = 0
        self._scheduler = scheduler
        self._response_time = response_time
        self._proving = PROVING if period < 0.5 * PROVING else 0.0
        """For how long a STOP is proved to be in time, in [s]; 0: for the tick at hand."""
        self._rise_delay = rise_delay
        self._steps = max(1, math.ceil(period / STEP))
        """Steps of the search in each tick."""
        self._pause = math.ceil(PAUSE / period)
        ticks = math.ceil((HALVINGS + 1) / self._steps)
        # In seconds, not in ticks: those may come late, and what was proved holds no longer then.
        self._searching = ticks * period
        """How long a search may take: its proofs let the arm go on as before for so long, [s]."""
        self._lasting = (2 * ticks + self._pause) * period
        """How long a scale counts once it was found safe: to the end of the next search, [s]."""
        # What a search finds is obeyed only when it is over, and must last until the next one is.
        self._obeyed_after = response_time + self._searching
        self._going_on = going_on + self._lasting
        self.looks_ahead = self._obeyed_after + self._going_on
        self.reset()

    def reset(self) -> None:
        """Forget the speed scales found and given out so far."""
        self.held: deque[tuple[float, float]] = deque()
        self.restart_search()

    def restart_search(self) -> None:
        """Let no scale that was found so far count as safe: what it rests on has changed."""
        self._step = 0
        self._safe, self._safe_at = 0.0, -math.inf
        self._low, self._high, self._low_at = 0.0, 1.0, -math.inf
        self._began_at = -math.inf

    def rests(self, tick: Tick) -> bool:
        """Whether the arm surely rests before contact, braking only after the next tick.

        What an arm can do that is told to stop in one of the next ticks is proved first: that
        holds for each of them, so that most ticks find all obstacles proved already.
        """
        scheduler, braking = self._scheduler, self._scheduler.arm.motion.braking
        q, v, age, response_time = tick.q, tick.v, tick.arm_age, self._response_time
        if not braking.covers(v, age, response_time):
            return False
        if scheduler.is_stop_proved(tick):
            return True
        if self._proving > 0.0 and braking.covers(v, age, response_time + self._proving):
            left = self.left
            table = braking.tabulate(q, v, age, response_time + self._proving)
            if self._is_free(tick, float(table.time[-1]), self._proving):
                return True
            # What this left over is asked again, of a STOP in this tick alone.
            self.left = left
        table = braking.tabulate(q, v, age, response_time)
        return self._is_free(tick, float(table.time[-1]), 0.0)

    @property
    def braking_delay(self) -> float:
        """From a tick until an arm that obeys its scale brakes at the earliest, in [s]."""
        return self._obeyed_after + self._scheduler.arm.motion.braking.reaction_time

    def covers(self, tick: Tick) -> bool:
        """Whether brakes are stated for all that joints can do until they obey a scale."""
        braking = self._scheduler.arm.motion.braking
        return braking.covers(tick.v, tick.arm_age, self._obeyed_after)

    def find_scale(self, tick: Tick, is_free: IsFree | None = None) -> float:
        """The greatest fraction of their operating velocities at which joints may go on, in [0, 1].

        Of an arm on a known path it is its clock that is scaled, and `is_free` that is asked.

        An arm that obeys and keeps to it for `going_on` seconds, and brakes then, surely rests
        before contact: joints that are faster slow down as if they braked, the others get no
        faster. So an arm on its way out may go on as fast as it is. A search takes a few ticks;
        what it found safe was proved for so much longer that it still holds when the next is over.
        """
        steps = self._steps
        if not tick.time - self._safe_at < self._lasting:
            # There is nothing to give out meanwhile: search to the end.
            self._step, steps = 0, HALVINGS + 1
        elif 0 < self._step <= HALVINGS and not tick.time - self._began_at <= self._searching:
            # Ticks came late, or none was asked for meanwhile: what was found is obeyed too late.
            self._step = 0
        for _ in range(steps):
            if not self._search(tick, is_free):
                break
        return self._safe if tick.time - self._safe_at < self._lasting else 0.0

    def _search(self, tick: Tick, is_free: IsFree | None) -> bool:
        """One step: the first tries the whole, the others halve. Whether there is another one."""
        if self._step > HALVINGS:
            self._step += 1
            if self._step > HALVINGS + self._pause:
                self._step = 0
            return False
        if self._step == 0:
            self._low, self._high, self._low_at = 0.0, 1.0, tick.time
            self._began_at = tick.time
        scale = 1.0 if self._step == 0 else 0.5 * (self._low + self._high)
        if is_free is None:
            safe = self._is_safe(tick, scale)
        else:
            safe = is_free(tick, self._obeyed_after, self._going_on, scale)
        if safe:
            self._low, self._low_at = scale, tick.time
        else:
            self._high = scale
        self._step += 1
        if self._low < 1.0 and self._step <= HALVINGS:
            return True
        self._safe, self._safe_at = self._low, self._low_at
        self._step = HALVINGS + 1
        return False

    def hold_scale(self, now: float, scale: float) -> float:
        """The scale to give out at `now` [s]: the least of those found in the last `rise_delay`."""
        recent = self.held
        while recent and recent[-1][1] >= scale:
            recent.pop()
        if scale < 1.0:
            # The whole need not be kept: it is what there is without anything less.
            recent.append((now, scale))
        while recent and recent[0][0] < now - self._rise_delay:
            recent.popleft()
        return recent[0][1] if recent else 1.0

    def _is_safe(self, tick: Tick, scale: float) -> bool:
        table = self._scheduler.arm.motion.braking.tabulate(
            tick.q, tick.v, tick.arm_age, self._obeyed_after, going_on=self._going_on, scale=scale
        )
        return self._is_free(tick, float(table.time[-1]))

    def _is_free(self, tick: Tick, stop_time: float, lasting: float = -1.0) -> bool:
        unsafe = self._scheduler.find_unsafe(tick, stop_time, lasting=lasting)
        self.evaluated += unsafe.evaluated
        self.left = max(self.left, unsafe.left)
        return unsafe.pair == NOBODY
