"""Bounds on the displacement of one joint by a given time, within its limits.

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
from typing import NamedTuple

from armguard.bounds.free_body import free_displacement
from armguard.bounds.limits import JointLimits
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.brakes import BrakeCurves, Stop, braked_displacement, find_stop, rest_time


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


@merged_kernel
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


@merged_kernel
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
def reached_velocity(
    velocity: float, accel: float, speeding: float, top: float, below: float, s: float
) -> float:
    """Greatest velocity that a free joint can have `s` >= 0 seconds after its stamp.

    Arguments as for `rise`.
    """
    reached = operating_velocity(velocity, accel, speeding, top, s)
    if s > below:
        # It may have come to rest at its stop, and have been thrown back from there.
        reached = max(reached, min(top, accel * (s - below)))
    return reached


class Ahead(NamedTuple):
    """What bounds a joint from its stamp on, either way, in [rad] or [m] and [s]."""

    accel: float
    """Its acceleration limit."""
    speeding: float
    """Its operating acceleration."""
    top: float
    """The most that it speeds up to."""
    up: float
    """The greatest velocity that it may have upwards."""
    down: float
    """The greatest velocity that it may have downwards."""
    room_above: float
    """How far up its stop is at the least."""
    room_below: float
    """How far down its stop is at the least."""
    above: float
    """When it can have got to the stop above first."""
    below: float
    """When it can have got to the stop below first."""


@kernel
def look_ahead(q: float, v: float, limits: JointLimits, joint: int) -> Ahead:
    """What bounds a joint from its stamp on, errors of its state included.

    Args:
        q: Its measured position, in [rad] or [m].
        v: Its measured velocity, in [rad]/[s] or [m]/[s].
        limits: Of all joints.
        joint: Which one it is.
    """
    accel, speeding = limits.acceleration[joint], limits.operating_acceleration[joint]
    top = max(limits.operating_velocity[joint], abs(v))
    up, down = v + limits.velocity_error[joint], -v + limits.velocity_error[joint]
    error = limits.position_error[joint]
    room_above, room_below = limits.upper[joint] - q - error, q - limits.lower[joint] - error
    above = operating_arrival(up, accel, speeding, top, room_above)
    below = operating_arrival(down, accel, speeding, top, room_below)
    return Ahead(accel, speeding, top, up, down, room_above, room_below, above, below)


@kernel
def thrown_velocity(q: float, v: float, limits: JointLimits, joint: int, s: float) -> float:
    """Greatest speed, either way, that a joint can have `s` seconds from its stamp off its stop.

    0 where it cannot have got to either stop by then.

    Args:
        q: Its measured position, in [rad] or [m].
        v: Its measured velocity, in [rad]/[s] or [m]/[s].
        limits: Of all joints.
        joint: Which one it is.
        s: In [s].
    """
    ahead = look_ahead(q, v, limits, joint)
    since = s - min(ahead.above, ahead.below)
    return min(ahead.top, ahead.accel * since) if since > 0.0 else 0.0


@kernel
def braked_velocity(speed: float, stop: Stop, s: float) -> float:
    """Greatest velocity `s` seconds after brakes engaged at a velocity of at most `speed`."""
    if not speed > 0.0 or s >= rest_time(stop, speed) * (1.0 + SUM_ROUNDING):
        return 0.0
    return max(speed - stop.deceleration * s, 0.0)


@kernel
def _find_velocity(
    velocity: float,
    accel: float,
    speeding: float,
    top: float,
    below: float,
    age: float,
    free: float,
    at_bite: float,
    stop: Stop,
    s: float,
) -> float:
    """Greatest velocity over the time that a node stands for, rounded up; see `fill_velocities`."""
    if free == math.inf:
        # From now until the node.
        greatest = top
        if age >= 0.0:
            greatest = reached_velocity(velocity, accel, speeding, top, below, s)
    elif s < 0.0:
        greatest = top
    elif s <= free:
        greatest = max(at_bite, 0.0)
    else:
        greatest = braked_velocity(at_bite, stop, s - free)
    return greatest + SUM_ROUNDING * top if greatest != 0.0 else 0.0


@kernel
def fill_velocities(
    q: FloatArray,
    v: FloatArray,
    age: float,
    free: float,
    limits: JointLimits,
    time: FloatArray,
    fastest: FloatArray,
    slowest: FloatArray,
) -> None:
    """Fill the greatest and least velocities of joints that are free for a time, and then brake.

    Where joints brake, a node stands for all times from its own on until they rest. Where they
    never do, it stands for all times from now up to its own.

    Args:
        q: Measured joint positions, in [rad] or [m]. Shape (nv,).
        v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        age: Now minus the stamp of the state, in [s].
        free: From the stamp until brakes engage at the latest, in [s]; inf: never.
        limits: Of the joints.
        time: Of the nodes, from now, in [s]. Shape (nodes,).
        fastest: Filled, in [rad]/[s] or [m]/[s]. Shape (nodes, nv).
        slowest: Filled, alike.
    """
    for j in range(q.shape[0]):
        if not (abs(q[j] + v[j] + age) < math.inf and free >= 0.0):
            fastest[:, j], slowest[:, j] = math.inf, -math.inf
            continue
        accel, speeding, top, up, down, _, _, above, below = look_ahead(q[j], v[j], limits, j)
        up_bite, down_bite, up_stop, down_stop = 0.0, 0.0, Stop(0.0, 0.0, 0.0), Stop(0.0, 0.0, 0.0)
        if free < math.inf:
            up_bite = reached_velocity(up, accel, speeding, top, below, free)
            down_bite = reached_velocity(down, accel, speeding, top, above, free)
            up_stop = find_stop(limits.brakes, j, up_bite)
            down_stop = find_stop(limits.brakes, j, down_bite)
        for k in range(time.shape[0]):
            s = age + time[k]
            fastest[k, j] = _find_velocity(
                up, accel, speeding, top, below, age, free, up_bite, up_stop, s
            )
            slowest[k, j] = -_find_velocity(
                down, accel, speeding, top, above, age, free, down_bite, down_stop, s
            )


@kernel
def _find_braking(
    velocity: float,
    accel: float,
    speeding: float,
    top: float,
    brakes: BrakeCurves,
    joint: int,
    below: float,
    free: float,
) -> tuple[float, Stop]:
    """Greatest velocity that a joint can have `free` seconds after its stamp, and its stop then."""
    reached = reached_velocity(velocity, accel, speeding, top, below, free)
    return reached, find_stop(brakes, joint, reached)


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
    for j in range(q.shape[0]):
        accel, speeding, top, up, down, room_above, room_below, above, below = look_ahead(
            q[j], v[j], limits, j
        )
        error = limits.position_error[j]
        # Where it is clipped to its limits.
        highest[j] = max(limits.upper[j] - q[j], 0.0) + error
        lowest[j] = min(limits.lower[j] - q[j], 0.0) - error
        fastest_up, up_stop = _find_braking(up, accel, speeding, top, limits.brakes, j, below, free)
        fastest_down, down_stop = _find_braking(
            down, accel, speeding, top, limits.brakes, j, above, free
        )
        # Where braking begins is the same for all that follows.
        up_free = min(rise(up, accel, speeding, top, room_below, below, free), highest[j])
        down_free = min(rise(down, accel, speeding, top, room_above, above, free), -lowest[j])
        # Downwards is upwards mirrored: signs of positions and velocities change.
        for k in range(time.shape[0]):
            s = age + time[k]
            if s <= free:
                high[k, j] = rise(up, accel, speeding, top, room_below, below, s)
                low[k, j] = -rise(down, accel, speeding, top, room_above, above, s)
            else:
                # One that stops at its limit gets no further, however fast it was.
                braked = up_free + brake(fastest_up, accel, up_stop, s - free)
                high[k, j] = max(braked, -max(room_below, 0.0))
                braked = down_free + brake(fastest_down, accel, down_stop, s - free)
                low[k, j] = -max(braked, -max(room_above, 0.0))
