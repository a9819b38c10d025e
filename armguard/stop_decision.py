"""Whether the arm can still stop, and how fast it may go on.

The contact time allows for everything that the arm could do; a verdict needs less. Its arm goes on
for one more tick and, should the next verdict be STOP, brakes: if it surely rests before anything
can touch it, there is no need to stop now. A STOP that is obeyed is in time, for it is given while
the tick before still had that proof.
"""

from __future__ import annotations

import math

from armguard.schedules.wheel import NOBODY
from armguard.watch import Tick, Watch

HALVINGS = 5
"""Of the interval in which the speed scale is sought."""

PAUSE = 10
"""Ticks between two searches."""

LASTING = 2 * (HALVINGS + 1) + PAUSE
"""Ticks that a scale lasts once it was found safe: until the search after the next one is over."""


class StopDecision:
    """Asks a watch whether the arm rests in time, by its table of braking.

    Args:
        watch: Knows the pairs.
        period: Of ticks, in [s].
        horizon: Period plus latency, in [s]: until the verdict after this one is obeyed.
        going_on: How long a speed scale must be safe, in [s].
        hold: How long a higher scale must have been safe before it is given out, in [s].
    """

    def __init__(
        self, watch: Watch, period: float, horizon: float, going_on: float, hold: float
    ) -> None:
        self._watch = watch
        self._horizon = horizon
        self._going_on = going_on + LASTING * period
        self._hold = hold
        self.reset()

    def reset(self) -> None:
        """Forget the speed scales given out so far."""
        self._given, self._given_at = 1.0, -math.inf
        self.restart_search()
        self._safe, self._safe_at = 0.0, -LASTING

    def restart_search(self) -> None:
        """Let no scale that was found so far count as safe: there are obstacles that it ignores."""
        self._step = 0
        self._safe, self._safe_at = 0.0, -LASTING
        self._low, self._high, self._low_at = 0.0, 1.0, -LASTING

    def rests(self, tick: Tick) -> bool:
        """Whether the arm surely rests before contact, braking only after the next tick."""
        braking = self._watch.arm.motion.braking
        table = braking.tabulate(tick.q, tick.v, tick.arm_age, self._horizon)
        return self._watch.find_unsafe(tick, float(table.time[-1])) == NOBODY

    def find_scale(self, tick: Tick, *, at_once: bool) -> float:
        """The greatest fraction of their velocity limits at which joints may go on, in [0, 1].

        An arm that keeps to it for `going_on` seconds and brakes then surely rests before contact:
        joints that are faster slow down as if they braked, the others get no faster. So an arm on
        its way out may go on as fast as it is. A search takes a step a tick; what it found safe was
        proved for so much longer that it still holds when the next search is over.

        Args:
            tick: The present one.
            at_once: Whether to search to the end in this tick.
        """
        self._search(tick)
        while at_once and 0 < self._step <= HALVINGS:
            self._search(tick)
        return self._safe if tick.number - self._safe_at < LASTING else 0.0

    def _search(self, tick: Tick) -> None:
        """One step: the first tries the whole, the others halve; then there is a pause."""
        if self._step <= HALVINGS:
            scale = 1.0 if self._step == 0 else 0.5 * (self._low + self._high)
            if self._is_safe(tick, scale):
                self._low, self._low_at = scale, tick.number
            else:
                self._high = scale
        self._step += 1
        if self._low == 1.0 or self._step == HALVINGS + 1:
            self._safe, self._safe_at = self._low, self._low_at
            self._low, self._high, self._low_at = 0.0, 1.0, -LASTING
            self._step = HALVINGS + 1
        elif self._step > HALVINGS + PAUSE:
            self._step = 0

    def hold_scale(self, now: float, scale: float) -> float:
        """The scale to give out at `now`, in [s]: it falls at once and rises after `hold`."""
        if scale <= self._given:
            self._given, self._given_at = scale, now
        elif not now - self._given_at < self._hold:
            self._given = scale
        return self._given

    def _is_safe(self, tick: Tick, scale: float) -> bool:
        table = self._watch.arm.motion.braking.tabulate(
            tick.q, tick.v, tick.arm_age, self._horizon, going_on=self._going_on, scale=scale
        )
        return self._watch.find_unsafe(tick, float(table.time[-1])) == NOBODY
