"""Random plans, arms that follow them as badly as they may, and obstacles on collision course."""

import functools

import numpy as np
import pinocchio

from armguard.bounds import Plan, append_stop
from armguard.obstacles import Obstacles
from support.hostile_joints import STEP

SHARE = 0.9
"""Of acceleration limits that plans use."""

BLOCK = 64
"""How many steps of followers are laid out at a time: few enough for what is between to stay in a
processor's cache."""


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
        if order == 0:
            bases = (2 * s - 3) * s * s + 1, (s - 1) ** 2 * s, (3 - 2 * s) * s * s, (s - 1) * s * s
        elif order == 1:
            bases = 6 * (s - 1) * s, (3 * s - 4) * s + 1, 6 * (1 - s) * s, (3 * s - 2) * s
        else:
            bases = 12 * s - 6, 6 * s - 4, 6 - 12 * s, 6 * s - 2
        parts = self.q[k], h * self.v[k], self.q[k + 1], h * self.v[k + 1]
        return sum(base * part for base, part in zip(bases, parts, strict=True)) / h**order


class Waves:
    """A smooth motion within limits: each joint swings about a middle. Times count from 0."""

    def __init__(self, robot, random, speed):
        lower = np.where(np.isfinite(robot.lower_position_limit), robot.lower_position_limit, -4.0)
        upper = np.where(np.isfinite(robot.upper_position_limit), robot.upper_position_limit, 4.0)
        nv = len(lower)
        # There is room to stop beyond, and a stop takes a fraction of a second.
        quick = 0.25 * robot.braking_deceleration / robot.velocity_limit
        speed = np.minimum(speed, quick)
        stop = np.square(speed * robot.velocity_limit) / (2.0 * robot.braking_deceleration)
        stop = np.minimum(stop, 0.3 * (upper - lower))
        speed = np.sqrt(2.0 * stop * robot.braking_deceleration) / robot.velocity_limit
        lower, upper = lower + stop, upper - stop
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


def make_plan(robot, waves, stamp, times, tracking_error, velocity_tracking_error=None, **changes):
    """The motion from a time on, sampled, and each joint's stop at its end."""
    plan = Plan(
        stamp,
        times,
        waves.position(stamp + times),
        waves.velocity(stamp + times),
        tracking_error,
        velocity_tracking_error,
    )
    stopped = append_stop(plan, robot.braking_deceleration)
    assert isinstance(stopped, Plan), stopped
    return stopped._replace(**changes)


