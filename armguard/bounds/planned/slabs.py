"""Where the joints of an arm that follows a plan can be: a box for each of many short times.

From now until the plan begins, joints are free within their limits, from what was measured; then
they are on the plan's curve, give or take its deviation, until braking is commanded. Within the
reaction time, each joint then leaves the curve, at any moment, and brakes. At the plan's end, and
where it ends before the reaction time is over, there is no curve to be on: joints are free for that
time, and then brake. The last slab ends when every joint surely rests.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.displacement import brake, fill_displacements
from armguard.bounds.limits import JointLimits
from armguard.bounds.planned.check import CheckedPlan, bound_velocity_deviation
from armguard.bounds.planned.curve import curve_range, evaluate_curve, speed_range
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.brakes import BrakeCurves, find_stop, rest_time
from armguard.robot.stop_time import compute_stop_time

SLAB = 5e-3
"""How long a slab of the curve is, in [s], unless there were too many."""
MOST_CURVE_SLABS = 200
WAITING_SLABS = 8
FREE_SLABS = 4
LEAVING_SLABS = 8
BRAKING_SLABS = 28


class JointSlabs(NamedTuple):
    """Boxes that contain all joint positions, each at every time from its start to its end."""

    start: FloatArray
    """From when the plan was checked, in [s]. Shape (slabs,)."""
    end: FloatArray
    """Likewise; the next one's start. Shape (slabs,)."""
    middle: FloatArray
    """Middles of the boxes, in [rad] or [m]. Shape (slabs, nv)."""
    half: FloatArray
    """Half their widths, in [rad] or [m]. Shape (slabs, nv)."""


def make_slabs(
    plan: CheckedPlan, limits: JointLimits, reaction_time: float, brake_after: float = math.inf
) -> JointSlabs:
    """All slabs from when the plan was checked until the arm rests.

    Args:
        plan: What the arm follows.
        limits: Of the robot that it was checked for.
        reaction_time: From command to braking torque at most, in [s].
        brake_after: When braking is commanded, in [s] from when the plan was checked, and not
            before the plan begins; at its end at the latest.
    """
    if not (np.abs(plan.v) <= limits.operating_velocity + limits.velocity_error).all():
        # Its controller does not keep to what it was said to keep to.
        limits = limits._replace(
            operating_velocity=limits.velocity, operating_acceleration=limits.acceleration
        )
    waiting = max(plan.stamp - plan.now, 0.0)
    begin = max(plan.now - plan.stamp, 0.0)
    last = float(plan.times[-1])
    command = min(begin + brake_after - waiting, last)
    parts = []
    if waiting > 0.0:
        nodes = np.linspace(0.0, waiting, WAITING_SLABS + 1)
        age = plan.now - plan.measured_stamp
        low, high = _spread(plan.measured_q, plan.measured_v, age, np.inf, limits, nodes)
        parts.append((nodes, low, high))
    count = min(max(int(np.ceil((command - begin) / SLAB)), 1), MOST_CURVE_SLABS)
    nodes = np.linspace(begin, command, count + 1)
    low, high, _, _ = _follow(plan, nodes)
    parts.append((nodes - begin, low, high))
    if command + reaction_time <= last:
        nodes, low, high = _leave(plan, limits, command, reaction_time)
    else:
        nodes, low, high = _overrun(plan, limits, command, reaction_time)
    parts.append((nodes, low, high))
    return _join(parts, limits)


