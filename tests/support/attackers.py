"""Balls that attack an arm within their bounds, and what could truly still happen.

Balls accelerate at constant rates for a step of time, so every motion here is one that bounds
allow, exactly. `attack_all` finds what they could still do to an arm whose motion is given: a
contact that it finds is one that can truly happen.
"""

from typing import NamedTuple

import numpy as np

from armguard.jit.kernels import kernel
from support.true_arm import find_pace, get_point, rotate

FEW = 3  # points of a leaf whose distances from those of other links are followed
HUNT, SPEND, HOARD, EDGE, BANG, WANDER = range(6)
"""What a ball does: chases the arm; rushes after a look and looks harmless before the next; keeps
still and spends all its allowance late; presses on while the arm may go on; switches; roams."""


class Balls(NamedTuple):
    """Obstacles as they truly are; `states` are positions and velocities, (n, 6)."""

    states: np.ndarray
    accel: np.ndarray
    speed: np.ndarray
    radius: np.ndarray
    mode: np.ndarray
    heading: np.ndarray
    shy: np.ndarray
    limit: np.ndarray
    """How fast a surface may truly be that touches each, in [m/s]; 0: it must rest. (n,)"""
    way: np.ndarray
    """How far one may truly go on that clamps it, in [m]. (n,)"""


class Harm(NamedTuple):
    """What leaves of an arm do whose motion is given; (times, leaves) each."""

    pace: np.ndarray
    """How fast the fastest of a leaf is from then on, in [m/s]."""
    way: np.ndarray
    """How far the farthest of it goes from then on, in [m]."""
    company: np.ndarray
    """How many balls come within the gap of it from then on."""
    first: np.ndarray
    """One that does so; -1: none."""
    closing: np.ndarray
    """How much nearer it comes from then on to another link, within the gap of that, in [m]."""


@kernel
def push_towards(arm, rotations, origins, center, leaf, goal, push):
    """Full acceleration of every joint that brings a leaf nearer to `goal`."""
    push[:] = 0.0
    k = arm.joint[leaf]
    dx, dy, dz = goal[0] - center[0], goal[1] - center[1], goal[2] - center[2]
    while k >= 0:
        axis = rotate(rotations, k, arm.axis[k, 0], arm.axis[k, 1], arm.axis[k, 2])
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


@kernel
def nearest_leaf(arm, centers, x, radius):
    """The leaf nearest to a ball, and the distance of their surfaces."""
    best, least = 0, np.inf
    for leaf in range(centers.shape[0]):
        dx, dy, dz = x[0] - centers[leaf, 0], x[1] - centers[leaf, 1], x[2] - centers[leaf, 2]
        away = np.sqrt(dx * dx + dy * dy + dz * dz) - arm.radius[leaf] - radius
        if away < least:
            best, least = leaf, away
    return best, least


@kernel
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


@kernel
def is_harmless(balls, harm, b, k, leaf):
    """Whether a contact of a ball and a leaf at a time is one that limits truly permit."""
    pace, limit = harm.pace[k, leaf], balls.limit[b]
    if not (limit > 0.0 and pace <= limit):
        return False
    if harm.closing[k, leaf] > balls.way[b]:
        return False
    others = harm.company[k, leaf] - (harm.first[k, leaf] == b)
    return others <= 0 or harm.way[k, leaf] <= balls.way[b]


@kernel
def find_company(arm, balls, trace, times, count, gap, harm):
    """Fill which balls are within a gap of each leaf from each time on, if they go straight on.

    One ball is named, and of more it is only known that there are at least two.
    """
    rotations, origins, centers = trace
    harm.company[:count] = 0
    harm.first[:count] = -1
    if not gap > 0.0:
        return
    for b in range(balls.accel.shape[0]):
        state, radius = balls.states[b], balls.radius[b]
        for leaf in range(arm.joint.shape[0]):
            comes = False
            for k in range(count - 1, -1, -1):
                x, y, z = (
                    state[0] + state[3] * times[k],
                    state[1] + state[4] * times[k],
                    state[2] + state[5] * times[k],
                )
                dx, dy, dz = (
                    centers[k, leaf, 0] - x,
                    centers[k, leaf, 1] - y,
                    centers[k, leaf, 2] - z,
                )
                far = arm.radius[leaf] + radius + gap
                if not comes and dx * dx + dy * dy + dz * dz <= far * far:
                    for index in range(arm.first[leaf], arm.first[leaf + 1]):
                        a, d, c = get_point(arm, rotations[k], origins[k], leaf, index)
                        if (a - x) ** 2 + (d - y) ** 2 + (c - z) ** 2 <= (radius + gap) ** 2:
                            comes = True
                            break
                if comes:
                    harm.company[k, leaf] += 1
                    harm.first[k, leaf] = b


