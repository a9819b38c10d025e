"""Motions within limits, as hostile as can be, and how fast a ball of the arm is in them.

A motion begins at its stamp, or before it where the state is newer than now. Joints are pushed by
scripts or towards a direction, within operating limits; one that has run into its stop comes back
as hard as it can. Its brakes engage at a moment of its own, and it stops as late as they allow, or
harder. Kinematics are written anew from Pinocchio's placements and axes.
"""

import math
from typing import NamedTuple

import numpy as np

from armguard.jit.kernels import kernel
from support.hostile_joints import STEP, turn


class Drive(NamedTuple):
    """What joints of one motion keep to, from the stamp on; arrays have the shape (nv,)."""

    lower: np.ndarray
    upper: np.ndarray
    top: np.ndarray
    """Operating velocities."""
    pace: np.ndarray
    """What velocities are at most from now on."""
    accel: np.ndarray
    speeding: np.ndarray
    deceleration: np.ndarray
    """That brakes guarantee at each instant; 0 where none is."""
    time: np.ndarray
    """In which brakes stop a joint at most."""
    distance: np.ndarray
    """In which brakes stop a joint at most."""


@kernel
def turn_vector(frame, x, y, z):
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@kernel
def place_ball(chain, q, v, local, spot):
    """Fill `spot` with a ball's place, how it is turned, its velocity and its rate, (18,)."""
    frame, other = np.zeros((3, 3)), np.zeros((3, 3))
    frame[0, 0] = frame[1, 1] = frame[2, 2] = 1.0
    x = y = z = 0.0
    # Velocity of what is at the world's origin, and rate.
    ux = uy = uz = wx = wy = wz = 0.0
    for k in range(chain.column.shape[0]):
        t, r, axis = chain.translation[k], chain.rotation[k], chain.axis[k]
        dx, dy, dz = turn_vector(frame, t[0], t[1], t[2])
        x, y, z = x + dx, y + dy, z + dz
        for m in range(3):
            other[0, m], other[1, m], other[2, m] = turn_vector(frame, r[0, m], r[1, m], r[2, m])
        a, b, c = turn_vector(other, axis[0], axis[1], axis[2])
        angle, rate = q[chain.column[k]], v[chain.column[k]]
        if chain.slides[k]:
            x, y, z = x + angle * a, y + angle * b, z + angle * c
            ux, uy, uz = ux + rate * a, uy + rate * b, uz + rate * c
            frame[:] = other
            continue
        wx, wy, wz = wx + rate * a, wy + rate * b, wz + rate * c
        ux -= rate * (b * z - c * y)
        uy -= rate * (c * x - a * z)
        uz -= rate * (a * y - b * x)
        for m in range(3):
            frame[0, m], frame[1, m], frame[2, m] = turn(
                other[0, m], other[1, m], other[2, m], a, b, c, angle
            )
    dx, dy, dz = turn_vector(frame, local[0], local[1], local[2])
    x, y, z = x + dx, y + dy, z + dz
    spot[0], spot[1], spot[2] = x, y, z
    for m in range(3):
        spot[3 + m], spot[6 + m], spot[9 + m] = frame[0, m], frame[1, m], frame[2, m]
    spot[12] = ux + wy * z - wz * y
    spot[13] = uy + wz * x - wx * z
    spot[14] = uz + wx * y - wy * x
    spot[15], spot[16], spot[17] = wx, wy, wz


@kernel
def ball_speed(spot, radius):
    """Greatest speed of any point of the ball."""
    rate = math.sqrt((spot[15:18] ** 2).sum())
    square = (spot[12:15] ** 2).sum()
    along = (spot[12:15] * spot[15:18]).sum() / rate if rate > 0.0 else 0.0
    across = math.sqrt(max(square - along * along, 0.0)) + radius * rate
    return math.sqrt(along * along + across * across)


