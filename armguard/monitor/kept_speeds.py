"""Since when joints have surely kept to some speeds: what proofs about such an arm rest on.

A speed is measured at its stamp, within an error, and changes by no more than the acceleration
limit, before the stamp and after. So it is known for how long either way it was surely below a
bound; where these times of successive states meet, it was so all along.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armguard.bounds.braking import BrakingMotion
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING, TIME_ROUNDING
from armguard.robot.brakes import find_stop, rest_time
from armguard.scheduling.scheduler import Tick


class KeptSpeeds:
    """Follows the joint states of an arm that is to keep to a fraction of its velocities.

    Attributes:
        rest_time: In which the arm rests from the speeds asked for last once brakes bite, in [s].
    """

    def __init__(self) -> None:
        self._bound: FloatArray = np.zeros(0)
        self.reset()

    def reset(self) -> None:
        """Forget what was kept to so far."""
        self.rest_time = math.inf
        self._since = math.inf
        self._until = -math.inf

    def follow(self, tick: Tick, scale: float, braking: BrakingMotion, ahead: float) -> float:
        """Take a tick's joint state: since when has the arm kept to what was asked of it so far?

        Args:
            tick: The tick.
            scale: What it is to keep to, as a fraction of its operating velocities.
            braking: Of the arm; its limits count.
            ahead: For how long it must surely keep to it from this tick on, in [s].

        Returns:
            In [s] since the epoch: proofs made since then, for the speeds asked for at their time,
            hold for these speeds. It is inf where a joint is, or may be by then, too fast.
        """
        if len(self._bound) != len(tick.v):
            self._bound = np.zeros(len(tick.v))
        around, self.rest_time, is_lower = _compare_speeds(
            braking.handle, tick.v, scale, self._bound
        )
        stamp = tick.time - tick.arm_age
        around -= TIME_ROUNDING * (abs(tick.time) + abs(tick.arm_age) + around)
        if not around >= abs(tick.arm_age) + ahead:
            self._since = math.inf
            return math.inf
        if self._since == math.inf or not (is_lower and stamp - around <= self._until):
            self._since = tick.time
        self._until = stamp + around
        return self._since


@kernel
def _compare_speeds(
    handle: Any, v: FloatArray, scale: float, bound: FloatArray
) -> tuple[float, float, bool]:
    """For how long joints surely were and are no faster than a fraction of their velocities.

    Args:
        handle: On the `BrakingData` of an arm.
        v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        scale: That fraction of their operating velocities.
        bound: Filled with these speeds. Shape (nv,).

    Returns:
        That time before and after the stamp, in [s], below 0 where one may be faster at it; in
        which all rest from these speeds once brakes bite, in [s]; and whether none of these speeds
        is above what `bound` was before.
    """
    limits = handle.content.limits
    around, rest = np.inf, 0.0
    is_lower = True
    for j in range(v.shape[0]):
        fastest = limits.operating_velocity[j] * scale
        is_lower = is_lower and fastest <= bound[j]
        bound[j] = fastest
        room = fastest - limits.velocity_error[j] - abs(v[j]) - SUM_ROUNDING * fastest
        around = min(around, room / limits.acceleration[j]) if room >= 0.0 else -np.inf
        rest = max(rest, rest_time(find_stop(limits.brakes, j, fastest), fastest))
    return around, rest * (1.0 + SUM_ROUNDING), is_lower
