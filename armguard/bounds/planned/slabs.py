"""Where the joints of an arm that follows a plan can be: a box for each of many short times.

*A piece that carries its own stop* is followed to its end, where the arm rests: joints are on its
curve, give or take their deviation. Until it begins they are on the pieces that the arm may be
following, or free within their limits where there is none. If the arm may leave it, each joint is
on it until a time of its own, at any moment, and brakes by itself from then on.

*A trajectory* is followed until brakes bite, at any time from now until the latest. From then on
either each joint brakes by itself, having left the trajectory at a time of its own, or all of them
slow down on the path, by its clock. The last slab ends when every joint surely rests.

A trajectory's clock is either time itself, or goes at any pace from 0 to 1: then the arm is
anywhere between where it was measured and where time itself would have brought it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armguard.bounds.displacement import brake, fill_displacements, operating_velocity
from armguard.bounds.limits import JointLimits
from armguard.bounds.planned.curve import (
    curve_range,
    evaluate_curve,
    find_top_speeds,
    speed_range,
)
from armguard.bounds.planned.following import fill_deviation_speed
from armguard.bounds.planned.plan import CheckedPlan
from armguard.bounds.planned.stop import bound_path_braking
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.brakes import BrakeCurves, find_decelerations, find_stop, rest_time
from armguard.robot.turns import align_turns, find_continuous

SLAB = 5e-3
"""How long a slab of the curve is, in [s], unless there were too many."""
MOST_CURVE_SLABS = 200
WAITING_SLABS = 8
MOST_LEAVING_SLABS = 24
BRAKING_SLABS = 24


class JointSlabs(NamedTuple):
    """Boxes that contain all joint positions, each at every time from its start to its end."""

    start: FloatArray
    """From when the course begins, in [s]. Shape (slabs,)."""
    end: FloatArray
    """Likewise; the next one's start. Shape (slabs,)."""
    middle: FloatArray
    """Middles of the boxes, in [rad] or [m]. Shape (slabs, nv)."""
    half: FloatArray
    """Half their widths, in [rad] or [m]. Shape (slabs, nv)."""


class PathClock(NamedTuple):
    """Where on a trajectory the arm is now, and how it goes on."""

    at: float
    """Where it was when it was measured, in [s] as in the plan's times."""
    age: float
    """How long ago that was, in [s]; negative where it is yet to be."""
    is_on_time: bool
    """Whether its clock is time itself; else it goes at any pace from 0 to 1."""
    followed: float
    """How long it has been followed, in [s]; negative: not before so long."""
    pace: float = 1.0
    """What the pace of a clock of its own does not exceed until brakes bite."""
    slowing: float = 0.0
    """How fast a stop slows it down anywhere on the trajectory, in [1]/[s]; 0: not known to."""
    is_slowing_stated: bool = False
    """Whether the controller says so; else it is what brakes guarantee, more in some places."""


def make_piece_slabs(
    plan: CheckedPlan, limits: JointLimits, before: Sequence[CheckedPlan] = ()
) -> JointSlabs:
    """All slabs of a piece with its own stop, from when it was checked until the arm rests.

    Args:
        plan: What the arm follows; it ends at rest.
        limits: Of the robot that it was checked for.
        before: What it may be following until the piece begins; none: joints are free until then.
    """
    lead = plan.stamp - plan.now
    begin, last = max(-lead, 0.0), float(plan.times[-1])
    parts = []
    if lead > 0.0:
        parts.append(_wait(plan, limits, before, lead))
    count = min(max(int(np.ceil((last - begin) / SLAB)), 1), MOST_CURVE_SLABS)
    settled = find_settling(plan, limits, math.inf)
    nodes = np.append(np.linspace(begin, last, count + 1), last + settled)
    low, high, _, _ = _follow(plan, nodes)
    parts.append((nodes - begin, low, high))
    return _join(parts, limits)


