"""Trees of spheres for the arm's links, proved to contain their surfaces.

Fitting, the proof, reports, growing of spheres that are none yet, and other programs' files.
"""

from armguard.cover.cover import Cover
from armguard.cover.report import CoverReport, LinkReport

__all__ = [
    "Cover",
    "CoverReport",
    "LinkReport",
]
