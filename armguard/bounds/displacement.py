"""How far one coordinate can have gone by a given time, within its limits.

A joint that is measured at q with velocity v may truly be anywhere within its errors of both. Its
displacement from where it truly was at the stamp lies between `low` and `high`:

- By acceleration and speed: the free body's bound (`free_body`), convex in time. A joint speeds up
  by no more than the operating acceleration, and to no more than the operating velocity; it slows
  down by as much as the acceleration limit, so that one that goes the wrong way turns round as hard
  as that.
- By position limits: it stays between the limits, or within what was measured beyond them.
- At a stop: no joint is to run into one, but should it do so, it may be at rest at the limit from
  the moment on at which it can have got there first, and come back from there; what throws it
  back is no controller's doing, so it speeds up by as much as the acceleration limit. (One that
  was thrown back before its stamp, and still speeds up so, breaks its operating limits.)
- While it brakes: as the brakes' entry says for the greatest velocity that it can have when they
  bite. Should they bite sooner, it is no faster then, and has that much longer to rest.

Before its stamp a joint was nowhere that its top speed does not reach: backwards in time, what
slows down by the acceleration limit speeds up by it. Both bounds, before they
are clipped to the limits, are convex (`high`) and concave (`low`) functions of time.
"""

from __future__ import annotations

import math

from armguard.bounds.free_body import free_displacement
from armguard.bounds.limits import JointLimits
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.brakes import BrakeCurves, Stop, braked_displacement, find_stop


@kernel
def arrival(start: float, accel: float, top: float, room: float) -> float:
    """Earliest time at which the fastest body can have gone `room`, rounded down; inf if never.

    It starts at `start` and accelerates at `accel` up to `top`, as in `free_displacement`.
    """
    if not room > 0.0:
        return 0.0
    if room == math.inf:
        return math.inf
    start = min(start, top)
    ramp = (top - start) / accel
    root = math.sqrt(start * start + 2.0 * accel * room)
    time = 2.0 * room / (start + root) if start >= 0.0 else (root - start) / accel
    if time > ramp:
        time = ramp + (room - 0.5 * (start + top) * ramp) / top
    return time * (1.0 - SUM_ROUNDING)


@kernel
def operating_velocity(start: float, accel: float, speeding: float, top: float, s: float) -> float:
    """Greatest velocity `s` >= 0 seconds after one of at most `start`.

    A joint that goes the other way turns round by at most `accel`, one that does not speeds up by
    at most `speeding`, and up to `top`.
    """
    if start < 0.0 and speeding < accel:
        turn = -start / accel
        if s <= turn:
            return start + accel * s + SUM_ROUNDING * accel * s
        return min(top, speeding * (s - turn) + SUM_ROUNDING * accel * s)
    return min(top, start + speeding * s)


@kernel
def operating_displacement(
    start: float, accel: float, speeding: float, top: float, s: float
) -> float:
    """How far that joint gets within `s` >= 0 seconds, rounded up."""
    if not (start < 0.0 and speeding < accel):
        displacement: float = free_displacement(start, speeding, top, s)
        return displacement
    turn = -start / accel
    if s <= turn:
        displacement = s * (start + 0.5 * accel * s)
    else:
        displacement = free_displacement(0.0, speeding, top, s - turn) + 0.5 * start * turn
    return displacement + SUM_ROUNDING * s * (accel * s - start)


@kernel
def operating_arrival(
    start: float, accel: float, speeding: float, top: float, room: float
) -> float:
    """Earliest time at which that joint can have gone `room`, rounded down; inf if never."""
    if not (start < 0.0 and speeding < accel and 0.0 < room < math.inf):
        time: float = arrival(start, speeding, top, room)
        return time
    turn = -start / accel
    time = turn + arrival(0.0, speeding, top, room - 0.5 * start * turn)
    return time * (1.0 - SUM_ROUNDING)


@kernel
def rise(
    velocity: float,
    accel: float,
    speeding: float,
    top: float,
    room_below: float,
    below: float,
    s: float,
) -> float:
    """Greatest displacement `s` seconds from the stamp, before it is clipped.

    `velocity` is the greatest that the joint may have had; `room_below` is how far down its stop
    is at the least, and `below` when it can have got there first.
    """
    if s < 0.0:
        return -top * s * (1.0 + SUM_ROUNDING)
    highest = operating_displacement(velocity, accel, speeding, top, s)
    if s > below:
        highest = max(highest, free_displacement(0.0, accel, top, s - below) - max(room_below, 0.0))
    return highest


