"""Finds the tethered partner whose state bounds an obstacle in addition to its own.

A tether proves nothing through a *partner* of which it is not clear where it is: one without an
accepted state, one of which a refused state may be true as well, or what stands still for ever.
Nor does one that contact limits permit the arm to touch: a part that the arm has pushed need not
keep to its bounds, and where it goes then the other one may follow. A
partner that is not seen any more grows with its age, as it does by itself; one that has broken its
bounds counts with the wider ones. Nothing is proved of an obstacle that could be anywhere: then its
radius is not known either.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.obstacles.regions import RegionLimits, strictest_limit
from armguard.obstacles.table import Marks, States
from armguard.obstacles.tethers import TIED, Tethers

LONGEST = 1.0
"""How far ahead partners are compared, in [s], at most."""

NO_PARTNER = -1
"""In place of a row, where no tether says more of an obstacle than its own states."""


class Partner(NamedTuple):
    """A partner, whose state bounds an obstacle in addition to its own."""

    row: int
    """That of the partner; NO_PARTNER where there is none."""
    radius: float
    """Around the hull of its centre points, in [m], within which all of the obstacle is."""
    length: float
    """Of the tether, in [m]."""


ALONE = Partner(NO_PARTNER, 0.0, 0.0)
"""That there is none."""


@kernel
def is_confirmed(marks: Marks, row: int) -> bool:
    """Whether an obstacle moves, and is where its accepted state says and nowhere else."""
    is_seen: bool = marks.alive[row] and marks.has_state[row]
    return is_seen and not (marks.refused[row] or marks.static[row])


@kernel
def _find_room(
    states: States, place: int, age: float, horizon: float, x: float, y: float, z: float
) -> float:
    """About how far from a point a body stays in the time to come, in [m]; its radius left out."""
    nearest, fastest = np.inf, 0.0
    for k in range(states.point_count[place]):
        square = (
            (states.points[place, k, 0] - x) ** 2
            + (states.points[place, k, 1] - y) ** 2
            + (states.points[place, k, 2] - z) ** 2
        )
        pace = (
            states.velocities[place, k, 0] ** 2
            + states.velocities[place, k, 1] ** 2
            + states.velocities[place, k, 2] ** 2
        )
        nearest, fastest = min(nearest, square), max(fastest, pace)
    duration = abs(age) + horizon
    pace = math.sqrt(fastest) + states.velocity_error[place]
    pace = min(states.speed[place], pace + 0.5 * states.accel[place] * duration)
    return math.sqrt(nearest) - states.position_error[place] - pace * duration


@kernel
def find_partner(
    tethers: Tethers,
    accepted: States,
    refused: States,
    marks: Marks,
    limits: RegionLimits,
    row: int,
    now: float,
    horizon: float,
    center: FloatArray,
) -> Partner:
    """The partner whose state says most of where an obstacle can be, if that is more than its own.

    Which one says most is estimated, by how near each may come to a place within a time. That
    decides about the price and how late contact times are; whichever is taken, they are safe.

    Args:
        tethers: Between the rows.
        accepted: Accepted states.
        refused: Refused ones.
        marks: What is known of each row.
        limits: What contact is permitted.
        row: Of the obstacle.
        now: Time of the tick on the obstacles' clock, in [s].
        horizon: How far ahead it matters, in [s].
        center: A place in the middle of what the obstacle must not touch, in [m]. Shape (3,).
    """
    if tethers.numbers[TIED] == 0 or tethers.row_count[row] == 0 or not is_known(marks, row):
        return ALONE
    horizon = min(horizon, LONGEST)
    x, y, z = center[0], center[1], center[2]
    best, radius = np.inf, 0.0
    for number in possible_states(marks, row):
        states, place, age = state_at(accepted, refused, marks, row, number, now)
        radius = max(radius, states.radius[place])
        best = min(best, _find_room(states, place, age, horizon, x, y, z) - states.radius[place])
    if math.isnan(best):
        best = -np.inf
    found, reach, length = NO_PARTNER, 0.0, 0.0
    for k in range(tethers.row_count[row]):
        number = tethers.of_row[row, k]
        partner = tethers.rows[number, 0] + tethers.rows[number, 1] - row
        if tethers.is_broken[number] or not is_confirmed(marks, partner):
            continue
        if strictest_limit(limits, marks.regions[partner]).max_speed > 0.0:
            continue
        grown = (tethers.length[number] + radius) * (1.0 + SUM_ROUNDING)
        age = now - accepted.stamp[partner]
        room = _find_room(accepted, partner, age, horizon, x, y, z) - grown
        if room > best:
            best, found, reach, length = room, partner, grown, tethers.length[number]
    return Partner(found, reach, length)