def make_left_piece_slabs(
    plan: CheckedPlan,
    limits: JointLimits,
    before: Sequence[CheckedPlan] = (),
    latency: float = 0.0,
) -> JointSlabs | None:
    """The same of a piece that joints may leave, each at any moment, to brake by themselves.

    An arm that leaves one of the pieces before, while it waits for this one to begin, is not in
    these slabs: it is in those of that piece.

    Args:
        plan: What the arm follows; it ends at rest.
        limits: Of the robot that it was checked for.
        before: What it may be following until the piece begins.
        latency: Until the arm follows it at the latest, in [s]: how fast joints can be off it
            follows from how long they have been near it.

    Returns:
        None where a joint may be faster than its brakes are stated for, and where the piece is yet
        to begin and joints are free until then: no brakes are known of those.
    """
    lead = plan.stamp - plan.now
    parts = []
    if lead > 0.0:
        if not before:
            return None
        parts.append(_wait(plan, limits, before, lead))
    begin = max(-lead, 0.0)
    age = max(lead, 0.0) + plan.now - plan.measured_stamp
    clock = PathClock(begin - age, age, True, -latency)
    # The last moment is when it rests at the end; from then on nothing is left to brake.
    latest = max(float(plan.times[-1]) - begin, 0.0) + find_settling(plan, limits, math.inf)
    left = _leave(plan, limits, clock, latest)
    if left is None:
        return None
    return _join([*parts, left], limits)


