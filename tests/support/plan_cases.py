"""Random plans, arms that follow them as badly as they may, and obstacles on collision course."""

import numpy as np
import pinocchio

from armguard.bounds import Plan
from armguard.obstacles import Obstacles
from support.hostile_joints import CAREFUL, RECKLESS, STEP, brake_joints, limits_of, move_joints

SHARE = 0.9
"""Of acceleration limits that plans use."""


class Hermite:
    """The cubic through samples and their velocities, put together from Hermite's four bases."""

    def __init__(self, times, q, v):
        self.times, self.q, self.v = (np.asarray(array, dtype=float) for array in (times, q, v))

    def __call__(self, t, order=0):
        """Its derivative of an order at times, shape (n,) or ()."""
        t = np.asarray(t, dtype=float)
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        h = (self.times[k + 1] - self.times[k])[..., None]
        s = (t - self.times[k])[..., None] / h
        bases = [
            [1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2],
            [6 * (s**2 - s), 1 - 4 * s + 3 * s**2, 6 * (s - s**2), 3 * s**2 - 2 * s],
            [12 * s - 6, 6 * s - 4, 6 - 12 * s, 6 * s - 2],
        ][order]
        parts = self.q[k], h * self.v[k], self.q[k + 1], h * self.v[k + 1]
        return sum(base * part for base, part in zip(bases, parts, strict=True)) / h**order


class Waves:
    """A smooth motion within limits: each joint swings about a middle. Times count from 0."""

    def __init__(self, robot, random, speed):
        lower = np.where(np.isfinite(robot.lower_position_limit), robot.lower_position_limit, -4.0)
        upper = np.where(np.isfinite(robot.upper_position_limit), robot.upper_position_limit, 4.0)
        nv = len(lower)
        self.rate = random.uniform(1.0, 8.0, nv)
        self.phase = random.uniform(0.0, 2.0 * np.pi, nv)
        self.size = random.uniform(0.1, 1.0, nv) * np.minimum.reduce(
            [
                speed * robot.velocity_limit / self.rate,
                SHARE * robot.acceleration_limit / self.rate**2,
                0.45 * (upper - lower),
            ]
        )
        self.middle = random.uniform(lower + self.size, upper - self.size)

    def position(self, t):
        return self.middle + self.size * np.sin(self.rate * np.asarray(t)[..., None] + self.phase)

    def velocity(self, t):
        turn = self.rate * np.asarray(t)[..., None] + self.phase
        return self.size * self.rate * np.cos(turn)


def make_plan(waves, stamp, times, tracking_error, velocity_tracking_error=None):
    """The motion from a time on, sampled."""
    return Plan(
        stamp,
        times,
        waves.position(stamp + times),
        waves.velocity(stamp + times),
        tracking_error,
        velocity_tracking_error,
    )


