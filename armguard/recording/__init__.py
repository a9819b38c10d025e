"""What an arm's monitor was told and what it answered, on a file, and the same again from it.

A `Recorder` writes from a process of its own; `replay` steps a monitor made anew through a
recording, and compares its verdicts to the bit. Needs the extra `record`.
"""

from armguard.recording.recorder import Recorder

__all__ = [
    "Recorder",
]