def _follow(
    plan: CheckedPlan, nodes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Ranges of positions between neighbouring nodes, and of velocities right on the curve."""
    low, high, slowest, fastest = np.empty((4, len(nodes) - 1, len(plan.deviation)))
    _fill_ranges(plan.times, plan.q, plan.v, nodes, low, high, slowest, fastest)
    return low - plan.deviation, high + plan.deviation, slowest, fastest


def _leave(
    plan: CheckedPlan, limits: JointLimits, command: float, reaction_time: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes, least and greatest positions while joints leave the plan, each when it likes."""
    leaving = np.linspace(command, command + reaction_time, LEAVING_SLABS + 1)
    low_on, high_on, slowest, fastest = _follow(plan, leaving)
    for k in range(LEAVING_SLABS):
        off = bound_velocity_deviation(plan, limits.velocity_error, leaving[k], leaving[k + 1])
        reach = _reach(plan, limits, leaving[k + 1])
        slowest[k] = np.maximum(slowest[k] - off, plan.measured_v - reach)
        fastest[k] = np.minimum(fastest[k] + off, plan.measured_v + reach)
    pace = np.maximum(-slowest, fastest)
    top = np.maximum(limits.operating_velocity, np.abs(plan.v).max(axis=0))
    rest = _slowest_rest(np.minimum(pace, top).max(axis=0), limits.brakes) * (1.0 + SUM_ROUNDING)
    nodes = np.concatenate([leaving, leaving[-1] + np.linspace(0.0, rest, BRAKING_SLABS + 1)[1:]])
    low, high = np.empty((2, len(nodes) - 1, len(top)))
    _fill_leaving(nodes, low_on, high_on, slowest, fastest, top, limits, low, high)
    return nodes - command, low, high


def _reach(plan: CheckedPlan, limits: JointLimits, along: float) -> FloatArray:
    """How far velocities can have come from the measured ones by then, and since the check."""
    stamp = plan.measured_stamp - plan.stamp
    away = max(abs(along - stamp), abs(plan.now - plan.measured_stamp))
    return limits.velocity_error + away * limits.acceleration * (1.0 + SUM_ROUNDING)


def _overrun(
    plan: CheckedPlan, limits: JointLimits, command: float, reaction_time: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes, least and greatest positions where the plan ends before all joints surely brake."""
    q, v = np.empty((2, len(plan.deviation)))
    evaluate_curve(plan.times, plan.q, plan.v, command, q, v)
    off = bound_velocity_deviation(plan, limits.velocity_error, command, command)
    off = np.minimum(off, np.abs(plan.measured_v - v) + _reach(plan, limits, command))
    errors = limits._replace(position_error=plan.deviation, velocity_error=off)
    rest = compute_stop_time(
        v,
        off,
        limits.operating_velocity,
        limits.acceleration,
        limits.brakes,
        0.0,
        0.0,
        reaction_time,
        limits.operating_acceleration,
    )
    nodes = np.concatenate(
        [
            np.linspace(0.0, reaction_time, FREE_SLABS + 1)[:-1],
            np.linspace(reaction_time, rest, BRAKING_SLABS + 1),
        ]
    )
    return nodes, *_spread(q, v, 0.0, reaction_time, errors, nodes)


def _join(
    parts: list[tuple[FloatArray, FloatArray, FloatArray]], limits: JointLimits
) -> JointSlabs:
    """Slabs of all parts, one after the other, no joint beyond where it can be at all."""
    starts, ends, offset = [], [], 0.0
    for nodes, _, _ in parts:
        starts.append(offset + nodes[:-1])
        offset += float(nodes[-1])
        ends.append(np.append(starts[-1][1:], offset))
    # Joints are believed up to an error beyond their limits, and truly another one beyond.
    low = np.concatenate([low for _, low, _ in parts])
    high = np.concatenate([high for _, _, high in parts])
    low = np.maximum(low, limits.lower - 2.0 * limits.position_error)
    high = np.minimum(high, limits.upper + 2.0 * limits.position_error)
    half = 0.5 * (high - low) + SUM_ROUNDING * (np.abs(low) + np.abs(high))
    return JointSlabs(np.concatenate(starts), np.concatenate(ends), 0.5 * (high + low), half)


def _spread(
    q: FloatArray, v: FloatArray, age: float, free: float, limits: JointLimits, nodes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest positions between neighbouring nodes of joints measured `age` ago."""
    shape = len(nodes), len(q)
    high, low, highest, lowest = (
        np.empty(shape),
        np.empty(shape),
        np.empty(len(q)),
        np.empty(len(q)),
    )
    fill_displacements(q, v, age, free, limits, nodes, high, low, highest, lowest)
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
    nodes: FloatArray,
    low: FloatArray,
    high: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
) -> None:
    """Fill ranges on the curve between neighbouring nodes, each of shape (nodes - 1, nv)."""
    for k in range(nodes.shape[0] - 1):
        curve_range(times, q, v, nodes[k], nodes[k + 1], low[k], high[k])
        speed_range(times, q, v, nodes[k], nodes[k + 1], slowest[k], fastest[k])


@kernel
def _slowest_rest(pace: FloatArray, brakes: BrakeCurves) -> float:
    """Time in which all joints rest that brake from speeds of at most `pace`, (nv,), in [s]."""
    slowest = 0.0
    for j in range(pace.shape[0]):
        slowest = max(slowest, rest_time(find_stop(brakes, j, pace[j]), pace[j]))
    return slowest


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
