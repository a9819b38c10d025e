"""The strongest sweeps over all pairs that we could write: what `deadline` has to beat.

A sweep evaluates every pair of link, or of sphere, and obstacle in every tick. It keeps no
certificates, so it needs no bookkeeping; all that it can save is the exact contact time where
something cheap proves that a pair cannot decide. Obstacles lie in rows of one array, loops are free
of branches so that they run several obstacles at a time, and a tick is one call of Pinocchio and
one of Numba.

- `bounds`: the line-of-centres bound of every pair of a link's ball and an obstacle, isotropic; the
  exact time only where that bound beats the best so far, the obstacle with the least bound first.
- `spheres`: the same, with all leaves of the cover, its finest spheres, in place of the links'
  balls: the accuracy with which armguard itself sees what is near. There it answers later than
  `bounds`. Far away it may answer a little earlier: the centre of a leaf can be further from the
  axes than that of its link's ball, and so quicker; armguard takes the better of the two.
- `reach`: the obstacle that decided last time is evaluated first. Of all others only those matter
  that could by then get into the ball which the arm cannot leave, or into the one around its links
  that these can fill by then: a comparison of squares, without root or quotient. A pair's time is
  the better of reach and isotropic. `reach32` compares in single precision, widened by more than
  that can be off.

The best so far only falls, so what was ruled out stays so. Comparisons are widened by far more than
their rounding. What a monitor does beside this is left out: states are believed, and taken to be
without errors and within their bounds, as the scene's are. Asking each pair, too, whether it could
beat the best so far instead of when is no faster than `bounds`: what it saves in roots it spends on
the pairs that it cannot rule out.
"""

from __future__ import annotations

import math

from armguard.contact.advancement import ball_contact_time
from armguard.contact.bodies import Ball, Bounds
from armguard.jit import kernel

ADVANCES = 8  # as the monitor's
BLOCK = 256
SLACK = 1e-12  # relative, of sums of a few terms
ROOM, ROOM_SINGLE = 1e-9, 1e-4  # [m]: beyond what is lost to rounding within 100 m
NEARLY = 1e-3  # relative; where links gain less, the arm's time stands for all
EPOCH = 4.0  # [s]: stamps count from a time nearer than this, so that single precision keeps them

# Rows of the obstacles' array.
X, Y, Z, VX, VY, VZ, SIZE, ACCEL, SPEED, STAMP, LEAST = range(11)
# Rows of the array for `reach`. What an obstacle can cover by t, counted from the epoch as its
# stamp is, is FOLD + V t with FOLD = radius − V stamp; once it is up to speed, QUICK + V t, which
# is (V − |v|)² / 2A less.
NX, NY, NZ, PACE, FOLD, QUICK = range(6)
# Rows of the links' array: their balls now, or the leaves in their place; then what that is made
# of: centre in the joint's frame, the joint, and from RATE on, for each joint, what its speed adds
# to the error, and whether it moves the link. The balls that links and arm cannot leave are rows of
# the same kind that rest.
LX, LY, LZ, LVX, LVY, LVZ, LSIZE, LACCEL, LSPEED, LERROR = range(10)
LOCAL, JOINT, FLOOR, RATE = 10, 13, 14, 15
# Entries of the answer: the earliest contact [s], whose it is, exact evaluations; then what `reach`
# is told: how long any obstacle takes to get up to speed at most, the epoch, and by how much to
# widen its test.
TIME, WINNER, SPENT, RAMP, SINCE, WIDEN = range(6)


