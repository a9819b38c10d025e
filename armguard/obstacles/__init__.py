"""Obstacles as their writers report them: a table that takes plausible samples.

Samples are read, tested against what older ones allow, and taken or refused with a fault.
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
