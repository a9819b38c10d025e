"""Velocity bounds of another arm from a plan that it has shared until a stated time.

An arm shares a plan by a promise: from the plan's first sample until the time `until`, it does
nothing but follow the plan, on time or with a slowed clock, or stop, at any moment and however it
likes: each joint by itself or on the path, to rest or until it goes on along the plan. The promise
cannot be revoked, so its end need not be communicated in time: a late or lost message makes no
bound wrong. A controller that needs another motion must wait until `until`.

What all these motions have in common is a ceiling for each joint and way of turning. At a time t
the arm has got no further along its plan than it would have on time, since no clock runs fast; so
a joint that follows is no faster forwards than

    W(t) = max over s <= t of max(0, dq/ds) + the velocity's tracking error,

and one that stops gets slower. W never falls, so it holds at t whatever happened before. Between
samples the plan is cubic, its velocity a quadratic, and in Bernstein's form that lies between the
least and the greatest of v0, 3 (q1 - q0)/h - v0 - v1, and v1.

After `until`, operating limits (v°, a°) alone hold: forwards the joint is no faster than the lesser
of v° and W(until) + a° (t - until). And from its state at t0 on it is always no faster than
max(0, v) + dv + a° (t - t0). `SharedPlan.narrow` finds a line above the least of these:

    max(0, v) + dv + lift + slope (t - t0),    slope <= a°.

The lift reaches up to W(t0), and the slope is the steepest that any later step of W, or the time
after `until`, asks for. Lift 0 with slope a° is what holds without a plan; of the two, that which
lets a joint turn less far within `STOPPING_TIME` is taken. Both are sound, and both ways of turning
are bounded by the same line.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.planned.plan import Refusal, read_plan
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import ACCEPTANCE_SLACK, SUM_ROUNDING
from armguard.robot.wrap_angle import unwrap

STOPPING_TIME = 0.2
"""About as long as arms take to stop, in [s]: what is narrow within that time averts most stops."""

MOST_SAMPLES = 2000
"""Of a plan, so that to take it fits into a tick or two."""

_STEPS = 32
"""Most steps of the ceilings, so that a plan of many samples costs no more than others."""


class SharedPlan(NamedTuple):
    """Bounds from a shared plan; times in [s] on the clock of the arm's joint states."""

    start: float
    """It holds from then on."""
    until: float
    """And until then."""
    begins: FloatArray
    """When each step of the ceilings begins, rising. Shape (m,)."""
    ceilings: FloatArray
    """Greatest velocities forwards, [:, 0], and backwards, [:, 1], up to the end of each step; in
    [rad]/[s] or [m]/[s], at least 0, never falling. Shape (m, 2, nv)."""

    def find_excess(self, stamp: float, v: FloatArray, velocity_error: FloatArray) -> FloatArray:
        """How much joints are certainly faster than the plan allows; at most 0 if they are not.

        Args:
            stamp: Of the joint state, in [s].
            v: Its velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            velocity_error: What they may be off by, alike. Shape (nv,).

        Returns:
            In [rad]/[s] or [m]/[s]. Shape (nv,).
        """
        ceiling = self.ceilings[self._step_at(stamp)]
        slack = ACCEPTANCE_SLACK * (np.abs(v) + velocity_error)
        return np.maximum(v - ceiling[0], -v - ceiling[1]) - velocity_error - slack

    def narrow(
        self, stamp: float, fastest: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """A line that no joint's velocity exceeds, whichever way it turns, from a state on.

        Args:
            stamp: Of the state, in [s], from `start` to before `until`.
            fastest: How fast joints may be then, forwards and backwards: max(0, ±v) + dv.
                Shape (2, nv).
            velocity: Operating velocities. Shape (nv,).
            acceleration: Operating accelerations. Shape (nv,).

        Returns:
            What joints may be faster by at once, in [rad]/[s] or [m]/[s], and how much faster they
            may get a second, no more than `acceleration`. Shape (nv,) each.
        """
        step = self._step_at(stamp)
        slack = ACCEPTANCE_SLACK * (abs(stamp) + abs(self.until))
        lift = np.maximum(self.ceilings[step] - fastest, 0.0)
        begin = fastest + lift
        # After the end, up to the operating velocity as soon as that can be.
        at_end = np.minimum(self.ceilings[-1], velocity)
        left = max(self.until - stamp - slack, 0.0)
        with np.errstate(all="ignore"):
            steep = (velocity - begin) / (left + (velocity - at_end) / acceleration)
            if step + 1 < len(self.begins):
                elapsed = np.maximum(self.begins[step + 1 :] - stamp - slack, 0.0)
                rise = (self.ceilings[step + 1 :] - begin) / elapsed[:, None, None]
                steep = np.maximum(steep, rise.max(axis=0))
        slope = np.maximum(steep, 0.0).max(axis=0) * (1.0 + SUM_ROUNDING)
        higher = lift.max(axis=0)
        # What is no number is none here; then joint limits alone count.
        is_less = higher + 0.5 * STOPPING_TIME * slope < 0.5 * STOPPING_TIME * acceleration
        is_less &= slope <= acceleration
        return np.where(is_less, higher, 0.0), np.where(is_less, slope, acceleration)

    def _step_at(self, stamp: float) -> int:
        """The step that a time falls into; where it is sure in none, the later one."""
        slack = ACCEPTANCE_SLACK * (abs(stamp) + abs(self.until))
        return max(int(np.searchsorted(self.begins, stamp + slack, side="right")) - 1, 0)


def read_shared_plan(
    plan: object, until: object, fastest: FloatArray, clock_error: float = 0.0
) -> SharedPlan:
    """The bounds from a shared plan.

    Args:
        plan: An `armguard.Plan` that says how far velocities may be off, and that ends at rest or
            not before `until`, of `MOST_SAMPLES` at most.
        until: Time until which the arm follows it, in [s] on the clock of its stamp.
        fastest: Greatest speeds of continuous joints, whose positions may wrap, in [rad]/[s]; inf
            for all others. Shape (nv,).
        clock_error: What that clock may be off by, either way, in [s].

    Raises:
        ArmguardError: The plan cannot be used; the message says why.
    """
    found = read_plan(plan, len(fastest))
    if isinstance(found, Refusal):
        raise ArmguardError(f"shared plan: {found.subject}", found.detail)
    times, q, v = (np.asarray(one, dtype=np.float64) for one in (found.times, found.q, found.v))
    if len(times) > MOST_SAMPLES:
        raise ArmguardError(
            "shared plan", f"has {len(times)} samples", expected=f"{MOST_SAMPLES} at most"
        )
    if found.velocity_tracking_error is None:
        raise ArmguardError(
            "shared plan",
            "has no velocity_tracking_error",
            expected="how far velocities may be off: it bounds what the other arm counts on",
        )
    if not 0.0 <= clock_error < math.inf:
        raise ArmguardError(
            "clock_error", f"is {clock_error!r}", expected="a finite time, at least 0, in [s]"
        )
    try:
        end = float(until) if isinstance(until, (int, float, np.integer, np.floating)) else math.nan
    except OverflowError:  # an integer beyond all floats
        end = math.nan
    start = found.stamp + clock_error
    end -= clock_error
    if not start < end < math.inf:
        raise ArmguardError(
            "until", f"is {until!r}", expected=f"a finite time after {start:.6g} s, its beginning"
        )
    q = unwrap(times, q, fastest)
    tracking = np.asarray(found.velocity_tracking_error, dtype=np.float64)
    if v[-1].any() and not found.stamp + times[-1] >= end + clock_error:
        raise ArmguardError(
            "shared plan",
            f"ends {end - found.stamp - times[-1]:.4g} s before `until`, and not at rest",
            expected="velocities of 0 at the last sample, or samples up to `until`",
        )
    # Overflow is a ceiling of infinity, which narrows nothing.
    with np.errstate(over="ignore"):
        lasting = np.diff(times)[:, None]
        middle = 3.0 * np.diff(q, axis=0) / lasting - v[:-1] - v[1:]
        terms = (np.abs(q[:-1]) + np.abs(q[1:])) / lasting + np.abs(v[:-1]) + np.abs(v[1:])
        rounding = SUM_ROUNDING * terms
    forwards = np.maximum(np.maximum(v[:-1], v[1:]), middle) + rounding
    backwards = np.maximum(np.maximum(-v[:-1], -v[1:]), -middle) + rounding
    ceilings = np.maximum(np.stack([forwards, backwards], axis=1), 0.0)
    ceilings = np.maximum.accumulate(ceilings, axis=0) + tracking
    # A clock that is off may show the arm further along its plan.
    begins = found.stamp + times[:-1] - clock_error
    count = max(int(np.searchsorted(begins, end)), 1)
    # Ceilings never fall, so the last one of some steps holds for all of them.
    last = np.unique(np.linspace(0, count, min(count, _STEPS) + 1).astype(np.int64)[1:] - 1)
    first = np.concatenate([[0], last[:-1] + 1])
    return SharedPlan(start, end, begins[first], ceilings[last])
