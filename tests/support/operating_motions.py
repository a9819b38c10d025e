"""Joint motions that obey operating limits exactly, and nothing beyond: hostile, and in bulk.

A joint is pushed by a part of what it may: against its velocity by as much as its acceleration
limit, with it by as much as the operating acceleration, and up to the operating velocity. Every
piece is integrated in closed form, from event to event: where it turns round, is as fast as it may
be, or runs into its stop, from where it comes back as hard as the hardware allows.
"""

from typing import NamedTuple

import numpy as np

from armguard.jit.kernels import kernel

PIECES = 4
"""Of constant push in each motion."""


class Law(NamedTuple):
    """What one joint keeps to."""

    lower: float
    upper: float
    velocity: float
    speeding: float
    accel: float
    braking: float


@kernel
def hit_time(room, pace, rate):
    """When a coordinate that goes at `pace` and speeds up at `rate` has gone `room` >= 0."""
    if room == 0.0:
        return 0.0 if pace > 0.0 or rate > 0.0 else np.inf
    square = pace * pace + 2.0 * rate * room
    if square < 0.0:
        return np.inf
    fastest = pace + np.sqrt(square)
    return 2.0 * room / fastest if fastest > 0.0 else np.inf


@kernel
def glide(q, v, rate, span, law):
    """Constant acceleration for a while, or until a stop: position, velocity, time left, hit."""
    side = 1.0 if v > 0.0 or (v == 0.0 and rate > 0.0) else -1.0
    room = max(law.upper - q if side > 0.0 else q - law.lower, 0.0)
    time = hit_time(room, abs(v), side * rate)
    if time < span:
        return (law.upper if side > 0.0 else law.lower), 0.0, span - time, True
    return q + v * span + 0.5 * rate * span * span, v + rate * span, 0.0, False


@kernel
def push_joint(q, v, push, span, top, law, bounced):
    """A joint pushed for `span` seconds, push in [-1, 1]: position, velocity, whether it hit."""
    hit = bounced
    sign = np.sign(push)
    if sign == 0.0:
        q, v, _, now = glide(q, v, 0.0, span, law)
        return q, v, hit or now
    while span > 1e-15:
        if v * sign < 0.0:
            # Turning round.
            rate = push * law.accel
            step = min(span, -v / rate)
            q, faster, left, now = glide(q, v, rate, step, law)
            v = 0.0 if step < span or now else faster
        elif abs(v) < top:
            # What a stop throws back is no controller's doing.
            rate = push * (law.accel if hit else law.speeding)
            step = min(span, (top - abs(v)) / abs(rate))
            q, faster, left, now = glide(q, v, rate, step, law)
            v = faster if now or step == span else sign * top
        else:
            step = span
            q, v, left, now = glide(q, v, 0.0, span, law)
        span -= step - left
        hit |= now
        if now and (q - law.lower if sign < 0.0 else law.upper - q) <= 0.0:
            # It rests at its stop, pushed against it.
            return q, 0.0, True
    return q, v, hit


@kernel
def slow_joint(q, v, rate, span, law):
    """A joint that slows down until it rests."""
    step = min(span, abs(v) / rate)
    q, faster, _, now = glide(q, v, -np.sign(v) * rate, step, law)
    if now:
        return q, 0.0, True
    return q, 0.0 if step < span else faster, False


@kernel
def random_push(random):
    kind = random.integers(0, 8)
    if kind == 0:
        return random.uniform(-1.0, 1.0)
    if kind == 1:
        return 0.0
    return 1.0 if random.random() < 0.5 else -1.0


@kernel
def record_joint(q, v, free, times, law, random, places, rates):
    """One motion from (q, v), recorded at rising times >= 0; whether it ran into a stop.

    It is free until `free`, and brakes then.
    """
    hit = False
    if times.shape[0] == 0:
        return hit
    end = min(times[-1], free)
    switches = np.sort(random.uniform(0.0, 1.0, PIECES - 1)) * max(end, 1e-9)
    pushes = np.empty(PIECES)
    strengths = np.empty(PIECES)
    for piece in range(PIECES):
        pushes[piece] = random_push(random)
        kind = random.integers(0, 3)
        part = random.uniform(0.0, 1.0) if kind == 0 else kind - 1.0
        strengths[piece] = law.braking + part * (law.accel - law.braking)
    now = 0.0
    for k in range(times.shape[0]):
        while now < times[k]:
            piece = 0
            until = times[k]
            while piece < PIECES - 1 and switches[piece] <= now:
                piece += 1
            if piece < PIECES - 1:
                until = min(until, switches[piece])
            if now < free:
                until = min(until, free)
                q, v, hit = push_joint(q, v, pushes[piece], until - now, law.velocity, law, hit)
            else:
                q, v, new = slow_joint(q, v, strengths[piece], until - now, law)
                hit |= new
            now = until
        places[k], rates[k] = q, v
    return hit