@kernel
def _place_links(rotation, translation, jacobian, v, links):  # type: ignore[no-untyped-def]
    """Centres, velocities and velocity errors of the links' balls, from Pinocchio's results."""
    for i in range(links.shape[1]):
        error = links[FLOOR, i]
        lx = ly = lz = wx = wy = wz = 0.0
        for k in range(v.size):
            error += links[RATE + k, i] * abs(v[k])
            rate = links[RATE + v.size + k, i] * v[k]
            lx += jacobian[0, k] * rate
            ly += jacobian[1, k] * rate
            lz += jacobian[2, k] * rate
            wx += jacobian[3, k] * rate
            wy += jacobian[4, k] * rate
            wz += jacobian[5, k] * rate
        joint = int(links[JOINT, i])
        px, py, pz = links[LOCAL, i], links[LOCAL + 1, i], links[LOCAL + 2, i]
        for row in range(3):
            a, b, c = rotation[joint, row, 0], rotation[joint, row, 1], rotation[joint, row, 2]
            links[LX + row, i] = a * px + b * py + c * pz + translation[joint, row]
        x, y, z = links[LX, i], links[LY, i], links[LZ, i]
        links[LVX, i] = lx + wy * z - wz * y
        links[LVY, i] = ly + wz * x - wx * z
        links[LVZ, i] = lz + wx * y - wy * x
        links[LERROR, i] = error * (1.0 + SLACK)


@kernel
def _pair_time(links, i, bodies, j, now):  # type: ignore[no-untyped-def]
    """Exact contact time of a link's ball and an obstacle, isotropic; or of a workspace ball."""
    link = Ball(
        links[LX, i], links[LY, i], links[LZ, i], links[LVX, i], links[LVY, i], links[LVZ, i],
        Bounds(links[LACCEL, i], links[LSPEED, i], links[LERROR, i], 0.0),
    )  # fmt: skip
    body = Ball(
        bodies[X, j], bodies[Y, j], bodies[Z, j], bodies[VX, j], bodies[VY, j], bodies[VZ, j],
        Bounds(bodies[ACCEL, j], bodies[SPEED, j], 0.0, now - bodies[STAMP, j]),
    )  # fmt: skip
    distance = (links[LSIZE, i] + bodies[SIZE, j]) * (1.0 + SLACK)
    return ball_contact_time(link, body, distance, ADVANCES, None)


@kernel
def _try_reach(links, balls, bodies, j, now, answer):  # type: ignore[no-untyped-def]
    """Take an obstacle's time into the answer, each link after the reach of the arm and its own.

    The last of the balls is the arm's.
    """
    answer[SPENT] += 1.0
    arm_time = _pair_time(balls, links.shape[1], bodies, j, now)
    for back in range(links.shape[1]):
        if arm_time >= answer[TIME] * (1.0 - NEARLY):
            if arm_time < answer[TIME]:
                answer[TIME], answer[WINNER] = arm_time, j
            return
        i = links.shape[1] - 1 - back  # the quickest first
        answer[SPENT] += 1.0
        time = max(arm_time, _pair_time(balls, i, bodies, j, now))
        if time < answer[TIME]:
            answer[SPENT] += 1.0
            time = max(time, _pair_time(links, i, bodies, j, now))
        if time < answer[TIME]:
            answer[TIME], answer[WINNER] = time, j


@kernel
def _carry(place, rate, age, target):  # type: ignore[no-untyped-def]
    for k in range(target.size):
        target[k] = place[k] + rate[k] * age[k]


@kernel
def _bring_to_now(bodies, first, last, now, room):  # type: ignore[no-untyped-def]
    """A block of obstacles as of now, in separate loops so that each runs several at a time.

    Rows of room: where they would be at their speed (3), radius and how far off that is at most,
    how much their velocity may have changed, age.
    """
    count = last - first
    age, growth, size = room[5, :count], room[4, :count], room[3, :count]
    stamp, accel, radius = (
        bodies[STAMP, first:last],
        bodies[ACCEL, first:last],
        bodies[SIZE, first:last],
    )
    for k in range(age.size):
        age[k] = abs(now - stamp[k])
    for axis in range(3):
        _carry(bodies[X + axis, first:last], bodies[VX + axis, first:last], age, room[axis, :count])
    for k in range(age.size):
        growth[k] = accel[k] * age[k]
    for k in range(age.size):
        size[k] = radius[k] + 0.5 * growth[k] * age[k]


