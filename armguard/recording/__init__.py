"""What a monitor was told and what it answered, in a file, and the same again from it.

A `Recorder` writes from a process of its own; `replay` steps a monitor made anew through a
recording, and compares its verdicts to the bit. Both need the extra `record`.
"""

from typing import Any

from armguard.recording.reading import Recording
from armguard.recording.recorder import Recorder
from armguard.recording.replay import Difference, Replay, ReplayedTick, ReplayReport, replay

__all__ = [
    "BagRun",
    "Difference",
    "Recorder",
    "Recording",
    "Replay",
    "ReplayReport",
    "ReplayedTick",
    "replay",
]


def __getattr__(name: str) -> Any:
    """`BagRun` alone needs the bridges: it is loaded when it is asked for."""
    if name == "BagRun":
        from armguard.recording.bags import BagRun

        return BagRun
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
