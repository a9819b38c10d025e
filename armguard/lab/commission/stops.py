"""Measures a STOP: when a joint began to slow down, and its stopping time and distance.

A joint's speed is modeled by two straight lines, before and during braking. The brakes engage where
the lines meet. All break times whose sum of squares is close to the least are possible. The latest
of them counts for the response and the earliest for the stop, so both are never too short.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.lab.commission.noise import estimate_noise
from armguard.lab.commission.observations import Observations, StopCommand

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

_AVERAGED = 5
"""Positions whose mean tells where a joint is while it creeps to rest."""

_SHIFTED = 1.25
"""Times what a creep to rest takes from where positions no longer show it."""

_LONGER = 1.2
"""Times the length of a stop at the fitted deceleration: what takes longer was not steady."""

_UNEVEN = 2.0
"""Times the noise that samples of a steady deceleration may be off its line by."""


class JointStop(NamedTuple):
    """Response of one joint to one STOP."""

    joint: str
    told: float
    """Time of the verdict, in [s] of the monitor's clock."""
    speed: float
    """Speed when the brakes engaged, at least, in [rad/s] or [m/s]."""
    response: float
    """From the verdict to the bite, at most, in [s]."""
    stopping_time: float
    """Time from braking to rest, at most, in [s]."""
    stopping_distance: float
    """Distance during that time, at most, in [rad] or [m]."""
    deceleration: float
    """Deceleration at each instant, at least, in [rad/s²] or [m/s²]; NaN if it was not constant."""


class UnmeasuredStop(NamedTuple):
    """A STOP to which the response of a joint is unknown."""

    joint: str
    command: StopCommand
    why: str
    response: float = float("nan")
    """From the verdict to the bite, at most, in [s]; NaN where it is not known, and infinite where
    the joint was still fast when the STOP ended."""

    def __str__(self) -> str:
        return f"{self.joint}, STOP at {self.command.told:.3f} s: {self.why}"


def measure_stops(seen: Observations) -> tuple[list[JointStop], list[UnmeasuredStop]]:
    """All stops of all joints that moved, and those of them that could not be measured."""
    found: list[JointStop] = []
    unmeasured: list[UnmeasuredStop] = []
    for command in seen.stops:
        for joint in range(len(seen.robot.joints)):
            measured = measure_stop(seen, command, joint)
            if isinstance(measured, JointStop):
                found.append(measured)
            elif measured is not None:
                unmeasured.append(measured)
    return found, unmeasured


def find_response(
    stops: list[JointStop], unmeasured: list[UnmeasuredStop]
) -> tuple[float, list[UnmeasuredStop]]:
    """The longest response, and the STOPs for which it may have been longer.

    A joint that was still fast at the end of a STOP may have ignored it, unless the STOP was over
    before the arm had to obey. A joint whose response is not known otherwise tells nothing as long
    as another one tells of the same STOP; if none does, the arm may have ignored it.
    """
    told = {stop.told for stop in stops}
    responses = [stop.response for stop in stops]
    for one in unmeasured:
        if np.isfinite(one.response):
            told.add(one.command.told)
            responses.append(one.response)
    longest = max(responses, default=float("nan"))
    open_ones = []
    for one in unmeasured:
        length = one.command.ended - one.command.told
        was_over = np.isinf(one.response) and length <= longest
        is_told = not np.isinf(one.response) and one.command.told in told
        if not (was_over or is_told):
            open_ones.append(one)
    return longest, open_ones


