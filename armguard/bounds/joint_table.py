"""Tables of joint displacements over time, for joints that move freely or brake.

Where contact limits are stated there are ranges of velocities as well, see `fill_velocities`.

The range over a time interval is that of its ends: `high` falls and then rises, `low` mirrors it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.bounds.displacement import fill_displacements, fill_velocities
from armguard.bounds.joint_box import JointBox, make_box
from armguard.bounds.limits import JointLimits
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel, merged_kernel


class JointTable(NamedTuple):
    """Displacements of all joints over a grid of times, for one joint state."""

    time: FloatArray
    """From now, in [s], rising from 0. Shape (nodes,)."""
    high: FloatArray
    """Greatest displacements at each node, in [rad] or [m], not yet clipped. Shape (nodes, nv)."""
    low: FloatArray
    """Least displacements at each node, in [rad] or [m], not yet clipped. Shape (nodes, nv)."""
    highest: FloatArray
    """What `high` is clipped to. Shape (nv,)."""
    lowest: FloatArray
    """What `low` is clipped to. Shape (nv,)."""
    fastest: FloatArray
    """Greatest velocities that each node stands for, in [rad]/[s] or [m]/[s]; without rows where
    no contact limits are stated. Shape (nodes, nv) or (0, nv)."""
    slowest: FloatArray
    """Least velocities, alike."""
    interpolates: bool
    """Whether `high` is convex and `low` concave, so that chords between nodes bound them."""
    box: JointBox
    """The range over the interval at hand, which `set_span` fills."""


def make_table(
    time: FloatArray,
    turning: BoolArray,
    position_error: FloatArray,
    *,
    interpolates: bool,
    with_velocities: bool,
) -> JointTable:
    """A table without content."""
    shape = len(time), len(turning)
    timed = shape if with_velocities else (0, shape[1])
    return JointTable(
        time=time,
        high=np.full(shape, np.inf),
        low=np.full(shape, -np.inf),
        highest=np.full(shape[1], np.inf),
        lowest=np.full(shape[1], -np.inf),
        fastest=np.full(timed, np.inf),
        slowest=np.full(timed, -np.inf),
        interpolates=interpolates,
        box=make_box(turning, position_error),
    )


@kernel
def fill_table(
    q: FloatArray, v: FloatArray, age: float, free: float, limits: JointLimits, table: JointTable
) -> None:
    """Fill a table, whose nodes stand for times from now; arguments as for `fill_velocities`."""
    fill_displacements(
        q, v, age, free, limits, table.time, table.high, table.low, table.highest, table.lowest
    )
    if table.fastest.shape[0] > 0:
        fill_velocities(q, v, age, free, limits, table.time, table.fastest, table.slowest)


@merged_kernel
def set_span(table: JointTable, first: int, last: int, part: float) -> None:
    """Fill `table.box.span` for the time from one node to a fraction of the time to another."""
    if not table.interpolates:
        part = 1.0
    span = table.box.span
    for j in range(table.highest.shape[0]):
        before, after = table.high[first, j], table.high[last, j]
        high = max(before, before + part * (after - before))
        before, after = table.low[first, j], table.low[last, j]
        low = min(before, before + part * (after - before))
        high = min(high, table.highest[j])
        low = max(low, table.lowest[j])
        span[0, j] = high
        span[1, j] = low
        span[2, j] = max(high, -low)
