"""Scheduling: which pairs each tick evaluates, and the expiry of certificates.

`deadline` is the monitor's own schedule, over obstacles. Schedules over pairs of link and obstacle
implement `Schedule`; those of the paper are in `paper`.
"""

from typing import TYPE_CHECKING

from armguard.lazy import lazy_names
from armguard.scheduling.schedule import SCHEDULES, make_schedule
from armguard.settings.schedule import DEADLINE, Schedule

if TYPE_CHECKING:
    from armguard.scheduling.paper.daa import DaaSchedule
    from armguard.scheduling.paper.full import FullSchedule
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "DaaSchedule": "armguard.scheduling.paper.daa",
            "FullSchedule": "armguard.scheduling.paper.full",
        },
    )

__all__ = [
    "DEADLINE",
    "SCHEDULES",
    "DaaSchedule",
    "FullSchedule",
    "Schedule",
    "make_schedule",
]