@kernel
def brake(velocity: float, accel: float, stop: Stop, s: float) -> float:
    """Greatest displacement within `s` seconds of braking from a velocity of at most `velocity`.

    A joint that moves forwards stops as `stop` says, which holds from that velocity; one that moves
    backwards decelerates by at most `accel`, each until it rests.
    """
    if velocity > 0.0:
        braked: float = braked_displacement(velocity, stop, s)
        return braked
    until = min(s, -velocity / accel)
    distance = until * (-velocity - 0.5 * accel * until)
    return -distance + SUM_ROUNDING * distance


@kernel
def eased_velocity(velocity: float, stop: Stop, pace: float, s: float) -> float:
    """Greatest velocity `s` seconds after a joint faster than a pace began to slow down to it.

    It slows down as if it braked. Of times and distances alone, all that follows is that it keeps
    to the pace after the time in which it would rest.
    """
    if s >= stop.time:
        return pace
    return max(pace, velocity - stop.deceleration * s)


@kernel
def _ease(
    velocity: float, accel: float, speeding: float, stop: Stop, pace: float, s: float
) -> tuple[float, float]:
    """Greatest displacement in `s` seconds of keeping to a pace, and the greatest velocity then.

    A joint that is faster slows down as if it braked, any other gets no faster.
    """
    if velocity <= pace:
        eased = operating_displacement(velocity, accel, speeding, pace, s)
        return eased, operating_velocity(velocity, accel, speeding, pace, s)
    # As fast as it was for as long as time and distance allow, and at its pace from then on.
    until = min(s, min(stop.time, stop.distance / velocity))
    distance = until * velocity + pace * (s - until)
    if stop.deceleration > 0.0:
        until = min(min(s, stop.time), (velocity - pace) / stop.deceleration)
        held = until * (velocity - 0.5 * stop.deceleration * until) + pace * (s - until)
        distance = min(distance, held)
    return distance * (1.0 + SUM_ROUNDING), eased_velocity(velocity, stop, pace, s)


@kernel
def _find_stops(
    velocity: float,
    accel: float,
    speeding: float,
    top: float,
    brakes: BrakeCurves,
    joint: int,
    below: float,
    free: float,
    going_on: float,
    pace: float,
) -> tuple[Stop, Stop]:
    """How a joint slows down to its pace, and how it stops then: the same at all times.

    Each is the entry for the greatest velocity that `_ease_off` finds for its beginning.
    """
    reached = operating_velocity(velocity, accel, speeding, top, free)
    if free > below:
        reached = max(reached, min(top, accel * (free - below)))
        speeding = accel
    easing = find_stop(brakes, joint, reached)
    _, left = _ease(reached, accel, speeding, easing, pace, going_on)
    if free < below < free + going_on:
        left = max(left, min(pace, accel * (free + going_on - below)))
    return easing, find_stop(brakes, joint, left)


@kernel
def _ease_off(
    velocity: float,
    accel: float,
    speeding: float,
    top: float,
    easing: Stop,
    highest: float,
    room_below: float,
    below: float,
    free: float,
    going_on: float,
    pace: float,
    s: float,
) -> tuple[float, float]:
    """`rise` of a joint that eases from `free` seconds after the stamp on; its velocity then.

    Of a time `s` from then until it has gone on for `going_on` seconds.
    """
    # Free: from the stamp until `free`.
    displacement = rise(velocity, accel, speeding, top, room_below, below, free)
    # Easing: for `going_on` seconds, from the greatest velocity that it can have reached.
    reached = operating_velocity(velocity, accel, speeding, top, free)
    if free > below:
        reached = max(reached, min(top, accel * (free - below)))
        # What a stop has thrown back still speeds up as hard.
        speeding = accel
    eased, left = _ease(reached, accel, speeding, easing, pace, min(s - free, going_on))
    displacement = min(displacement, highest) + eased
    if free < below < s:
        # It may have come to rest at its stop meanwhile, and come back from there.
        back = min(s, free + going_on) - below
        if back > 0.0:
            displacement = max(displacement, free_displacement(0.0, accel, pace, back) - room_below)
            left = max(left, min(pace, accel * back))
    return displacement, left


