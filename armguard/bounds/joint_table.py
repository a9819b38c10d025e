"""How far a point can be moved while every joint stays within a range: the box of displacements.

From the true configuration q0 to q0 + D along a straight path, at the fraction s of it,

    n . (p(q0 + D) - p(q0)) = sum_i D_i * (mean over s of the slope n . dp/dq_i).

With R_max(i, j, ...) the reach about the most distal of some joints, which no derivative of p with
respect to them exceeds, dq the position errors, c and h the first and second derivatives of n . p
at the *measured* configuration, the slope of joint i is within

- +- R_i, whatever the configuration,
- c_i +- (E_i + s S_i), with E_i = sum_j R_max(i, j) dq_j and S_i = sum_j R_max(i, j) |D_j|,
- c_i + s sum_j h_ij D_j +- (E_i + sum_jk R_max(i, j, k) (s |D_j| + dq_j) (s |D_k| + dq_k) / 2).

The mean of the lesser of the first two is elementary; that of the third is taken apart, with
|D| + sqrt(3) dq in place of |D| and dq. What they give is convex in each D_i, so the ends of its
range decide. The first two alone are the limit of arbitrarily many slices of the path, and never
exceed the second-order Taylor bound sum_i c_i D_i + sum_ij R_max(i, j) |D_i| |D_j| / 2.

A derivative with respect to several joints vanishes where one that is not the most distal slides.

A range over a time interval is that of its ends: `high` falls and then rises, `low` mirrors it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import SUM_ROUNDING

ROOT_3 = 1.7320508075688774  # rounded up


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
    turning: BoolArray
    """Which joints are revolute. Shape (nv,)."""
    position_error: FloatArray
    """What the measured positions may be off by, in [rad] or [m]. Shape (nv,)."""
    interpolates: bool
    """Whether `high` is convex and `low` concave, so that chords between nodes bound them."""
    span: FloatArray
    """Room to work in: high, low and magnitude over the interval at hand. Shape (3, nv)."""
    columns: FloatArray
    """Room to work in: the Jacobian of the point at hand, in [m]. Shape (3, nv)."""
    bend: FloatArray
    """Room to work in: the most that slopes rise and fall by second derivatives. Shape (2, nv)."""


def make_table(
    time: FloatArray, turning: BoolArray, position_error: FloatArray, interpolates: bool
) -> JointTable:
    """A table without content."""
    shape = len(time), len(turning)
    return JointTable(
        time=time,
        high=np.full(shape, np.inf),
        low=np.full(shape, -np.inf),
        highest=np.full(shape[1], np.inf),
        lowest=np.full(shape[1], -np.inf),
        turning=turning,
        position_error=position_error,
        interpolates=interpolates,
        span=np.zeros((3, shape[1])),
        columns=np.zeros((3, shape[1])),
        bend=np.zeros((2, shape[1])),
    )


@merged_kernel
def set_span(table: JointTable, first: int, last: int, part: float) -> None:
    """Fill `table.span` for the time from one node to a fraction of the time to another."""
    if not table.interpolates:
        part = 1.0
    for j in range(table.turning.shape[0]):
        before, after = table.high[first, j], table.high[last, j]
        high = max(before, before + part * (after - before))
        before, after = table.low[first, j], table.low[last, j]
        low = min(before, before + part * (after - before))
        high = min(high, table.highest[j])
        low = max(low, table.lowest[j])
        table.span[0, j] = high
        table.span[1, j] = low
        table.span[2, j] = max(high, -low)


@kernel
def _mean_slope(slope: float, spread: float, lever: float) -> float:
    """Mean over s in [0, 1] of min(slope + s spread, lever)."""
    if slope >= lever:
        return lever
    if slope + spread <= lever:
        return slope + 0.5 * spread
    missing = lever - slope
    return lever - 0.5 * missing * missing / spread


@kernel
def set_columns(px: float, py: float, pz: float, jacobian: FloatArray, table: JointTable) -> bool:
    """Fill `table.columns` for the point p; whether they are numbers, and finite.

    The Jacobian, shape (6, nv), is Pinocchio's `data.J` at the measured configuration: linear and
    angular velocity of what each joint moves, at the origin of the frame that p is in.
    """
    total = 0.0
    for j in range(table.turning.shape[0]):
        ax, ay, az = jacobian[3, j], jacobian[4, j], jacobian[5, j]
        x = jacobian[0, j] + ay * pz - az * py
        y = jacobian[1, j] + az * px - ax * pz
        z = jacobian[2, j] + ax * py - ay * px
        table.columns[0, j], table.columns[1, j], table.columns[2, j] = x, y, z
        total += x + y + z
    return abs(total) < np.inf


@kernel
def _set_bend(
    nx: float, ny: float, nz: float, jacobian: FloatArray, lever: FloatArray, table: JointTable
) -> None:
    """Fill `table.bend`: sum_j of the greatest h_ij D_j, and of the greatest -h_ij D_j."""
    bend, span, columns = table.bend, table.span, table.columns
    bend[:] = 0.0
    for i in range(lever.shape[0]):
        if not lever[i] > 0.0:
            continue
        ax, ay, az = jacobian[3, i], jacobian[4, i], jacobian[5, i]
        mx, my, mz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        for j in range(i, lever.shape[0]):
            if not lever[j] > 0.0:
                continue
            second = mx * columns[0, j] + my * columns[1, j] + mz * columns[2, j]
            one, other = second * span[0, j], second * span[1, j]
            bend[0, i] += max(one, other)
            bend[1, i] -= min(one, other)
            if j > i:
                one, other = second * span[0, i], second * span[1, i]
                bend[0, j] += max(one, other)
                bend[1, j] -= min(one, other)


@kernel
def displacement_in_span(
    nx: float,
    ny: float,
    nz: float,
    jacobian: FloatArray,
    lever: FloatArray,
    slope_error: FloatArray,
    table: JointTable,
) -> float:
    """Bound on the displacement along n of a point while joints stay in `table.span`.

    `table.columns` are the point's. `jacobian`, (6, nv), is as for them; `lever` and
    `slope_error`, (nv,), are R_i and E_i.
    """
    span, columns = table.span, table.columns
    _set_bend(nx, ny, nz, jacobian, lever, table)
    # Towards the tip: sums over all joints of second and third order. In the second pass those of
    # the joints up to j are taken off one by one, which leaves the joints behind joint j.
    beyond = 0.0
    beyond_third = 0.0
    moved = 0.0
    wide = 0.0
    for j in range(lever.shape[0]):
        if lever[j] > 0.0:
            size = span[2, j]
            wider = size + ROOT_3 * table.position_error[j]
            beyond += lever[j] * size
            beyond_third += lever[j] * wider * (2.0 * wide + (wider if table.turning[j] else 0.0))
            if table.turning[j]:
                moved += size
                wide += wider
    largest = beyond * (1.0 + moved) + beyond_third * wide
    # From the base to the tip: `moved` and `wide` are the angles turned up to joint j.
    moved = 0.0
    wide = 0.0
    total = 0.0
    for j in range(lever.shape[0]):
        radius = lever[j]
        if not radius > 0.0:
            continue
        high, low, size = span[0, j], span[1, j], span[2, j]
        wider = size + ROOT_3 * table.position_error[j]
        beyond -= radius * size
        beyond_third -= radius * wider * (2.0 * wide + (wider if table.turning[j] else 0.0))
        if table.turning[j]:
            moved += size
            wide += wider
            spread = radius * moved + max(beyond, 0.0)
            third = radius * wide * wide + max(beyond_third, 0.0)
        else:
            spread = radius * moved
            third = radius * wide * wide
        # Mean slope of joint j along n, upwards and downwards: the lesser of both bounds above.
        slope = nx * columns[0, j] + ny * columns[1, j] + nz * columns[2, j]
        slope = min(max(slope, -radius), radius)
        error = slope_error[j]
        rest = error + third / 6.0
        rising = min(
            _mean_slope(slope + error, spread, radius), slope + 0.5 * table.bend[0, j] + rest
        )
        falling = -min(
            _mean_slope(error - slope, spread, radius), 0.5 * table.bend[1, j] - slope + rest
        )
        # Convex in the joint's displacement: one end of its range decides.
        upwards = high * (rising if high > 0.0 else falling)
        downwards = low * (rising if low > 0.0 else falling)
        total += max(upwards, downwards)
    return total + SUM_ROUNDING * largest


@merged_kernel
def _displacement_without_bend(
    nx: float,
    ny: float,
    nz: float,
    lever: FloatArray,
    slope_error: FloatArray,
    table: JointTable,
) -> float:
    """`displacement_in_span` by the first two bounds on slopes alone: cheaper, and safe by itself.

    But for rounding it is never less, since that one takes the least of these and others.
    """
    span, columns = table.span, table.columns
    beyond = moved = 0.0
    for j in range(lever.shape[0]):
        if lever[j] > 0.0:
            beyond += lever[j] * span[2, j]
            if table.turning[j]:
                moved += span[2, j]
    largest = beyond * (1.0 + moved)
    moved = total = 0.0
    for j in range(lever.shape[0]):
        radius = lever[j]
        if not radius > 0.0:
            continue
        high, low, size = span[0, j], span[1, j], span[2, j]
        beyond -= radius * size
        spread = 0.0
        if table.turning[j]:
            moved += size
            spread = max(beyond, 0.0)
        spread += radius * moved
        slope = nx * columns[0, j] + ny * columns[1, j] + nz * columns[2, j]
        slope = min(max(slope, -radius), radius)
        error = slope_error[j]
        rising = _mean_slope(slope + error, spread, radius)
        falling = -_mean_slope(error - slope, spread, radius)
        upwards = high * (rising if high > 0.0 else falling)
        downwards = low * (rising if low > 0.0 else falling)
        total += max(upwards, downwards)
    return total + SUM_ROUNDING * largest


@merged_kernel
def stays_within(
    room: float,
    nx: float,
    ny: float,
    nz: float,
    jacobian: FloatArray,
    lever: FloatArray,
    slope_error: FloatArray,
    table: JointTable,
) -> bool:
    """Whether a point is surely displaced along n by less than `room`, in [m].

    The other arguments are those of `displacement_in_span`, by which it is decided where a bound
    that takes half the time does not say so already.
    """
    if room > _displacement_without_bend(nx, ny, nz, lever, slope_error, table):
        return True
    found: bool = room > displacement_in_span(nx, ny, nz, jacobian, lever, slope_error, table)
    return found
