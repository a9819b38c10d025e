"""Stops of plans, joint by joint or on the path, and their check.

Joint by joint, each joint decelerates by what its brake guarantees. On the path, all joints slow
down together: with s the path time, the arm at q(s) and the clock's pace ds/dt = w, a joint's
acceleration is q''(s) w² + q'(s) dw/dt. With w <= 1 none needs more than its brake's b_i while

    -dw/dt <= min_i (b_i - |q''_i|) / |q'_i|.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.checks import check_duration
from armguard.bounds.planned.curve import (
    curve_range,
    evaluate_curve,
    find_top_speeds,
    interval_at,
    interval_coefficients,
    top_speed_between,
)
from armguard.bounds.planned.findings import FINE, HARD, UNCOVERED
from armguard.bounds.planned.plan import MOST_SAMPLES, Plan, Refusal, read_plan
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK, SUM_ROUNDING, TERM_ROUNDING
from armguard.robot.brakes import BrakeCurves, find_gentlest_stop
from armguard.robot.robot import Robot

GRAIN = 1e-6
"""What the lasting of a joint's stop is rounded up to, in [s]."""

PATH_STEP = 2e-3
"""Longest time between samples of a stop on a bending path, in [s]."""

PATH_SHARE = 0.98
"""How much of the possible slowing a stop on a bending path uses: cubics between its samples bend a
little more than the path does."""