@kernel
def _bound_pairs(links, room, bodies, first, last):  # type: ignore[no-untyped-def]
    """Least line-of-centres bound of each obstacle over all links.

    Until it is as fast as it may be the pair closes a gap g, at first at the rate u, in
    2 g / (u + s) with s² = u² + 2 a g; at the rate V from there on, in (2 a g + (V − u)²) / 2 a V.
    """
    count = last - first
    x, y, z = room[0, :count], room[1, :count], room[2, :count]
    size, growth = room[3, :count], room[4, :count]
    vx, vy, vz = bodies[VX, first:last], bodies[VY, first:last], bodies[VZ, first:last]
    accel, speed = bodies[ACCEL, first:last], bodies[SPEED, first:last]
    least = bodies[LEAST, first:last]
    for k in range(least.size):
        least[k] = math.inf
    for i in range(links.shape[1]):
        cx, cy, cz = links[LX, i], links[LY, i], links[LZ, i]
        ux, uy, uz = links[LVX, i], links[LVY, i], links[LVZ, i]
        radius, error = links[LSIZE, i] + ROOM, links[LERROR, i] + ROOM
        link_accel, link_speed = links[LACCEL, i], links[LSPEED, i]
        for k in range(least.size):
            dx, dy, dz = x[k] - cx, y[k] - cy, z[k] - cz
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            gap = distance - (radius + size[k])
            away = dx * (vx[k] - ux) + dy * (vy[k] - uy) + dz * (vz[k] - uz)
            top = link_speed + speed[k]
            rate = min(error + growth[k] - away / distance, top)
            twice = 2.0 * (link_accel + accel[k])
            pull = twice * gap
            reached = math.sqrt(rate * rate + pull)
            # Of (√ − u)/a and 2 g/(u + √) that one which does not cancel, as quotients of 2 a g.
            over = reached - rate if rate < 0.0 else 2.0 * gap
            under = 0.5 * twice if rate < 0.0 else rate + reached
            left = top - rate
            over = pull + left * left if reached > top else over
            under = twice * top if reached > top else under
            time = over / under * (1.0 - SLACK)
            time = time if (gap > 0.0) & (time > 0.0) else 0.0
            least[k] = time if time < least[k] else least[k]


@kernel
def _try_links(links, room, bodies, j, now, answer):  # type: ignore[no-untyped-def]
    """The same, isotropic: a look at those links whose bound beats the best so far."""
    _bring_to_now(bodies, j, j + 1, now, room)
    for back in range(links.shape[1]):
        i = links.shape[1] - 1 - back  # the quickest first
        _bound_pairs(links[:, i : i + 1], room, bodies, j, j + 1)
        if bodies[LEAST, j] >= answer[TIME]:
            continue
        answer[SPENT] += 1.0
        time = _pair_time(links, i, bodies, j, now)
        if time < answer[TIME]:
            answer[TIME], answer[WINNER] = time, j


@kernel
def sweep_bounds(rotation, translation, jacobian, v, links, balls, bodies, near, room, answer, now):  # type: ignore[no-untyped-def]
    """The earliest contact of all pairs: bounds for all, the least first, then what beats it."""
    _place_links(rotation, translation, jacobian, v, links)
    count, bounds = bodies.shape[1], bodies[LEAST]
    answer[TIME], answer[SPENT] = math.inf, 0.0
    for first in range(0, count, BLOCK):
        last = min(first + BLOCK, count)
        _bring_to_now(bodies, first, last, now, room)
        _bound_pairs(links, room, bodies, first, last)
    if count == 0:
        return
    seed = 0
    for j in range(count):
        if bounds[j] < bounds[seed]:
            seed = j
    _try_links(links, room, bodies, seed, now, answer)
    for j in range(count):
        if bounds[j] < answer[TIME] and j != seed:
            _try_links(links, room, bodies, j, now, answer)


@kernel
def _find_arm_radius(links, balls, time):  # type: ignore[no-untyped-def]
    """Radius about the arm's ball's centre within which all links stay until `time`."""
    radius = 0.0
    for i in range(links.shape[1]):
        dx = links[LX, i] - balls[LX, -1]
        dy = links[LY, i] - balls[LY, -1]
        dz = links[LZ, i] - balls[LZ, -1]
        away = math.sqrt(dx * dx + dy * dy + dz * dz)
        radius = max(radius, away + links[LSIZE, i] + links[LSPEED, i] * time)
    return min(radius, balls[LSIZE, -1]) * (1.0 + SLACK) + ROOM


