"""Bounds on a point's displacement while every joint stays within a range: the box.

From the true configuration q0 to q0 + D along a straight path, at the fraction s of it,

    n . (p(q0 + D) - p(q0)) = sum_i D_i * (mean over s of the slope n . dp/dq_i).

With R_max(i, j, ...) the reach about the most distal of some joints, which no derivative of p with
respect to them exceeds, dq the position errors, c and h the first and second derivatives of n . p
at the *measured* configuration, the slope of joint i is within

- +- R_i, whatever the configuration,
- c_i +- (E_i + s S_i), with E_i = sum_j R_max(i, j) dq_j and S_i = sum_j R_max(i, j) |D_j|,
- c_i + s sum_j h_ij D_j +- (E_i + sum_jk R_max(i, j, k) (s |D_j| + dq_j) (s |D_k| + dq_k) / 2).

The first two give one bound, the third another; both hold, so the lesser counts. The mean of the
lesser of the first two is elementary. It is the limit of arbitrarily many slices of the path, and
never exceeds the second-order Taylor bound sum_i c_i D_i + sum_ij R_max(i, j) |D_i| |D_j| / 2.

The third gives a quadratic form and a remainder, with |D| + sqrt(3) dq in place of |D| and dq:

    sum_i D_i (c_i + sum_j h_ij D_j / 2)
        + sum_i |D_i| E_i + sum_ijk R_max(i, j, k) |D_i D_j D_k| / 6.

Where c_i + sum_j h_ij D_j has one sign all over the box, the form is greatest with D_i at one end
of its range, whatever the other joints do. With these ends fixed, each h_ij D_j counts as the most
that it can be. What is left is convex in each D_i, so the ends of its range decide.

A derivative with respect to several joints vanishes where one that is not the most distal slides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import SUM_ROUNDING

Vector = tuple[float, float, float]
"""In the world."""

ROOT_3 = 1.7320508075688774  # rounded up


class JointBox(NamedTuple):
    """Ranges of joint displacements, and the room to bound what a point does within them."""

    turning: BoolArray
    """Which joints are revolute. Shape (nv,)."""
    position_error: FloatArray
    """Error of the configuration that displacements count from, in [rad] or [m]. Shape (nv,)."""
    span: FloatArray
    """Greatest and least displacements, and greatest magnitudes, in [rad] or [m]. Shape (3, nv)."""
    columns: FloatArray
    """Room to work in: the Jacobian of the point at hand, in [m]. Shape (3, nv)."""
    slope: FloatArray
    """Room to work in: slopes c_i along the direction at hand, in [m]. Shape (nv,)."""
    second: FloatArray
    """Room to work in: second derivatives h_ij along it, in [m]. Shape (nv, nv)."""
    ends: FloatArray
    """Room to work in: the part of `span` where they are greatest, as there. Shape (2, nv)."""
    forth: FloatArray
    """Room to work in: how far joints can go, in [rad] or [m]. Shape (nv,)."""
    back: FloatArray
    """Room to work in: the same the other way, negative. Shape (nv,)."""
    joints: FloatArray
    """Room to work in: a row of numbers for each joint, see `surface_speed`. Shape (nv, 15)."""


def make_box(turning: BoolArray, position_error: FloatArray) -> JointBox:
    """A box of no displacements, for joints that are measured with these errors."""
    count = len(turning)
    return JointBox(
        turning=turning,
        position_error=position_error,
        span=np.zeros((3, count)),
        columns=np.zeros((3, count)),
        slope=np.zeros(count),
        second=np.zeros((count, count)),
        ends=np.zeros((2, count)),
        forth=np.zeros(count),
        back=np.zeros(count),
        joints=np.zeros((count, 15)),
    )


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
def set_columns(px: float, py: float, pz: float, jacobian: FloatArray, box: JointBox) -> bool:
    """Fill `box.columns` for the point p; whether they are numbers, and finite.

    The Jacobian, shape (6, nv), is Pinocchio's `data.J` at the measured configuration: linear and
    angular velocity of what each joint moves, at the origin of the frame that p is in.
    """
    total = 0.0
    for j in range(box.turning.shape[0]):
        ax, ay, az = jacobian[3, j], jacobian[4, j], jacobian[5, j]
        x = jacobian[0, j] + ay * pz - az * py
        y = jacobian[1, j] + az * px - ax * pz
        z = jacobian[2, j] + ax * py - ay * px
        box.columns[0, j], box.columns[1, j], box.columns[2, j] = x, y, z
        total += x + y + z
    return abs(total) < np.inf


@merged_kernel
def _displacement_by_levers(
    normal: Vector,
    lever: FloatArray,
    slope_error: FloatArray,
    box: JointBox,
) -> float:
    """The bound by the first two bounds on slopes; arguments as in `displacement_in_box`."""
    nx, ny, nz = normal
    span, columns = box.span, box.columns
    beyond = moved = 0.0
    for j in range(lever.shape[0]):
        if lever[j] > 0.0:
            beyond += lever[j] * span[2, j]
            if box.turning[j]:
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
        if box.turning[j]:
            moved += size
            spread = max(beyond, 0.0)
        spread += radius * moved
        slope = nx * columns[0, j] + ny * columns[1, j] + nz * columns[2, j]
        slope = min(max(slope, -radius), radius)
        error = slope_error[j]
        rising = _mean_slope(slope + error, spread, radius)
        falling = -_mean_slope(error - slope, spread, radius)
        # Convex in the joint's displacement: one end of its range decides.
        upwards = high * (rising if high > 0.0 else falling)
        downwards = low * (rising if low > 0.0 else falling)
        total += max(upwards, downwards)
    return total + SUM_ROUNDING * largest


@kernel
def _fill_slopes(normal: Vector, jacobian: FloatArray, lever: FloatArray, box: JointBox) -> None:
    """Fill `box.slope`, `box.second` and `box.ends` for a direction."""
    nx, ny, nz = normal
    span, columns, slope, second, ends = box.span, box.columns, box.slope, box.second, box.ends
    count = lever.shape[0]
    for i in range(count):
        if not lever[i] > 0.0:
            continue
        slope[i] = nx * columns[0, i] + ny * columns[1, i] + nz * columns[2, i]
        ax, ay, az = jacobian[3, i], jacobian[4, i], jacobian[5, i]
        mx, my, mz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        for j in range(i, count):
            bend = mx * columns[0, j] + my * columns[1, j] + mz * columns[2, j]
            second[i, j] = second[j, i] = bend
    for i in range(count):
        if not lever[i] > 0.0:
            continue
        most = least = slope[i]
        for j in range(count):
            if lever[j] > 0.0:
                one, other = second[i, j] * span[0, j], second[i, j] * span[1, j]
                most += max(one, other)
                least += min(one, other)
        ends[0, i], ends[1, i] = span[0, i], span[1, i]
        if least >= 0.0:
            ends[1, i] = ends[0, i]
        elif most <= 0.0:
            ends[0, i] = ends[1, i]


@kernel
def _displacement_by_second_derivatives(
    normal: Vector,
    jacobian: FloatArray,
    lever: FloatArray,
    slope_error: FloatArray,
    box: JointBox,
) -> float:
    """The bound by the last bound on slopes; arguments as in `displacement_in_box`."""
    _fill_slopes(normal, jacobian, lever, box)
    total = rest = largest = 0.0
    # From the base to the tip: `wide` is the angle turned up to joint i.
    wide = 0.0
    for i in range(lever.shape[0]):
        radius = lever[i]
        if not radius > 0.0:
            continue
        rise = fall = 0.0
        for j in range(lever.shape[0]):
            if lever[j] > 0.0:
                one, other = box.second[i, j] * box.ends[0, j], box.second[i, j] * box.ends[1, j]
                rise += max(one, other)
                fall += min(one, other)
        # Convex in the joint's displacement: one end of its range decides.
        high, low, slope = box.ends[0, i], box.ends[1, i], box.slope[i]
        upwards = high * (slope + 0.5 * (rise if high > 0.0 else fall))
        downwards = low * (slope + 0.5 * (rise if low > 0.0 else fall))
        total += max(upwards, downwards)
        size = box.span[2, i]
        wider = size + ROOT_3 * box.position_error[i]
        third = 0.5 * wide * wide
        if box.turning[i]:
            third += wider * (0.5 * wide + wider / 6.0)
            wide += wider
        rest += size * slope_error[i] + radius * wider * third
        largest += radius * wider * (1.0 + wide) * (1.0 + wide)
    return total + rest + SUM_ROUNDING * largest


@kernel
def displacement_in_box(
    normal: Vector,
    jacobian: FloatArray,
    lever: FloatArray,
    slope_error: FloatArray,
    box: JointBox,
) -> float:
    """Bound on the displacement along a unit vector n of a point while joints stay in `box.span`.

    `box.columns` are the point's. `jacobian`, (6, nv), is as for them; `lever` and
    `slope_error`, (nv,), are R_i and E_i.
    """
    return min(
        _displacement_by_levers(normal, lever, slope_error, box),
        _displacement_by_second_derivatives(normal, jacobian, lever, slope_error, box),
    )


@merged_kernel
def stays_within(
    room: float,
    normal: Vector,
    jacobian: FloatArray,
    lever: FloatArray,
    slope_error: FloatArray,
    box: JointBox,
) -> bool:
    """Whether the displacement of a point along n is proved to be less than `room`, in [m].

    The other arguments are those of `displacement_in_box`, whose cheaper half is tried first.
    """
    if room > _displacement_by_levers(normal, lever, slope_error, box):
        return True
    found: bool = room > _displacement_by_second_derivatives(
        normal, jacobian, lever, slope_error, box
    )
    return found