@kernel
def drive_joint(drive, j, now, start, end, bite, script, goal, q, v):
    """Fill positions and velocities of one joint from a step on; whether it is within limits.

    `script`: two pushes, parts of the limit; when the second takes over, in [s]; below 0.5 for
    brakes with a constant deceleration, not at the last moment; and how much harder than they must
    they are. `goal` is the way that it is pushed instead where that is not 0.
    """
    hit = 0.0  # the side of the stop that threw it back
    held, rate = 0.0, 0.0
    for k in range(start, end):
        before = v[k, j]
        if k == bite:
            speed = abs(before)
            rate = drive.accel[j]
            if drive.deceleration[j] > 0.0 or script[3] < 0.5:
                least = drive.deceleration[j]
                if speed > 0.0:
                    least = max(
                        least, speed / drive.time[j], 0.5 * speed * speed / drive.distance[j]
                    )
                rate = least + script[4] * (drive.accel[j] - least)
            elif speed > 0.0:
                held = min(
                    drive.time[j] - speed / rate,
                    (drive.distance[j] - 0.5 * speed * speed / rate) / speed,
                )
                held *= 1.0 - script[4]
        if k >= bite:
            hold = min(held, STEP)
            held -= hold
            until = min(STEP - hold, abs(before) / rate)
            side = np.sign(before)
            after = side * max(abs(before) - rate * (STEP - hold), 0.0)
            way = before * hold + side * until * (abs(before) - 0.5 * rate * until)
            if k + 1 >= now and abs(after) > drive.pace[j]:
                return False
        else:
            push = script[0] if k * STEP < script[2] else script[1]
            if goal != 0.0:
                push = goal
            speeding = drive.accel[j] if hit * push < 0.0 else drive.speeding[j]
            if push * before < 0.0:
                # It turns round as hard as it can, and is then at rest at the end of a step.
                after = before + push * drive.accel[j] * STEP
                if after * before < 0.0:
                    after = 0.0
            else:
                after = before + push * speeding * STEP
            top = drive.top[j] if k < now else drive.pace[j]
            limit = max(top, abs(before) - drive.accel[j] * STEP)
            after = min(max(after, -limit), limit)
            # It has to have slowed down to its pace by now.
            left = max(now - k - 1, 0) * STEP
            most = drive.pace[j] + drive.accel[j] * left
            after = min(max(after, -most), most)
            if abs(after - before) > drive.accel[j] * STEP * (1.0 + 1e-9):
                return False
            way = 0.5 * STEP * (before + after)
        q[k + 1, j] = q[k, j] + way
        if not drive.lower[j] <= q[k + 1, j] <= drive.upper[j]:
            hit = 1.0 if q[k + 1, j] > drive.upper[j] else -1.0
            q[k + 1, j] = min(max(q[k + 1, j], drive.lower[j]), drive.upper[j])
            after = 0.0
        v[k + 1, j] = after
    return True


@kernel
def fill_script(script, duration, random):
    for i in range(2):
        script[i] = random.uniform(-1.0, 1.0)
        if random.random() < 0.7:
            script[i] = np.sign(script[i])
    script[2] = random.uniform(0.0, duration)
    script[3] = random.random()
    script[4] = 0.0 if random.random() < 0.6 else random.random()


@kernel
def drive_arm(drive, now, start, end, free, goals, q, v, random):
    """Fill what joints do from a step on, whose row is given; whether they keep to the limits.

    They brake at step `free` at the latest; at none where it is beyond the end.
    """
    script = np.empty(5)
    brakes = free <= end
    common = free if random.random() < 0.5 else random.integers(start, free + 1)
    for j in range(q.shape[1]):
        bite = random.integers(start, free + 1) if random.random() < 0.2 else common
        if not brakes:
            bite = end + 1
        fill_script(script, STEP * (free - start if brakes else end - start), random)
        if not drive_joint(drive, j, now, start, end, bite, script, goals[j], q, v):
            return False
    return True


@kernel
def find_goals(chain, q, v, local, goals, random):
    """Which way each joint moves a ball to where it goes, or somewhere."""
    spot, one = np.empty(18), np.zeros(q.shape[0])
    place_ball(chain, q, v, local, spot)
    velocity = spot[12:15].copy()
    if random.random() < 0.3:
        for i in range(3):
            velocity[i] = random.normal()
    for j in range(q.shape[0]):
        one[:] = 0.0
        one[j] = 1.0
        place_ball(chain, q, one, local, spot)
        goals[j] = 1.0 if (spot[12:15] * velocity).sum() >= 0.0 else -1.0


@kernel
def farthest_ways(spots, count, radius, around, ways):
    """Fill `ways` with how far points of the ball get between any two of some steps from each on.

    `ways`, (steps,): the greatest displacement between that step and any later, of the centre and
    of points at `around`, (m, 3), from it.
    """
    for a in range(count - 1, -1, -1):
        ways[a] = ways[a + 1] if a + 1 < count else 0.0
        for b in range(a + 1, count):
            for p in range(around.shape[0]):
                square = 0.0
                for i in range(3):
                    gap = spots[b, i] - spots[a, i]
                    for m in range(3):
                        turned = spots[b, 3 + 3 * i + m] - spots[a, 3 + 3 * i + m]
                        gap += radius * turned * around[p, m]
                    square += gap * gap
                ways[a] = max(ways[a], math.sqrt(square))
