"""Messages from a driver's process to the process that watches it: signs of life, lines, counts.

The client library of a robot can hang or end its process, so another process watches. Each line of
the pipe is a word and its data. A full pipe loses lines; the driver never waits.
"""

from __future__ import annotations

import contextlib
import os

import msgspec

CONNECTING, DRIVING, LEAVING, TELL, COUNTS, MEASURED, WRONG = (
    "connecting",
    "driving",
    "leaving",
    "tell",
    "counts",
    "measured",
    "wrong",
)
"""Words of the lines: signs of life, a line for people, counts, what was measured, and why no other
try is of use."""


class Counts(msgspec.Struct):
    """Counts of a driver's process so far."""

    states: int = 0
    """Joint states published."""
    verdicts: int = 0
    """Number of new verdicts."""
    stops: int = 0
    """Number of times that the arm had to stop: for a STOP, or without a valid verdict."""
    silences: int = 0
    """Of these, without a valid verdict."""
    hard_stops: int = 0
    """Number of times that pausing did not bring the arm to rest, and the driver stopped it."""
    commands: int = 0
    """Commands of a shield."""
    missed: int = 0
    """Number of these whose motion came too late, or did not join the one before."""
    longest_gap: float = 0.0
    """Between two joint states, in [s]."""
    obeyed_p99: float | None = None
    """Delay from the tick of a STOP to the order to the robot, in [s], 99th percentile; None: none
    was measured, as behind a shield."""
    obeyed_max: float | None = None
    """The slowest of these, in [s]."""


class Link:
    """The driver's end of the pipe.

    Args:
        descriptor: Of the pipe.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        os.set_blocking(descriptor, False)

    def send(self, word: str, text: str = "") -> None:
        """Send a line, if there is room for it."""
        line = f"{word} {' '.join(text.split())}\n".encode()
        # Longer ones could be cut in two by a full pipe.
        with contextlib.suppress(OSError):
            os.write(self._descriptor, line[:4000].rstrip(b"\n") + b"\n")

    def tell(self, text: str) -> None:
        """Send a line for people."""
        self.send(TELL, text)

    def count(self, counts: Counts) -> None:
        """Send the counts so far."""
        self.send(COUNTS, msgspec.json.encode(counts).decode())
