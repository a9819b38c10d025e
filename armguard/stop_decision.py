"""Whether the arm can still stop, and how fast it may go on.

The contact time allows for everything that the arm could do; a verdict needs less. Its arm goes on
for one more tick and, should the next verdict be STOP, brakes: if it surely rests before anything
can touch it, there is no need to stop now. A STOP that is obeyed is in time, for it is given while
the tick before still had that proof.
"""

from __future__ import annotations

import math

from armguard.bounds import BrakingMotion
from armguard.schedules.wheel import NOBODY
from armguard.watch import Tick, Watch

HALVINGS = 5
"""Of the interval in which the speed scale is sought."""


class StopDecision:
    """Asks a watch whether the arm rests in time, by its table of braking.

    Args:
        watch: Knows the pairs.
        horizon: Period plus latency, in [s]: until the verdict after this one is obeyed.
        going_on: How long a speed scale must be safe, in [s].
        hold: How long a higher scale must have been safe before it is given out, in [s].
    """

    def __init__(self, watch: Watch, horizon: float, going_on: float, hold: float) -> None:
        self._watch = watch
        self._horizon = horizon
        self._going_on = going_on
        self._hold = hold
        self.reset()

    def reset(self) -> None:
        """Forget the speed scales given out so far."""
        self._scale = 1.0
        self._scale_at = -math.inf

    def rests(self, tick: Tick) -> bool:
        """Whether the arm surely rests before contact, braking only after the next tick."""
        braking = self._watch.arm.motion.braking
        table = braking.tabulate(tick.q, tick.v, tick.arm_age, self._horizon)
        return self._watch.find_unsafe(tick, float(table.time[-1])) == NOBODY

    def speed_scale(self, tick: Tick) -> float:
        """The greatest fraction of their velocity limits at which joints may go on, in [0, 1].

        An arm that keeps to it for `going_on` seconds and brakes then surely rests before contact:
        joints that are faster slow down as if they braked, the others get no faster. So an arm on
        its way out may go on as fast as it is.
        """
        if self._is_safe(tick, 1.0):
            return 1.0
        safe, unsafe = 0.0, 1.0
        for _ in range(HALVINGS):
            scale = 0.5 * (safe + unsafe)
            if self._is_safe(tick, scale):
                safe = scale
            else:
                unsafe = scale
        return safe

    def hold_scale(self, now: float, scale: float) -> float:
        """The scale to give out at `now`, in [s]: it falls at once and rises after `hold`."""
        if scale <= self._scale:
            self._scale, self._scale_at = scale, now
        elif not now - self._scale_at < self._hold:
            self._scale = scale
        return self._scale

    def _is_safe(self, tick: Tick, scale: float) -> bool:
        braking: BrakingMotion = self._watch.arm.motion.braking
        table = braking.tabulate(
            tick.q, tick.v, tick.arm_age, self._horizon, going_on=self._going_on, scale=scale
        )
        return self._watch.find_unsafe(tick, float(table.time[-1])) == NOBODY
