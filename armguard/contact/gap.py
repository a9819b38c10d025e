"""Compiled code for the time during which one direction separates two bounded bodies.

A unit vector n, the *separating direction*, proves that a sphere (body 1) and a point (body 2) are
apart at time t if

    gap(n, t) = n.x - contact_distance - D1(t) - D2(t) > 0,

where D bounds how far a body comes along its side of n with its acceleration, top speed, velocity
error and age. The gap is concave in t, piecewise quadratic, and followed to its root in closed
form. Whatever the direction, the time reached is proved; so it is in floating point:

- With e = 2**-53: a direction of length right to 4 e, positions right to e and sums of products
  make n.x right to 9 e |x|. D is a sum of at most three non-negative magnitudes ("reach"), each
  right to 5 e; the sums of the gap add 4 e of every term. GAP_ROUNDING, which is 16 e, of
  |x| + contact_distance and of both reaches is subtracted.
- A closing speed is inflated by GAP_ROUNDING of |v| + velocity_error, never of its own small
  value, and a slope by GAP_ROUNDING of the speeds in it. The step up to which
  `gap - slope h - accel h^2 / 2` stays positive is right to 10 e and shortened by 16 e, and so is
  its sum with the time so far. Slope and acceleration bound the gap between the two ends (Taylor's
  formula, not an approximation).
- When a body is taken to reach its top speed does not matter to safety: see `follow_forward`.
- Squares are used where they keep their bits; else the direction is rescaled by a power of two
  and the root taken by `hypot`. Non-zero accelerations below TINY count as TINY, lengths below it
  as contact, so that what underflows (2**-1074) is far below the GAP_ROUNDING of something present.
  Times below SHORTEST, where rounding is no longer relative, count as none. Lengths and ages above
  LARGE count as contact, speeds above it as anything up to the top speed, and no gap can overflow
  upwards; what overflows otherwise makes it -inf or NaN and ends the search where it stands.
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

from armguard.contact.bodies import Bounds
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import GAP_ROUNDING

TINY = 1e-270
LARGE = 1e153
NO_BOUND = sys.float_info.max  # the top speed of a body that has none
SHORTEST = 1e-305  # no time but 0 is shorter, so that times have all their bits
LONGEST = 1e305  # no step is longer, so that sums of times stay finite
MAX_PIECES = 12  # seven, and a few for ends that rounding splits


class Approach(NamedTuple):
    """One body along a direction, on its side of it."""

    closing: float
    """Its measured speed along the direction at its stamp, in [m/s]."""
    margin: float
    """What is added to that, in [m/s]; see `limits`."""
    top: float
    """Its top speed, in [m/s]."""
    accel: float
    """Bound on its acceleration, in [m/s²], as `usable_accel` gives it."""
    inverse: float
    """1 / accel, in [s²/m]."""
    age: float
    """Now minus its stamp, in [s]."""


@kernel
def _measured_speed(vx: float, vy: float, vz: float, speed: float, velocity_error: float) -> float:
    """The speed bound that holds: `speed`, or what was measured where that breaks it."""
    allowed = speed + velocity_error
    largest = max(abs(vx), abs(vy), abs(vz))
    if not (largest > 0.0):
        return largest + velocity_error  # NaN, or a zero that no bound can break
    scaled_x, scaled_y, scaled_z = vx / largest, vy / largest, vz / largest
    norm = largest * math.sqrt(scaled_x**2 + scaled_y**2 + scaled_z**2)
    norm = norm * (1.0 + GAP_ROUNDING) + 5e-324
    if norm <= allowed * (1.0 - GAP_ROUNDING):
        return speed
    return (norm + velocity_error) * (1.0 + GAP_ROUNDING)


@merged_kernel
def limits(vx: float, vy: float, vz: float, bounds: Bounds) -> tuple[float, float]:
    """Top speed, and what is added to a measured closing speed: its error, and a few ulp of |v|.

    Without a bound on acceleration a body has its top speed at once: its margin is infinite.
    """
    accel, speed, velocity_error, _ = bounds
    size = abs(vx) + abs(vy) + abs(vz)
    top = speed
    if not size * (1.0 + GAP_ROUNDING) <= speed + velocity_error:  # `size` is no less than |v|
        top = _measured_speed(vx, vy, vz, speed, velocity_error)
    margin = velocity_error
    if size > 0.0:
        margin += GAP_ROUNDING * (max(size, TINY) + velocity_error)
    if accel == math.inf or size > LARGE:
        margin = math.inf
    if top > NO_BOUND:  # without a bound; one that is broken by that much is beyond reckoning
        top = NO_BOUND if speed == math.inf and size <= LARGE else math.nan
    return top, margin


@kernel
def clock_drift(vx: float, vy: float, vz: float, bounds: Bounds, clock_error: float) -> float:
    """How far a body can get in the time that its stamp may be off by, rounded up."""
    if clock_error == 0.0:
        return 0.0
    top = limits(vx, vy, vz, bounds)[0]
    if bounds.speed == math.inf:
        return math.inf if clock_error > 0.0 else math.nan
    return top * clock_error * (1.0 + GAP_ROUNDING) + (TINY if top > 0.0 else 0.0)


@merged_kernel
def usable_accel(accel: float) -> float:
    """The acceleration to reckon with: none where `limits` sees to it, never a vanishing one."""
    if accel == math.inf:
        return 0.0
    return TINY if 0.0 < accel < TINY else abs(accel)  # -0.0 has no usable inverse


@merged_kernel
def are_bounds(bounds: Bounds) -> bool:
    """Whether bounds and age are usable, and hold the body back at all (NaN never does)."""
    accel, speed, velocity_error, age = bounds
    return (
        accel >= 0.0
        and speed >= 0.0
        and velocity_error >= 0.0
        and abs(age) < LARGE
        and (speed < math.inf or accel + velocity_error < math.inf)
    )


@kernel
def _rescaled(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    largest = max(abs(x), abs(y), abs(z))
    if not (0.0 < largest < math.inf):
        return math.nan, math.nan, math.nan, math.nan
    exponent = math.frexp(largest)[1]
    x, y, z = math.ldexp(x, -exponent), math.ldexp(y, -exponent), math.ldexp(z, -exponent)
    return x, y, z, 1.0 / math.sqrt(x * x + y * y + z * z)


@merged_kernel
def direction(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """A vector along (x, y, z) and the inverse of its length; NaN for the zero vector.

    Kept apart so that products with the vector need not wait for the root and the quotient.
    """
    square = x * x + y * y + z * z
    if 1e-40 < square < 1e300:
        return x, y, z, 1.0 / math.sqrt(square)
    return _rescaled(x, y, z)


@kernel
def _extreme_root(gap: float, slope: float, accel: float) -> float:
    return math.hypot(slope, math.sqrt(accel) * math.sqrt(gap) * math.sqrt(2.0))


@merged_kernel
def _step(gap: float, slope: float, accel: float) -> float:
    """Largest h up to which gap - slope h - accel h^2 / 2 stays positive, for gap > 0."""
    square = slope * slope + 2.0 * accel * gap
    ordinary = 1e-280 < square < 1e300
    root = math.sqrt(square) if ordinary else _extreme_root(gap, slope, accel)
    # One division for both forms: which of them is right depends on the data, as chance would.
    closing = slope >= 0.0
    above = root - slope
    below = slope + root
    twice = 2.0 * gap
    above = twice if closing else above
    below = below if closing else accel
    step = above / below * (1.0 - GAP_ROUNDING)
    if step > LONGEST:  # only what never closes takes for ever; NaN stays
        return math.inf if accel == 0.0 and slope <= 0.0 else LONGEST
    return step


@merged_kernel
def later(t: float, step: float) -> float:
    """The time `step` after `t`, rounded down, but never before `t`."""
    after = (t + step) * (1.0 - GAP_ROUNDING)
    return after if after > t + SHORTEST else t


@merged_kernel
def follow_forward(
    along: float, length: float, t: float, one: Approach, s1: float, other: Approach, s2: float
) -> tuple[float, float, float]:
    """`follow` where no stamp is newer than `t`: at most three pieces, chosen without branches.

    The stamps are `s1` and `s2` before `t`, in [s].

    A body's saturation is the time from its stamp to its top speed. With s the time since its
    stamp, a body that gains speed until sigma and has its top speed from then on comes
    start sigma + accel sigma^2 / 2 + top (s - sigma) far: its advance is the least of these over
    all sigma, so that each of them bounds it, and the rounding of sigma costs nothing.
    """
    closing1, margin1, top1, accel1, inverse1, _ = one
    closing2, margin2, top2, accel2, inverse2, _ = other
    start1 = closing1 + margin1
    start2 = closing2 + margin2
    start1 = top1 if start1 > top1 else start1
    start2 = top2 if start2 > top2 else start2
    saturation1 = (top1 - start1) * inverse1 if start1 < top1 else 0.0
    saturation2 = (top2 - start2) * inverse2 if start2 < top2 else 0.0
    # The gap at `t`: each body gains speed until its saturation and cruises from then on.
    until1 = min(saturation1, s1)
    until2 = min(saturation2, s2)
    gain1 = accel1 * until1
    gain2 = accel2 * until2
    cruise1 = top1 * (s1 - until1)
    cruise2 = top2 * (s2 - until2)
    advance1 = until1 * (start1 + 0.5 * gain1) + cruise1
    advance2 = until2 * (start2 + 0.5 * gain2) + cruise2
    fast1 = abs(start1) + gain1
    fast2 = abs(start2) + gain2
    reach = (until1 * fast1 + cruise1) + (until2 * fast2 + cruise2)
    gap = along - advance1 - advance2 - GAP_ROUNDING * (length + reach)
    if not gap > 0.0:
        return t, saturation1, saturation2

    # The gap's pieces from `t` on: until `first` both gain speed, until `last` one of them does.
    slope1 = start1 + gain1
    slope2 = start2 + gain2
    left1 = saturation1 - until1
    left2 = saturation2 - until2
    first = min(left1, left2)
    last = max(left1, left2)
    accel = accel1 + accel2
    slope = slope1 + slope2 + GAP_ROUNDING * (fast1 + fast2)
    # The second piece: one body has its top speed, the other one goes on gaining.
    is_first = left1 < left2
    later_accel = accel2 if is_first else accel1
    capped = top1 if is_first else top2
    gaining = slope2 if is_first else slope1
    gained = later_accel * first
    later_slope = capped + gaining + gained + GAP_ROUNDING * (capped + abs(gaining) + gained)
    later_gap = gap - first * (slope + 0.5 * accel * first)
    later_gap -= GAP_ROUNDING * (gap + first * (abs(slope) + accel * first))
    # The third piece: both have their top speeds, and the gap is linear.
    span = last - first
    last_slope = (top1 + top2) * (1.0 + GAP_ROUNDING)
    last_gap = later_gap - span * (later_slope + 0.5 * later_accel * span)
    last_gap -= GAP_ROUNDING * (later_gap + span * (abs(later_slope) + later_accel * span))
    # The root lies in the last piece at whose beginning the gap is still positive.
    is_later = (later_gap > 0.0) & (first < LONGEST)
    is_last = is_later & (last_gap > 0.0) & (last < LONGEST)
    past = first if is_later else 0.0
    gap = later_gap if is_later else gap
    slope = later_slope if is_later else slope
    accel = later_accel if is_later else accel
    past = last if is_last else past
    gap = last_gap if is_last else gap
    slope = last_slope if is_last else slope
    accel = 0.0 if is_last else accel
    return later(t, past + _step(gap, slope, accel)), saturation1, saturation2


@kernel
def motion(approach: Approach, s: float) -> tuple[float, float, float, float, float, float]:
    """One body's advance along a direction, `s` seconds from its stamp, either way.

    Returns the advance; the largest speed in it; slope and curvature in time of what bounds it
    from here to the end of the piece; that end, counted from the stamp; and the saturation time,
    from the stamp to when the speed bound is reached, inf if that lies further out than `s`.
    """
    closing, margin, top, accel, _, age = approach
    start = (closing if s >= 0.0 else -closing) + margin
    if start > top:
        start = top
    span = abs(s)
    reached = start + accel * span
    if reached < top * (1.0 - GAP_ROUNDING):
        advance = span * (start + 0.5 * accel * span)
        fast = abs(start) + accel * span
        if s >= 0.0:
            return advance, fast, reached, accel, s + (top - reached) / accel, math.inf
        return advance, fast, -reached, accel, 0.0, math.inf
    saturation = (top - start) / accel if start < top else 0.0
    until = min(saturation, span)
    advance = 0.5 * (start + top) * until + top * (span - until)
    if s >= 0.0:
        return advance, top, top, 0.0, math.inf, saturation
    if span - saturation > -2.0 * GAP_ROUNDING * age:
        return advance, top, -top, 0.0, -saturation, saturation
    # Too close to the end of the piece to step there: the chord to the stamp, D being convex.
    return advance, top, -advance / span, 0.0, 0.0, saturation


@kernel
def follow_backward(
    along: float, length: float, t: float, one: Approach, other: Approach
) -> tuple[float, float, float]:
    """`follow` where a stamp is newer than `t`: piece by piece, each bounded anew.

    Invariant of the loop: the gap is positive from the first `t` up to the present one.
    """
    age1, age2 = one.age, other.age
    saturation1 = 0.0
    saturation2 = 0.0
    for _ in range(MAX_PIECES):
        s1 = age1 + t
        s2 = age2 + t
        if s1 >= 0.0 and s2 >= 0.0:
            return follow_forward(along, length, t, one, s1, other, s2)
        advance1, fast1, slope1, curvature1, end1, saturation1 = motion(one, s1)
        advance2, fast2, slope2, curvature2, end2, saturation2 = motion(other, s2)
        slack = GAP_ROUNDING * (length + fast1 * abs(s1) + fast2 * abs(s2))
        gap = along - advance1 - advance2 - slack
        if not gap > 0.0:
            break
        # An end that is not the stamp itself comes a little early where that matters; where time
        # is too coarse to resolve it, the top speed bounds what follows.
        end1 = -age1 if end1 == 0.0 else (end1 - age1) * (1.0 - GAP_ROUNDING)
        end2 = -age2 if end2 == 0.0 else (end2 - age2) * (1.0 - GAP_ROUNDING)
        if not end1 > t + SHORTEST:
            slope1, curvature1, end1 = one.top, 0.0, math.inf
        if not end2 > t + SHORTEST:
            slope2, curvature2, end2 = other.top, 0.0, math.inf
        slope = slope1 + slope2 + GAP_ROUNDING * (fast1 + fast2)
        step = _step(gap, slope, curvature1 + curvature2)
        end = min(end1, end2)
        if not end < t + step:
            return later(t, step), saturation1, saturation2
        t = end
    return t, saturation1, saturation2


@merged_kernel
def follow(
    along: float, length: float, t: float, one: Approach, other: Approach
) -> tuple[float, float, float]:
    """Follow the gap of one direction from `t` to its root.

    `along` is n.x - contact_distance, `length` the magnitude that its rounding goes by. Returns
    the time reached, no earlier than `t`, and for both bodies the saturation time: for no longer
    than that from their stamps they are carried along their measured velocities when the next
    direction is chosen.
    """
    s1 = one.age + t
    s2 = other.age + t
    if s1 >= 0.0 and s2 >= 0.0:
        return follow_forward(along, length, t, one, s1, other, s2)
    return follow_backward(along, length, t, one, other)