def follow(robot, waves, plan, random, begin, reaction, command=None):
    """Joint positions and velocities at every step from `begin` to rest and a while beyond.

    The arm is off the plan by as much as it may, swings from side to side as fast as its limits
    allow, overshoots the plan's end for as long as it takes to react and brakes any way it likes.
    With a command to brake at some time on the plan, each joint does so when it likes.
    """
    nv, limits = len(robot.joints), limits_of(robot)
    curve = Hermite(plan.times, plan.q, plan.v)
    ends = np.concatenate([plan.times[:-1], plan.times[1:] - 1e-9])
    peak = np.abs(curve(ends, 2)).max(axis=0)
    off = random.choice([1.0, 1.0, 0.5, 0.0], nv) * plan.tracking_error
    fastest = np.sqrt(np.maximum(robot.acceleration_limit - peak, 0.0) / np.maximum(off, 1e-12))
    spare = 0.4 * robot.velocity_limit
    if plan.velocity_tracking_error is not None:
        spare = np.minimum(spare, plan.velocity_tracking_error)
    fastest = np.minimum(fastest, spare / np.maximum(off, 1e-12))
    rate = random.choice([1.0, 1.0, 0.0, 0.3], nv) * fastest
    # Many swing through the curve, at their fastest, just as the plan ends.
    end = float(plan.times[-1])
    meant = random.choice([0.0, np.pi, 0.5 * np.pi, -0.5 * np.pi, 1.0], nv)
    phase = meant - rate * (end if command is None else command)
    steps = round((end + plan.stamp - begin) / STEP)
    at = begin + STEP * np.arange(steps + 1)
    along = (at - plan.stamp)[:, None]
    inside = along[:, 0] >= 0.0
    q, v = waves.position(at), waves.velocity(at)
    q[inside], v[inside] = curve(along[inside, 0]), curve(along[inside, 0], 1)
    q += off * np.sin(rate * along + phase)
    v += off * rate * np.cos(rate * along + phase)
    q = np.clip(q, limits.lower, limits.upper)
    if command is not None:
        return _leave(q, v, round((plan.stamp - begin + command) / STEP), reaction, limits, random)
    qs, vs = list(q), list(v)
    position, velocity = qs[-1].copy(), vs[-1].copy()
    care = random.choice([CAREFUL, RECKLESS], nv)
    push, strength = random.choice([-1.0, 1.0, 0.0], nv), random.uniform(0.0, 1.0, nv)
    if random.random() < 0.5:
        strength = random.choice([0.0, 1.0], nv)
    for _ in range(round(random.choice([0.0, 1.0]) * reaction / STEP)):
        move_joints(position, velocity, push, limits, care, STEP)
        qs.append(position.copy())
        vs.append(velocity.copy())
    while np.any(velocity != 0.0):
        brake_joints(position, velocity, strength, limits, STEP)
        qs.append(position.copy())
        vs.append(velocity.copy())
    return np.array(qs), np.array(vs)


