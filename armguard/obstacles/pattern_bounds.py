"""Bounds by patterns of ids, for obstacles whose messages give none.

A hand, a head and a thrown ball need different bounds, and few perception systems send bounds. The
integrator of a cell states them once, by id.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ObstacleError
from armguard.obstacles.arguments import read_bound, show
from armguard.obstacles.broken_bounds import MAXIMUM_ACCEL, MAXIMUM_SPEED

_REMEMBERED = 4096
"""Ids of which the bounds are remembered; all are forgotten once there are more."""


class PatternBounds:
    """Bounds of obstacles whose messages give none.

    Args:
        accel: Bound on acceleration of ids that no pattern fits, in [m]/[s]².
        speed: Bound on their speed, in [m]/[s].
        patterns: Pattern of ids as in `fnmatch`, acceleration and speed. The first that fits
            counts.

    Attributes:
        others: Acceleration and speed of ids that no pattern fits, in [m]/[s]² and [m]/[s].

    Raises:
        ObstacleError: A bound or a pattern is malformed; the message names it.
    """

    def __init__(
        self, accel: object, speed: object, patterns: Iterable[tuple[str, float, float]] = ()
    ) -> None:
        self.others = _read_pair("", accel, speed)
        try:
            entries = [(pattern, accel, speed) for pattern, accel, speed in patterns]
        except (TypeError, ValueError):
            raise ObstacleError(
                "bounds", f"is {show(patterns)}", expected="a list of (pattern, accel, speed)"
            ) from None
        for pattern, *_ in entries:
            if not isinstance(pattern, str) or not pattern:
                raise ObstacleError("bounds", f"has pattern {show(pattern)}", expected="a string")
        self._patterns = [
            (pattern, _read_pair(f"bounds: pattern {pattern!r}: ", accel, speed))
            for pattern, accel, speed in entries
        ]
        self._known: dict[str, tuple[float, float]] = {}

    @property
    def patterns(self) -> tuple[tuple[str, float, float], ...]:
        """Patterns of ids, each with its acceleration and speed, in [m]/[s]² and [m]/[s]."""
        return tuple((pattern, *pair) for pattern, pair in self._patterns)

    def find(
        self, ids: Sequence[str], accel: float | None = None, speed: float | None = None
    ) -> tuple[ArrayLike, ArrayLike]:
        """Accelerations and speeds of these ids.

        Args:
            ids: Of obstacles. Length n.
            accel: Of those that no pattern fits, in [m]/[s]²; None: as made.
            speed: Speed of these ids, in [m]/[s].

        Returns:
            In [m]/[s]² and in [m]/[s]: one number each where there are no patterns, else arrays.
            Shapes () or (n,).
        """
        others = (
            self.others[0] if accel is None else accel,
            self.others[1] if speed is None else speed,
        )
        if not self._patterns:
            return others
        pairs: NDArray[np.float64] = np.array(
            [self._find_one(id) for id in ids], dtype=np.float64
        ).reshape(-1, 2)
        unnamed = np.isnan(pairs[:, 0])
        pairs[unnamed] = others
        return pairs[:, 0].copy(), pairs[:, 1].copy()

    def _find_one(self, id: str) -> tuple[float, float]:
        """Bounds of one id; NaN where no pattern fits."""
        found = self._known.get(id)
        if found is None:
            fits = (pair for pattern, pair in self._patterns if fnmatchcase(id, pattern))
            found = next(fits, (math.nan, math.nan))
            if len(self._known) >= _REMEMBERED:
                self._known.clear()
            self._known[id] = found
        return found


def _read_pair(where: str, accel: object, speed: object) -> tuple[float, float]:
    return (
        read_bound(f"{where}accel", accel, MAXIMUM_ACCEL, "m/s²"),
        read_bound(f"{where}speed", speed, MAXIMUM_SPEED, "m/s"),
    )
