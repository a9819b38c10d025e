"""Pairs of link and obstacle on the numbers of one tick: contact times and distances.

Beside them what of a camera's points is the arm, and another arm as obstacles of this one.
"""

from armguard.pairs.arm_obstacles import ArmObstacles
from armguard.pairs.cloud_filter import CloudFilter
from armguard.pairs.separation import compute_separation
from armguard.settings.separation_rule import SeparationRule

__all__ = [
    "ArmObstacles",
    "CloudFilter",
    "SeparationRule",
    "compute_separation",
]