@kernel(forceinline=True)
def _is_far(x, y, z, speed, fold, cx, cy, cz, radius, until):  # type: ignore[no-untyped-def]
    """Whether an obstacle stays out of a ball until a time of the clock; NaN is not far."""
    dx, dy, dz = x - cx, y - cy, z - cz
    limit = radius + fold + speed * until
    return dx * dx + dy * dy + dz * dz > limit * limit


@kernel
def _count_near(x, y, z, speed, fold, cx, cy, cz, radius, until):  # type: ignore[no-untyped-def]
    near = 0
    for k in range(x.size):
        far = _is_far(x[k], y[k], z[k], speed[k], fold[k], cx, cy, cz, radius, until)
        near += 0 if far else 1
    return near


@kernel
def sweep_reach(rotation, translation, jacobian, v, links, balls, bodies, near, room, answer, now):  # type: ignore[no-untyped-def]
    """The same, obstacle by obstacle first; a pair's time is the better of reach and isotropic."""
    _place_links(rotation, translation, jacobian, v, links)
    count, seed = bodies.shape[1], int(answer[WINNER])
    answer[TIME], answer[SPENT] = math.inf, 0.0
    if count == 0:
        return
    _try_reach(links, balls, bodies, seed, now, answer)
    number = near.dtype.type
    cx, cy, cz = number(balls[LX, -1]), number(balls[LY, -1]), number(balls[LZ, -1])
    radius = number(_find_arm_radius(links, balls, answer[TIME]) + answer[WIDEN])
    x, y, z, pace = near[NX], near[NY], near[NZ], near[PACE]
    for first in range(0, count, BLOCK):
        last = min(first + BLOCK, count)
        until = number(answer[TIME] + (now - answer[SINCE]))
        # Ages are 0 or more, so that by then every obstacle has had that long.
        fold = near[QUICK if answer[TIME] > answer[RAMP] else FOLD]
        close = _count_near(
            x[first:last], y[first:last], z[first:last], pace[first:last], fold[first:last],
            cx, cy, cz, radius, until,
        )  # fmt: skip
        if close == 0:
            continue
        for j in range(first, last):
            if _is_far(x[j], y[j], z[j], pace[j], fold[j], cx, cy, cz, radius, until) or j == seed:
                continue
            _try_reach(links, balls, bodies, j, now, answer)


@kernel
def _fold(bodies, near, j, since):  # type: ignore[no-untyped-def]
    speed, accel = bodies[SPEED, j], bodies[ACCEL, j]
    vx, vy, vz = bodies[VX, j], bodies[VY, j], bodies[VZ, j]
    spare = max(speed - math.sqrt(vx * vx + vy * vy + vz * vz), 0.0)
    near[NX, j], near[NY, j], near[NZ, j] = bodies[X, j], bodies[Y, j], bodies[Z, j]
    near[PACE, j] = speed
    near[FOLD, j] = bodies[SIZE, j] - speed * (bodies[STAMP, j] - since)
    near[QUICK, j] = near[FOLD, j] - spare * spare / (2.0 * accel)


@kernel
def take_measurements(bodies, near, first, stamp, position, velocity, size, accel, speed, answer):  # type: ignore[no-untyped-def]
    """Write what was measured of some obstacles, one after the other from `first` on.

    Positions in [m] and velocities in [m/s] of the shape (n, 3), at a stamp in [s]; size is the
    radius in [m]; bounds on acceleration and speed in [m/s²] and [m/s].
    """
    for k in range(position.shape[0]):
        j = first + k
        for axis in range(3):
            bodies[X + axis, j], bodies[VX + axis, j] = position[k, axis], velocity[k, axis]
        bodies[SIZE, j], bodies[ACCEL, j], bodies[SPEED, j] = size, accel, speed
        bodies[STAMP, j] = stamp
        if near.size:
            _fold(bodies, near, j, answer[SINCE])
    answer[RAMP] = max(answer[RAMP], speed / accel)
    if stamp - answer[SINCE] > EPOCH:
        answer[SINCE] = stamp
        for j in range(near.shape[1]):
            _fold(bodies, near, j, stamp)


SWEEPS = {
    "spheres": sweep_bounds,
    "bounds": sweep_bounds,
    "reach": sweep_reach,
    "reach32": sweep_reach,
}