class Follower:
    """Arms that follow a plan as badly as they may, all at once. Times count from its beginning.

    Each joint is off the plan by as much as it may, and swings from side to side as fast as it may;
    many are at the edge of both just when brakes bite.

    Attributes:
        time: Of each step, in [s]. Shape (steps,).
        along: Where on the plan's curve each arm is, in [s]. Shape (steps, arms).
        q: Shape (steps, arms, nv).
        v: Shape (steps, arms, nv).
        resting: Since when each arm rests, in [s]. Shape (arms,).
    """

    def __init__(self, robot, waves, plan, random, arms, first, now, *, wanders=False, most=1.0):
        nv = len(robot.joints)
        curve = Hermite(plan.times, plan.q, plan.v)
        ends = np.concatenate([plan.times[:-1], plan.times[1:] - 1e-9])
        peak = np.abs(curve(ends, 2)).max(axis=0)
        off = np.asarray(plan.tracking_error) + robot.position_error
        off = off * random.choice([1.0, 1.0, 0.5, 0.0], (arms, nv))
        spare = np.maximum(robot.acceleration_limit - peak, 0.0)
        rate = np.sqrt(spare / np.maximum(off, 1e-12))
        pace = np.minimum(0.4 * robot.velocity_limit, 0.3 * robot.braking_deceleration)
        if plan.velocity_tracking_error is not None:
            pace = np.minimum(pace, plan.velocity_tracking_error + robot.velocity_error)
        rate = np.minimum(rate, pace / np.maximum(off, 1e-12))
        rate = rate * random.choice([1.0, 1.0, 0.0, 0.3], (arms, nv))
        phase = random.choice([0.0, np.pi, 0.5 * np.pi, -0.5 * np.pi, 1.0], (arms, nv)) - rate * now
        self.robot, self.random, self.now = robot, random, now
        self._off = off, rate, phase
        last = float(plan.times[-1]) + 1.0
        self.time = first + STEP * np.arange(round((last - first) / STEP) + 1)
        along = np.tile(self.time[:, None], (1, arms))
        self.pace = np.ones((len(self.time), arms))
        if wanders:
            # A clock that slows down and speeds up again as it likes, from where it is now on.
            least, slow = random.choice([0.0, 0.3, 1.0], arms), random.uniform(2.0, 15.0, arms)
            turn = slow * (self.time[:, None] - first) + random.uniform(0.0, 6.0, arms)
            self.pace = most * (least + (1.0 - least) * 0.5 * (1.0 + np.cos(turn)))
            gone = np.cumsum(0.5 * STEP * (self.pace[1:] + self.pace[:-1]), axis=0)
            along = first + np.concatenate([np.zeros((1, arms)), gone])
        self._curve, self._waves, self._stamp = curve, waves, plan.stamp
        self.along = along
        self.resting = np.full(arms, float(plan.times[-1]))

    @functools.cached_property
    def q(self):
        return self._lay(0)

    @functools.cached_property
    def v(self):
        return self._lay(1)

    def _lay(self, order, steps=None):
        """Where the arms are, or how fast: somewhere along the curve, and swinging about it.

        Only the first `steps` are filled, if so many are asked for.
        """
        laid = np.empty((*self.along.shape, self._off[0].shape[1]))
        steps = len(self.time) if steps is None else min(steps, len(self.time))
        for first in range(0, steps, BLOCK):
            some = slice(first, min(first + BLOCK, steps))
            laid[some] = self._lay_some(some, order)
        return laid

    def _lay_some(self, some, order):
        along, (off, rate, phase) = self.along[some], self._off
        if (along == along[:, :1]).all():
            along = along[:, :1]  # all arms are at one place of the curve
        curve, waves = self._curve, self._waves
        laid = curve(np.clip(along, 0.0, curve.times[-1]), order)
        if order == 1:
            laid = laid * (self.pace[some] * (along <= curve.times[-1]))[..., None]
        if (before := along < 0.0).any():
            free = (waves.position, waves.velocity)[order](self._stamp + along)
            laid = np.where(before[..., None], free, laid)
        swing = rate * self.time[some, None, None] + phase
        if order == 1:
            return laid + off * rate * np.cos(swing)
        limits = self.robot.lower_position_limit, self.robot.upper_position_limit
        return np.clip(laid + off * np.sin(swing), *limits)

    def index(self, time):
        return round((time - self.time[0]) / STEP)

    def brake_joints(self, window):
        """From now on each joint leaves, at a time of its own within a window, and brakes."""
        robot, random = self.robot, self.random
        braking = robot.braking_deceleration
        arms, nv = self._off[0].shape
        begin = self.index(self.now)
        leaves = begin + random.choice([0, round(window / STEP), -1], (arms, nv))
        leaves[leaves < begin] = begin + random.integers(0, round(window / STEP) + 1)
        # Where all have left, nothing of the plan counts.
        self.q, self.v = (self._lay(order, leaves.max() + 2) for order in (0, 1))
        strength = random.choice([0.0, 1.0, 0.5], (arms, nv))
        flips = random.random((arms, nv)) < 0.3
        lower, upper = robot.lower_position_limit, robot.upper_position_limit
        for k in range(begin, len(self.time) - 1):
            off = leaves <= k
            part = np.where(flips & (random.random((arms, nv)) < 0.5), 1.0 - strength, strength)
            rate = braking + part * (robot.acceleration_limit - braking)
            q, v = self.q[k], self.v[k]
            side, pace = np.sign(v), np.abs(v)
            until = np.minimum(STEP, pace / rate)
            free = q + side * until * (pace - 0.5 * rate * until)
            # One that gets to its limit stops there.
            moved = np.minimum(np.maximum(free, lower), upper)
            slower = side * np.maximum(pace - rate * STEP, 0.0)
            slower *= (moved == free) | (v == 0.0)
            np.copyto(self.q[k + 1], moved, where=off)
            np.copyto(self.v[k + 1], slower, where=off)
            moving = ~off | (self.v[k + 1] != 0.0)
            self.resting = np.where(
                moving.any(axis=1), np.inf, np.minimum(self.resting, self.time[k + 1])
            )
            if not moving.any():
                self.q[k + 1 :], self.v[k + 1 :] = self.q[k + 1], 0.0
                break


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
        joints = sorted({joint for joint, _ in self.parts})
        at = np.empty((len(qs), self.model.njoints, 4, 4))
        for k, q in enumerate(qs):
            pinocchio.forwardKinematics(self.model, self.data, q)
            for joint in joints:
                at[k, joint] = self.data.oMi[joint].homogeneous
        return np.concatenate(
            [
                points @ at[:, joint, :3, :3].swapaxes(1, 2) + at[:, joint, None, :3, 3]
                for joint, points in self.parts
            ],
            axis=1,
        )


