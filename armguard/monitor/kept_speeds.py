"""Finds since when joints have kept below given speeds, a premise of proofs about slow arms.

A speed is measured at its stamp, within an error, and its rate of change is at most the
acceleration limit. So for some time before and after the stamp it was certainly below a bound. If
these times of successive states overlap, it was below the bound all along.

Without it, a speed scale below 1 is proved again in every tick: beside a person at 1.1 m in
`bench_near` a tick takes 76 evaluations instead of 18, and its median rises by a third.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armguard.bounds.braking import BrakingMotion
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING, TIME_ROUNDING
from armguard.robot.brakes import find_stop, rest_time
from armguard.robot.stop_time import speed_at_bite
from armguard.scheduling.scheduler import Tick


class KeptSpeeds:
    """Follows the joint states of an arm that must keep below a fraction of its velocities.

    Attributes:
        stop_time: Stop time of an arm that keeps the requested speeds until brakes engage, in [s]
            from the tick.
    """

    def __init__(self) -> None:
        self._bound: FloatArray = np.zeros(0)
        self._braking: BrakingMotion | None = None
        self._compare: Any = None
        self._followed_at = -math.inf
        self.reset()

    def reset(self) -> None:
        """Drop the history."""
        self.stop_time = math.inf
        self._since = math.inf
        self._until = -math.inf

    def follow(
        self, tick: Tick, scale: float, braking: BrakingMotion, ahead: float, horizon: float
    ) -> float:
        """Process a tick's joint state; returns since when the arm has kept the requested speeds.

        Args:
            tick: The tick.
            scale: The requested fraction of its operating velocities.
            braking: Braking motion of the arm, with its limits.
            ahead: How long it must still keep them from this tick on, in [s].
            horizon: Time until its STOP, in [s] from the tick.

        Returns:
            Time in [s] since the epoch: proofs made since then, for the speeds requested at their
            time, hold. It is inf if a joint is, or may get, too fast.
        """
        if braking is not self._braking:
            # To find out for each call what it is called with would take longer than the answer.
            self._braking, some = braking, np.zeros(len(tick.v))
            if len(self._bound) != len(some):
                self._bound = some
            self._compare = machine_code(_compare_speeds, braking.handle, some, 0.0, 0.0, 0.0, some)
        free = horizon + braking.reaction_time
        around, rest, is_lower = self._compare(
            braking.handle, np.ascontiguousarray(tick.v), tick.arm_age, scale, free, self._bound
        )
        self.stop_time = free + rest
        stamp = tick.time - tick.arm_age
        around -= TIME_ROUNDING * (abs(tick.time) + abs(tick.arm_age) + around)
        if not around >= abs(tick.arm_age) + ahead:
            self._since = math.inf
            return math.inf
        if self._since == math.inf or not (is_lower and stamp - around <= self._until):
            # Nor do proofs of an earlier tick count that was at the same time.
            is_new = tick.time != self._followed_at
            self._since = tick.time if is_new else math.nextafter(tick.time, math.inf)
        self._followed_at = tick.time
        self._until = stamp + around
        return self._since


@kernel
def _compare_speeds(
    handle: Any, v: FloatArray, age: float, scale: float, free: float, bound: FloatArray
) -> tuple[float, float, bool]:
    """How long joints certainly were, and stay, below a fraction of their velocities.

    Args:
        handle: On the `BrakingData` of an arm.
        v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        age: Of the joint state, in [s].
        scale: That fraction of their operating velocities.
        free: Time until brakes engage, in [s].
        bound: Filled with these speeds. Shape (nv,).

    Returns:
        That time before and after the stamp, in [s], below 0 where one may be faster at it; in
        which all that are no faster rest once brakes bite, in [s]; and whether none of these speeds
        is above what `bound` was before.
    """
    limits = handle.content.limits
    around, rest = np.inf, 0.0
    is_lower = True
    after = max(age, 0.0) + free
    for j in range(v.shape[0]):
        fastest = limits.operating_velocity[j] * scale
        is_lower = is_lower and fastest <= bound[j]
        bound[j] = fastest
        room = fastest - limits.velocity_error[j] - abs(v[j]) - SUM_ROUNDING * fastest
        around = min(around, room / limits.acceleration[j]) if room >= 0.0 else -np.inf
        # Nor faster than it can be by then, by the rule of the table of braking.
        speed = speed_at_bite(
            v[j], limits.velocity_error[j], fastest, limits.acceleration[j],
            limits.operating_acceleration[j], after, -age,
        )  # fmt: skip
        rest = max(rest, rest_time(find_stop(limits.brakes, j, speed), speed))
    return around, rest * (1.0 + SUM_ROUNDING), is_lower
