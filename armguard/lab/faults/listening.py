"""Receives a monitor's output: its verdicts, and its lines on standard error.

All times are those of hearing, on the machine's monotonic clock, in [s]: what an arm would hear,
and when. Verdicts are kept where they change.
"""

from __future__ import annotations

import threading
import time
from typing import IO, NamedTuple

import zmq

from armguard.messages.answers import decode_answer
from armguard.messages.incoming import MessageError
from armguard.verdict import Level, Reason, ReasonKind, Verdict

POLL_INTERVAL = 50
"""Between two looks whether listening is over, in [ms]."""

USUAL = frozenset(
    {
        ReasonKind.CONTACT,
        ReasonKind.CONTACT_ALLOWED,
        ReasonKind.CONTACT_FORBIDDEN,
        ReasonKind.HOLD,
        ReasonKind.CROWD,
        ReasonKind.BUDGET_SPENT,
        ReasonKind.LATE_DATA,  # of a busy machine
        ReasonKind.LATE_DATA_UNKNOWN,
    }
)
"""What verdicts rest on where nothing is wrong."""


class VerdictChange(NamedTuple):
    """A verdict that says something else than the one before it."""

    time: float
    level: Level
    reasons: tuple[Reason, ...]
    """Without the usual ones, the weightiest first."""

    @property
    def kinds(self) -> frozenset[ReasonKind]:
        """Kinds of these reasons."""
        return frozenset(reason.kind for reason in self.reasons)


class VerdictLog:
    """Hears all verdicts in a thread of its own; a context.

    Args:
        address: Of the monitor's verdicts.
    """

    def __init__(self, address: str) -> None:
        self.heard: list[VerdictChange] = []
        self.missing: list[tuple[float, int]] = []
        """Gaps in the numbers of verdicts: when each was noticed, in [s], and how many are missing.
        """
        self.last_time = -float("inf")
        """When a verdict was heard last."""
        self._address = address
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="verdicts", daemon=True)
        self._sequence = 0

    def __enter__(self) -> VerdictLog:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def is_sound(self, now: float, patience: float) -> bool:
        """Whether verdicts are heard at `now` [s], and nothing is wrong by their word.

        Args:
            now: The present.
            patience: Silence that is no fault, in [s].
        """
        return bool(self.heard) and now - self.last_time < patience and not self.heard[-1].reasons

    def _listen(self) -> None:
        context = zmq.Context()
        try:
            reader = context.socket(zmq.SUB)
            reader.set(zmq.RCVHWM, 0)
            reader.set(zmq.RECONNECT_IVL, 20)
            reader.set(zmq.RECONNECT_IVL_MAX, 200)
            reader.subscribe(b"")
            reader.connect(self._address)
            while not self._ending.is_set():
                if reader.poll(POLL_INTERVAL):
                    try:
                        verdict = decode_answer(reader.recv())
                    except MessageError:
                        continue
                    if isinstance(verdict, Verdict):
                        self._take(time.monotonic(), verdict)
        finally:
            context.destroy(linger=0)

    def _take(self, now: float, verdict: Verdict) -> None:
        missing = verdict.sequence - self._sequence - 1
        if self._sequence and missing > 0:
            self.missing.append((now, missing))
        # A monitor that was started anew counts anew.
        self._sequence = verdict.sequence
        self.last_time = now
        reasons = tuple(reason for reason in verdict.reasons if reason.kind not in USUAL)
        fresh = VerdictChange(now, verdict.level, reasons)
        before = self.heard[-1] if self.heard else None
        if before is None or (fresh.level, fresh.kinds) != (before.level, before.kinds):
            self.heard.append(fresh)


class LineLog:
    """Keeps the lines of a process, with the times at which they came.

    Args:
        stream: Of the process; read by a thread until its end.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self.lines: list[tuple[float, str]] = []
        self._stream = stream
        self._thread = threading.Thread(target=self._read, name="lines", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Read what is left of a process that has ended."""
        self._thread.join()
        self._stream.close()

    def _read(self) -> None:
        for line in self._stream:
            self.lines.append((time.monotonic(), line.decode(errors="replace").rstrip()))