def _wait(
    plan: CheckedPlan, limits: JointLimits, before: Sequence[CheckedPlan], lead: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes until a piece begins, and least and greatest positions between them."""
    nodes = np.linspace(0.0, lead, WAITING_SLABS + 1)
    if not before:
        age = plan.now - plan.measured_stamp
        return nodes, *_spread(plan.measured_q, plan.measured_v, age, limits, nodes)
    boxes = [_follow(one, nodes + (plan.now - one.stamp)) for one in before]
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    return nodes, low, high


def make_stop_slabs(
    plan: CheckedPlan, limits: JointLimits, clock: PathClock, latest_bite: float, *, on_path: bool
) -> JointSlabs | None:
    """All slabs of an arm that follows a trajectory until its brakes bite, and then stops.

    Args:
        plan: What it follows; it ends at rest, and the arm stays there.
        limits: Of the robot that it was checked for.
        clock: Where on it the arm is.
        latest_bite: Until when brakes bite, in [s] from now: at any time until then, and where
            joints stop by themselves each at a time of its own.
        on_path: Whether all joints stop together, on the path.

    Returns:
        None where a joint may be faster than its brakes are stated for, and where the arm is to
        stop on the path, and brakes guarantee no such thing there.
    """
    if not on_path:
        left = _leave(plan, limits, clock, latest_bite)
        return None if left is None else _join([left], limits)
    slowing = _find_slowing(plan, limits, clock, latest_bite)
    if not slowing > 0.0:
        return None
    rest = clock.pace / slowing + find_settling(plan, limits, clock.followed)
    nodes = _divide(latest_bite, rest)
    first, last = _run_clock(clock, slowing, nodes, latest_bite)
    low, high, _, _ = _fill(plan, first, last)
    return _join([(nodes, low - plan.deviation, high + plan.deviation)], limits)


def _divide(latest_bite: float, rest: float) -> FloatArray:
    """Nodes until the latest bite, in [s], and from then on until all rest."""
    count = min(max(int(np.ceil(latest_bite / SLAB)), 4), MOST_LEAVING_SLABS)
    nodes = np.linspace(0.0, latest_bite, count + 1)
    braking = latest_bite + np.linspace(0.0, rest, BRAKING_SLABS + 1)[1:]
    return np.concatenate([nodes, braking if rest > 0.0 else []])


def _leave(
    plan: CheckedPlan, limits: JointLimits, clock: PathClock, latest_bite: float
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Nodes until all rest, and least and greatest positions between them, of joints that leave.

    None where a joint may be faster than its brakes are stated for.
    """
    nodes = _divide(latest_bite, 0.0)
    first, last = _run_clock(clock, math.inf, nodes, math.inf)
    low, high, slowest, fastest = _fill(plan, first, last)
    if not clock.is_on_time:
        slowest = np.minimum(0.0, slowest * clock.pace)
        fastest = np.maximum(0.0, fastest * clock.pace)
    measured, error = _believe(plan, limits, clock, slowest, fastest)
    _widen_all(
        plan.deviation, plan.acceleration, plan.velocity_deviation, measured, error,
        limits.acceleration, limits.operating_acceleration, clock.followed, clock.age, nodes,
        slowest, fastest,
    )  # fmt: skip
    top = np.maximum(limits.operating_velocity, np.abs(plan.measured_v))
    _raise_to_fastest(plan.v, top)
    pace = np.minimum(np.maximum(-slowest, fastest), top)
    if not (pace.max(axis=0) <= limits.brakes.speed[:, -1]).all():
        return None
    rest = find_rest(nodes, pace, limits.brakes) - latest_bite
    leaving, nodes = nodes, _divide(latest_bite, max(rest, 1e-6))
    # Since the stamp its clock may have been faster than its pace: that counts as measured.
    reach = _reach(plan, limits, clock, plan.measured_v, leaving)
    low_on, high_on = _narrow((low - plan.deviation, high + plan.deviation), reach)
    low, high = np.empty((2, len(nodes) - 1, len(top)))
    _fill_leaving(nodes, low_on, high_on, slowest, fastest, top, limits, low, high)
    return nodes, low, high


def find_settling(plan: CheckedPlan, limits: JointLimits, followed: float) -> float:
    """How long joints may still move about the place where they come to rest, in [s].

    Args:
        plan: What they follow.
        limits: Of the robot that it was checked for.
        followed: How long they have followed it by then, in [s].
    """
    speed = np.empty_like(plan.deviation)
    fill_deviation_speed(
        plan.deviation, plan.acceleration, plan.velocity_deviation, followed, speed
    )
    pace = np.minimum(speed, limits.velocity + limits.velocity_error)
    return float(find_rest(np.zeros(2), pace[None], limits.brakes))


def _find_slowing(
    plan: CheckedPlan, limits: JointLimits, clock: PathClock, latest_bite: float
) -> float:
    """How fast the clock can surely be slowed down wherever the arm can be by then, in [1]/[s]."""
    if clock.is_slowing_stated or not clock.slowing > 0.0:
        return clock.slowing
    # Only what lies ahead counts: that far it gets at the most by what brakes do anywhere.
    begin = clock.at - abs(clock.age)
    end = clock.at + abs(clock.age) + latest_bite + 0.5 / clock.slowing
    braking = find_decelerations(limits.brakes, find_top_speeds(plan.times, plan.q, plan.v))
    slowing, _, _ = bound_path_braking(
        plan.times, plan.q, plan.v, braking, max(begin, 0.0), max(end, 0.0)
    )
    return float(slowing)


def _run_clock(
    clock: PathClock, slowing: float, nodes: FloatArray, latest_bite: float
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest times on the trajectory between neighbouring nodes, (nodes - 1,) each.

    Brakes that bite at the latest bite, in [s], slow its clock down to rest.
    """
    after = np.maximum(nodes - latest_bite, 0.0)
    gone = clock.pace * (nodes - after)
    if after.any():
        slowing = min(slowing, 1e300)  # a path on which no joint moves ends at once
        until = np.minimum(after, clock.pace / slowing)
        gone += until * (clock.pace - 0.5 * slowing * until)
    gone *= 1.0 + SUM_ROUNDING
    if clock.is_on_time:
        # Brakes that can slow the clock down may have done so at once.
        now = clock.at + clock.age
        return now + (np.zeros(len(gone) - 1) if after.any() else nodes[:-1]), now + gone[1:]
    first = np.full(len(gone) - 1, clock.at + min(clock.age, 0.0))
    return first, clock.at + abs(clock.age) + gone[1:]


def _follow(
    plan: CheckedPlan, nodes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Ranges of positions between neighbouring times, and of velocities right on the curve."""
    low, high, slowest, fastest = _fill(plan, nodes[:-1], nodes[1:])
    return low - plan.deviation, high + plan.deviation, slowest, fastest


def _fill(
    plan: CheckedPlan, first: FloatArray, last: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Ranges of positions and velocities right on the curve between times on it."""
    low, high, slowest, fastest = np.empty((4, len(first), len(plan.deviation)))
    _fill_ranges(plan.times, plan.q, plan.v, first, last, low, high, slowest, fastest)
    return low, high, slowest, fastest


def _believe(
    plan: CheckedPlan,
    limits: JointLimits,
    clock: PathClock,
    slowest: FloatArray,
    fastest: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Measured velocities and their errors, of an arm whose clock keeps to its pace; (nv,) each.

    Ranges of velocities right on the curve are (slabs, nv).
    """
    measured, error = plan.measured_v, limits.velocity_error
    if not clock.pace < 1.0:
        return measured, error
    # One that was measured to be faster than its pace counts as if it were so fast: for one
    # that is not, the velocity nearest to the measured one is no farther from the true one.
    off = np.empty_like(measured)
    fill_deviation_speed(
        plan.deviation, plan.acceleration, plan.velocity_deviation, clock.followed, off
    )
    kept = np.clip(measured, slowest[0] - off, fastest[0] + off)
    if clock.age < 0.0:
        # It was measured later than that, when it may have had any pace.
        error = error + np.abs(measured - kept)
    return kept, error


def _reach(
    plan: CheckedPlan,
    limits: JointLimits,
    clock: PathClock,
    v: FloatArray,
    nodes: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Where joints can get between neighbouring nodes from where they were measured, as at `v`."""
    at, speed = np.empty_like(v), np.empty_like(v)
    evaluate_curve(plan.times, plan.q, plan.v, clock.at, at, speed)
    q = align_turns(plan.measured_q, at, find_continuous(limits.lower, limits.upper))
    return _spread(q, v, clock.age, limits, nodes)


def _narrow(
    ranges: tuple[FloatArray, FloatArray], others: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest values by both; by the first alone where they have none in common."""
    low, high = np.maximum(ranges[0], others[0]), np.minimum(ranges[1], others[1])
    fits = low <= high
    return np.where(fits, low, ranges[0]), np.where(fits, high, ranges[1])


def _join(
    parts: list[tuple[FloatArray, FloatArray, FloatArray]], limits: JointLimits
) -> JointSlabs:
    """Slabs of all parts, one after the other, no joint beyond where it can be at all."""
    starts, ends, offset = [], [], 0.0
    for nodes, _, _ in parts:
        starts.append(offset + nodes[:-1])
        offset += float(nodes[-1])
        ends.append(np.append(starts[-1][1:], offset))
    low = np.concatenate([low for _, low, _ in parts])
    high = np.concatenate([high for _, _, high in parts])
    _center(low, high, limits.lower, limits.upper, limits.position_error)
    return JointSlabs(np.concatenate(starts), np.concatenate(ends), low, high)


def _spread(
    q: FloatArray, v: FloatArray, age: float, limits: JointLimits, nodes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest positions between neighbouring nodes of joints that are free.

    They were measured `age` seconds before the first node, (nv,) each.
    """
    high, low = np.empty((2, len(nodes), len(q)))
    highest, lowest = np.empty((2, len(q)))
    fill_displacements(q, v, age, math.inf, limits, nodes, high, low, highest, lowest)
    high, low = np.minimum(high, highest), np.maximum(low, lowest)
    return (
        q - limits.position_error + np.minimum(low[:-1], low[1:]),
        q + limits.position_error + np.maximum(high[:-1], high[1:]),
    )


@kernel
def _fill_ranges(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    first: FloatArray,
    last: FloatArray,
    low: FloatArray,
    high: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
) -> None:
    """Fill ranges on the curve between times, each of shape (slabs, nv)."""
    for k in range(first.shape[0]):
        curve_range(times, q, v, first[k], last[k], low[k], high[k])
        speed_range(times, q, v, first[k], last[k], slowest[k], fastest[k])


@kernel
def _widen_all(
    deviation: FloatArray,
    acceleration: FloatArray,
    stated: FloatArray,
    measured_v: FloatArray,
    velocity_error: FloatArray,
    acceleration_limit: FloatArray,
    speeding: FloatArray,
    followed: float,
    age: float,
    nodes: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
) -> None:
    """Widen ranges of velocities between nodes by what an arm on the curve may be off by.

    The least of what is stated, what follows from staying within the deviation, and what follows
    from the measured velocity: a joint speeds up from there by no more than `speeding`, and slows
    down by no more than its acceleration limit. `slowest` and `fastest` are (nodes - 1, nv).
    """
    off = np.empty_like(deviation)
    for k in range(slowest.shape[0]):
        fill_deviation_speed(deviation, acceleration, stated, followed + nodes[k], off)
        # A slab may begin before the stamp, when a joint that slows down was faster.
        before = max(-(age + nodes[k]), 0.0) * (1.0 + SUM_ROUNDING)
        after = max(age + nodes[k + 1], 0.0) * (1.0 + SUM_ROUNDING)
        for j in range(off.shape[0]):
            up, down = measured_v[j] + velocity_error[j], -measured_v[j] + velocity_error[j]
            limit = acceleration_limit[j]
            most = operating_velocity(up, limit, speeding[j], math.inf, after)
            least = -operating_velocity(down, limit, speeding[j], math.inf, after)
            slowest[k, j] = max(slowest[k, j] - off[j], min(least, -down - before * limit))
            fastest[k, j] = min(fastest[k, j] + off[j], max(most, up + before * limit))


@kernel
def _center(
    low: FloatArray, high: FloatArray, lower: FloatArray, upper: FloatArray, error: FloatArray
) -> None:
    """Turn least and greatest positions, (slabs, nv), into middles and half widths, in place."""
    for k in range(low.shape[0]):
        for j in range(low.shape[1]):
            # Joints are believed up to an error beyond their limits, and truly another one beyond.
            least = max(low[k, j], lower[j] - 2.0 * error[j])
            most = min(high[k, j], upper[j] + 2.0 * error[j])
            low[k, j] = 0.5 * (most + least)
            high[k, j] = 0.5 * (most - least) + SUM_ROUNDING * (abs(least) + abs(most))


@kernel
def _raise_to_fastest(v: FloatArray, top: FloatArray) -> None:
    """Raise `top`, (nv,), to the greatest speeds among samples, (k, nv)."""
    for k in range(v.shape[0]):
        for j in range(v.shape[1]):
            top[j] = max(top[j], abs(v[k, j]))


@kernel
def find_rest(nodes: FloatArray, pace: FloatArray, brakes: BrakeCurves) -> float:
    """When all joints surely rest that leave between nodes, from speeds of at most `pace`.

    The speeds are (nodes - 1, nv), from one node to the next; the time is rounded up.
    """
    rest = 0.0
    for k in range(pace.shape[0]):
        for j in range(pace.shape[1]):
            lasting = rest_time(find_stop(brakes, j, pace[k, j]), pace[k, j])
            rest = max(rest, (nodes[k + 1] + lasting) * (1.0 + SUM_ROUNDING))
    return rest


@kernel
def _fill_leaving(
    nodes: FloatArray,
    low_on: FloatArray,
    high_on: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
    top: FloatArray,
    limits: JointLimits,
    low: FloatArray,
    high: FloatArray,
) -> None:
    """Fill least and greatest positions between nodes of joints that leave a plan and brake.

    `low_on`, `high_on`, `slowest` and `fastest`, (leaving, nv), are the ranges on the plan between
    the first nodes, the last of which all joints have left it by.
    """
    leaving = low_on.shape[0]
    for k in range(nodes.shape[0] - 1):
        for j in range(top.shape[0]):
            accel, brakes = limits.acceleration[j], limits.brakes
            highest = high_on[k, j] if k < leaving else -math.inf
            lowest = low_on[k, j] if k < leaving else math.inf
            for i in range(min(k + 1, leaving)):
                # Going on, it is furthest if it left first and now is last; going back, if not.
                longest = nodes[k + 1] - nodes[i]
                shortest = max(nodes[k] - nodes[i + 1], 0.0)
                up, down = min(fastest[i, j], top[j]), min(-slowest[i, j], top[j])
                stop = find_stop(brakes, j, up)
                braked = brake(up, accel, stop, longest if up > 0.0 else shortest)
                highest = max(highest, high_on[i, j] + braked)
                stop = find_stop(brakes, j, down)
                braked = brake(down, accel, stop, longest if down > 0.0 else shortest)
                lowest = min(lowest, low_on[i, j] - braked)
            # One that stops at a limit gets no further, however fast it was.
            high[k, j] = max(highest, limits.lower[j] + limits.position_error[j])
            low[k, j] = min(lowest, limits.upper[j] - limits.position_error[j])
