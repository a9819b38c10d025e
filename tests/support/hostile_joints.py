"""Joint motions that obey every limit, as hostile as they can be made, simulated in bulk.

The kinematics are written anew from Pinocchio's placements and axes. A motion is a script for each
joint: three accelerations, as parts of the limit, and two times at which one gives way to the
next. Joints keep to their limits either by braking in time or by running into their stops.
"""

from typing import NamedTuple

import numpy as np

from armguard.bounds.levers import moving_joints
from armguard.jit.kernels import kernel
from armguard.robot.joints import is_prismatic

STEP = 1e-3
RECKLESS, CAREFUL = 0, 1  # runs into stops; brakes before them
SCRIPTED, GREEDY = 0, 1


class Chain(NamedTuple):
    column: np.ndarray
    slides: np.ndarray
    axis: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


class Limits(NamedTuple):
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    accel: np.ndarray
    braking: np.ndarray


def limits_of(robot):
    return Limits(
        robot.lower_position_limit,
        robot.upper_position_limit,
        robot.velocity_limit,
        robot.acceleration_limit,
        robot.braking_deceleration,
    )


def chain_to(robot, joint):
    model = robot.model
    numbers = moving_joints(model, joint)
    slides = np.array([is_prismatic(model, k) for k in numbers])
    subspaces = [np.ravel(model.joints[k].createData().S) for k in numbers]
    placements = [model.jointPlacements[k] for k in numbers]
    return Chain(
        np.array([model.idx_vs[k] for k in numbers]),
        slides,
        np.array([s[:3] if p else s[3:] for s, p in zip(subspaces, slides, strict=True)]),
        np.array([p.rotation for p in placements]),
        np.array([p.translation for p in placements]),
    )


@kernel
def turn(x, y, z, a, b, d, angle):
    """Rodrigues' formula: (x, y, z) about the axis (a, b, d)."""
    c, s = np.cos(angle), np.sin(angle)
    along = (a * x + b * y + d * z) * (1.0 - c)
    return (
        x * c + (b * z - d * y) * s + a * along,
        y * c + (d * x - a * z) * s + b * along,
        z * c + (a * y - b * x) * s + d * along,
    )


@kernel
def place_point(chain, q, local, inner):
    """Where a point is; `inner` takes where it is in each joint's frame, (joints + 1, 3)."""
    count = chain.column.shape[0]
    x, y, z = local[0], local[1], local[2]
    axis, r, t = chain.axis, chain.rotation, chain.translation
    for k in range(count - 1, -1, -1):
        angle = q[chain.column[k]]
        if chain.slides[k]:
            x, y, z = x + axis[k, 0] * angle, y + axis[k, 1] * angle, z + axis[k, 2] * angle
        else:
            x, y, z = turn(x, y, z, axis[k, 0], axis[k, 1], axis[k, 2], angle)
        inner[k, 0], inner[k, 1], inner[k, 2] = x, y, z
        x, y, z = (
            r[k, 0, 0] * x + r[k, 0, 1] * y + r[k, 0, 2] * z + t[k, 0],
            r[k, 1, 0] * x + r[k, 1, 1] * y + r[k, 1, 2] * z + t[k, 1],
            r[k, 2, 0] * x + r[k, 2, 1] * y + r[k, 2, 2] * z + t[k, 2],
        )
    inner[count, 0], inner[count, 1], inner[count, 2] = x, y, z
    return inner[count]


@kernel
def set_slopes(chain, q, direction, inner, slope):
    """How fast the point that was placed last goes along `direction`, per joint."""
    slope[:] = 0.0
    x, y, z = direction[0], direction[1], direction[2]
    r = chain.rotation
    for k in range(chain.column.shape[0]):
        a, b, d = chain.axis[k, 0], chain.axis[k, 1], chain.axis[k, 2]
        x, y, z = (
            r[k, 0, 0] * x + r[k, 1, 0] * y + r[k, 2, 0] * z,
            r[k, 0, 1] * x + r[k, 1, 1] * y + r[k, 2, 1] * z,
            r[k, 0, 2] * x + r[k, 1, 2] * y + r[k, 2, 2] * z,
        )
        if chain.slides[k]:
            slope[chain.column[k]] = a * x + b * y + d * z
            continue
        px, py, pz = inner[k, 0], inner[k, 1], inner[k, 2]
        slope[chain.column[k]] = (
            x * (b * pz - d * py) + y * (d * px - a * pz) + z * (a * py - b * px)
        )
        x, y, z = turn(x, y, z, a, b, d, -q[chain.column[k]])


@kernel
def stop_at_limits(q, v, limits, j):
    if limits.lower[j] <= q[j] <= limits.upper[j]:
        return False
    q[j] = min(max(q[j], limits.lower[j]), limits.upper[j])
    v[j] = 0.0
    return True


