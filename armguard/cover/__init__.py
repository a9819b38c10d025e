"""Trees of spheres for the arm's links, proved to contain their surfaces.

Contains fitting, the proof, reports, inflation of imported spheres, and other tools' files.
"""

from typing import TYPE_CHECKING

from armguard.cover.cover import Cover
from armguard.lazy import lazy_names

if TYPE_CHECKING:
    from armguard.cover.report import CoverReport, LinkReport
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "CoverReport": "armguard.cover.report",
            "LinkReport": "armguard.cover.report",
        },
    )

__all__ = [
    "Cover",
    "CoverReport",
    "LinkReport",
]
