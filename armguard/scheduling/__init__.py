"""What is evaluated in which tick, and until when each certificate holds.

`deadline` is the monitor's own schedule, over obstacles; schedules over pairs of link and obstacle
follow `Schedule`, and those of the paper stand in `paper`.
"""

from armguard.scheduling.paper.daa import DaaSchedule
from armguard.scheduling.paper.full import DistanceSchedule, FullSchedule
from armguard.scheduling.schedule import SCHEDULES, make_schedule
from armguard.settings.schedule import DEADLINE, Measure, Schedule

__all__ = [
    "DEADLINE",
    "SCHEDULES",
    "DaaSchedule",
    "DistanceSchedule",
    "FullSchedule",
    "Measure",
    "Schedule",
    "make_schedule",
]
