"""Boxes of joint positions of an arm that follows a plan, one for each slab of time.

A piece that contains its own stop is followed to its end, where the arm is at rest: joints are on
its curve within their deviation. Until it begins, they are on the pieces that the arm may be
following, or free within their limits if there is none. If the arm may leave the piece, each joint
can leave it at any moment, and brakes by itself from then on.

Where contact limits are stated there are boxes of velocities as well. On a piece a velocity is that
of its curve, within what the controller states, or else within what any joint keeps that can stay
within its deviation to the end: joint states are tested for that (`following`). While a joint
brakes, its velocity lies between 0 and what it was when it left.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.displacement import (
    brake,
    braked_velocity,
    fill_displacements,
    fill_velocities,
    operating_velocity,
)
from armguard.bounds.limits import JointLimits
from armguard.bounds.planned.curve import curve_range, evaluate_curve
from armguard.bounds.planned.following import fill_deviation_speed
from armguard.bounds.planned.plan import CheckedPlan
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING, TERM_ROUNDING
from armguard.robot.brakes import find_stop, rest_time
from armguard.robot.wrap_angle import nearest_turn

SLAB = 5e-3
"""How long a slab of the curve is, in [s], unless there were too many."""
MOST_CURVE_SLABS = 200
WAITING_SLABS = 8
MOST_LEAVING_SLABS = 24
BRAKING_SLABS = 24


Slabs = tuple[FloatArray, FloatArray, FloatArray]
"""When slabs start and end, in [s] from when the piece was checked, (2, slabs); least and greatest
joint positions within each, in [rad] or [m], (2, slabs, nv); and least and greatest velocities, in
[rad]/[s] or [m]/[s], alike; without slabs where no contact limits are stated."""


@kernel
def _divide(begin: float, end: float, count: int) -> FloatArray:
    """Nodes of so many slabs of the same length. Shape (count + 1,)."""
    nodes = np.empty(count + 1)
    step = (end - begin) / count
    for k in range(count):
        nodes[k] = k * step + begin
    nodes[count] = end
    return nodes


@kernel
def _make_slabs(
    lead: float, nodes: FloatArray, joints: int, with_velocities: bool
) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    """Slabs until a lead is over and between nodes, which count from then on; still empty.

    Returns how many come before the nodes, times, and boxes of positions and of velocities.
    """
    waiting = WAITING_SLABS if lead > 0.0 else 0
    count = waiting + nodes.shape[0] - 1
    begin = max(lead, 0.0)
    until = _divide(0.0, begin, WAITING_SLABS)
    times, boxes = np.empty((2, count)), np.empty((2, count, joints))
    for k in range(count):
        if k < waiting:
            times[0, k], times[1, k] = until[k], until[k + 1]
        else:
            times[0, k] = begin + nodes[k - waiting]
            times[1, k] = begin + nodes[k - waiting + 1]
        for j in range(joints):
            boxes[0, k, j], boxes[1, k, j] = math.inf, -math.inf
    timed = count if with_velocities else 0
    speeds = np.empty((2, timed, joints))
    for k in range(timed):
        for j in range(joints):
            speeds[0, k, j], speeds[1, k, j] = math.inf, -math.inf
    return waiting, times, boxes, speeds


@kernel
def lay_piece(
    plan: CheckedPlan, limits: JointLimits, is_free: bool, with_velocities: bool
) -> Slabs:
    """All slabs of a piece with its own stop, from when it was checked until the arm rests.

    Args:
        plan: What the arm follows; it ends at rest.
        limits: Of the robot, or a handle on them.
        is_free: Whether joints are free until the piece begins; else those slabs are left empty,
            for `include`.
        with_velocities: Whether to lay out velocities as well.
    """
    joints = plan.deviation.shape[0]
    lead = plan.stamp - plan.now
    begin, last = max(-lead, 0.0), plan.times[-1]
    count = min(max(math.ceil((last - begin) / SLAB), 1), MOST_CURVE_SLABS)
    along = np.append(_divide(begin, last, count), last + _find_settling(plan, limits))
    waiting, times, boxes, speeds = _make_slabs(lead, along - begin, joints, with_velocities)
    low, high = boxes[0], boxes[1]
    if is_free and waiting > 0:
        age = plan.now - plan.measured_stamp
        until = _divide(0.0, lead, waiting)
        _spread(plan.measured_q, plan.measured_v, age, limits, until, low, high)
        if with_velocities:
            fill_velocities(
                plan.measured_q, plan.measured_v, age, math.inf, limits, until[1:], speeds[1],
                speeds[0],
            )  # fmt: skip
    for k in range(count + 1):
        _follow(plan, along[k], along[k + 1], low[waiting + k], high[waiting + k])
    if with_velocities:
        off, top = _find_following_speeds(plan, limits)
        for k in range(count + 1):
            slowest, fastest = speeds[0, waiting + k], speeds[1, waiting + k]
            _follow_speeds(plan, off, top, along[k], along[k + 1], slowest, fastest)
    return times, boxes, speeds


@kernel
def _follow(
    plan: CheckedPlan, first: float, last: float, low: FloatArray, high: FloatArray
) -> None:
    """Fill where joints can be that follow a plan, between two times on it. Shape (nv,) each."""
    curve_range(plan.times, plan.q, plan.v, first, last, 0, low, high)
    for j in range(low.shape[0]):
        low[j] -= plan.deviation[j]
        high[j] += plan.deviation[j]


@kernel
def _find_following_speeds(plan: CheckedPlan, limits: JointLimits) -> tuple[FloatArray, FloatArray]:
    """How fast joints that follow a plan can be off it, and at all; (nv,) each."""
    off, top = np.empty_like(plan.deviation), np.empty_like(plan.deviation)
    # Whenever it is, they can stay within their deviation from then on.
    fill_deviation_speed(plan.deviation, plan.acceleration, plan.velocity_deviation, math.inf, off)
    # What the rounding of stamps does to where on the plan they are.
    late = TERM_ROUNDING * (abs(plan.now) + abs(plan.stamp) + plan.times[-1])
    for j in range(off.shape[0]):
        off[j] += late * plan.acceleration[j]
        top[j] = _find_top_speed(plan, limits, j)
    return off, top


@kernel
def _find_top_speed(plan: CheckedPlan, limits: JointLimits, j: int) -> float:
    """How fast a joint that follows a plan, or may leave it, can be at all."""
    return max(limits.operating_velocity[j], abs(plan.measured_v[j]), plan.top_speed[j])


@kernel
def _follow_speeds(
    plan: CheckedPlan,
    off: FloatArray,
    top: FloatArray,
    first: float,
    last: float,
    slowest: FloatArray,
    fastest: FloatArray,
) -> None:
    """Fill how fast joints are that follow a plan, between two times on it. Shape (nv,) each.

    They are off its velocities by no more than `off`, and no faster than `top`.
    """
    curve_range(plan.times, plan.q, plan.v, first, last, 1, slowest, fastest)
    for j in range(off.shape[0]):
        slowest[j] = max(slowest[j] - off[j], -top[j])
        fastest[j] = min(fastest[j] + off[j], top[j])


@kernel
def include(
    times: FloatArray,
    boxes: FloatArray,
    speeds: FloatArray,
    plan: CheckedPlan,
    limits: JointLimits,
    begun: float,
) -> None:
    """Widen the slabs of an arm that waits by where it is on a plan that began so long before.

    Where there are velocities, they are widened by how fast it is there.
    """
    low, high = np.empty_like(plan.deviation), np.empty_like(plan.deviation)
    for k in range(WAITING_SLABS):
        _follow(plan, times[0, k] + begun, times[1, k] + begun, low, high)
        for j in range(low.shape[0]):
            boxes[0, k, j] = min(boxes[0, k, j], low[j])
            boxes[1, k, j] = max(boxes[1, k, j], high[j])
    if speeds.shape[1] == 0:
        return
    off, top = _find_following_speeds(plan, limits)
    for k in range(WAITING_SLABS):
        _follow_speeds(plan, off, top, times[0, k] + begun, times[1, k] + begun, low, high)
        for j in range(low.shape[0]):
            speeds[0, k, j] = min(speeds[0, k, j], low[j])
            speeds[1, k, j] = max(speeds[1, k, j], high[j])


@kernel
def lay_left_piece(
    plan: CheckedPlan, limits: JointLimits, latency: float, with_velocities: bool
) -> Slabs:
    """The slabs of joints that leave a plan, each by itself and at any moment, and brake.

    An arm that leaves one of the pieces before, while it waits for this one to begin, is not in
    these slabs: it is in those of that piece. They are left empty, for `include`.

    Args:
        plan: What the arm follows; it ends at rest.
        limits: Of the robot, or a handle on them.
        latency: Until the arm follows it at the latest, in [s]: how fast joints can be off it
            follows from how long they have been near it.
        with_velocities: Whether to lay out velocities as well.

    Returns:
        No slabs where a joint may be faster than its brakes are stated for.
    """
    joints = plan.deviation.shape[0]
    lead = plan.stamp - plan.now
    begin = max(-lead, 0.0)
    age = max(lead, 0.0) + plan.now - plan.measured_stamp
    # The last moment is when it rests at the end; from then on nothing is left to brake.
    latest_bite = max(plan.times[-1] - begin, 0.0) + _find_settling(plan, limits)
    leaving = min(max(math.ceil(latest_bite / SLAB), 4), MOST_LEAVING_SLABS)
    nodes = _divide(0.0, latest_bite, leaving)
    # Where on the plan joints can be until they leave it, and how fast right on it.
    low_on, high_on = np.empty((leaving, joints)), np.empty((leaving, joints))
    slowest, fastest = np.empty((leaving, joints)), np.empty((leaving, joints))
    for k in range(leaving):
        first, last = begin + nodes[k], begin + nodes[k + 1] * (1.0 + SUM_ROUNDING)
        _follow(plan, first, last, low_on[k], high_on[k])
        curve_range(plan.times, plan.q, plan.v, first, last, 1, slowest[k], fastest[k])
    # How fast they truly are, and how soon they rest then.
    _widen_speeds(plan, limits, age, latency, nodes, slowest, fastest)
    rest = 0.0
    top = np.empty(joints)
    for j in range(joints):
        top[j] = _find_top_speed(plan, limits, j)
        for k in range(leaving):
            pace = min(max(-slowest[k, j], fastest[k, j]), top[j])
            if not pace <= limits.brakes.speed[j, -1]:
                return np.empty((2, 0)), np.empty((2, 0, joints)), np.empty((2, 0, joints))
            lasting = rest_time(find_stop(limits.brakes, j, pace), pace)
            rest = max(rest, (nodes[k + 1] + lasting) * (1.0 + SUM_ROUNDING))
    # Where they can be at all, from where they were measured.
    low_free, high_free = np.empty((leaving, joints)), np.empty((leaving, joints))
    at, speed = np.empty(joints), np.empty(joints)
    evaluate_curve(plan.times, plan.q, plan.v, begin - age, at, speed)
    q = plan.measured_q.copy()
    for j in range(joints):
        if math.isinf(limits.lower[j]) and math.isinf(limits.upper[j]):
            q[j] = nearest_turn(q[j], at[j])
    _spread(q, plan.measured_v, age, limits, nodes, low_free, high_free)
    for k in range(leaving):
        for j in range(joints):
            low, high = max(low_on[k, j], low_free[k, j]), min(high_on[k, j], high_free[k, j])
            # Where the two have nothing in common, the plan counts alone.
            if low <= high:
                low_on[k, j], high_on[k, j] = low, high
    braking = latest_bite + _divide(0.0, max(rest - latest_bite, 1e-6), BRAKING_SLABS)
    nodes = np.concatenate((nodes[:-1], braking))
    waiting, times, boxes, speeds = _make_slabs(lead, nodes, joints, with_velocities)
    left = boxes[:, waiting:]
    left[0, :leaving], left[1, :leaving] = low_on, high_on
    _brake_all(nodes, left[0], left[1], slowest, fastest, top, limits)
    if with_velocities:
        left = speeds[:, waiting:]
        _brake_speeds(nodes, left[0], left[1], slowest, fastest, top, limits)
    return times, boxes, speeds


@kernel
def _brake_all(
    nodes: FloatArray,
    low: FloatArray,
    high: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
    top: FloatArray,
    limits: JointLimits,
) -> None:
    """Widen positions between nodes, (slabs, nv), by joints that have left a plan and brake.

    So far they are those on the plan in the first slabs, by the end of which all joints have left
    it, and empty from then on; `slowest` and `fastest`, (leaving, nv), are velocities there.
    """
    leaving = slowest.shape[0]
    for j in range(top.shape[0]):
        accel = limits.acceleration[j]
        # From the last slab back, so that what is added to has not been widened yet.
        for i in range(leaving - 1, -1, -1):
            low_on, high_on = low[i, j], high[i, j]
            up, down = min(fastest[i, j], top[j]), min(-slowest[i, j], top[j])
            up_stop = find_stop(limits.brakes, j, up)
            down_stop = find_stop(limits.brakes, j, down)
            for k in range(i, low.shape[0]):
                # Going on, it is furthest if it left first and now is last; going back, if not.
                longest = nodes[k + 1] - nodes[i]
                shortest = max(nodes[k] - nodes[i + 1], 0.0)
                braked = brake(up, accel, up_stop, longest if up > 0.0 else shortest)
                high[k, j] = max(high[k, j], high_on + braked)
                braked = brake(down, accel, down_stop, longest if down > 0.0 else shortest)
                low[k, j] = min(low[k, j], low_on - braked)
        for k in range(low.shape[0]):
            # One that stops at a limit gets no further, however fast it was.
            high[k, j] = max(high[k, j], limits.lower[j] + limits.position_error[j])
            low[k, j] = min(low[k, j], limits.upper[j] - limits.position_error[j])


@kernel
def _brake_speeds(
    nodes: FloatArray,
    low: FloatArray,
    high: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
    top: FloatArray,
    limits: JointLimits,
) -> None:
    """Fill velocities between nodes, (slabs, nv), of joints that leave a plan at any moment.

    The other arguments are those of `_brake_all`.
    """
    for j in range(top.shape[0]):
        for k in range(low.shape[0]):
            # A joint that has come to rest, or rests for the rest of the slab.
            low[k, j] = high[k, j] = 0.0
        for i in range(slowest.shape[0]):
            up, down = min(fastest[i, j], top[j]), min(-slowest[i, j], top[j])
            up_stop = find_stop(limits.brakes, j, up)
            down_stop = find_stop(limits.brakes, j, down)
            for k in range(i, low.shape[0]):
                # It is fastest if it left last and now is first.
                shortest = max(nodes[k] - nodes[i + 1], 0.0) * (1.0 - SUM_ROUNDING)
                high[k, j] = max(high[k, j], braked_velocity(up, up_stop, shortest))
                low[k, j] = min(low[k, j], -braked_velocity(down, down_stop, shortest))
        for k in range(low.shape[0]):
            low[k, j] -= SUM_ROUNDING * top[j]
            high[k, j] += SUM_ROUNDING * top[j]


@kernel
def _find_settling(plan: CheckedPlan, limits: JointLimits) -> float:
    """How long joints may still move about the place where a plan comes to rest, in [s]."""
    pace = np.empty_like(plan.deviation)
    fill_deviation_speed(plan.deviation, plan.acceleration, plan.velocity_deviation, math.inf, pace)
    rest = 0.0
    for j in range(pace.shape[0]):
        fastest = min(pace[j], limits.velocity[j] + limits.velocity_error[j])
        lasting = rest_time(find_stop(limits.brakes, j, fastest), fastest)
        rest = max(rest, lasting * (1.0 + SUM_ROUNDING))
    return rest


@kernel
def _spread(
    q: FloatArray,
    v: FloatArray,
    age: float,
    limits: JointLimits,
    nodes: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> None:
    """Fill least and greatest positions between neighbouring nodes of joints that are free.

    They were measured `age` seconds before the first node, (nv,) each. More rows than there are
    slabs stay as they are.
    """
    shape = nodes.shape[0], q.shape[0]
    up, down = np.empty(shape), np.empty(shape)
    highest, lowest = np.empty_like(q), np.empty_like(q)
    fill_displacements(q, v, age, math.inf, limits, nodes, up, down, highest, lowest)
    for k in range(nodes.shape[0] - 1):
        for j in range(q.shape[0]):
            least = max(min(down[k, j], down[k + 1, j]), lowest[j])
            most = min(max(up[k, j], up[k + 1, j]), highest[j])
            low[k, j] = q[j] - limits.position_error[j] + least
            high[k, j] = q[j] + limits.position_error[j] + most


@kernel
def _widen_speeds(
    plan: CheckedPlan,
    limits: JointLimits,
    age: float,
    latency: float,
    nodes: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
) -> None:
    """Widen ranges of velocities between nodes by what an arm on the curve may be off by.

    The least of what is stated, what follows from staying within the deviation, and what follows
    from the measured velocity: a joint speeds up from there by no more than its operating
    acceleration, and slows down by no more than its acceleration limit. `slowest` and `fastest`
    are right on the curve so far, (slabs, nv), of which the nodes are the first ones.
    """
    off = np.empty_like(plan.deviation)
    for k in range(slowest.shape[0]):
        fill_deviation_speed(
            plan.deviation, plan.acceleration, plan.velocity_deviation, nodes[k] - latency, off
        )
        # A slab may begin before the stamp, when a joint that slows down was faster.
        before = max(-(age + nodes[k]), 0.0) * (1.0 + SUM_ROUNDING)
        after = max(age + nodes[k + 1], 0.0) * (1.0 + SUM_ROUNDING)
        for j in range(off.shape[0]):
            up = plan.measured_v[j] + limits.velocity_error[j]
            down = -plan.measured_v[j] + limits.velocity_error[j]
            limit, speeding = limits.acceleration[j], limits.operating_acceleration[j]
            most = operating_velocity(up, limit, speeding, math.inf, after)
            least = -operating_velocity(down, limit, speeding, math.inf, after)
            slowest[k, j] = max(slowest[k, j] - off[j], min(least, -down - before * limit))
            fastest[k, j] = min(fastest[k, j] + off[j], max(most, up + before * limit))


@kernel
def center(boxes: FloatArray, limits: JointLimits) -> None:
    """Turn least and greatest positions of slabs into middles and half widths, in place."""
    low, high, error = boxes[0], boxes[1], limits.position_error
    for k in range(low.shape[0]):
        for j in range(low.shape[1]):
            # Joints are believed up to an error beyond their limits, and truly another one beyond.
            least = max(low[k, j], limits.lower[j] - 2.0 * error[j])
            most = min(high[k, j], limits.upper[j] + 2.0 * error[j])
            low[k, j] = 0.5 * (most + least)
            high[k, j] = 0.5 * (most - least) + SUM_ROUNDING * (abs(least) + abs(most))
