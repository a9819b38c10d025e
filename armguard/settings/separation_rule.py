"""Parameters of the protective separation distance [Separation]_, as a monitor is given them."""

from __future__ import annotations

from typing import Literal

import msgspec

from armguard.settings.declarations import NotNegative, check_fields

HUMAN_SPEED = 1.6
"""How fast a person walks towards a robot where nothing else is known, in [m/s] [Approach]_."""


class SeparationRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the [separation distance](separation.md), whose margin verdicts then carry.

    Raises:
        ArmguardError: A number is negative, infinite or none.
    """

    human_speed: NotNegative | Literal["own"] | None = HUMAN_SPEED
    """Walking speed, in [m/s]; `"own"` (Python: `None`): each obstacle's speed bound."""
    intrusion_distance: NotNegative = 0.0
    """Reach before detection, in [m]."""
    human_uncertainty: NotNegative = 0.0
    """Added to obstacles' position errors, in [m]."""
    robot_uncertainty: NotNegative = 0.0
    """Added to the arm's, in [m]."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.human_speed == "own":
            msgspec.structs.force_setattr(self, "human_speed", None)