@kernel
def fill_displacements(
    q: FloatArray,
    v: FloatArray,
    age: float,
    free: float,
    limits: JointLimits,
    time: FloatArray,
    high: FloatArray,
    low: FloatArray,
    highest: FloatArray,
    lowest: FloatArray,
) -> None:
    """Fill the least and greatest displacements at the times `age` + `time` from the stamp.

    Joints are free to move for `free` seconds from their stamp, then brake; inf: they never do.
    `high` and `low`, shape (nodes, nv), are not yet clipped to `highest` and `lowest`, (nv,).
    """
    fill_eased_displacements(q, v, age, free, 0.0, 1.0, limits, time, high, low, highest, lowest)


@kernel
def fill_eased_displacements(
    q: FloatArray,
    v: FloatArray,
    age: float,
    free: float,
    going_on: float,
    scale: float,
    limits: JointLimits,
    time: FloatArray,
    high: FloatArray,
    low: FloatArray,
    highest: FloatArray,
    lowest: FloatArray,
) -> None:
    """`fill_displacements` of joints that keep to a fraction of their speed before they brake.

    For `going_on` seconds after they were free, those that are faster than `scale` times their
    operating velocities slow down as if they braked, and the others get no faster than that.
    """
    for j in range(q.shape[0]):
        accel, speeding = limits.acceleration[j], limits.operating_acceleration[j]
        top = max(limits.operating_velocity[j], abs(v[j]))
        pace = scale * limits.operating_velocity[j]
        up, down = v[j] + limits.velocity_error[j], -v[j] + limits.velocity_error[j]
        error = limits.position_error[j]
        room_above, room_below = limits.upper[j] - q[j] - error, q[j] - limits.lower[j] - error
        # When the joint can have got to each of its stops first, and where it is clipped to them.
        above = operating_arrival(up, accel, speeding, top, room_above)
        below = operating_arrival(down, accel, speeding, top, room_below)
        highest[j] = max(limits.upper[j] - q[j], 0.0) + error
        lowest[j] = min(limits.lower[j] - q[j], 0.0) - error
        up_easing, up_braking = _find_stops(
            up, accel, speeding, top, limits.brakes, j, below, free, going_on, pace
        )
        down_easing, down_braking = _find_stops(
            down, accel, speeding, top, limits.brakes, j, above, free, going_on, pace
        )
        # Downwards is upwards mirrored: signs of positions and velocities change.
        up_eased, up_left = _ease_off(
            up, accel, speeding, top, up_easing, highest[j], room_below, below, free, going_on,
            pace, free + going_on,
        )  # fmt: skip
        down_eased, down_left = _ease_off(
            down, accel, speeding, top, down_easing, -lowest[j], room_above, above, free, going_on,
            pace, free + going_on,
        )  # fmt: skip
        for k in range(time.shape[0]):
            s = age + time[k]
            if s <= free:
                high[k, j] = rise(up, accel, speeding, top, room_below, below, s)
                low[k, j] = -rise(down, accel, speeding, top, room_above, above, s)
            elif s > free + going_on:
                # Where braking begins, and how fast, is the same for all that follows.
                braked = brake(up_left, accel, up_braking, s - free - going_on)
                settled = min(up_eased, highest[j]) + braked
                high[k, j] = max(settled, -max(room_below, 0.0))
                braked = brake(down_left, accel, down_braking, s - free - going_on)
                settled = min(down_eased, -lowest[j]) + braked
                low[k, j] = -max(settled, -max(room_above, 0.0))
            else:
                # One that stops at its limit below gets no further down, however fast it was.
                settled, _ = _ease_off(
                    up, accel, speeding, top, up_easing, highest[j], room_below, below, free,
                    going_on, pace, s,
                )  # fmt: skip
                high[k, j] = max(settled, -max(room_below, 0.0))
                settled, _ = _ease_off(
                    down, accel, speeding, top, down_easing, -lowest[j], room_above, above, free,
                    going_on, pace, s,
                )  # fmt: skip
                low[k, j] = -max(settled, -max(room_above, 0.0))
