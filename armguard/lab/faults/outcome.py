"""What came of a fault, judged by what was heard and by what truly happened."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.lab.faults.catalogue import SILENCE, Fault
from armguard.lab.faults.listening import VerdictChange
from armguard.lab.faults.truth import Closest
from armguard.verdict import ReasonKind

Array = NDArray[np.float64]

SILENT = 2
"""Column of what the arm did: 1 where it obeyed silence."""


class Detection(NamedTuple):
    """The first sign of a fault."""

    time: float
    """In [s] of the machine's monotonic clock."""
    level: str
    """What the arm was told then: a verdict's level, or that nothing was."""
    words: str
    """The sign."""


class Outcome(NamedTuple):
    """One fault's row; times in [s]."""

    fault: Fault
    detected: float | None
    """From the fault's begin to its first sign; None: there was none."""
    level: str
    """What the arm was told then."""
    sign: str
    """Which sign it was, in the monitor's words."""
    recovered: float | None
    """From the fault's end until nothing is wrong by the verdicts; None: that did not come."""
    resets: int
    """Resets that it took."""
    foreign: tuple[str, ...]
    """What was latched before them and is no sign of the fault, in words: a consequence of it, or
    of something else, as of a machine that was busy."""
    obeying: Closest
    """Of the arm that obeys, from the fault's begin to the next fault's."""
    ignoring: Closest
    """Of the control, the same arm that obeys nothing, on its way in the same time."""
    missing: int
    """Verdicts that were made and not heard."""
    was_tried: bool = True
    """Whether the fault was made: not on a machine on which the cell did not get so far."""

    @property
    def problem(self) -> str:
        """What is not as it must be; empty: nothing."""
        if self.was_tried and self.fault.signs and self.detected is None:
            return "not detected"
        if self.obeying.contacts:
            return "contact"
        if not self.was_tried:
            return ""
        if self.recovered is None:
            return "not recovered"
        if not self.ignoring.contacts:
            return "the control was not hit"
        if not self.obeying.moving > 0.0:
            return "the arm never moved"
        return ""


def find_detection(
    fault: Fault,
    begin: float,
    end: float,
    heard: Sequence[VerdictChange],
    lines: Sequence[tuple[float, str]],
    truth: Array,
) -> Detection | None:
    """The first sign of a fault, in any of the ways in which it may show.

    Args:
        fault: The fault.
        begin: When it began, in [s].
        end: Until when its signs count, in [s].
        heard: Verdicts, where they changed.
        lines: What the monitor wrote, with times.
        truth: Rows of what the arm did.
    """
    found: list[Detection] = []
    kinds = {ReasonKind[sign] for sign in fault.signs if sign in ReasonKind.__members__}
    for one in heard:
        signs = [reason for reason in one.reasons if reason.kind in kinds]
        if begin <= one.time <= end and signs:
            found.append(Detection(one.time, one.level.name, str(signs[0])))
            break
    words = [sign for sign in fault.signs if sign not in ReasonKind.__members__]
    for time, line in lines:
        if begin <= time <= end and any(word in line for word in words):
            told = line.partition(" ")[2].partition(" ")[2]
            found.append(Detection(time, _level_at(heard, time), told))
            break
    if SILENCE in fault.signs:
        within = truth[(truth[:, 0] >= begin) & (truth[:, 0] <= end)]
        # Where it was silent before, as a late tick makes it, the next silence counts, if any.
        silent = np.flatnonzero(within[:, SILENT])
        falls_silent = np.flatnonzero(np.diff(within[:, SILENT]) > 0.0) + 1
        for row in [*falls_silent, *silent][:1]:
            found.append(Detection(float(within[row, 0]), "none", "no verdict: the arm brakes"))
    return min(found, default=None)


def _level_at(heard: Sequence[VerdictChange], time: float) -> str:
    """The level of the verdict that was in force."""
    return next((one.level.name for one in reversed(heard) if one.time <= time), "none")
