"""Parameters of the protective separation distance [Separation]_, as a monitor is given them."""

from __future__ import annotations

from typing import Literal

import msgspec

from armguard.settings.declarations import NotNegative, check_fields

HUMAN_SPEED = 1.6
"""How fast a person walks towards a robot where nothing else is known, in [m/s] [Approach]_."""


class SeparationRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The usual rule's distance, whose margin each verdict is to carry.

    What a table or a robot says of errors comes on top of these parameters.

    Raises:
        ArmguardError: A number is negative, infinite or none.
    """

    human_speed: NotNegative | Literal["own"] | None = HUMAN_SPEED
    """At which people walk, in [m/s]; `"own"`: the speed bound of each obstacle, as `None` in
    Python."""
    intrusion_distance: NotNegative = 0.0
    """How far a person reaches before they are seen, in [m]; not added for what stands still."""
    human_uncertainty: NotNegative = 0.0
    """Added to the errors of the positions of obstacles, in [m]."""
    robot_uncertainty: NotNegative = 0.0
    """Added to those of the arm, in [m]."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.human_speed == "own":
            msgspec.structs.force_setattr(self, "human_speed", None)
