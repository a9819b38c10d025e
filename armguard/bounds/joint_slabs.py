"""Where the joints of an arm that follows a plan can be: a box for each of many short times.

From now until the plan begins, joints are free within their limits, from what was measured; then
they are on the plan's curve, give or take its deviation; from its end on they are free for the
reaction time and then brake, from wherever on the curve's end and however fast they truly are. The
last slab ends when every joint surely rests.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armguard.bounds.joint_limits import JointLimits
from armguard.bounds.sums import ROUNDING
from armguard.bounds.travel import fill_displacements
from armguard.compilation import kernel
from armguard.plan_curve import curve_range
from armguard.plans import CheckedPlan
from armguard.verdict import compute_stop_time

Floats = npt.NDArray[np.float64]

SLAB = 5e-3
"""How long a slab of the curve is, in [s], unless there were too many."""
MOST_CURVE_SLABS = 200
WAITING_SLABS = 8
FREE_SLABS = 4
BRAKING_SLABS = 28


class JointSlabs(NamedTuple):
    """Boxes that contain all joint positions, each at every time from its start to its end."""

    start: Floats
    """From when the plan was checked, in [s]. Shape (slabs,)."""
    end: Floats
    """Likewise; the next one's start. Shape (slabs,)."""
    middle: Floats
    """Middles of the boxes, in [rad] or [m]. Shape (slabs, nv)."""
    half: Floats
    """Half their widths, alike. Shape (slabs, nv)."""


def make_slabs(plan: CheckedPlan, limits: JointLimits, reaction_time: float) -> JointSlabs:
    """All slabs from when the plan was checked until the arm rests after it.

    Args:
        plan: What the arm follows.
        limits: Of the robot that it was checked for.
        reaction_time: From the plan's end to braking torque, in [s].
    """
    waiting = max(plan.stamp - plan.now, 0.0)
    begin = max(plan.now - plan.stamp, 0.0)
    last = float(plan.times[-1])
    parts = []
    if waiting > 0.0:
        nodes = np.linspace(0.0, waiting, WAITING_SLABS + 1)
        age = plan.now - plan.measured_stamp
        low, high = _spread(plan.measured_q, plan.measured_v, age, np.inf, limits, nodes)
        parts.append((nodes, low, high))
    count = min(max(int(np.ceil((last - begin) / SLAB)), 1), MOST_CURVE_SLABS)
    nodes = np.linspace(begin, last, count + 1)
    low, high = np.empty((2, count, len(plan.deviation)))
    _fill_ranges(plan.times, plan.q, plan.v, nodes, low, high)
    parts.append((nodes - begin, low - plan.deviation, high + plan.deviation))

    errors = limits._replace(position_error=plan.deviation, velocity_error=plan.end_deviation)
    rest = compute_stop_time(
        plan.v[-1],
        plan.end_deviation,
        limits.velocity,
        limits.acceleration,
        limits.braking,
        0.0,
        0.0,
        reaction_time,
    )
    nodes = np.concatenate(
        [
            np.linspace(0.0, reaction_time, FREE_SLABS + 1)[:-1],
            np.linspace(reaction_time, rest, BRAKING_SLABS + 1),
        ]
    )
    low, high = _spread(plan.q[-1], plan.v[-1], 0.0, reaction_time, errors, nodes)
    parts.append((nodes, low, high))
    return _join(parts, limits)


def _join(parts: list[tuple[Floats, Floats, Floats]], limits: JointLimits) -> JointSlabs:
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
    half = 0.5 * (high - low) + ROUNDING * (np.abs(low) + np.abs(high))
    return JointSlabs(np.concatenate(starts), np.concatenate(ends), 0.5 * (high + low), half)


def _spread(
    q: Floats, v: Floats, age: float, free: float, limits: JointLimits, nodes: Floats
) -> tuple[Floats, Floats]:
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
    times: Floats, q: Floats, v: Floats, nodes: Floats, low: Floats, high: Floats
) -> None:
    """Fill the ranges of the curve between neighbouring nodes. Shape (nodes - 1, nv)."""
    for slab in range(nodes.shape[0] - 1):
        curve_range(times, q, v, nodes[slab], nodes[slab + 1], low[slab], high[slab])
