"""Positions of continuous joints, wrapped: positions whole turns apart are the same.

Drivers and planners count turns or wrap at ±pi, as they like. A joint whose position has no limits
is where it is at q + 2 pi k for every whole k: forward kinematics, Jacobians and bounds on motion
depend on its sine and cosine alone. So a position may be replaced by the one of these that lies
nearest to another, and neither where the arm is nor what it could do changes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armguard.jit.kernels import kernel

TURN = 2.0 * math.pi
"""One turn, in [rad]; less than 3e-16 rad off."""

MOST_TURNS = 2.0**24
"""Beyond this a position stays as it is. Up to here all rounding of it stays below 1e-7 rad."""


@kernel
def nearest_turn(position: float, reference: float) -> float:
    """The position, whole turns aside, that lies nearest to another one; both in [rad].

    A position that is no such number of turns away, or no number, comes back as it is.
    """
    turns = np.floor((reference - position) / TURN + 0.5)
    if turns == 0.0 or not abs(turns) <= MOST_TURNS:
        return position
    return position + turns * TURN


def align_turns(
    positions: NDArray[np.float64],
    references: NDArray[np.float64],
    continuous: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Positions, those of continuous joints whole turns nearest to references; all (nv,)."""
    aligned = positions.copy()
    for joint in np.flatnonzero(continuous):
        aligned[joint] = nearest_turn(positions[joint], references[joint])
    return aligned


def unwrap(
    times: NDArray[np.float64], positions: NDArray[np.float64], fastest: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Positions at rising times, those of continuous joints whole turns nearest to each other.

    From time to time only where a joint is too slow for half a turn in between: then no other
    number of turns is a motion of it, and nothing is guessed. A longer step stays as it is.

    Args:
        times: In [s]. Shape (k,).
        positions: In [rad] or [m]. Shape (k, nv).
        fastest: Greatest speeds of continuous joints, in [rad]/[s]; inf for all others, which stay
            as they are. Shape (nv,).
    """
    unwrapped = positions.copy()
    for j in np.flatnonzero(np.isfinite(fastest)):
        with np.errstate(over="ignore", invalid="ignore"):
            turns = -np.floor(np.diff(positions[:, j]) / TURN + 0.5)
        is_sure = (fastest[j] * np.diff(times) < 0.5 * TURN) & (np.abs(turns) <= MOST_TURNS)
        unwrapped[1:, j] += TURN * np.cumsum(np.where(is_sure, turns, 0.0))
    return unwrapped


def find_continuous(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which joints are continuous, by their position limits, inf where there are none. (nv,)."""
    return np.isinf(lower) & np.isinf(upper)
