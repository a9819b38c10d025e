"""Random configurations of an arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.robot import Robot, efforts


def draw_configuration(robot: Robot, random: np.random.Generator) -> NDArray[np.float64]:
    """Joint positions spread evenly over their ranges, a turn where there is none. Shape (nv,)."""
    return efforts.draw_configuration(robot.model, random)
