"""People as they are: what parts of a body can do, measured, with the share that keeps to it.

One bound for a whole person is either broken by hands or wasted on the trunk. `BOUNDS` has one for
each part, with its percentile and its source; `find_bounds` finds it by the id of an obstacle, and
`list_bounds` gives all of them as `Obstacles(bounds=…)` takes them. In a cell file `[bounds.of]`
names parts by patterns of ids.

A `Skeleton` makes obstacles of a person's joints, as body-tracking kits find them.

`measure_motion` and `check_bounds` hold other recordings against them, which is needed wherever
other people work. docs/people.md says how, and what was found.
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