def _leave(q, v, step, reaction, limits, random):
    """Joints leave their paths from a step on, each at a time of its own, and brake."""
    nv, window = q.shape[1], round(reaction / STEP)
    leaves = step + random.choice([0, window, window // 2], nv)
    strength = random.choice([0.0, 1.0], nv) * random.choice([1.0, random.random()])
    qs, vs = list(q[: step + 1]), list(v[: step + 1])
    position, velocity = q[step].copy(), v[step].copy()
    for k in range(step, 100_000):
        on = k < leaves
        brake_joints(position, velocity, strength, limits, STEP)
        if on.any():
            position[on], velocity[on] = q[k + 1, on], v[k + 1, on]
        qs.append(position.copy())
        vs.append(velocity.copy())
        if not on.any() and not velocity.any():
            break
    return np.array(qs), np.array(vs)


class Skin:
    """Some corners of the geometry of all links: what a body can touch, covers aside."""

    def __init__(self, robot, random, most=12):
        self.model, self.data = robot.model, robot.model.createData()
        self.parts = []
        for link in robot.links:
            points = robot.hull(link)
            chosen = random.permutation(len(points))[:most]
            self.parts.append((robot.joint_index(link), points[chosen]))

    def place(self, qs):
        """Where they are in each configuration. Shape (len(qs), corners, 3)."""
        places = []
        for q in qs:
            pinocchio.forwardKinematics(self.model, self.data, q)
            at = self.data.oMi
            places.append(
                np.concatenate([p @ at[j].rotation.T + at[j].translation for j, p in self.parts])
            )
        return np.array(places)


class Attack:
    """An arm that follows a plan, and a body that is to meet a corner of it on the way.

    Attributes:
        plan: The plan; `now` is when it is checked, the arm measured at `stamp` as `q` and `v`.
        brake_after: When it is told to brake, in [s] from now; inf if not before the plan ends.
        contact: When body and arm first touch, in [s] from now; inf if not before the arm rests.
        rest: When the arm rests, likewise.
        obstacles: What a sensor saw of the body.
    """

    def __init__(self, robot, skin, random, reaction, stated):
        self.now = now = 1.0
        lead = round(random.choice([0.0, 0.0, -0.02, 0.03]) / STEP) * STEP
        duration = 0.01 * random.integers(5, 30)
        times = np.linspace(0.0, duration, random.integers(12, 60))
        command = None
        if duration + min(lead, 0.0) > reaction and random.random() < 0.5:
            latest = round((duration - reaction) / STEP)
            command = STEP * random.integers(round(max(-lead, 0.0) / STEP), latest + 1)
        self.brake_after = np.inf if command is None else command + lead
        waves = Waves(robot, random, random.choice([0.1, 0.3, 0.5]))
        errors = random.choice([1e-4, 2e-3, 1e-2]) * np.ones(len(robot.joints))
        speeds = random.choice([0.02, 0.1]) * np.ones(len(robot.joints)) if stated else None
        self.plan = make_plan(waves, now + lead, times, errors, speeds)
        begin = now - 0.03
        qs, vs = follow(robot, waves, self.plan, random, begin, reaction, command)
        step = round((now - begin) / STEP)
        seen = step + int(random.integers(-8, 3))
        if command is not None:
            # What has left the plan is no state to check it against.
            seen = min(seen, round((self.plan.stamp + command - begin) / STEP))
        self.stamp = begin + seen * STEP
        self.q = qs[seen] + random.choice([-1.0, 0.0, 1.0], len(errors)) * robot.position_error
        self.v = vs[seen] + random.choice([-1.0, 0.0, 1.0], len(errors)) * robot.velocity_error
        self.rest = (len(qs) - 1 - step) * STEP
        self.qs, self.step = qs, step
        self._aim(skin, random)

    def _aim(self, skin, random):
        qs, step, now = self.qs, self.step, self.now
        places = skin.place(qs)
        target = random.integers(places.shape[1])
        accel, speed = random.choice([0.0, 2.0, 10.0]), random.choice([0.3, 2.0])
        meet = int(random.integers(step, len(qs)))
        times = (np.arange(len(qs)) - step) * STEP
        heading = random.normal(size=3)
        heading /= np.linalg.norm(heading)
        duration = max(times[meet], STEP)
        push = random.uniform(0.0, 1.0) * min(accel, 1.9 * speed / (duration + 0.03))
        start = random.uniform(-1.0, 1.0) * (speed - push * (duration + 0.03))
        if start < -speed or speed < push * (duration + 0.03):
            push, start = 0.0, random.uniform(0.0, speed)
        # Within its bounds from before it is measured until a while after they are to meet.
        paths = heading * (start * times + 0.5 * push * times**2)[:, None]
        pace = heading * (start + push * times)[:, None]
        radius = random.uniform(0.0, 0.15)
        count = int(random.choice([1, 2, 8]))
        corners = 0.1 * random.normal(size=(count, 3))
        corners[0] = 0.0
        touch = places[meet, target] - random.uniform(0.5, 1.0) * radius * heading
        corners = corners + touch - paths[meet]
        first = np.inf
        for k in range(step, meet + 1):
            if self._touches(corners + paths[k], places[k], radius):
                first = times[k]
                break
        self.contact = first
        seen = step + int(random.integers(-10, 3))
        error, slip = random.choice([0.0, 0.02]), random.choice([0.0, 0.1])
        noise = random.normal(size=(2, count, 3))
        noise /= np.linalg.norm(noise, axis=2, keepdims=True)
        self.obstacles = Obstacles(accel=accel, speed=speed)
        self.obstacles.update(
            ["body"],
            now + times[seen],
            (corners + paths[seen] + error * noise[0])[None],
            (pace[seen] + slip * noise[1])[None],
            radius=radius,
            position_error=error,
            velocity_error=slip,
        )

    @staticmethod
    def _touches(corners, places, radius):
        points = list(corners) + [0.5 * (a + b) for i, a in enumerate(corners) for b in corners[:i]]
        gaps = np.linalg.norm(places[None] - np.array(points)[:, None], axis=2)
        return bool((gaps <= radius).any())


def all_pairs(obstacles, links):
    rows = np.flatnonzero(obstacles.table.alive)
    return (rows[:, None] * links + np.arange(links)).ravel()