class Attack:
    """An arm that follows a plan, and a body that is to meet a corner of it on the way.

    Attributes:
        plan: The plan; `now` is when it is checked, the arm measured at `stamp` as `q` and `v`.
        is_stopped: Whether brakes bite on the way, from now until the latest bite.
        contact: When body and arm first touch, in [s] from now; inf if not before the arm rests.
        rest: When the arm rests, likewise.
        obstacles: What a sensor saw of the body.
    """

    def __init__(self, robot, skin, random, latest_bite, stated):
        self.now = now = 1.0
        lead = round(random.choice([0.0, 0.0, -0.02, 0.03]) / STEP) * STEP
        duration = 0.01 * random.integers(5, 30)
        times = np.linspace(0.0, duration, random.integers(12, 60))
        self.is_stopped = bool(random.random() < 0.5)
        if self.is_stopped:
            lead = min(lead, 0.0)
        waves = Waves(robot, random, random.choice([0.1, 0.3, 0.5]))
        errors = random.choice([1e-4, 2e-3, 1e-2]) * np.ones(len(robot.joints))
        speeds = random.choice([0.02, 0.1]) * np.ones(len(robot.joints)) if stated else None
        self.plan = make_plan(robot, waves, now + lead, times, errors, speeds)
        arm = Follower(robot, waves, self.plan, random, 1, -lead - 0.03, -lead)
        if self.is_stopped:
            arm.brake_joints(max(min(latest_bite, duration + lead), STEP))
        step = arm.index(-lead)
        end = min(arm.index(min(arm.resting[0], arm.time[-1])) + 1, len(arm.time) - 1)
        qs, vs = arm.q[: end + 1, 0], arm.v[: end + 1, 0]
        seen = step + int(random.integers(-8, 1 if self.is_stopped else 3))
        self.stamp = now + (seen - step) * STEP
        # What is measured is within the deviation, too.
        off = random.choice([-1.0, 0.0, 1.0], len(errors)) * robot.position_error
        curve = Hermite(self.plan.times, self.plan.q, self.plan.v)
        at = max(arm.time[seen], 0.0)
        self.q = np.clip(qs[seen] + off, *(curve(at) + sign * errors for sign in (-1.0, 1.0)))
        if arm.time[seen] < 0.0:
            self.q = qs[seen] + off
        self.v = vs[seen] + random.choice([-1.0, 0.0, 1.0], len(errors)) * robot.velocity_error
        self.rest = (len(qs) - 1 - step) * STEP
        self.qs, self.step = qs, step
        self._aim(skin, random)

    def _aim(self, skin, random):
        qs, step, now = self.qs, self.step, self.now
        target = random.integers(sum(len(points) for _, points in skin.parts))
        accel, speed = random.choice([0.0, 2.0, 10.0]), random.choice([0.3, 2.0])
        meet = int(random.integers(step, len(qs)))
        places = skin.place(qs[step : meet + 1])
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
        touch = places[-1, target] - random.uniform(0.5, 1.0) * radius * heading
        corners = corners + touch - paths[meet]
        first = np.inf
        for k in range(step, meet + 1):
            if self._touches(corners + paths[k], places[k - step], radius):
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


def place_spheres(arm, placement):
    """Centres of all spheres of an arm whose joints are placed so. Shape (slabs, n, 3)."""
    carriers = placement[:, arm.carrier]
    return np.einsum("knij,nj->kni", carriers[..., :3], arm.local) + carriers[..., 3]


def place_course(motion, course):
    """Centres of all spheres in the middle of each slab of a course. Shape (slabs, n, 3)."""
    return place_spheres(motion._arm, course.placement)
