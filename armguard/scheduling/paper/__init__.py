"""The schedules of [Awareness]_, on pair numbers alone.

They see neither arms nor obstacles, so that the world of the paper runs on the same code.
"""

from armguard.scheduling.paper.daa import DaaSchedule
from armguard.scheduling.paper.full import DistanceSchedule, FullSchedule

__all__ = [
    "DaaSchedule",
    "DistanceSchedule",
    "FullSchedule",
]
