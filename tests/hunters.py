"""Arms and balls that attack each other within their bounds, and what could truly still happen.

Written anew from Pinocchio's placements and axes, in Numba, and independent of what it is to test.
Balls accelerate at constant rates for a step of time, so every motion here is one that bounds
allow, exactly. `attack_all` finds what they could still do to an arm whose motion is given: a
contact that it finds is one that can truly happen.
"""

from typing import NamedTuple

import numba
import numpy as np
from joint_motions import move_joints, turn

from armguard.levers import is_prismatic
from armguard.robot import Robot

HUNT, SPEND, HOARD, EDGE, BANG, WANDER = range(6)
"""What a ball does: chases the arm; rushes after a look and looks harmless before the next; keeps
still and spends all its allowance late; presses on while the arm may go on; switches; roams."""

POINTS = 20  # of the surface, at most, in each leaf
ROOM = 0.01  # that a careful arm keeps to its stops, in [rad] or [m]


class Skeleton(NamedTuple):
    """An arm as it truly is: joints, and points of its surface.

    The finest spheres of its cover, the leaves, only say which points are worth a look: they may
    stand out of the spheres above them, and of the arm.
    """

    parent: np.ndarray
    slides: np.ndarray
    axis: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    joint: np.ndarray
    link: np.ndarray
    local: np.ndarray
    radius: np.ndarray
    first: np.ndarray
    """Where the points of each leaf begin in `points`; one more at the end."""
    points: np.ndarray
    """In the frame of the leaf's joint."""


class Balls(NamedTuple):
    """Obstacles as they truly are; `states` are positions and velocities, (n, 6)."""

    states: np.ndarray
    accel: np.ndarray
    speed: np.ndarray
    radius: np.ndarray
    mode: np.ndarray
    heading: np.ndarray
    shy: np.ndarray


def make_skeleton(robot: Robot) -> Skeleton:
    model = robot.model
    numbers = range(1, model.njoints)
    spaces = [np.ravel(model.joints[k].createData().S) for k in numbers]
    slides = np.array([is_prismatic(model, k) for k in numbers])
    rows = []
    for link, name in enumerate(robot.links):
        tree = robot.cover.tree(name)
        leaves = tree.spheres[np.asarray(tree.child_count) == 0]
        rows += [(robot.joint_index(name) - 1, link, *sphere) for sphere in leaves]
    rows = np.array(rows)
    points = _share_points(robot, rows)
    return Skeleton(
        np.array([model.parents[k] - 1 for k in numbers]),
        slides,
        np.array([s[:3] if p else s[3:] for s, p in zip(spaces, slides, strict=True)]),
        np.array([model.jointPlacements[k].rotation for k in numbers]),
        np.array([model.jointPlacements[k].translation for k in numbers]),
        rows[:, 0].astype(np.int64),
        rows[:, 1].astype(np.int64),
        rows[:, 2:5].copy(),
        rows[:, 5].copy(),
        np.cumsum([0] + [len(some) for some in points]),
        np.concatenate(points),
    )


def _share_points(robot, leaves):
    """Points of the true surface for each leaf, (n, 3), as evenly spread as can be."""
    shared = [np.zeros((0, 3)) for _ in leaves]
    for link, name in enumerate(robot.links):
        triangles = robot.triangles(name)
        middles = 0.5 * (triangles + np.roll(triangles, 1, axis=1))
        every = np.concatenate(
            [triangles.reshape(-1, 3), middles.reshape(-1, 3), triangles.mean(axis=1)]
        )
        every = np.unique(every, axis=0)
        own = np.flatnonzero(leaves[:, 1] == link)
        away = np.linalg.norm(every[:, None] - leaves[own, 2:5], axis=2) - leaves[own, 5]
        nearest = own[np.argmin(away, axis=1)]
        for leaf in own:
            mine = every[nearest == leaf]
            if not len(mine):
                continue
            chosen, apart = [0], np.full(len(mine), np.inf)
            while len(chosen) < min(POINTS, len(mine)):
                apart = np.minimum(apart, np.linalg.norm(mine - mine[chosen[-1]], axis=1))
                chosen.append(int(np.argmax(apart)))
            shared[leaf] = mine[chosen]
    return shared


