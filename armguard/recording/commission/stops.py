"""A STOP as a measurement: when a joint began to slow down, and how long and far it still went.

A joint's speed is taken as two straight lines: as it was, and slowing down. The break between them
is where the brakes bit. How closely the samples fix it is told by their squares: times at which the
sum of these is not much worse than at the best are possible, and of them the latest counts for the
response and the earliest for the stop, so that each is too long rather than too short.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.recording.commission.noise import estimate_noise
from armguard.recording.commission.observations import Observations, StopCommand

LEAD_IN = 0.05
"""How much of the course before a STOP is looked at, in [s]."""

SLOWEST = 0.05
"""A joint slower than this share of its velocity limit tells nothing about its brakes."""

DEVIATIONS = 3.0
"""Standard deviations of a measurement that are added on the safe side."""

_TAIL = 0.2
"""Share of its speed below which a slowing joint is no longer fitted: brakes settle then."""

_FEWEST = 4
"""Samples that either line must have."""

_STEPS_BETWEEN = 16
"""Times between two samples that are tried for the break."""

_MOST_PLACES = 800
"""Times tried at most."""

_LEAST_BREAK = 0.3
"""Of the deceleration, by which the line before must be flatter: else it slowed down anyway."""

_STRAIGHT = 0.005
"""Of a speed, that samples of a steady deceleration may be off a straight line by, noise or not."""

_UNEVEN = 2.0
"""Times the noise that samples of a steady deceleration may be off its line by."""


class JointStop(NamedTuple):
    """How one joint obeyed one STOP."""

    joint: str
    told: float
    """Time of the verdict, in [s] of the monitor's clock."""
    speed: float
    """When the brakes bit, at least, in [rad/s] or [m/s]."""
    response: float
    """From the verdict to the bite, at most, in [s]."""
    stopping_time: float
    """From the bite to rest, at most, in [s]."""
    stopping_distance: float
    """Meanwhile, at most, in [rad] or [m]."""
    deceleration: float
    """At each instant of it, at least, in [rad/s²] or [m/s²]; NaN where it was not steady."""


def measure_stops(seen: Observations) -> tuple[list[JointStop], list[str]]:
    """All stops of all joints, and in words which of them could not be measured, and why."""
    found: list[JointStop] = []
    problems = []
    for command in seen.stops:
        for joint, name in enumerate(seen.robot.joints):
            measured = measure_stop(seen, command, joint)
            if isinstance(measured, JointStop):
                found.append(measured)
            elif measured:
                problems.append(f"{name}, STOP at {command.told:.3f} s: {measured}")
    return found, problems


def measure_stop(seen: Observations, command: StopCommand, joint: int) -> JointStop | str:
    """How one joint obeyed one STOP, or why that cannot be told; empty: it was hardly moving."""
    inside = (seen.stamps >= command.told - LEAD_IN) & (seen.stamps <= command.ended)
    stamps, q, v = seen.stamps[inside], seen.q[inside, joint], seen.v[inside, joint]
    before = np.flatnonzero(stamps <= command.told)
    if not len(before):
        return "no joint state before it"
    start = float(np.mean(v[before[-5:]]))
    if not abs(start) >= SLOWEST * float(seen.robot.velocity_limit[joint]):
        return ""
    speed = np.sign(start) * v
    noise = estimate_noise(seen.v[:, joint])
    slow = np.flatnonzero((speed <= _TAIL * abs(start)) & (stamps > command.told))
    if not len(slow):
        return "it ends before the joint is slow"
    fit = _fit_break(stamps[: slow[0] + 1], speed[: slow[0] + 1], command.told)
    if isinstance(fit, str):
        return fit
    # Below this a sample does not tell whether the joint moves; it decelerates as before.
    least = max(4.0 * noise, 0.01 * abs(start))
    moving = np.flatnonzero(np.abs(speed) > least)
    if moving[-1] + 1 >= len(stamps):
        return "it ends before the joint rests"
    rest = stamps[moving[-1] + 1] + least / fit.deceleration
    position = np.sign(start) * q
    bite = np.interp(fit.earliest, stamps, position)
    position_noise = estimate_noise(seen.q[:, joint])
    distance = float(position[stamps >= fit.earliest].max() - bite)
    distance += 2.0 * DEVIATIONS * position_noise
    time = float(rest) - fit.earliest
    deceleration = min(
        fit.least_deceleration, fit.speed / time, 0.5 * fit.speed * fit.speed / distance
    )
    is_steady = fit.residual <= max(_UNEVEN * noise, _STRAIGHT * fit.speed)
    return JointStop(
        seen.robot.joints[joint],
        command.told,
        fit.speed,
        fit.latest - command.told,
        time,
        distance,
        deceleration if is_steady else float("nan"),
    )


