"""Where the joints of an arm that follows a plan can be: a box for each of many short times.

*A piece that carries its own stop* is followed to its end, where the arm rests: joints are on its
curve, give or take their deviation. Until it begins they are on the pieces that the arm may be
following, or free within their limits where there is none. If the arm may leave it, each joint is
on it until a time of its own, at any moment, and brakes by itself from then on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armguard.bounds.displacement import brake, fill_displacements, operating_velocity
from armguard.bounds.limits import JointLimits
from armguard.bounds.planned.curve import curve_range, evaluate_curve, speed_range
from armguard.bounds.planned.following import fill_deviation_speed
from armguard.bounds.planned.plan import CheckedPlan, make_example
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.brakes import find_stop, rest_time
from armguard.robot.wrap_angle import nearest_turn

SLAB = 5e-3
"""How long a slab of the curve is, in [s], unless there were too many."""
MOST_CURVE_SLABS = 200
WAITING_SLABS = 8
MOST_LEAVING_SLABS = 24
BRAKING_SLABS = 24


class JointSlabs(NamedTuple):
    """Boxes that contain all joint positions, each at every time from its start to its end.

    While they are laid out they hold least positions in place of `middle`, and greatest ones in
    place of `half`.
    """

    start: FloatArray
    """From when the course begins, in [s]. Shape (slabs,)."""
    end: FloatArray
    """Likewise; the next one's start. Shape (slabs,)."""
    middle: FloatArray
    """Middles of the boxes, in [rad] or [m]. Shape (slabs, nv)."""
    half: FloatArray
    """Half their widths, in [rad] or [m]. Shape (slabs, nv)."""


class SlabMaker:
    """Lays out slabs for the plans of one robot.

    Args:
        limits: Of the robot that plans were checked for; what is shared of these may change.
    """

    def __init__(self, limits: JointLimits) -> None:
        self._limits = handle = pack(limits)
        plan = make_example()
        slabs = JointSlabs(*np.zeros((2, 1)), *np.zeros((2, 1, 1)))
        # All that these are handed is an example's like, made here, or by kernels.
        self._lay_piece = machine_code(_lay_piece, plan, handle, 0.0, True)
        self._lay_leaving = machine_code(_lay_leaving, plan, handle, 0.0, 0.0, 0.0, 0.0)
        self._include = machine_code(_include, slabs, plan, 0.0)
        self._center = machine_code(_center, slabs, handle, 0, 0)

    def lay_piece(self, plan: CheckedPlan, before: Sequence[CheckedPlan] = ()) -> JointSlabs:
        """All slabs of a piece with its own stop, from when it was checked until the arm rests.

        Args:
            plan: What the arm follows; it ends at rest.
            before: What it may be following until the piece begins; none: joints are free until
                then.
        """
        lead = plan.stamp - plan.now
        times, boxes = self._lay_piece(plan, self._limits, lead, not before)
        slabs = JointSlabs(*times, *boxes)
        self._wait(slabs, plan, before, lead)
        return slabs

    def lay_left_piece(
        self, plan: CheckedPlan, before: Sequence[CheckedPlan] = (), latency: float = 0.0
    ) -> JointSlabs | None:
        """The same of a piece that joints may leave, each at any moment, to brake by themselves.

        An arm that leaves one of the pieces before, while it waits for this one to begin, is not in
        these slabs: it is in those of that piece.

        Args:
            plan: What the arm follows; it ends at rest.
            before: What it may be following until the piece begins.
            latency: Until the arm follows it at the latest, in [s]: how fast joints can be off it
                follows from how long they have been near it.

        Returns:
            None where a joint may be faster than its brakes are stated for, and where the piece is
            yet to begin and joints are free until then: no brakes are known of those.
        """
        lead = plan.stamp - plan.now
        if lead > 0.0 and not before:
            return None
        begin = max(-lead, 0.0)
        age = max(lead, 0.0) + plan.now - plan.measured_stamp
        is_braked, times, boxes = self._lay_leaving(
            plan, self._limits, begin, age, float(latency), lead
        )
        if not is_braked:
            return None
        slabs = JointSlabs(*times, *boxes)
        self._wait(slabs, plan, before, lead)
        return slabs

    def _wait(
        self, slabs: JointSlabs, plan: CheckedPlan, before: Sequence[CheckedPlan], lead: float
    ) -> None:
        """Lay out the slabs until a piece begins of an arm that follows one of those before."""
        if lead > 0.0 and before:
            for one in before:
                self._include(slabs, one, plan.now - one.stamp)
            self._center(slabs, self._limits, 0, WAITING_SLABS)


