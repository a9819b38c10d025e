"""Records the inputs and answers of a monitor in a file, and replays the file.

A `Recorder` writes from a separate process. `replay` steps a new monitor through a recording and
checks that the verdicts are bit-identical. `verify` finds later changes of the file. All need the
extra `record`.
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
