"""Schedules of pairs by name; `armguard.settings.schedule` defines their interface."""

from __future__ import annotations

from typing import get_args

from armguard.exceptions import ArmguardError
from armguard.settings.schedule import DEADLINE, Schedule, ScheduleName

SCHEDULES: tuple[str, ...] = tuple(name for name in get_args(ScheduleName) if name != DEADLINE)
"""Names of schedules of pairs."""


def make_schedule(name: str | Schedule, period: float) -> Schedule:
    """Make a schedule by its name.

    Args:
        name: One of `SCHEDULES`, or a schedule of your own, which is returned as it is.
        period: Time between two ticks, in [s].
    """
    if not isinstance(name, str) and isinstance(name, Schedule):
        return name
    if name not in SCHEDULES:
        raise ArmguardError("schedule", f"is {name!r}", expected=", ".join((DEADLINE, *SCHEDULES)))
    # The monitor's own schedule needs none of them.
    from armguard.scheduling.paper.daa import DaaSchedule
    from armguard.scheduling.paper.full import FullSchedule

    return DaaSchedule(period) if name == "daa" else FullSchedule()