@kernel
def _make_room(count: int, joints: int) -> tuple[FloatArray, FloatArray]:
    """Room for the times, (2, slabs), and the boxes of slabs, (2, slabs, nv).

    Two arrays are handed over in half the time that four take.
    """
    return np.empty((2, count)), np.empty((2, count, joints))


@kernel
def _view(times: FloatArray, boxes: FloatArray) -> JointSlabs:
    """The slabs that these are."""
    return JointSlabs(times[0], times[1], boxes[0], boxes[1])


@kernel
def _divide(nodes: FloatArray, first: int, count: int, begin: float, end: float) -> None:
    """Fill the nodes from `first` on: so many slabs of the same length, and where they end."""
    step = (end - begin) / count
    for k in range(count):
        nodes[first + k] = k * step + begin
    nodes[first + count] = end


@kernel
def _fill_times(slabs: JointSlabs, nodes: FloatArray, lead: float) -> int:
    """Fill when slabs begin and end: those until the lead is over, and those between nodes.

    Nodes count from then on. Returns how many slabs come before.
    """
    waiting = WAITING_SLABS if lead > 0.0 else 0
    until = np.zeros(WAITING_SLABS + 1)
    if waiting > 0:
        _divide(until, 0, waiting, 0.0, lead)
    for k in range(waiting):
        slabs.start[k], slabs.end[k] = until[k], until[k + 1]
    for k in range(nodes.shape[0] - 1):
        slabs.start[waiting + k] = until[waiting] + nodes[k]
        slabs.end[waiting + k] = until[waiting] + nodes[k + 1]
    return waiting


@kernel
def _lay_piece(
    plan: CheckedPlan, limits: JointLimits, lead: float, is_free: bool
) -> tuple[FloatArray, FloatArray]:
    """The slabs of a piece; those until it begins only where joints are free until then."""
    joints = plan.deviation.shape[0]
    begin, last = max(-lead, 0.0), plan.times[-1]
    count = min(max(math.ceil((last - begin) / SLAB), 1), MOST_CURVE_SLABS)
    along, nodes = np.empty(count + 2), np.empty(count + 2)
    _divide(along, 0, count, begin, last)
    along[count + 1] = last + _find_settling(plan, limits)
    for k in range(count + 2):
        nodes[k] = along[k] - begin
    times, boxes = _make_room(count + 1 + (WAITING_SLABS if lead > 0.0 else 0), joints)
    slabs = _view(times, boxes)
    waiting = _fill_times(slabs, nodes, lead)
    low, high = slabs.middle, slabs.half
    for k in range(waiting):
        low[k, :], high[k, :] = math.inf, -math.inf
    if is_free and waiting > 0:
        until = np.empty(waiting + 1)
        _divide(until, 0, waiting, 0.0, lead)
        q, v, age = plan.measured_q, plan.measured_v, plan.now - plan.measured_stamp
        _spread(q, v, age, limits, until, low, high)
        _center(slabs, limits, 0, waiting)
    for k in range(count + 1):
        low_on, high_on = low[waiting + k], high[waiting + k]
        curve_range(plan.times, plan.q, plan.v, along[k], along[k + 1], low_on, high_on)
        for j in range(joints):
            low_on[j] -= plan.deviation[j]
            high_on[j] += plan.deviation[j]
    _center(slabs, limits, waiting, low.shape[0])
    return times, boxes


@kernel
def _include(slabs: JointSlabs, plan: CheckedPlan, begun: float) -> None:
    """Widen the slabs of an arm that waits by where it is on a plan that began so long before."""
    times, q, v, deviation = plan.times, plan.q, plan.v, plan.deviation
    low, high = np.empty_like(deviation), np.empty_like(deviation)
    for k in range(WAITING_SLABS):
        curve_range(times, q, v, slabs.start[k] + begun, slabs.end[k] + begun, low, high)
        for j in range(low.shape[0]):
            slabs.middle[k, j] = min(slabs.middle[k, j], low[j] - deviation[j])
            slabs.half[k, j] = max(slabs.half[k, j], high[j] + deviation[j])


