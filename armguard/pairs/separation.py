"""The protective separation distance of speed and separation monitoring.

The rule in use today beside people, with the symbols of ISO/TS 15066 [Separation]_:

    Sp = Sh + Sr + Ss + C + Zd + Zr

how far the person gets until the robot rests, the robot gets until it brakes, and it gets while it
brakes; how far a person reaches past the sensor before it sees them; and what both positions may be
off by. armguard computes it to be compared with; it is no claim that anything conforms to a
standard.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.kernels import kernel
from armguard.settings.separation_rule import HUMAN_SPEED


def compute_separation(
    robot_speed: ArrayLike,
    reaction_time: ArrayLike,
    stopping_time: ArrayLike,
    *,
    human_speed: ArrayLike = HUMAN_SPEED,
    stopping_distance: ArrayLike | None = None,
    intrusion_distance: ArrayLike = 0.0,
    human_uncertainty: ArrayLike = 0.0,
    robot_uncertainty: ArrayLike = 0.0,
) -> Any:
    """Protective separation distance Sp: below it the robot must stop. All arguments broadcast.

    Args:
        robot_speed: Speed of the robot towards the person, v_r, in [m/s]; 0 where it recedes.
            Shape (...).
        reaction_time: Until braking begins, T_r, in [s]. Shape (...).
        stopping_time: From then until the robot rests, T_s, in [s]. Shape (...).
        human_speed: Speed of the person towards the robot, v_h, in [m/s]. Shape (...).
        stopping_distance: How far the robot gets while it brakes, Ss, in [m]; None: v_r T_s / 2,
            as with a constant deceleration. Shape (...).
        intrusion_distance: How far a person reaches before they are seen, C, in [m]. Shape (...).
        human_uncertainty: Of the person's position, Zd, in [m]. Shape (...).
        robot_uncertainty: Of the robot's position, Zr, in [m]. Shape (...).

    Returns:
        Distances in [m], inf where any argument is. Shape (...); a float if every argument is a
        single number.

    Raises:
        ArmguardError: An argument is negative, NaN or no number, or shapes do not fit.
    """
    speed = _amount("robot_speed", robot_speed)
    reaction = _amount("reaction_time", reaction_time)
    stopping = _amount("stopping_time", stopping_time)
    human = _amount("human_speed", human_speed)
    offsets = [
        _amount("intrusion_distance", intrusion_distance),
        _amount("human_uncertainty", human_uncertainty),
        _amount("robot_uncertainty", robot_uncertainty),
    ]
    if stopping_distance is not None:
        offsets.append(_amount("stopping_distance", stopping_distance))
    arrays = [speed, reaction, stopping, human, *offsets]
    try:
        np.broadcast_shapes(*(array.shape for array in arrays))
    except ValueError:
        shapes = ", ".join(str(array.shape) for array in arrays)
        raise ArmguardError(
            "arguments", f"do not broadcast: {shapes}", remedy="make their shapes agree"
        ) from None
    if stopping_distance is None:
        offsets.append(0.5 * _times(speed, stopping))
    distance = _times(human, reaction + stopping) + _times(speed, reaction) + sum(offsets)
    return distance if np.ndim(distance) else float(distance)


@kernel
def separation_of(
    robot_speed: float,
    reaction_time: float,
    stopping_time: float,
    human_speed: float,
    offsets: float,
) -> float:
    """Sp of one pair for compiled code; NaN where an argument is, and none of them is checked.

    The robot brakes at a constant rate; `offsets` is C + Zd + Zr. Arguments as for
    `compute_separation`.
    """
    human = distance_covered(human_speed, reaction_time + stopping_time)
    robot = distance_covered(robot_speed, reaction_time)
    braking = 0.5 * distance_covered(robot_speed, stopping_time)
    return human + robot + braking + offsets


@kernel
def distance_covered(speed: float, duration: float) -> float:
    """How far a speed leads in a time; nowhere if either is 0, even if the other is infinite."""
    if (speed == 0.0 and duration >= 0.0) or (duration == 0.0 and speed >= 0.0):
        return 0.0
    return speed * duration


def _times(speed: Any, duration: Any) -> Any:
    """Distance covered; none at speed 0, however long it takes."""
    with np.errstate(invalid="ignore"):
        distance = speed * duration
    return np.where((speed == 0.0) | (duration == 0.0), 0.0, distance)


def _amount(name: str, value: ArrayLike) -> Any:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArmguardError(name, f"is no number: {error}") from error
    if not (array >= 0.0).all():
        worst = array[~(array >= 0.0)].ravel()[0]
        raise ArmguardError(name, f"is {worst}", expected="0 or more")
    return array