class _Break(NamedTuple):
    """Two lines that meet where the brakes bit."""

    earliest: float
    latest: float
    speed: float
    """There, at least."""
    deceleration: float
    least_deceleration: float
    residual: float
    """Root mean square of what the samples of the second line are off by."""


def _fit_break(stamps: FloatArray, speed: FloatArray, told: float) -> _Break | str:
    """Fit both lines to a course of speeds that ends while the joint still slows down."""
    if len(stamps) < 2 * _FEWEST + 1:
        return f"only {len(stamps)} joint states while it slows down"
    gaps = np.diff(stamps)
    usable = (stamps >= max(told, stamps[_FEWEST - 1])) & (stamps <= stamps[-_FEWEST])
    places = stamps[usable]
    if not len(places):
        return f"fewer than {_FEWEST} joint states before or after its brakes bit"
    freedom = len(stamps) - 4
    worst = 1.0 + DEVIATIONS**2 / freedom
    # At the states first, and then between those that are not much worse than the best.
    squares, _ = _fit_lines(stamps, speed, places)
    near = np.flatnonzero(squares <= 2.0 * worst * squares.min())
    first, last = max(0, near[0] - 1), min(len(places) - 1, near[-1] + 1)
    step = float(np.max(gaps)) / _STEPS_BETWEEN
    fine = np.arange(max(told, places[first] - gaps[0]), places[last] + step, step)
    places = np.linspace(fine[0], fine[-1], min(len(fine), _MOST_PLACES))
    squares, lines = _fit_lines(stamps, speed, places)
    best = int(np.argmin(squares))
    level, before, after = lines[best]
    if not -after > 0.0 or not before - after >= _LEAST_BREAK * -after:
        return "it slowed down already, so that its brakes cannot be told from its plan"
    variance = squares[best] / freedom
    possible = places[squares <= squares[best] * worst]
    # Nor is it known what happens between two states.
    step = float(np.max(np.diff(places), initial=step)) + 0.5 * float(np.median(gaps))
    time = stamps - places[best]
    basis = np.stack([np.ones_like(time), np.minimum(time, 0.0), np.maximum(time, 0.0)], 1)
    spread = np.sqrt(variance * np.diag(np.linalg.inv(basis.T @ basis)))
    slowing = (speed - basis @ lines[best])[time >= 0.0]
    return _Break(
        float(possible.min()) - step,
        float(possible.max()) + step,
        float(level - DEVIATIONS * spread[0]),
        float(-after),
        float(-after - DEVIATIONS * spread[2]),
        float(np.sqrt(np.mean(slowing**2))),
    )


def _fit_lines(
    stamps: FloatArray, speed: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fit two lines that meet at each of the places.

    Returns:
        The sums of squares that are left, shape (places,), and of each pair of lines the level
        where they meet and the slopes before and after, shape (places, 3).
    """
    time = stamps - places[:, None]
    basis = np.stack([np.ones_like(time), np.minimum(time, 0.0), np.maximum(time, 0.0)], axis=-1)
    lines = (np.linalg.pinv(basis) @ speed[:, None])[..., 0]
    left = speed - (basis @ lines[..., None])[..., 0]
    return np.sum(left * left, axis=1), lines