@kernel
def _count_leaving(latest_bite: float) -> int:
    """How many slabs there are until the latest bite, in [s]."""
    return min(max(math.ceil(latest_bite / SLAB), 4), MOST_LEAVING_SLABS)


@kernel
def _divide_rest(nodes: FloatArray, first: int, latest_bite: float, rest: float) -> None:
    """Fill the nodes after the latest bite, which is the first one, until all rest."""
    _divide(nodes, first, BRAKING_SLABS, 0.0, rest)
    for k in range(first, first + BRAKING_SLABS + 1):
        nodes[k] += latest_bite


@kernel
def _lay_leaving(
    plan: CheckedPlan,
    limits: JointLimits,
    begin: float,
    age: float,
    latency: float,
    lead: float,
) -> tuple[bool, FloatArray, FloatArray]:
    """The slabs of joints that leave a plan each by itself, and whether brakes are stated for them.

    Where there is a lead, in [s], the slabs until it is over are left to be laid out.

    Args:
        plan: What the arm follows; it ends at rest.
        limits: Of the robot.
        begin: Where on the plan the first slab begins, in [s] as in the plan's times.
        age: How long before that the joint state was measured, in [s].
        latency: After that the arm follows the plan at the latest, in [s].
        lead: Until the first slab of the plan begins, in [s]; 0 or less: it has begun.
    """
    joints = plan.deviation.shape[0]
    # The last moment is when it rests at the end; from then on nothing is left to brake.
    latest_bite = max(plan.times[-1] - begin, 0.0) + _find_settling(plan, limits)
    leaving = _count_leaving(latest_bite)
    nodes = np.empty(leaving + BRAKING_SLABS + 1)
    _divide(nodes, 0, leaving, 0.0, latest_bite)
    # Where on the plan joints can be until they leave it, and how fast right on it.
    low_on, high_on = np.empty((leaving, joints)), np.empty((leaving, joints))
    slowest, fastest = np.empty((leaving, joints)), np.empty((leaving, joints))
    for k in range(leaving):
        first, last = begin + nodes[k], begin + nodes[k + 1] * (1.0 + SUM_ROUNDING)
        curve_range(plan.times, plan.q, plan.v, first, last, low_on[k], high_on[k])
        speed_range(plan.times, plan.q, plan.v, first, last, slowest[k], fastest[k])
    # How fast they truly are, and how soon they rest then.
    _widen_speeds(plan, limits, age, latency, nodes, slowest, fastest)
    rest = 0.0
    top = np.empty(joints)
    for j in range(joints):
        top[j] = max(limits.operating_velocity[j], abs(plan.measured_v[j]), plan.top_speed[j])
        for k in range(leaving):
            pace = min(max(-slowest[k, j], fastest[k, j]), top[j])
            if not pace <= limits.brakes.speed[j, -1]:
                return False, np.empty((2, 0)), np.empty((2, 0, joints))
            lasting = rest_time(find_stop(limits.brakes, j, pace), pace)
            rest = max(rest, (nodes[k + 1] + lasting) * (1.0 + SUM_ROUNDING))
    _divide_rest(nodes, leaving, latest_bite, max(rest - latest_bite, 1e-6))
    # Where they can be at all, from where they were measured.
    low_free, high_free = np.empty((leaving, joints)), np.empty((leaving, joints))
    at, speed = np.empty(joints), np.empty(joints)
    evaluate_curve(plan.times, plan.q, plan.v, begin - age, at, speed)
    q = plan.measured_q.copy()
    for j in range(joints):
        if math.isinf(limits.lower[j]) and math.isinf(limits.upper[j]):
            q[j] = nearest_turn(q[j], at[j])
    _spread(q, plan.measured_v, age, limits, nodes[: leaving + 1], low_free, high_free)
    for k in range(leaving):
        for j in range(joints):
            low_on[k, j] -= plan.deviation[j]
            high_on[k, j] += plan.deviation[j]
            low, high = max(low_on[k, j], low_free[k, j]), min(high_on[k, j], high_free[k, j])
            # Where the two have nothing in common, the plan counts alone.
            if low <= high:
                low_on[k, j], high_on[k, j] = low, high
    count = leaving + BRAKING_SLABS
    times, boxes = _make_room(count + (WAITING_SLABS if lead > 0.0 else 0), joints)
    slabs = _view(times, boxes)
    waiting = _fill_times(slabs, nodes, lead)
    for k in range(waiting):
        slabs.middle[k, :], slabs.half[k, :] = math.inf, -math.inf
    left = JointSlabs(nodes[:-1], nodes[1:], slabs.middle[waiting:], slabs.half[waiting:])
    _brake_all(left, low_on, high_on, slowest, fastest, top, limits)
    _center(slabs, limits, waiting, waiting + count)
    return True, times, boxes