@kernel
def move_joints(q, v, push, limits, care, step):
    """One step of free motion, in place; `push` is a part of the acceleration limit.

    Returns whether a joint ran into a stop.
    """
    hits = False
    for j in range(q.shape[0]):
        top = limits.velocity[j]
        after = v[j] + push[j] * limits.accel[j] * step
        if care[j] == CAREFUL:
            # Fast enough to need the brakes now, with a step in hand.
            for side in (1.0, -1.0):
                room = limits.upper[j] - q[j] if side > 0.0 else q[j] - limits.lower[j]
                ahead = side * after
                need = step * (max(side * v[j], 0.0) + max(ahead, 0.0)) / 2.0
                if ahead > 0.0 and ahead * ahead / (2.0 * limits.accel[j]) + need > room:
                    after = side * (side * v[j] - limits.accel[j] * step)
        after = min(max(after, -top), top)
        q[j] += 0.5 * step * (v[j] + after)
        v[j] = after
        hits |= stop_at_limits(q, v, limits, j)
    return hits


@kernel
def brake_joints(q, v, strength, limits, step):
    """One step of braking, in place; strength 0 is what is guaranteed, 1 all there may be."""
    hits = False
    for j in range(q.shape[0]):
        rate = limits.braking[j] + strength[j] * (limits.accel[j] - limits.braking[j])
        until = min(step, abs(v[j]) / rate)
        q[j] += np.sign(v[j]) * until * (abs(v[j]) - 0.5 * rate * until)
        v[j] = np.sign(v[j]) * max(abs(v[j]) - rate * step, 0.0)
        hits |= stop_at_limits(q, v, limits, j)
    return hits


@kernel
def furthest_ways(chain, limits, q, v, local, direction, script, mode, care, free, way):
    """Fill `way` with the greatest displacement of the point up to each step.

    `script`: three pushes and two switching times for each joint, (nv, 5). The joints are free for
    `free` seconds and brake then, the harder the larger the push is that the script would give.
    Returns whether a joint ran into a stop.
    """
    q, v = q.copy(), v.copy()
    slope = np.zeros(q.shape[0])
    push = np.zeros(q.shape[0])
    inner = np.empty((chain.column.shape[0] + 1, 3))
    place = place_point(chain, q, local, inner)
    start = direction[0] * place[0] + direction[1] * place[1] + direction[2] * place[2]
    hits = False
    furthest = 0.0
    way[0] = 0.0
    for k in range(1, way.shape[0]):
        now = (k - 1) * STEP
        if mode == GREEDY:
            set_slopes(chain, q, direction, inner, slope)
        for j in range(q.shape[0]):
            if mode == GREEDY and now >= script[j, 1]:
                push[j] = 1.0 if slope[j] > 0.0 else -1.0
            elif now < script[j, 1]:
                push[j] = script[j, 0]
            elif now < script[j, 3]:
                push[j] = script[j, 2]
            else:
                push[j] = script[j, 4]
        if now < free - 1e-9:
            hits |= move_joints(q, v, push, limits, care, STEP)
        else:
            hits |= brake_joints(q, v, np.abs(push), limits, STEP)
        place = place_point(chain, q, local, inner)
        along = direction[0] * place[0] + direction[1] * place[1] + direction[2] * place[2]
        furthest = max(furthest, along - start)
        way[k] = furthest
    return hits


@kernel
def random_script(nv, duration, random):
    script = np.empty((nv, 5))
    for j in range(nv):
        for k in (0, 2, 4):
            kind = random.integers(0, 4)
            script[j, k] = random.uniform(-1.0, 1.0) if kind == 0 else np.sign(kind - 2.5)
            if kind == 1 and random.random() < 0.3:
                script[j, k] = 0.0
        one, other = random.uniform(0.0, duration), random.uniform(0.0, duration)
        if random.random() < 0.3:
            one = 0.0
        script[j, 1], script[j, 3] = min(one, other), max(one, other)
    return script


@kernel
def pick_error(random):
    """A part of the largest error, often all of it."""
    size = 3.0 * random.uniform(-1.0, 1.0)
    return min(max(size, -1.0), 1.0)