@numba.njit(cache=True)
def place_leaves(arm, q, rotations, origins, centers):
    """Fill placements of the joints' frames and centres of the leaves."""
    column = np.empty(3)
    for k in range(arm.parent.shape[0]):
        for i in range(3):
            column[:] = 0.0
            column[i] = 1.0
            if not arm.slides[k]:
                turn(column, arm.axis[k], q[k], column)
            for j in range(3):
                rotations[k, j, i] = (
                    arm.rotation[k, j, 0] * column[0]
                    + arm.rotation[k, j, 1] * column[1]
                    + arm.rotation[k, j, 2] * column[2]
                )
        for j in range(3):
            origins[k, j] = arm.translation[k, j]
            if arm.slides[k]:
                for i in range(3):
                    origins[k, j] += arm.rotation[k, j, i] * arm.axis[k, i] * q[k]
        up = arm.parent[k]
        if up >= 0:
            rotations[k] = rotations[up] @ rotations[k]
            origins[k] = rotations[up] @ origins[k] + origins[up]
    for leaf in range(arm.joint.shape[0]):
        k = arm.joint[leaf]
        for j in range(3):
            centers[leaf, j] = origins[k, j]
            for i in range(3):
                centers[leaf, j] += rotations[k, j, i] * arm.local[leaf, i]


@numba.njit(cache=True)
def make_room(arm):
    """Room for placements and centres."""
    joints, leaves = arm.parent.shape[0], arm.joint.shape[0]
    return np.empty((joints, 3, 3)), np.empty((joints, 3)), np.empty((leaves, 3))


@numba.njit(cache=True)
def make_trace(arm, samples):
    """The same for several instants."""
    joints, leaves = arm.parent.shape[0], arm.joint.shape[0]
    return (
        np.empty((samples, joints, 3, 3)),
        np.empty((samples, joints, 3)),
        np.empty((samples, leaves, 3)),
    )


@numba.njit(cache=True)
def get_point(arm, rotations, origins, leaf, index):
    """Where a point of a leaf is."""
    k, p = arm.joint[leaf], arm.points[index]
    r, o = rotations[k], origins[k]
    return (
        o[0] + r[0, 0] * p[0] + r[0, 1] * p[1] + r[0, 2] * p[2],
        o[1] + r[1, 0] * p[0] + r[1, 1] * p[1] + r[1, 2] * p[2],
        o[2] + r[2, 0] * p[0] + r[2, 1] * p[1] + r[2, 2] * p[2],
    )


@numba.njit(cache=True)
def push_towards(arm, rotations, origins, center, leaf, goal, push):
    """Full acceleration of every joint that brings a leaf nearer to `goal`."""
    push[:] = 0.0
    k = arm.joint[leaf]
    dx, dy, dz = goal[0] - center[0], goal[1] - center[1], goal[2] - center[2]
    while k >= 0:
        axis = rotations[k] @ arm.axis[k]
        if arm.slides[k]:
            along = axis[0] * dx + axis[1] * dy + axis[2] * dz
        else:
            ox, oy, oz = (
                center[0] - origins[k, 0],
                center[1] - origins[k, 1],
                center[2] - origins[k, 2],
            )
            along = (
                (axis[1] * oz - axis[2] * oy) * dx
                + (axis[2] * ox - axis[0] * oz) * dy
                + (axis[0] * oy - axis[1] * ox) * dz
            )
        push[k] = 1.0 if along > 0.0 else -1.0
        k = arm.parent[k]


@numba.njit(cache=True)
def nearest_leaf(arm, centers, x, radius):
    """The leaf nearest to a ball, and the distance of their surfaces."""
    best, least = 0, np.inf
    for leaf in range(centers.shape[0]):
        dx, dy, dz = x[0] - centers[leaf, 0], x[1] - centers[leaf, 1], x[2] - centers[leaf, 2]
        away = np.sqrt(dx * dx + dy * dy + dz * dz) - arm.radius[leaf] - radius
        if away < least:
            best, least = leaf, away
    return best, least


