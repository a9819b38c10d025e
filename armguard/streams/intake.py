"""What all handlers of messages work with: the table, where faults are counted, and times."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import MessageError
from armguard.obstacles.obstacles import Obstacles
from armguard.streams.faults import FaultLog
from armguard.streams.stamp_clocks import HELD_UP, StampTimes

_SUMMED_IN_PYTHON = 32
"""Most numbers whose sum Python finds in less time than NumPy takes to begin."""

_SUMMED_AT_ONCE = 10_000
"""Most numbers whose products BLAS sums up in the thread that asks. More it shares out among other
threads, and where further processes keep the processors busy, the loop would wait for those."""


@dataclasses.dataclass(frozen=True)
class Intake:
    """What all handlers of messages work with."""

    obstacles: Obstacles
    """The table."""
    faults: FaultLog
    """Where faults are counted."""
    times: StampTimes
    """Translates stamps."""

    def count_gaps(
        self, found: Sequence[tuple[str, int, str]], source: str, sequence: int | None
    ) -> None:
        """Count what the number of a message shows to be lost, or sent by a second sender.

        Args:
            found: As `SequenceWatch.follow` tells it.
            source: Who sent the message.
            sequence: Its number.
        """
        for kind, times, problem in found:
            self.faults.add(kind, source, sequence, problem, times)

    def tell_verdict(self, error: MessageError) -> None:
        """Let the verdict know of a refused message: what it would have told is not known."""
        problem = f"{error.value}; expected {error.expected}"
        now = self.times.drain_start
        self.obstacles.leave_malformed(error.source, error.field, problem, now)

    def count_hold_up(self, gap: float, source: str, sequence: int | None) -> str:
        """Count that clocks were compared too slowly for a joint state or a plan.

        These have no errors of their own that could be widened.

        Args:
            gap: What the stamp may be too old by, in [s]; more than `HELD_UP`.
            source: Whose stamp it is.
            sequence: Number of the message, where it has one.

        Returns:
            The problem in words.
        """
        problem = f"clocks were compared within {gap:.3g} s; expected {HELD_UP:.3g} s at most"
        self.faults.add("clocks held up", source, sequence, problem)
        return problem

    def check_finite(self, source: str, sequence: int | None, named: Mapping[str, object]) -> bool:
        """Count values that are not finite; refusing them is the business of table and monitor.

        Args:
            source: Who sent them.
            sequence: Number of the message, where it has one.
            named: The values, by the names of their fields; None is no value.

        Returns:
            Whether all are finite, bounds apart, which may be infinite.
        """
        usable = True
        for field, values in named.items():
            if values is None or (type(values) is float and math.isfinite(values)):
                continue
            array = np.asarray(values, float)
            if is_finite(array):
                continue
            # Bounds may be infinite: that says that there is none.
            good = ~np.isnan(array) if field in ("accel", "speed") else np.isfinite(array)
            if good.all():
                continue
            place = np.unravel_index(int(np.argmin(good)), good.shape)
            index = f"[{', '.join(str(int(i)) for i in place)}]" if place else ""
            problem = f"{field}{index} is {array[place]}; expected a finite number"
            self.faults.add("not finite", source, sequence, problem)
            usable = False
        return usable


def is_finite(array: NDArray[np.float64]) -> bool:
    """Whether numbers are surely finite; False where that takes a closer look.

    Their sum, and that of their squares, is finite only if all are, and found in less than half the
    time.
    """
    if array.size <= _SUMMED_IN_PYTHON:
        flat = array if array.ndim == 1 else array.ravel()
        return math.isfinite(sum(flat.tolist()))
    return array.size <= _SUMMED_AT_ONCE and math.isfinite(np.vdot(array, array))
