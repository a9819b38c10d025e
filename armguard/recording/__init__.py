"""What a monitor was told and what it answered, in a file, and the same again from it.

A `Recorder` writes from a process of its own; `replay` steps a monitor made anew through a
recording, and compares its verdicts to the bit; `verify` finds what was changed in the file since.
All need the extra `record`.
"""

from armguard.recording.parts import Rotation
from armguard.recording.reading import Recording
from armguard.recording.recorder import Recorder
from armguard.recording.replay import Difference, Replay, ReplayedTick, ReplayReport, replay
from armguard.recording.verification import Verification, verify

__all__ = [
    "Difference",
    "Recorder",
    "Recording",
    "Replay",
    "ReplayReport",
    "ReplayedTick",
    "Rotation",
    "Verification",
    "replay",
    "verify",
]