@numba.njit(cache=True)
def shortfall(state, accel, speed, x, y, z, contact, t):
    """What a ball lacks, in [m], to be within `contact` of a point in `t` seconds; <= 0: it can.

    The better of two motions that its bounds allow: one acceleration all the time, and full
    acceleration to the speed that it then keeps.
    """
    ux, uy, uz = state[3], state[4], state[5]
    dx, dy, dz = x - state[0] - ux * t, y - state[1] - uy * t, z - state[2] - uz * t
    far = np.sqrt(dx * dx + dy * dy + dz * dz)
    need = far - contact
    if need <= 0.0 or t <= 0.0:
        return need
    dx, dy, dz = dx / far, dy / far, dz / far
    along = ux * dx + uy * dy + uz * dz
    across = max(ux * ux + uy * uy + uz * uz - along * along, 0.0)
    faster = np.sqrt(max(speed * speed - across, 0.0)) - along
    lacks = need - 0.5 * min(accel, max(faster, 0.0) / t) * t * t
    if lacks <= 0.0 or accel * t <= faster:
        return lacks
    gx, gy, gz = x - state[0], y - state[1], z - state[2]
    for _ in range(3):
        size = np.sqrt(gx * gx + gy * gy + gz * gz)
        if not size > 0.0:
            break
        wx, wy, wz = gx * speed / size, gy * speed / size, gz * speed / size
        change = np.sqrt((wx - ux) ** 2 + (wy - uy) ** 2 + (wz - uz) ** 2)
        ramp = change / accel if accel > 0.0 else np.inf
        if not ramp < t:
            break
        ex = x - state[0] - 0.5 * (ux + wx) * ramp - wx * (t - ramp)
        ey = y - state[1] - 0.5 * (uy + wy) * ramp - wy * (t - ramp)
        ez = z - state[2] - 0.5 * (uz + wz) * ramp - wz * (t - ramp)
        lacks = min(lacks, np.sqrt(ex * ex + ey * ey + ez * ez) - contact)
        gx = x - state[0] - 0.5 * (ux - wx) * ramp
        gy = y - state[1] - 0.5 * (uy - wy) * ramp
        gz = z - state[2] - 0.5 * (uz - wz) * ramp
    return lacks


@numba.njit(cache=True)
def _pushed(v, rate, top, t):
    """Way and velocity after `t` seconds at one acceleration, up to a speed."""
    end = v + rate * t
    if abs(end) <= top:
        return 0.5 * (v + end) * t, end
    goal = top if rate > 0.0 else -top
    ramp = (goal - v) / rate
    return 0.5 * (v + goal) * ramp + goal * (t - ramp), goal


@numba.njit(cache=True)
def _braked(v, rate, pace, t):
    """Way and velocity after `t` seconds of slowing down to a pace, which is then kept."""
    until = min(t, (abs(v) - pace) / rate)
    way = until * (abs(v) - 0.5 * rate * until) + pace * (t - until)
    return np.sign(v) * way, np.sign(v) * (abs(v) - rate * until)


@numba.njit(cache=True)
def trace_arm(arm, limits, q, v, push, strength, free, going, scale, times, trace):
    """Fill where everything is at `times`, of an arm that is pushed and then brakes.

    After `free` seconds it keeps to a fraction of its speeds for `going` seconds, then brakes.
    Returns how many of the times there are before it rests. One that reaches a stop stays there.
    """
    rotations, origins, centers = trace
    place = np.empty_like(q)
    for k in range(times.shape[0]):
        moves = False
        for j in range(q.shape[0]):
            top, rate = limits.velocity[j], limits.accel[j]
            way, speed = _pushed(v[j], push[j] * rate, top, min(times[k], free))
            slows = limits.braking[j] + strength[j] * (rate - limits.braking[j])
            if times[k] > free:
                then = min(times[k] - free, going)
                if abs(speed) > scale * top:
                    further, speed = _braked(speed, slows, scale * top, then)
                else:
                    further, speed = _pushed(speed, push[j] * rate, scale * top, then)
                way += further
            if times[k] > free + going:
                further, speed = _braked(speed, slows, 0.0, times[k] - free - going)
                way += further
            place[j] = min(max(q[j] + way, limits.lower[j]), limits.upper[j])
            moves |= abs(speed) > 1e-12 and place[j] == q[j] + way
        if times[k] > free and not moves:
            return k
        place_leaves(arm, place, rotations[k], origins[k], centers[k])
    return times.shape[0]