@kernel
def attack(
    chain, limits, q, v, error_q, error_v, local, direction, free, motions, climbs, checks, worst,
    random,
):  # fmt: skip
    """Run motions from one measured state; `worst[:, c]`: furthest way up to step checks[c].

    Row 0 is of those motions that run into no stop, row 1 of all.

    Errors are drawn anew for each motion; a part of the motions is found by hill climbing towards
    the furthest way at a check chosen by chance.
    """
    nv = q.shape[0]
    steps = checks[-1]
    way = np.empty(steps + 1)
    care = np.zeros(nv, np.int64)
    for _ in range(motions):
        start_q, start_v = q.copy(), v.copy()
        for j in range(nv):
            size = pick_error(random)
            start_q[j] = min(max(q[j] + size * error_q[j], limits.lower[j]), limits.upper[j])
            size = pick_error(random)
            start_v[j] += size * error_v[j]
            start_v[j] = min(max(start_v[j], -limits.velocity[j]), limits.velocity[j])
            care[j] = random.integers(0, 2)
        mode = random.integers(0, 2)
        script = random_script(nv, steps * STEP, random)
        target = checks[random.integers(0, checks.shape[0])]
        best = -1.0
        for _ in range(climbs + 1):
            trial = script.copy()
            if best >= 0.0:
                fresh = random_script(nv, steps * STEP, random)
                j = random.integers(0, nv)
                trial[j] = fresh[j]
            hits = furthest_ways(
                chain, limits, start_q, start_v, local, direction, trial, mode, care, free, way
            )
            for c in range(checks.shape[0]):
                worst[1, c] = max(worst[1, c], way[checks[c]])
                if not hits:
                    worst[0, c] = max(worst[0, c], way[checks[c]])
            if way[target] >= best:
                best, script = way[target], trial


def random_state(robot, random):
    """A measured state within limits; joints often at them, or on their way to a stop."""
    lower = np.where(np.isfinite(robot.lower_position_limit), robot.lower_position_limit, -3.0)
    upper = np.where(np.isfinite(robot.upper_position_limit), robot.upper_position_limit, 3.0)
    nv = len(lower)
    q = random.uniform(lower, upper)
    edge = random.random(nv) < random.choice([0.0, 0.3])
    near = random.random(nv) * random.choice([0.0, 1e-3, 0.05])
    q = np.where(edge, np.where(random.random(nv) < 0.5, lower + near, upper - near), q)
    v = random.uniform(-1.0, 1.0, nv) * robot.velocity_limit * random.choice([0.0, 0.3, 1.0])
    fast = random.random(nv) < random.choice([0.0, 0.3])
    v = np.where(fast, np.sign(v) * robot.velocity_limit, v)
    return np.clip(q, lower, upper), v


@kernel
def record_motion(
    chain, limits, q, v, local, direction, script, mode, care, free, places, positions, velocities
):  # fmt: skip
    """Fill places of the point, joint positions and velocities at every step of one motion."""
    q, v = q.copy(), v.copy()
    slope, push = np.zeros(q.shape[0]), np.zeros(q.shape[0])
    inner = np.empty((chain.column.shape[0] + 1, 3))
    for k in range(places.shape[0]):
        if k > 0:
            now = (k - 1) * STEP
            if mode == GREEDY:
                set_slopes(chain, q, direction, inner, slope)
            for j in range(q.shape[0]):
                if mode == GREEDY and now >= script[j, 1]:
                    push[j] = 1.0 if slope[j] > 0.0 else -1.0
                else:
                    push[j] = script[j, 0 if now < script[j, 1] else 2]
            if now < free - 1e-9:
                move_joints(q, v, push, limits, care, STEP)
            else:
                brake_joints(q, v, np.abs(push), limits, STEP)
        places[k] = place_point(chain, q, local, inner)
        positions[k], velocities[k] = q, v


@kernel
def chase(places, radius, points, velocities, accel, speed, since, states):
    """Let the corners of a hull chase a point, each within its bounds.

    Fills `states` (steps, corners, 6). Returns the first step from `since` on at which a corner,
    or the middle of two, is within `radius` of the point, or -1.
    """
    x, u = points.copy(), velocities.copy()
    count = x.shape[0]
    gap, after = np.empty(3), np.empty(3)
    first = -1
    for k in range(places.shape[0]):
        for c in range(count):
            if k > 0:
                for i in range(3):
                    gap[i] = places[k, i] - x[c, i]
                away = np.sqrt(gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2) + 1e-12
                for i in range(3):
                    after[i] = u[c, i] + gap[i] * (accel * STEP / away)
                pace = np.sqrt(after[0] ** 2 + after[1] ** 2 + after[2] ** 2)
                slower = min(1.0, speed / pace) if pace > 0.0 else 1.0
                for i in range(3):
                    after[i] *= slower
                    x[c, i] += 0.5 * STEP * (u[c, i] + after[i])
                    u[c, i] = after[i]
            for i in range(3):
                states[k, c, i], states[k, c, 3 + i] = x[c, i], u[c, i]
        if k < since or first >= 0:
            continue
        for a in range(count):
            for b in range(a, count):
                for i in range(3):
                    gap[i] = places[k, i] - 0.5 * (x[a, i] + x[b, i])
                if gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2 <= radius * radius:
                    first = k
    return first