@kernel
def _brake_all(
    left: JointSlabs,
    low_on: FloatArray,
    high_on: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
    top: FloatArray,
    limits: JointLimits,
) -> None:
    """Fill least and greatest positions of joints that leave a plan and brake.

    `low_on`, `high_on`, `slowest` and `fastest`, (leaving, nv), are the ranges on the plan in the
    first slabs, by the end of which all joints have left it.
    """
    start, end, low, high = left
    leaving = low_on.shape[0]
    for j in range(top.shape[0]):
        accel = limits.acceleration[j]
        for k in range(low.shape[0]):
            low[k, j] = low_on[k, j] if k < leaving else math.inf
            high[k, j] = high_on[k, j] if k < leaving else -math.inf
        for i in range(leaving):
            up, down = min(fastest[i, j], top[j]), min(-slowest[i, j], top[j])
            up_stop = find_stop(limits.brakes, j, up)
            down_stop = find_stop(limits.brakes, j, down)
            for k in range(i, low.shape[0]):
                # Going on, it is furthest if it left first and now is last; going back, if not.
                longest = end[k] - start[i]
                shortest = max(start[k] - end[i], 0.0)
                braked = brake(up, accel, up_stop, longest if up > 0.0 else shortest)
                high[k, j] = max(high[k, j], high_on[i, j] + braked)
                braked = brake(down, accel, down_stop, longest if down > 0.0 else shortest)
                low[k, j] = min(low[k, j], low_on[i, j] - braked)
        for k in range(low.shape[0]):
            # One that stops at a limit gets no further, however fast it was.
            high[k, j] = max(high[k, j], limits.lower[j] + limits.position_error[j])
            low[k, j] = min(low[k, j], limits.upper[j] - limits.position_error[j])


@kernel
def _find_rest(limits: JointLimits, pace: FloatArray) -> float:
    """How long it takes until all joints surely rest, from speeds of at most `pace`; rounded up."""
    rest = 0.0
    for j in range(pace.shape[0]):
        lasting = rest_time(find_stop(limits.brakes, j, pace[j]), pace[j])
        rest = max(rest, lasting * (1.0 + SUM_ROUNDING))
    return rest


@kernel
def _find_settling(plan: CheckedPlan, limits: JointLimits) -> float:
    """How long joints may still move about the place where a plan comes to rest, in [s]."""
    pace = np.empty_like(plan.deviation)
    fill_deviation_speed(plan.deviation, plan.acceleration, plan.velocity_deviation, math.inf, pace)
    for j in range(pace.shape[0]):
        pace[j] = min(pace[j], limits.velocity[j] + limits.velocity_error[j])
    return _find_rest(limits, pace)


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
    for j in range(q.shape[0]):
        for k in range(nodes.shape[0]):
            up[k, j] = min(up[k, j], highest[j])
            down[k, j] = max(down[k, j], lowest[j])
        for k in range(nodes.shape[0] - 1):
            low[k, j] = q[j] - limits.position_error[j] + min(down[k, j], down[k + 1, j])
            high[k, j] = q[j] + limits.position_error[j] + max(up[k, j], up[k + 1, j])


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
def _center(slabs: JointSlabs, limits: JointLimits, first: int, last: int) -> None:
    """Turn least and greatest positions of slabs into middles and half widths, in place."""
    low, high, error = slabs.middle, slabs.half, limits.position_error
    for k in range(first, last):
        for j in range(low.shape[1]):
            # Joints are believed up to an error beyond their limits, and truly another one beyond.
            least = max(low[k, j], limits.lower[j] - 2.0 * error[j])
            most = min(high[k, j], limits.upper[j] + 2.0 * error[j])
            low[k, j] = 0.5 * (most + least)
            high[k, j] = 0.5 * (most - least) + SUM_ROUNDING * (abs(least) + abs(most))
