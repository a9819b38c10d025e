"""An arm as it truly is: where it is, how it moves within its limits, and points of its surface.

Written anew from Pinocchio's placements and axes, in Numba, and independent of what it is to test.
"""

from typing import NamedTuple

import numpy as np

from armguard.jit.kernels import kernel
from armguard.robot import Robot
from armguard.robot.joints import is_prismatic
from support.hostile_joints import move_joints, turn

POINTS = 20  # of the surface, at most, in each leaf
PACED = 6  # of these, those whose speed and way count: the first ones are farthest apart
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


@kernel
def rotate(rotations, k, x, y, z):
    """The k-th of some rotation matrices times a vector."""
    r = rotations
    return (
        r[k, 0, 0] * x + r[k, 0, 1] * y + r[k, 0, 2] * z,
        r[k, 1, 0] * x + r[k, 1, 1] * y + r[k, 1, 2] * z,
        r[k, 2, 0] * x + r[k, 2, 1] * y + r[k, 2, 2] * z,
    )


@kernel
def place_leaves(arm, q, rotations, origins, centers):
    """Fill placements of the joints' frames and centres of the leaves."""
    for k in range(arm.parent.shape[0]):
        a, b, d = arm.axis[k, 0], arm.axis[k, 1], arm.axis[k, 2]
        up, slides = arm.parent[k], arm.slides[k]
        for i in range(3):
            x, y, z = 1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2)
            if not slides:
                x, y, z = turn(x, y, z, a, b, d, q[k])
            x, y, z = rotate(arm.rotation, k, x, y, z)
            if up >= 0:
                x, y, z = rotate(rotations, up, x, y, z)
            rotations[k, 0, i], rotations[k, 1, i], rotations[k, 2, i] = x, y, z
        x, y, z = arm.translation[k, 0], arm.translation[k, 1], arm.translation[k, 2]
        if slides:
            along = rotate(arm.rotation, k, a, b, d)
            x, y, z = x + along[0] * q[k], y + along[1] * q[k], z + along[2] * q[k]
        if up >= 0:
            x, y, z = rotate(rotations, up, x, y, z)
            x, y, z = x + origins[up, 0], y + origins[up, 1], z + origins[up, 2]
        origins[k, 0], origins[k, 1], origins[k, 2] = x, y, z
    for leaf in range(arm.joint.shape[0]):
        k, local = arm.joint[leaf], arm.local
        x, y, z = rotate(rotations, k, local[leaf, 0], local[leaf, 1], local[leaf, 2])
        centers[leaf, 0] = origins[k, 0] + x
        centers[leaf, 1] = origins[k, 1] + y
        centers[leaf, 2] = origins[k, 2] + z


@kernel
def make_room(arm):
    """Room for placements and centres."""
    joints, leaves = arm.parent.shape[0], arm.joint.shape[0]
    return np.empty((joints, 3, 3)), np.empty((joints, 3)), np.empty((leaves, 3))


@kernel
def make_trace(arm, samples):
    """The same for several instants."""
    joints, leaves = arm.parent.shape[0], arm.joint.shape[0]
    return (
        np.empty((samples, joints, 3, 3)),
        np.empty((samples, joints, 3)),
        np.empty((samples, leaves, 3)),
    )


@kernel
def get_point(arm, rotations, origins, leaf, index):
    """Where a point of a leaf is."""
    k, p = arm.joint[leaf], arm.points[index]
    r, o = rotations[k], origins[k]
    return (
        o[0] + r[0, 0] * p[0] + r[0, 1] * p[1] + r[0, 2] * p[2],
        o[1] + r[1, 0] * p[0] + r[1, 1] * p[1] + r[1, 2] * p[2],
        o[2] + r[2, 0] * p[0] + r[2, 1] * p[1] + r[2, 2] * p[2],
    )


