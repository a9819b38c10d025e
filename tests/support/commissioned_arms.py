"""Simulated arms whose figures are known, as recordings of them would show them."""

import functools
import math
from types import SimpleNamespace

import numpy as np

from armguard.lab.commission.observations import Observations, StopCommand

FINE = 1e-4  # [s]


class Arm:
    """Joints that work to and fro between rests, and obey STOPs as late and as hard as is known.

    Args:
        velocity: To which each joint speeds up, in [rad/s]. Shape (nv,).
        acceleration: With which it does, and slows down at work, in [rad/s²]. Shape (nv,).
        braking: Deceleration on STOP, in [rad/s²]. Shape (nv,).
        latency: From a STOP until it slows down, in [s].
        cruise: How long it keeps its speed each time, in [s].
        ramp: How long brakes take until they act in full, in [s].
    """

    def __init__(self, velocity, acceleration, braking, latency, cruise=0.6, ramp=0.0):
        self.velocity = np.asarray(velocity, float)
        self.acceleration = np.asarray(acceleration, float)
        self.braking = np.asarray(braking, float)
        self.latency, self.cruise, self.ramp = latency, cruise, ramp

    def work(self, stops, duration, hold=1.0):
        """Times, positions and velocities, each `FINE`; it begins anew `hold` [s] after a STOP."""
        figures = zip(self.velocity, self.acceleration, self.braking, strict=True)
        courses = [
            work_joint(*joint, self.latency, self.cruise, self.ramp, tuple(stops), duration, hold)
            for joint in figures
        ]
        q, v = (np.stack(rows, axis=1) for rows in zip(*courses, strict=True))
        return FINE * np.arange(len(q)), q, v


@functools.lru_cache
def work_joint(velocity, acceleration, braking, latency, cruise, ramp, stops, duration, hold):
    """Positions and velocities of one joint, each `FINE`."""
    count = round(duration / FINE)
    q, v = np.zeros(count), np.zeros(count)
    rise = velocity / acceleration
    whole = 2.0 * rise + cruise + 0.1
    begun = position = speed = 0.0
    for k in range(count):
        q[k], v[k] = position, speed
        now = k * FINE
        told = next((stop for stop in stops if stop + latency <= now < stop + hold), None)
        if told is not None:
            since = now - told - latency
            share = min(1.0, (since + 0.5 * FINE) / ramp) if ramp else 1.0
            change = min(abs(speed), share * braking * FINE)
            after = speed - math.copysign(change, speed)
            begun = told + hold
        else:
            turn, time = divmod(max(0.0, now + FINE - begun), whole)
            profile = min(time, 2.0 * rise + cruise - time) * acceleration
            after = (-1.0 if turn % 2 else 1.0) * min(max(profile, 0.0), velocity)
        position += 0.5 * (speed + after) * FINE
        speed = after
    return q, v


def sample(
    arm,
    stops,
    duration,
    *,
    period=1e-3,
    noise=0.0,
    velocity_noise=0.0,
    quantum=0.0,
    velocity_bias=0.0,
    seed=0,
    **more,
):
    """What a recording of such an arm has in it; noise is uniform, and so has a largest amount."""
    random = np.random.default_rng(seed)
    times, q, v = arm.work(stops, duration)
    chosen = np.arange(random.integers(0, 10), len(times), round(period / FINE))
    times, q, v = times[chosen], q[chosen], v[chosen]
    q = q + random.uniform(-noise, noise, q.shape)
    if quantum:
        q = quantum * np.round(q / quantum)
    v = v + velocity_bias + random.uniform(-velocity_noise, velocity_noise, v.shape)
    count = len(arm.velocity)
    robot = SimpleNamespace(
        joints=tuple(f"joint{i}" for i in range(count)),
        velocity_limit=np.full(count, 2.0),
        acceleration_limit=np.full(count, 15.0),
    )
    fields = {
        "robot": robot,
        "stamps": times,
        "q": q,
        "v": v,
        "stops": [StopCommand(stop, stop + 1.0) for stop in stops],
        "plans": [],
        "sources": {},
        "payload": 1.0,
        "latency": 0.002,
    }
    return Observations(**(fields | more))