@numba.njit(cache=True)
def attack_all(arm, balls, trace, times, count):
    """What the most dangerous ball lacks for a contact at any of the times.

    Returns that in [m], the ball, the index of the time, and how many balls were near enough to be
    tried one by one.
    """
    rotations, origins, centers = trace
    worst, who, when, tried = np.inf, -1, -1, 0
    if count == 0:
        return worst, who, when, tried
    middle = np.zeros(3)
    for i in range(3):
        middle[i] = centers[:count, :, i].mean()
    spread = 0.0
    for k in range(count):
        for leaf in range(arm.joint.shape[0]):
            dx, dy, dz = (
                centers[k, leaf, 0] - middle[0],
                centers[k, leaf, 1] - middle[1],
                centers[k, leaf, 2] - middle[2],
            )
            spread = max(spread, np.sqrt(dx * dx + dy * dy + dz * dz) + arm.radius[leaf])
    last = times[count - 1]
    for b in range(balls.accel.shape[0]):
        state, radius = balls.states[b], balls.radius[b]
        dx, dy, dz = state[0] - middle[0], state[1] - middle[1], state[2] - middle[2]
        if np.sqrt(dx * dx + dy * dy + dz * dz) > spread + radius + balls.speed[b] * last:
            continue
        tried += 1
        for k in range(count):
            reach = balls.speed[b] * times[k]
            for leaf in range(arm.joint.shape[0]):
                x, y, z = centers[k, leaf, 0], centers[k, leaf, 1], centers[k, leaf, 2]
                contact = arm.radius[leaf] + radius
                dx, dy, dz = x - state[0], y - state[1], z - state[2]
                # Too far for its speed, and farther than the worst so far: not worth a closer look.
                far = contact + reach + min(worst, 10.0)
                if dx * dx + dy * dy + dz * dz > far * far:
                    continue
                lacks = shortfall(state, balls.accel[b], balls.speed[b], x, y, z, contact, times[k])
                if not lacks < worst:
                    continue
                for index in range(arm.first[leaf], arm.first[leaf + 1]):
                    x, y, z = get_point(arm, rotations[k], origins[k], leaf, index)
                    lacks = shortfall(
                        state, balls.accel[b], balls.speed[b], x, y, z, radius, times[k]
                    )
                    if lacks < worst:
                        worst, who, when = lacks, b, k
    return worst, who, when, tried


