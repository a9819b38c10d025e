"""Measured bounds of the parts of a person's body, with the share of samples within them.

One bound for a whole person is either too small for hands or too large for the trunk. `BOUNDS` has
bounds of each part, with their percentile and source. `find_bounds` returns them by the id of an
obstacle, and `list_bounds` returns all of them for `Obstacles(bounds=…)`. In a cell file,
`[bounds.of]` names parts by patterns of ids.

A `Skeleton` makes obstacles from a person's joints, as body-tracking kits measure them.

`measure_motion` and `check_bounds` compare further recordings with these bounds. This is necessary
wherever other people work. docs/people.md describes the method and the results.
"""

from typing import TYPE_CHECKING

from armguard.lazy import lazy_names
from armguard.people.body_parts import BOUNDS, PATTERNS, PartBounds, find_bounds, list_bounds

if TYPE_CHECKING:
    from armguard.lab.people import BoundReport, Motion, check_bounds, measure_motion
    from armguard.people.skeleton import UPPER_BODY, Skeleton, Tethered
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "BoundReport": "armguard.lab.people",
            "Motion": "armguard.lab.people",
            "Skeleton": "armguard.people.skeleton",
            "Tethered": "armguard.people.skeleton",
            "UPPER_BODY": "armguard.people.skeleton",
            "check_bounds": "armguard.lab.people",
            "measure_motion": "armguard.lab.people",
        },
    )

__all__ = [
    "BOUNDS",
    "PATTERNS",
    "UPPER_BODY",
    "BoundReport",
    "Motion",
    "PartBounds",
    "Skeleton",
    "Tethered",
    "check_bounds",
    "find_bounds",
    "list_bounds",
    "measure_motion",
]
