"""Numbers that a monitor is given, read so that nothing else passes for one."""

from __future__ import annotations

import math

import numpy as np

from armguard.exceptions import ArmguardError


def read_number(value: object) -> float:
    """The number that `value` is; NaN for whatever is not one."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def check_not_negative(**values: float) -> None:
    """Check durations and lengths, by name.

    Raises:
        ArmguardError: One of them is negative, infinite or no number.
    """
    for name, value in values.items():
        if not 0.0 <= read_number(value) < math.inf:
            raise ArmguardError(name, f"is {value!r}", expected="a finite number, at least 0")


def read_budget(budget: object, *, by_deadline: bool) -> int | None:
    """Evaluations that a tick may spend; None: as many as it takes.

    Raises:
        ArmguardError: It is no whole number above 0, or the schedule knows no budget.
    """
    if budget is None:
        return None
    if isinstance(budget, bool) or not isinstance(budget, (int, np.integer)) or not budget > 0:
        raise ArmguardError("budget", f"is {budget!r}", expected="a whole number above 0, or None")
    if not by_deadline:
        raise ArmguardError(
            "budget", "is given", expected='schedule="deadline", which alone keeps to one'
        )
    return int(budget)
