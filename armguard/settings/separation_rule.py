"""Parameters of the protective separation distance [Separation]_, as a monitor is given them."""

from __future__ import annotations

from typing import NamedTuple

HUMAN_SPEED = 1.6
"""How fast a person walks towards a robot where nothing else is known, in [m/s] [Approach]_."""


class SeparationRule(NamedTuple):
    """Parameters of the rule. What a table or a robot says of errors comes on top of them."""

    human_speed: float | None = HUMAN_SPEED
    """Speed of every obstacle that is not static, v_h, in [m/s]; None: its own speed bound."""
    intrusion_distance: float = 0.0
    """How far a person reaches before they are seen, C, in [m]; not added for what stands still."""
    human_uncertainty: float = 0.0
    """Added to the obstacle's position error, Zd, in [m]."""
    robot_uncertainty: float = 0.0
    """Added to the sphere's position error, Zr, in [m]."""
