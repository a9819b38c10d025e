"""Pairs of link and obstacle: contact times and distances with the data of one tick.

Also contains the filter of the arm's own points in clouds, and other arms as obstacles.
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