def measure_stop(
    seen: Observations, command: StopCommand, joint: int
) -> JointStop | UnmeasuredStop | None:
    """Response of one joint to one STOP, or why it is unknown; None: the joint hardly moved."""
    name = seen.robot.joints[joint]
    inside = (seen.stamps >= command.told - LEAD_IN) & (seen.stamps <= command.ended)
    stamps, q, v = seen.stamps[inside], seen.q[inside, joint], seen.v[inside, joint]
    before = np.flatnonzero(stamps <= command.told)
    if not len(before):
        return UnmeasuredStop(name, command, "no joint state before it")
    start = float(np.mean(v[before[-5:]]))
    if not abs(start) >= SLOWEST * float(seen.robot.velocity_limit[joint]):
        return None
    speed = np.sign(start) * v
    noise = estimate_noise(seen.v[:, joint])
    slow = np.flatnonzero((speed <= _TAIL * abs(start)) & (stamps > command.told))
    if not len(slow):
        return UnmeasuredStop(name, command, "the STOP ends before the joint is slow", float("inf"))
    fit = _fit_break(stamps[: slow[0] + 1], speed[: slow[0] + 1], command.told)
    if isinstance(fit, str):
        return UnmeasuredStop(name, command, fit)
    position = np.sign(start) * q
    bite = np.interp(fit.earliest, stamps, position)
    # What an encoder's steps do shows only while it moves.
    position_noise = estimate_noise(seen.q[:, joint], seen.find_moving(joint, SLOWEST))
    # Below this a sample does not tell whether the joint moves.
    least = max(4.0 * noise, 0.01 * abs(start))
    if not 2.0 * least < np.minimum(speed[1:], speed[:-1]).max():
        return UnmeasuredStop(
            name, command, "noise of its velocity hides when the joint is at rest"
        )
    rest = max(
        _find_rest_by_speed(stamps, speed, least, fit.deceleration),
        _find_rest_by_position(stamps, position, DEVIATIONS * position_noise),
    )
    # The means end before the last state.
    if not rest <= stamps[-_AVERAGED]:
        response = fit.latest - command.told
        return UnmeasuredStop(name, command, "the STOP ends before the joint is at rest", response)
    distance = float(position[stamps >= fit.earliest].max() - bite)
    distance += 2.0 * DEVIATIONS * position_noise
    time = rest - fit.earliest
    deceleration = min(
        fit.least_deceleration, fit.speed / time, 0.5 * fit.speed * fit.speed / distance
    )
    is_steady = fit.residual <= max(_UNEVEN * noise, _STRAIGHT * fit.speed)
    # A joint that creeps to rest decelerates less there than on the whole.
    is_steady &= time * fit.least_deceleration <= _LONGER * abs(start)
    return JointStop(
        name,
        command.told,
        fit.speed,
        fit.latest - command.told,
        time,
        distance,
        deceleration if is_steady else float("nan"),
    )


def _find_rest_by_speed(
    stamps: FloatArray, speed: FloatArray, least: float, deceleration: float
) -> float:
    """When a joint rests, as told by its speed; infinite if it moves to the end.

    From the least speed that can be told it takes as long again as it took to halve its speed to
    that: brakes may let it creep there. It is not taken to slow down faster than it did before.
    """
    rates = np.abs(speed)
    # One sample by itself may be far off.
    moving = np.minimum(rates[1:], rates[:-1])
    ended = int(np.flatnonzero(moving > least)[-1]) + 2
    if ended >= len(stamps):
        return float("inf")
    halved = int(np.flatnonzero(moving > 2.0 * least)[-1]) + 2
    left = max(stamps[ended] - stamps[halved], least / deceleration)
    return float(stamps[ended] + left)


def _find_rest_by_position(stamps: FloatArray, position: FloatArray, least: float) -> float:
    """When a joint rests, as told by its position, which shows what noise of its speed hides.

    From the least distance that can be told it takes as long again as it took to come there from
    four times that, if it slows down steadily; a quarter of that is added, since noise shifts both.
    Means of a few positions keep single ones that are far off from counting as motion.
    """
    means = np.convolve(position, np.full(_AVERAGED, 1.0 / _AVERAGED), "valid")
    off = np.abs(means - means[-1])
    times = stamps[_AVERAGED // 2 :]
    far, near = (np.flatnonzero(off > bound) for bound in (4.0 * least, least))
    if not len(near):
        return float(times[0])
    ended = times[near[-1] + 1]
    left = ended - times[far[-1] + 1] if len(far) else ended - times[0]
    return float(ended + _SHIFTED * left)


class _Break(NamedTuple):
    """Two lines that meet where the brakes engaged."""

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
        return f"only {len(stamps)} joint states during its deceleration"
    gaps = np.diff(stamps)
    usable = (stamps >= max(told, stamps[_FEWEST - 1])) & (stamps <= stamps[-_FEWEST])
    places = stamps[usable]
    if not len(places):
        return f"fewer than {_FEWEST} joint states before or after its brakes engaged"
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
        return "it already decelerated, so its brakes cannot be distinguished from its plan"
    variance = squares[best] / freedom
    possible = places[squares <= squares[best] * worst]
    # Nor is it known what happens between two states.
    step = float(np.max(np.diff(places), initial=step)) + 0.5 * float(np.median(gaps))
    time = stamps - places[best]
    basis = _make_basis(time)
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


def _make_basis(time: FloatArray) -> FloatArray:
    """Level and slopes of which two lines that meet at time 0 are made. Shape (..., n, 3)."""
    return np.stack([np.ones_like(time), np.minimum(time, 0.0), np.maximum(time, 0.0)], axis=-1)


def _fit_lines(
    stamps: FloatArray, speed: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fit two lines that meet at each of the places.

    Returns:
        The sums of squares that are left, shape (places,), and of each pair of lines the level
        where they meet and the slopes before and after, shape (places, 3).
    """
    time = stamps - places[:, None]
    basis = _make_basis(time)
    lines = (np.linalg.pinv(basis) @ speed[:, None])[..., 0]
    left = speed - (basis @ lines[..., None])[..., 0]
    return np.sum(left * left, axis=1), lines
