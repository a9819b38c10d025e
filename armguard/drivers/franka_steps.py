"""Joint positions for a Franka Research 3: one each millisecond, smooth, within its limits.

The robot checks the differences of received positions, and ends a motion whose velocity,
acceleration or jerk is too great. So positions pass three first-order low-pass filters and are
checked before they are sent. Each step begins at the robot's reference, which after a lost packet
is the robot's substitute.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

PERIOD = 0.001
"""Between two positions, in [s]."""

SHARE = 0.1
"""Share of the distance to its input that each of the three filters moves in a period."""

ACCELERATION, JERK = 10.0, 5000.0
"""Limits of all joints, in [rad/s²] and [rad/s³]: `kMaxJointAcceleration` and `kMaxJointJerk` of
rate_limiting.h [Franka]_."""

_VELOCITIES = np.array(
    [
        # at most, offset, twice the deceleration, lower and upper position
        [2.62, 0.30, 12.0, -2.7501, 2.7501],
        [2.62, 0.20, 5.17, -1.7918, 1.7918],
        [2.62, 0.20, 7.0, -2.9065, 2.9065],
        [2.62, 0.30, 8.0, -3.0481, -0.1458],
        [5.26, 0.35, 34.0, -2.8101, 2.8101],
        [4.18, 0.35, 11.0, 0.54092, 4.5205],
        [5.26, 0.35, 34.0, -3.0196, 3.0196],
    ]
).T
"""Velocity limits by position, in [rad] and [rad/s]: `computeUpperLimitsJointVelocity` and
its counterpart, as above. Shape (5, 7)."""

EPSILON = 1e-3
"""By how much a step must be within each limit: `kLimitEps`, as above."""

_GAIN = SHARE**3 / PERIOD**3
_VELOCITY_GAIN = (3.0 * SHARE**2 - 2.0 * SHARE**3) / PERIOD**2
_ACCELERATION_GAIN = (3.0 * SHARE - 3.0 * SHARE**2 + SHARE**3) / PERIOD


class Step(NamedTuple):
    """The next position, and its differences. Shape (7,) each."""

    q: NDArray[np.float64]
    """In [rad]."""
    v: NDArray[np.float64]
    """In [rad/s]."""
    a: NDArray[np.float64]
    """In [rad/s²]."""
    jerk: NDArray[np.float64]
    """In [rad/s³]."""


def step_towards(target: ArrayLike, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Step:
    """The next position on the way to a target.

    The differences are those of the robot: jerk changes the acceleration, which changes the
    velocity, which changes the position, each with its new value. With these, the gains place all
    three poles at 1 − `SHARE`. So the response to a moving target is an average of its past
    positions with nonnegative weights. Joints are never faster than the target was, never
    accelerate more, and never overshoot.

    Args:
        target: Where to be, in [rad]. Shape (7,).
        q: Last position, in [rad]. Shape (7,).
        v: Its velocity, in [rad/s]. Shape (7,).
        a: Its acceleration, in [rad/s²]. Shape (7,).
    """
    to, last, speed, change = (np.asarray(values, float) for values in (target, q, v, a))
    jerk = _GAIN * (to - last) - _VELOCITY_GAIN * speed - _ACCELERATION_GAIN * change
    change = change + PERIOD * jerk
    speed = speed + PERIOD * change
    return Step(last + PERIOD * speed, speed, change, jerk)


def find_excess(step: Step, names: Sequence[str]) -> str:
    """Which limit of the robot a step exceeds, in words; empty if none.

    Args:
        step: The step to be sent.
        names: Of the joints.
    """
    most, offset, twice, lower, upper = _VELOCITIES
    fastest = np.clip(np.sqrt(np.maximum(twice * (upper - step.q), 0.0)) - offset, 0.0, most)
    slowest = -np.clip(np.sqrt(np.maximum(twice * (step.q - lower), 0.0)) - offset, 0.0, most)
    for word, unit, values, least, greatest in (
        ("position", "rad", step.q, lower, upper),
        ("velocity", "rad/s", step.v, slowest, fastest),
        ("acceleration", "rad/s²", step.a, np.full(7, -ACCELERATION), np.full(7, ACCELERATION)),
        ("jerk", "rad/s³", step.jerk, np.full(7, -JERK), np.full(7, JERK)),
    ):
        is_kept = (least + EPSILON <= values) & (values <= greatest - EPSILON)
        # A joint that rests may be where none may move.
        is_kept |= (word == "velocity") & (np.abs(values) <= EPSILON)
        if not is_kept.all():
            joint = int(np.argmin(is_kept))
            return (
                f"{names[joint]} would have a {word} of {values[joint]:.4g} {unit}, and the robot "
                f"accepts {least[joint]:.4g} to {greatest[joint]:.4g}"
            )
    return ""
