"""What came of a fault, judged by what was heard and by what truly happened."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.lab.faults.catalogue import SILENCE, Fault
from armguard.lab.faults.listening import Heard, Silence
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
    silence: float
    """Longest time without a verdict; of a fault that ends the monitor, that is no loss."""
    was_tried: bool = True
    """Whether the fault was made: not on a machine on which the cell did not get so far."""

    @property
    def problem(self) -> str:
        """What is not as it must be; empty: nothing."""
        if not self.was_tried:
            return "contact" if self.obeying.contacts else ""
        if self.fault.signs and self.detected is None:
            return "not detected"
        if self.obeying.contacts:
            return "contact"
        if self.recovered is None:
            return "not recovered"
        if not self.ignoring.contacts:
            return "the control was not hit"
        if not self.obeying.moving > 0.0:
            return "the arm never moved"
        return ""

    def describe(self) -> dict[str, Any]:
        """The row as plain data."""
        return {
            "fault": self.fault.name,
            "needs_sign": bool(self.fault.signs),
            "detected_ms": _to_milliseconds(self.detected),
            "verdict": self.level,
            "sign": self.sign,
            "recovered_ms": _to_milliseconds(self.recovered),
            "resets": self.resets,
            "other_latches": list(self.foreign),
            "contacts": self.obeying.contacts,
            "closest_mm": _to_millimetres(self.obeying.distance),
            "moving": round(self.obeying.moving, 3),
            "control_contacts": self.ignoring.contacts,
            "verdicts_missing": self.missing,
            "longest_silence_ms": _to_milliseconds(self.silence),
            "tried": self.was_tried,
            "problem": self.problem,
        }


def find_detection(
    fault: Fault,
    begin: float,
    end: float,
    heard: Sequence[Heard],
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


def measure_silence(silences: Sequence[Silence], begin: float, end: float) -> tuple[int, float]:
    """Verdicts not heard from `begin` to `end` [s], and the longest time without any, in [s]."""
    within = [one for one in silences if one.end >= begin and one.begin <= end]
    lengths = [
        min(one.end, end) - max(one.begin, begin) for one in within if math.isfinite(one.begin)
    ]
    missing = sum(one.missing for one in within if one.end <= end)
    return missing, max(lengths, default=0.0)


def _level_at(heard: Sequence[Heard], time: float) -> str:
    """The level of the verdict that was in force."""
    level = "none"
    for one in heard:
        if one.time > time:
            break
        level = one.level.name
    return level


def _to_milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(1e3 * seconds, 1)


def _to_millimetres(metres: float) -> float | None:
    return round(1e3 * metres, 1) if math.isfinite(metres) else None