def append_stop(plan: Plan, braking: FloatArray) -> Plan | Refusal:
    """The plan with a stop at its end, joint by joint; or a refusal.

    Args:
        plan: Any object; a malformed plan is refused.
        braking: Guaranteed decelerations, in [rad]/[s²] or [m]/[s²]. Shape (nv,).

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
        # Every joint's motion is quadratic between these, which cubics through samples reproduce.
        lasting = np.unique(each[each > 0.0])[:, None]
        left = np.maximum(1.0 - lasting / np.where(each > 0.0, each, 1.0), 0.0)
        # The mean velocity until a sample is that between both ends.
        more_q = q[-1] + 0.5 * np.minimum(lasting, each) * v[-1] * (1.0 + left)
        more_v = v[-1] * left
        more_times = times[-1] + lasting[:, 0]
    if not (np.isfinite(more_q).all() and (np.diff(more_times, prepend=times[-1]) > 0.0).all()):
        return Refusal("plan", f"ends at {pace.max():.4g}, from which no stop can be computed")
    return read._replace(
        times=np.concatenate([times, more_times]),
        q=np.concatenate([q, more_q]),
        v=np.concatenate([v, more_v]),
    )


def stop_on_path(
    robot: Robot, plan: Plan, payload: float | None = None, *, at: float | None = None
) -> Plan:
    """The plan with a stop on its path: all joints slow down together, by the plan's clock.

    The arm follows the plan until `at`. From then on the plan's clock slows down at a constant
    rate, the greatest at which no joint must brake harder than guaranteed. If the plan ends before
    the clock has stopped, the arm continues straight on. A stop that begins at the plan's end is no
    harder than the stated stopping times and distances. A stop that begins earlier uses only
    decelerations that are guaranteed at each instant, at the joints' speeds during the stop.

    This function does not check the rest of the plan or any obstacles: `Monitor.commit` judges the
    result.

    Args:
        robot: The arm.
        plan: A piece of trajectory; it need not end at rest.
        payload: Greatest payload, tool included, in [kg]; None: the heaviest payload of its brakes.
        at: Beginning of the stop, in [s] as in the plan's times; within 1 µs of a sample, it begins
            at that sample. None: at the plan's end.

    Returns:
        The plan until `at`, and samples of the stop, at whose end the arm is at rest.

    Raises:
        ArmguardError: The plan is malformed, `at` is not within its times, the payload or the speed
            of a joint is beyond the stated brakes, or the path bends too much for the guaranteed
            braking. The message names the joint.
    """
    read = read_plan(plan, len(robot.joints))
    if isinstance(read, Refusal):
        raise ArmguardError(read.subject, read.detail, expected="a plan to stop on")
    times, q, v = (np.asarray(part) for part in (read.times, read.q, read.v))
    last = float(times[-1])
    begin = last if at is None else _read_begin(at, times)
    brakes = robot.brakes.make_curves(payload)
    fastest = find_top_speeds(times, q, v)
    off = np.flatnonzero(~(fastest <= brakes.speed[:, -1] * (1.0 + LIMIT_SLACK)))
    if len(off):
        j = int(off[0])
        stated = f"at most the {brakes.speed[j, -1]:.4g} that its brakes are stated for"
        raise ArmguardError(robot.joints[j], f"goes at {fastest[j]:.4g}", expected=stated)
    # A committed piece is judged by what its greatest speeds allow.
    most = find_gentlest_stop(brakes, fastest)
    if begin == last:
        # From its end on the arm goes straight on, however hard the path bends before.
        speeds = np.abs(v[-1])
        braking = np.minimum(most, find_gentlest_stop(brakes, speeds))
        with np.errstate(divide="ignore"):
            slowing = float((braking / speeds).min()) * (1.0 - SUM_ROUNDING)
    else:
        slowing = PATH_SHARE * _find_slowing(robot, brakes, most, times, q, v, begin)
    lasting = max(1.0 / slowing, 2.0 * GRAIN)
    # Samples of the stop: evenly spaced where the path bends, and those of the plan that it passes.
    gone = np.minimum(times[times > begin], begin + 0.5 * lasting) - begin
    passed = lasting * (1.0 - np.sqrt(np.maximum(1.0 - 2.0 * gone / lasting, 0.0)))
    bent = float(passed.max(initial=0.0))
    step = max(PATH_STEP, bent / (MOST_SAMPLES // 4))
    since = np.unique(np.concatenate([np.arange(0.0, bent, step), passed, [0.0, lasting]]))
    # The first and the last one stay; no two are closer than a grain.
    since = since[(since == 0.0) | ((since > GRAIN) & (np.diff(since, append=math.inf) > GRAIN))]
    pace = np.maximum(1.0 - since / lasting, 0.0)
    along = begin + since * (0.5 + 0.5 * pace)
    more_q, more_v = np.empty((len(since), q.shape[1])), np.empty((len(since), q.shape[1]))
    for k in range(len(since)):
        evaluate_curve(times, q, v, float(along[k]), more_q[k], more_v[k])
    # Beyond its end the path goes straight on.
    more_q += np.maximum(along - last, 0.0)[:, None] * v[-1]
    more_v *= pace[:, None]
    before = times < begin
    return read._replace(
        times=np.concatenate([times[before], begin + since]),
        q=np.concatenate([q[before], more_q]),
        v=np.concatenate([v[before], more_v]),
    )


def _read_begin(at: object, times: FloatArray) -> float:
    """When a stop begins: `at`, or the sample that is no further from it than a grain."""
    last = float(times[-1])
    try:
        begin = check_duration("at", at)  # type: ignore[arg-type]  # it may be anything
    except (TypeError, ValueError):
        begin = math.nan
    if not begin <= last:
        raise ArmguardError("at", f"is {at!r}", expected=f"a time of the plan, 0 to {last:.6g} s")
    nearest = float(times[np.abs(times - begin).argmin()])
    return nearest if abs(nearest - begin) <= GRAIN else begin


def _find_slowing(
    robot: Robot,
    brakes: BrakeCurves,
    most: FloatArray,
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    begin: float,
) -> float:
    """How fast the path's clock can be slowed down from `begin` to rest, in [1]/[s].

    Only the part of the path that a stop passes matters, which is the shorter, the faster the clock
    slows down. So parts are tried, each twice as long as the one before. No joint brakes harder
    than `most`, in [rad]/[s²] or [m]/[s²], (nv,).
    """
    left = float(times[-1]) - begin
    passed = PATH_STEP
    low, high = np.empty(q.shape[1]), np.empty(q.shape[1])
    while True:
        end = begin + min(passed, left)
        curve_range(times, q, v, begin, end, 1, low, high)
        speeds = np.maximum(high, -low)
        # By the first entry that covers the speed, or the last one, for rounding. A joint at rest
        # has nothing to brake.
        slower = ~(speeds[:, None] <= brakes.speed * (1.0 + LIMIT_SLACK))
        entry = np.minimum(slower.sum(axis=1), brakes.speed.shape[1] - 1)
        stated = np.take_along_axis(brakes.deceleration, entry[:, None], axis=1)[:, 0]
        braking = np.where(speeds > LIMIT_SLACK, np.minimum(stated, most), np.inf)
        slowing, joint, when = bound_path_braking(times, q, v, braking, begin, end)
        if slowing > 0.0 and (passed >= left or 0.5 / (PATH_SHARE * slowing) <= passed):
            return slowing
        if not slowing > 0.0:
            # A longer part has no smaller bends, and no lower speeds.
            raise ArmguardError(
                robot.joints[joint],
                f"bends at {braking[joint] - slowing:.4g} after {when:.6g} s: no stop on the path",
                expected=f"less than the {braking[joint]:.4g} that its brakes guarantee at each"
                " instant",
                remedy="a slower path, or a stop joint by joint, as Monitor.with_stop appends it",
            )
        passed *= 2.0


@kernel
def find_hard_stop(
    times: FloatArray, q: FloatArray, v: FloatArray, speeds: FloatArray, brakes: BrakeCurves
) -> tuple[int, int, float, float, float, float]:
    """The first joint that comes to rest harder than brakes guarantee, in fields of a `Finding`.

    A joint's stop is its last phase of slowing down before it rests for good.

    Args:
        times: Of the samples, in [s], rising. Shape (k,), k >= 2.
        q: Positions, in [rad] or [m]. Shape (k, nv).
        v: Velocities, the last ones 0, in [rad]/[s] or [m]/[s]. Shape (k, nv).
        speeds: Greatest ones on the curve, in [rad]/[s] or [m]/[s]. Shape (nv,).
        brakes: What they guarantee.

    Returns:
        UNCOVERED where a joint is faster than brakes are stated for, HARD, or FINE.
    """
    for j in range(q.shape[1]):
        stated = brakes.speed[j, -1]
        if not speeds[j] <= stated * (1.0 + LIMIT_SLACK):
            return UNCOVERED, j, speeds[j], 0.0, stated, 0.0
    allowed = find_gentlest_stop(brakes, speeds)
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
            slack = allowed[j] * LIMIT_SLACK + 8.0 * TERM_ROUNDING * size / h
            # The acceleration is linear between samples, so it is greatest at one of them.
            if not max(first, last) <= allowed[j] + slack:
                return HARD, j, max(first, last), 0.0, allowed[j], times[k]
            if first <= 0.0 or heading * v[k, j] <= 0.0:
                break
    return FINE, -1, 0.0, 0.0, 0.0, 0.0


@kernel
def bound_path_braking(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    braking: FloatArray,
    first: float,
    last: float,
) -> tuple[float, int, float]:
    """Guaranteed deceleration of the path's clock between two times, in [1]/[s].

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
            pace = top_speed_between(v[k, j], v[k + 1, j], h, c, d)
            spare = braking[j] * (1.0 - SUM_ROUNDING) - bend
            if pace > 0.0 or not spare > 0.0:
                found = spare / pace if spare > 0.0 else spare
                if not found >= least:
                    least, joint, when = found, j, times[k]
    return least, joint, when
