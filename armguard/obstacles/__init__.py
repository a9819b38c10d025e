"""The table of obstacles: stores the plausible samples that sources report.

Each sample is tested against what older samples allow, and is accepted or refused with a fault.
"""

from armguard.obstacles.faults import Fault, FaultKind
from armguard.obstacles.frames import Frame
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.sources import Source

__all__ = [
    "Fault",
    "FaultKind",
    "Frame",
    "Obstacles",
    "Source",
]
