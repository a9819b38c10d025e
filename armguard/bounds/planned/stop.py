"""Stops that a plan carries or that begin on it: appended, checked, and how soon they end.

Joint by joint, each joint decelerates by what its brake guarantees. On the path, all joints slow
down together: with s the path time, the arm at q(s) and the clock's pace ds/dt = w, a joint's
acceleration is q''(s) w² + q'(s) dw/dt. With w <= 1 none needs more than its brake's b_i while

    -dw/dt <= min_i (b_i - |q''_i|) / |q'_i|.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.planned.curve import interval_at, interval_coefficients
from armguard.bounds.planned.plan import Plan, Refusal, read_plan
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK, SUM_ROUNDING, TERM_ROUNDING

GRAIN = 1e-6
"""What the lasting of a joint's stop is rounded up to, in [s]."""


def append_stop(plan: Plan, braking: FloatArray, *, on_path: bool) -> Plan | Refusal:
    """The plan with a stop at its end, not harder than brakes guarantee; or what is wrong with it.

    Args:
        plan: Anything at all.
        braking: Guaranteed decelerations, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        on_path: Whether all joints stop together, straight on from the plan's end; else each
            decelerates as much as its brake guarantees.

    Returns:
        A plan of the same samples and some more; positions and velocities are continuous, and a
        plan that ends at rest comes back with the same samples.
    """
    read = read_plan(plan, len(braking))
    if isinstance(read, Refusal):
        return read
    times, q, v = (np.asarray(part) for part in (read.times, read.q, read.v))
    pace = np.abs(v[-1])
    with np.errstate(all="ignore"):
        # No harder than guaranteed, and no two samples closer than a grain.
        each = np.ceil(pace / braking / GRAIN) * GRAIN
        if on_path:
            each[:] = each.max()
        # Every joint's motion is quadratic between these, which cubics through samples reproduce.
        lasting = np.unique(each[each > 0.0])[:, None]
        left = np.maximum(1.0 - lasting / np.where(each > 0.0, each, 1.0), 0.0)
        # The mean velocity until a sample is that between both ends.
        more_q = q[-1] + 0.5 * np.minimum(lasting, each) * v[-1] * (1.0 + left)
        more_v = v[-1] * left
        more_times = times[-1] + lasting[:, 0]
    if not (np.isfinite(more_q).all() and (np.diff(more_times, prepend=times[-1]) > 0.0).all()):
        return Refusal("plan", f"ends at {pace.max():.4g}, from which no stop can be reckoned")
    return read._replace(
        times=np.concatenate([times, more_times]),
        q=np.concatenate([q, more_q]),
        v=np.concatenate([v, more_v]),
    )


@kernel
def find_hard_stop(
    times: FloatArray, q: FloatArray, v: FloatArray, allowed: FloatArray
) -> tuple[int, float, float]:
    """The first joint that comes to rest harder than allowed, that deceleration, and when.

    A joint's stop is its last phase of slowing down before it rests for good.

    Args:
        times: Of the samples, in [s], rising. Shape (k,), k >= 2.
        q: Positions, in [rad] or [m]. Shape (k, nv).
        v: Velocities, the last ones 0, in [rad]/[s] or [m]/[s]. Shape (k, nv).
        allowed: In [rad]/[s²] or [m]/[s²]. Shape (nv,).

    Returns:
        -1 for the joint where there is none.
    """
    for j in range(q.shape[1]):
        heading = 0.0
        # Backwards from the end: past where the joint rests, then through its last phase.
        for k in range(times.shape[0] - 2, -1, -1):
            h, c, d = interval_coefficients(times, q, v, k, j)
            moved = q[k + 1, j] - q[k, j]
            if heading == 0.0:
                fastest = max(abs(v[k, j]), abs(v[k + 1, j]))
                if max(fastest, abs(moved)) <= LIMIT_SLACK:
                    continue
                heading = math.copysign(1.0, v[k, j] if abs(v[k, j]) > LIMIT_SLACK else moved)
            first, last = -heading * 2.0 * c, -heading * (2.0 * c + 6.0 * d * h)
            # What rounding of the samples themselves does to those differences.
            size = (abs(q[k, j]) + abs(q[k + 1, j])) / h + abs(v[k, j]) + abs(v[k + 1, j])
            slack = 8.0 * TERM_ROUNDING * size / h
            # The acceleration is linear between samples, so it is greatest at one of them.
            if not max(first, last) <= allowed[j] + slack:
                return j, max(first, last), times[k]
            if first <= 0.0 or heading * v[k, j] <= 0.0:
                break
    return -1, 0.0, 0.0


@kernel
def bound_path_braking(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    braking: FloatArray,
    first: float,
    last: float,
) -> tuple[float, int, float]:
    """How fast the path's clock can surely be slowed down between two times, in [1]/[s].

    Args:
        times: Of the samples, in [s], rising. Shape (k,), k >= 2.
        q: Positions, in [rad] or [m]. Shape (k, nv).
        v: Velocities, in [rad]/[s] or [m]/[s]. Shape (k, nv).
        braking: Guaranteed decelerations, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        first: In [s], as in `times`.
        last: In [s], as in `times`, >= first.

    Returns:
        Deceleration of the clock, at its pace of 1 or below; the joint that decides, and the
        sample before; inf and -1 where no joint moves. 0 or less: brakes guarantee none.
    """
    least, joint, when = math.inf, -1, 0.0
    for k in range(interval_at(times, first), interval_at(times, last) + 1):
        for j in range(q.shape[1]):
            h, c, d = interval_coefficients(times, q, v, k, j)
            bend = max(abs(2.0 * c), abs(2.0 * c + 6.0 * d * h))
            pace = max(abs(v[k, j]), abs(v[k + 1, j]))
            turn = -c / (3.0 * d) if d != 0.0 else 0.0
            if 0.0 < turn < h:
                pace = max(pace, abs(v[k, j] + turn * c))
            spare = braking[j] * (1.0 - SUM_ROUNDING) - bend
            if pace > 0.0 or not spare > 0.0:
                found = spare / pace if spare > 0.0 else spare
                if not found >= least:
                    least, joint, when = found, j, times[k]
    return least, joint, when
