"""Pairs of link and obstacle on the numbers of one tick: contact times and distances.

Beside them what of a camera's points is the arm, and another arm as obstacles of this one.
"""

from typing import TYPE_CHECKING

from armguard.lazy import lazy_names
from armguard.settings.separation_rule import SeparationRule

if TYPE_CHECKING:
    from armguard.pairs.arm_obstacles import ArmObstacles
    from armguard.pairs.cloud_filter import CloudFilter
    from armguard.pairs.separation import compute_separation
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "ArmObstacles": "armguard.pairs.arm_obstacles",
            "CloudFilter": "armguard.pairs.cloud_filter",
            "compute_separation": "armguard.pairs.separation",
        },
    )

__all__ = [
    "ArmObstacles",
    "CloudFilter",
    "SeparationRule",
    "compute_separation",
]