def list_link_pairs(arm):
    """Pairs of leaves whose distance more than one joint can change. Shape (m, 2)."""
    carried = []
    for joint in arm.joint:
        own, k = set(), joint
        while k >= 0:
            own.add(int(k))
            k = arm.parent[k]
        carried.append(own)
    count = len(carried)
    pairs = [(a, b) for a in range(count) for b in range(a) if len(carried[a] ^ carried[b]) > 1]
    return np.array(pairs, dtype=np.int64)


@kernel
def fill_closing(arm, pairs, trace, count, gap, closing):
    """Fill how much nearer points of each leaf come to points of others, (times, leaves).

    From each time on, of points that are within a gap of each other once they are nearest.
    """
    rotations, origins, centers = trace
    closing[:count] = 0.0
    if not gap > 0.0 or count == 0:
        return
    last = count - 1
    for i in range(pairs.shape[0]):
        a, b = pairs[i, 0], pairs[i, 1]
        square = ((centers[last, a] - centers[last, b]) ** 2).sum()
        if square > (arm.radius[a] + arm.radius[b] + gap) ** 2:
            continue
        for m in range(arm.first[a], min(arm.first[a] + FEW, arm.first[a + 1])):
            for n in range(arm.first[b], min(arm.first[b] + FEW, arm.first[b + 1])):
                nearest = np.inf
                for k in range(last, -1, -1):
                    x, y, z = get_point(arm, rotations[k], origins[k], a, m)
                    u, v, w = get_point(arm, rotations[k], origins[k], b, n)
                    away = np.sqrt((x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2)
                    nearest = min(nearest, away)
                    if nearest <= gap:
                        closes = away - nearest
                        closing[k, a] = max(closing[k, a], closes)
                        closing[k, b] = max(closing[k, b], closes)
    for k in range(last - 1, -1, -1):
        for leaf in range(arm.joint.shape[0]):
            closing[k, leaf] = max(closing[k, leaf], closing[k + 1, leaf])


@kernel
def attack_all(arm, balls, trace, times, count, harm):
    """What the most dangerous ball lacks for a contact at any of the times that does harm.

    Returns that in [m], the ball, the index of the time, and how many balls were near enough to be
    tried one by one; and of contacts that are permitted, and possible, how near the fastest comes
    to its limit, as a fraction of that, and how fast any is, in [m/s]; 0 without one.
    """
    rotations, origins, centers = trace
    worst, who, when, tried, gentle, pace = np.inf, -1, -1, 0, 0.0, 0.0
    if count == 0:
        return worst, who, when, tried, gentle, pace
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
                permitted = is_harmless(balls, harm, b, k, leaf)
                # Of permitted contacts only faster ones are of interest, or nearer to their limit.
                here = harm.pace[k, leaf]
                if permitted and not (here > gentle * balls.limit[b] or here > pace):
                    continue
                x, y, z = centers[k, leaf, 0], centers[k, leaf, 1], centers[k, leaf, 2]
                contact = arm.radius[leaf] + radius
                dx, dy, dz = x - state[0], y - state[1], z - state[2]
                # Too far for its speed, and farther than the worst so far: not worth a closer look.
                enough = 0.0 if permitted else min(worst, 10.0)
                far = contact + reach + enough
                if dx * dx + dy * dy + dz * dz > far * far:
                    continue
                lacks = shortfall(state, balls.accel[b], balls.speed[b], x, y, z, contact, times[k])
                if not lacks <= enough:
                    continue
                for index in range(arm.first[leaf], arm.first[leaf + 1]):
                    x, y, z = get_point(arm, rotations[k], origins[k], leaf, index)
                    lacks = shortfall(
                        state, balls.accel[b], balls.speed[b], x, y, z, radius, times[k]
                    )
                    if permitted and lacks <= 0.0:
                        pace = max(pace, harm.pace[k, leaf])
                        gentle = max(gentle, harm.pace[k, leaf] / balls.limit[b])
                        break
                    if lacks < worst and not permitted:
                        worst, who, when = lacks, b, k
    return worst, who, when, tried, gentle, pace


@kernel
def count_near(arm, balls, room, trace, times, links):
    """Pairs of a link and a ball that do not touch, and could truly touch at one of the times.

    Only by motions of balls that `shortfall` knows, of an arm whose motion is given: of what could
    happen it is rather too little than too much. `room` is the arm as it is, `trace` as it is then.

    Returns how many there are, and the soonest such time, inf without one.
    """
    count, soonest = 0, np.inf
    rotations, origins, centers = trace
    when = np.empty(links)
    for b in range(balls.accel.shape[0]):
        state, radius = balls.states[b], balls.radius[b]
        when[:] = np.inf
        for leaf in range(arm.joint.shape[0]):
            link = arm.link[leaf]
            for k in range(times.shape[0]):
                if not times[k] < when[link]:
                    break
                x, y, z = centers[k, leaf, 0], centers[k, leaf, 1], centers[k, leaf, 2]
                far = arm.radius[leaf] + radius + balls.speed[b] * times[k]
                dx, dy, dz = x - state[0], y - state[1], z - state[2]
                if dx * dx + dy * dy + dz * dz > far * far:
                    continue
                for index in range(arm.first[leaf], arm.first[leaf + 1]):
                    x, y, z = get_point(arm, rotations[k], origins[k], leaf, index)
                    lacks = shortfall(
                        state, balls.accel[b], balls.speed[b], x, y, z, radius, times[k]
                    )
                    if lacks <= 0.0:
                        when[link] = times[k]
                        break
        for link in range(links):
            if when[link] < np.inf and not _touches(arm, state[:3], radius, room, link):
                count += 1
                soonest = min(soonest, when[link])
    return count, soonest


@kernel
def _touches(arm, x, radius, room, link):
    """Whether a ball touches a link; any one for -1."""
    for leaf in range(arm.joint.shape[0]):
        if link >= 0 and arm.link[leaf] != link:
            continue
        if _touches_leaf(arm, x, radius, room, leaf):
            return True
    return False


@kernel
def _touches_leaf(arm, x, radius, room, leaf):
    rotations, origins, centers = room
    dx, dy, dz = x[0] - centers[leaf, 0], x[1] - centers[leaf, 1], x[2] - centers[leaf, 2]
    far = arm.radius[leaf] + radius
    if dx * dx + dy * dy + dz * dz > far * far:
        return False
    for index in range(arm.first[leaf], arm.first[leaf + 1]):
        px, py, pz = get_point(arm, rotations, origins, leaf, index)
        if (x[0] - px) ** 2 + (x[1] - py) ** 2 + (x[2] - pz) ** 2 <= radius * radius:
            return True
    return False


@kernel
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
                # It stands still, as its reference state says that it might.
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


@kernel
def find_prey(arm, balls, centers):
    """The ball nearest to the arm in time, and the leaf that it is nearest to."""
    best, prey, leaf = np.inf, 0, 0
    for b in range(balls.accel.shape[0]):
        near, away = nearest_leaf(arm, centers, balls.states[b, :3], balls.radius[b])
        time = away / max(balls.speed[b], 0.1)
        if time < best:
            best, prey, leaf = time, b, near
    return prey, leaf


@kernel
def count_touching(arm, balls, room, rates):
    """How many balls touch the arm, and how many it hurts; how near others are to their limit.

    It hurts what a leaf touches that is faster than the limit, or moves if there is none.
    """
    rotations, origins, centers = room
    count = hurt = 0
    gentle = 0.0
    for b in range(balls.accel.shape[0]):
        if not _touches(arm, balls.states[b, :3], balls.radius[b], room, -1):
            continue
        count += 1
        if not np.abs(rates).max() > 0.0:
            continue
        limit = balls.limit[b]
        fastest = np.inf
        if limit > 0.0:
            fastest = 0.0
            for leaf in range(centers.shape[0]):
                if _touches_leaf(arm, balls.states[b, :3], balls.radius[b], room, leaf):
                    pace = find_pace(arm, rotations, origins, centers, rates, leaf)
                    fastest = max(fastest, pace)
        if fastest > limit:
            hurt += 1
        else:
            gentle = max(gentle, fastest / limit)
    return count, hurt, gentle