@numba.njit(cache=True)
def steer_balls(
    arm, balls, centers, before, step, stopped, looked, until_look, between, home, random
):
    """One step of all balls, each within its bounds.

    `looked`: ticks since each was looked at; `until_look`: ticks until the next time; `between`:
    ticks from one to the other. `stopped`: ticks for which the arm has had to stop.
    """
    for b in range(balls.accel.shape[0]):
        state = balls.states[b]
        if not balls.speed[b] > 0.0:
            continue
        mode = balls.mode[b]
        leaf, away = nearest_leaf(arm, centers, state[:3], balls.radius[b])
        lead = max(away, 0.0) / balls.speed[b]
        goal = centers[leaf] + (centers[leaf] - before[leaf]) * (min(lead, 0.3) / step)
        towards = goal - state[:3]
        push = 1.0
        flees = stopped > balls.shy[b]
        if mode == WANDER:
            if random.random() < 0.01:
                for i in range(3):
                    balls.heading[b, i] = random.normal()
            far = np.sqrt(state[0] ** 2 + state[1] ** 2 + state[2] ** 2)
            towards = balls.heading[b].copy()
            if far > home[b] or away < 0.5 * balls.speed[b]:
                towards = -state[:3].copy() if far > home[b] else state[:3].copy()
        elif flees:
            push = -1.0
        elif mode == SPEND:
            push = 1.0 if until_look[b] > max(2, between[b] // 4) else -1.0
        elif mode == HOARD:
            if looked[b] < 0.7 * between[b]:
                # It stands still, as its anchor says that it might.
                towards = -state[3:6].copy()
                push = min(1.0, np.sqrt((towards**2).sum()) / (balls.accel[b] * step))
        elif mode == EDGE:
            push = 1.0 if stopped == 0 else -1.0
        elif mode == BANG:
            if random.random() < 0.02:
                balls.heading[b, 0] = -np.sign(balls.heading[b, 0])
            push = 1.0 if balls.heading[b, 0] > 0.0 else -1.0
            if away > 1.5:
                push = 1.0
        size = np.sqrt((towards**2).sum())
        change = np.zeros(3)
        if size > 0.0:
            change[:] = towards * (push * balls.accel[b] * step / size * (1.0 - 1e-9))
        after = state[3:6] + change
        pace = np.sqrt((after**2).sum())
        if pace > balls.speed[b] * (1.0 - 1e-9):
            # The nearest velocity that it may have: the change is no larger for that.
            after *= balls.speed[b] / pace * (1.0 - 1e-9)
        for i in range(3):
            state[i] += 0.5 * step * (state[3 + i] + after[i])
            state[3 + i] = after[i]


@numba.njit(cache=True)
def find_prey(arm, balls, centers):
    """The ball nearest to the arm in time, and the leaf that it is nearest to."""
    best, prey, leaf = np.inf, 0, 0
    for b in range(balls.accel.shape[0]):
        near, away = nearest_leaf(arm, centers, balls.states[b, :3], balls.radius[b])
        time = away / max(balls.speed[b], 0.1)
        if time < best:
            best, prey, leaf = time, b, near
    return prey, leaf


@numba.njit(cache=True)
def move_freely(q, v, push, limits, top, care, step):
    """One step of an arm that goes as it likes, at `top` of its speeds, and clear of its stops.

    A joint keeps so far from its stops that even its guaranteed brakes save it.
    """
    want = push.copy()
    for j in range(q.shape[0]):
        side = 1.0 if v[j] > 0.0 else -1.0
        room = limits.upper[j] - q[j] if side > 0.0 else q[j] - limits.lower[j]
        pace = abs(v[j]) + 2.0 * limits.accel[j] * step + 0.05
        ahead = pace * pace / (2.0 * limits.braking[j]) + pace * 0.06 + ROOM
        near = min(limits.upper[j] - q[j], q[j] - limits.lower[j])
        if ahead > room:
            want[j] = -side * min(1.0, abs(v[j]) / (limits.accel[j] * step))
        elif near < 0.1 and v[j] == 0.0:
            want[j] = 1.0 if q[j] - limits.lower[j] < limits.upper[j] - q[j] else -1.0
        after = v[j] + want[j] * limits.accel[j] * step
        if abs(after) > top * limits.velocity[j]:
            goal = np.sign(after) * top * limits.velocity[j]
            want[j] = (goal - v[j]) / (limits.accel[j] * step)
            want[j] = min(max(want[j], -1.0), 1.0)
    return move_joints(q, v, want, limits, care, step)


@numba.njit(cache=True)
def count_touching(arm, balls, rotations, origins, centers):
    """How many balls touch the arm."""
    count = 0
    for b in range(balls.accel.shape[0]):
        x, radius = balls.states[b, :3], balls.radius[b]
        touches = False
        for leaf in range(centers.shape[0]):
            dx, dy, dz = x[0] - centers[leaf, 0], x[1] - centers[leaf, 1], x[2] - centers[leaf, 2]
            far = arm.radius[leaf] + radius
            if touches or dx * dx + dy * dy + dz * dz > far * far:
                continue
            for index in range(arm.first[leaf], arm.first[leaf + 1]):
                px, py, pz = get_point(arm, rotations, origins, leaf, index)
                gap = (x[0] - px) ** 2 + (x[1] - py) ** 2 + (x[2] - pz) ** 2
                touches |= gap <= radius * radius
        count += touches
    return count