@kernel
def find_pace(arm, rotations, origins, centers, rates, leaf):
    """How fast the fastest of a leaf is, of its centre and a few points of the surface, [m/s].

    By the velocities of the joints that carry it, each about or along its axis.
    """
    spin, slide = np.zeros(3), np.zeros(3)
    k = arm.joint[leaf]
    while k >= 0:
        axis = rotate(rotations, k, arm.axis[k, 0], arm.axis[k, 1], arm.axis[k, 2])
        if arm.slides[k]:
            for i in range(3):
                slide[i] += axis[i] * rates[k]
        else:
            a, b, c = axis[0] * rates[k], axis[1] * rates[k], axis[2] * rates[k]
            x, y, z = origins[k, 0], origins[k, 1], origins[k, 2]
            # What turns about an axis through x has the velocity w × (p - x).
            spin[0], spin[1], spin[2] = spin[0] + a, spin[1] + b, spin[2] + c
            slide[0] -= b * z - c * y
            slide[1] -= c * x - a * z
            slide[2] -= a * y - b * x
        k = arm.parent[k]
    fastest = 0.0
    first, last = arm.first[leaf], arm.first[leaf + 1]
    for index in range(first - 1, min(first + PACED, last)):
        x, y, z = centers[leaf, 0], centers[leaf, 1], centers[leaf, 2]
        if index >= first:
            x, y, z = get_point(arm, rotations, origins, leaf, index)
        square = (slide[0] + spin[1] * z - spin[2] * y) ** 2
        square += (slide[1] + spin[2] * x - spin[0] * z) ** 2
        square += (slide[2] + spin[0] * y - spin[1] * x) ** 2
        fastest = max(fastest, square)
    return np.sqrt(fastest)


@kernel
def fill_paces(arm, trace, rates, count, pace):
    """Fill how fast each leaf is at each of some times, or at any later one, (times, leaves)."""
    rotations, origins, centers = trace
    for leaf in range(arm.joint.shape[0]):
        later = 0.0
        for k in range(count - 1, -1, -1):
            here = find_pace(arm, rotations[k], origins[k], centers[k], rates[k], leaf)
            later = max(later, here)
            pace[k, leaf] = later


@kernel
def fill_ways(arm, trace, count, way):
    """Fill how far points of each leaf get from each of some times on, (times, leaves)."""
    rotations, origins, _ = trace
    for leaf in range(arm.joint.shape[0]):
        first = arm.first[leaf]
        last = min(first + PACED, arm.first[leaf + 1])
        way[:count, leaf] = 0.0
        for index in range(first, last):
            for k in range(count - 1):
                x, y, z = get_point(arm, rotations[k], origins[k], leaf, index)
                for later in range(k + 1, count):
                    a, b, c = get_point(arm, rotations[later], origins[later], leaf, index)
                    gone = np.sqrt((a - x) ** 2 + (b - y) ** 2 + (c - z) ** 2)
                    way[k, leaf] = max(way[k, leaf], gone)


@kernel
def _pushed(v, rate, top, t):
    """Way and velocity after `t` seconds at one acceleration, up to a speed."""
    end = v + rate * t
    if abs(end) <= top:
        return 0.5 * (v + end) * t, end
    goal = top if rate > 0.0 else -top
    ramp = (goal - v) / rate
    return 0.5 * (v + goal) * ramp + goal * (t - ramp), goal


@kernel
def _braked(v, rate, t):
    """Way and velocity after `t` seconds of slowing down to rest."""
    until = min(t, abs(v) / rate)
    way = until * (abs(v) - 0.5 * rate * until)
    return np.sign(v) * way, np.sign(v) * (abs(v) - rate * until)


@kernel
def trace_arm(arm, limits, q, v, push, strength, free, scale, times, trace, rates):
    """Fill where everything is at `times`, of an arm that is pushed and then brakes.

    For `free` seconds it keeps to a fraction of its speeds, as it has done before, then it brakes.
    Returns how many of the times there are before it rests. One that reaches a stop stays there.
    `rates` are filled with the velocities of its joints, (times, nv).
    """
    rotations, origins, centers = trace
    place = np.empty_like(q)
    for k in range(times.shape[0]):
        moves = False
        for j in range(q.shape[0]):
            top, rate = scale * limits.velocity[j], limits.accel[j]
            start = min(max(v[j], -top), top)
            way, speed = _pushed(start, push[j] * rate, top, min(times[k], free))
            slows = limits.braking[j] + strength[j] * (rate - limits.braking[j])
            if times[k] > free:
                further, speed = _braked(speed, slows, times[k] - free)
                way += further
            place[j] = min(max(q[j] + way, limits.lower[j]), limits.upper[j])
            rates[k, j] = speed if place[j] == q[j] + way else 0.0
            moves |= abs(speed) > 1e-12 and place[j] == q[j] + way
        if times[k] > free and not moves:
            return k
        place_leaves(arm, place, rotations[k], origins[k], centers[k])
    return times.shape[0]


@kernel
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
