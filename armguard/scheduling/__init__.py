"""What is evaluated in which tick, and until when each certificate holds.

`deadline` is the monitor's own schedule, over obstacles; schedules over pairs of link and obstacle
follow `Schedule`, and those of the paper stand in `paper`.
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
