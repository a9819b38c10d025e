"""Regions of a body by patterns of ids, for obstacles whose messages state none.

Few perception systems say which part of a body an obstacle is, but most name it: "left_hand".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np

from armguard.body_regions import NUMBERS, REGIONS
from armguard.exceptions import ObstacleError
from armguard.jit.arrays import IntArray
from armguard.obstacles.arguments import show

_REMEMBERED = 4096
"""Ids of which the regions are remembered; all are forgotten once there are more."""


class PatternRegions:
    """Sets of regions by id; region number k adds 2**k to a set.

    An id that several patterns fit has the regions of all of them, so that the strictest of their
    limits counts, whatever their order.

    Args:
        patterns: Region by pattern of ids as in `fnmatch`.

    Attributes:
        patterns: As given.

    Raises:
        ObstacleError: A pattern is no text, or a region is unknown.
    """

    def __init__(self, patterns: Mapping[str, str] | None = None) -> None:
        if not isinstance(patterns or {}, Mapping):
            raise ObstacleError(
                "regions", f"is {show(patterns)}", expected="a region by pattern of ids"
            )
        self.patterns = dict(patterns or {})
        for pattern, region in self.patterns.items():
            if not isinstance(pattern, str) or not pattern:
                raise ObstacleError("regions", f"has pattern {show(pattern)}", expected="a string")
            if not isinstance(region, str) or region not in NUMBERS:
                raise ObstacleError(
                    f"regions: pattern {pattern!r}",
                    f"names the region {show(region)}",
                    expected=f"one of {', '.join(REGIONS)}",
                )
        self._known: dict[str, int] = {}

    def find(self, ids: Sequence[str]) -> IntArray | None:
        """Sets of regions of these ids, 0 where no pattern fits; None where there are no patterns.

        Returns:
            Shape (n,).
        """
        if not self.patterns:
            return None
        return np.array([self._find_one(id) for id in ids], dtype=np.int64)

    def _find_one(self, id: str) -> int:
        found = self._known.get(id)
        if found is None:
            found = 0
            for pattern, region in self.patterns.items():
                if fnmatchcase(id, pattern):
                    found |= 1 << NUMBERS[region]
            if len(self._known) >= _REMEMBERED:
                self._known.clear()
            self._known[id] = found
        return found
