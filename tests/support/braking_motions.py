"""Joints that brake anyhow within what their brakes are stated for, many at a time.

A motion is a list of pieces of constant acceleration. It is free at first, then may slow down to a
pace, and brakes at any time from then on or before: by the entry for its true speed at the bite it
holds its speed for as long as time and distance allow, or less, and slows down as hard as it likes,
no less than what is guaranteed. Nothing here is taken from the bounds but the layout of a table.
"""

from typing import NamedTuple

import numpy as np

from armguard.bounds.limits import JointLimits
from armguard.robot.brakes import BrakeCurves

TURNS = 3  # changes of mind while free


class Joints(NamedTuple):
    limits: JointLimits
    q: np.ndarray
    v: np.ndarray
    true: np.ndarray
    """Velocities as they are, within their errors."""


def draw_tables(random, count, top, accel):
    """Monotone tables of up to three speeds; each entry times, a deceleration, or both."""
    speed = np.sort(random.uniform(0.1, 1.0, (count, 3)), axis=1) * top[:, None]
    speed[:, -1] = 1.3 * top
    # No harder than the acceleration limit: a time and a distance that leave room for it.
    time = speed / accel[:, None] * random.uniform(1.0, 6.0, (count, 3))
    time = np.maximum.accumulate(time, axis=1)
    least, most = 0.5 * speed**2 / accel[:, None], speed * time
    distance = least + (most - least) * random.uniform(0.0, 1.0, (count, 3))
    distance = np.maximum.accumulate(distance, axis=1)
    held = accel[:, None] * random.uniform(0.05, 1.0, (count, 3))
    held = np.minimum.accumulate(held, axis=1)
    kind = random.integers(0, 3, (count, 1))
    time, distance = (np.where(kind == 1, np.inf, values) for values in (time, distance))
    held = np.where(kind == 0, 0.0, held)
    return BrakeCurves(*(np.ascontiguousarray(part) for part in (speed, held, time, distance)))


def draw_joints(random, count):
    top, accel = random.uniform(0.3, 2.0, count), 10.0 ** random.uniform(0.3, 1.5, count)
    error = random.choice([0.0, 0.02, 0.2], count)
    share = random.choice([1.0, 0.1, 0.5], count)
    far = np.full(count, np.inf)
    limits = JointLimits(
        lower=-far,
        upper=far,
        velocity=top,
        acceleration=accel,
        brakes=draw_tables(random, count, top, accel),
        position_error=np.zeros(count),
        velocity_error=error,
        operating_velocity=top,
        operating_acceleration=share * accel,
    )
    v = top * np.clip(random.uniform(-1.2, 1.2, count), -1.0, 1.0)
    v *= random.choice([1.0, 0.1, 0.0], count)
    off = np.clip(random.uniform(-2.0, 2.0, count), -1.0, 1.0) * error
    return Joints(limits, np.zeros(count), v, np.clip(v + off, -top, top))


class Pieces:
    """Motions as they are made, piece by piece."""

    def __init__(self, start):
        self.spans, self.rates, self.starts = [], [], []
        self.v = start.copy()

    def go(self, span, rate):
        span = np.maximum(span, 0.0)
        self.spans.append(span)
        self.rates.append(rate)
        self.starts.append(self.v)
        self.v = self.v + rate * span

    def until(self, target, slows, speeds, span):
        """Go to a target velocity, and keep it; the time left of `span` is used up."""
        # First towards rest, as far as the target or rest, then away from it.
        same = np.sign(target) * np.sign(self.v) > 0.0
        via = np.where(same, np.sign(self.v) * np.minimum(np.abs(self.v), np.abs(target)), 0.0)
        first = np.minimum(span, np.abs(self.v - via) / slows)
        rate = -np.sign(self.v) * slows
        reached = np.abs(self.v - via) / slows <= span
        self.go(first, rate)
        self.v = np.where(reached, via, self.v)
        left = span - first
        second = np.minimum(left, np.abs(target - self.v) / speeds)
        reached = np.abs(target - self.v) / speeds <= left
        self.go(second, np.sign(target - self.v) * speeds)
        self.v = np.where(reached, target, self.v)
        self.go(left - second, np.zeros(len(span)))

    def brake(self, random, limits, span):
        """Slow down to rest as the entry for the present speed says; `span` is used up."""
        speed = np.abs(self.v)
        stops = speed > 0.0
        held, time, distance = look_up(limits.brakes, speed)
        harder = held + (limits.acceleration - held) * random.choice([0.0, 1.0, 0.5], len(speed))
        # What times and distances call for, where nothing is guaranteed at each instant.
        mean = np.maximum(speed / time, 0.5 * speed**2 / distance)
        rate = np.minimum(np.maximum(harder, mean * (1.0 + 1e-9)), limits.acceleration)
        with np.errstate(invalid="ignore", divide="ignore"):
            ramp = np.where(stops, speed / rate, 0.0)
            room = np.minimum(time - ramp, (distance - 0.5 * speed * ramp) / speed)
        room = np.where((held > 0.0) | ~stops, 0.0, np.maximum(room, 0.0))
        room = np.minimum(room * random.choice([1.0, 0.0, 0.7], len(speed)), span)
        self.go(room, np.zeros(len(speed)))
        slowed = np.minimum(ramp, span - room)
        self.go(slowed, np.where(stops, -np.sign(self.v) * rate, 0.0))
        rests = stops & (ramp <= span - room)
        self.v = np.where(rests, 0.0, self.v)
        return span - room - slowed

    def places(self, times):
        """Displacements at some times. Shape (times, n)."""
        begin, places = np.zeros(len(self.v)), np.zeros((len(times), len(self.v)))
        for span, rate, start in zip(self.spans, self.rates, self.starts, strict=True):
            within = np.clip(times[:, None] - begin, 0.0, span)
            places += within * (start + 0.5 * rate * within)
            begin = begin + span
        return places


def look_up(brakes, speed):
    step = (speed[:, None] > brakes.speed).sum(axis=1)
    rows = np.arange(len(speed))
    return (part[rows, step] for part in (brakes.deceleration, brakes.time, brakes.distance))


def move(random, joints, free, times):
    """Displacements at `times` from the stamp. Shape (times, n).

    Where nothing comes between, brakes may bite before the free time is over.
    """
    limits, count = joints.limits, len(joints.q)
    pieces = Pieces(joints.true)
    early = random.random(count) < 0.3
    bite = np.where(early, free * random.uniform(0.0, 1.0, count), free)
    for part in np.diff(np.linspace(0.0, 1.0, TURNS + 1)):
        target = limits.velocity * np.clip(random.uniform(-2.0, 2.0, count), -1.0, 1.0)
        pieces.until(target, limits.acceleration, limits.operating_acceleration, part * bite)
    rests = pieces.brake(random, limits, np.full(count, 1e3))
    pieces.go(rests, np.zeros(count))
    return pieces.places(times)
