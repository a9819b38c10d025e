"""Possible places of one state of the obstacle: a free body or a hull, within its bounds."""

from __future__ import annotations

from typing import Any

from armguard_check.intervals import (
    ONE,
    ZERO,
    Interval,
    Vector,
    add,
    dot,
    least,
    length,
    read,
    read_bound,
    read_size,
    read_vectors,
    require,
    scale,
)


class Body:
    """One state of the obstacle.

    Attributes:
        size: Greatest distance of its surface from the hull of its measured points.
    """

    def __init__(self, state: dict[str, Any], now: Interval) -> None:
        points, velocities = (read_vectors(state[key], key) for key in ("points", "velocities"))
        self._corners = list(zip(points, velocities, strict=True))
        require(bool(points), "an obstacle has no points")
        self._age = now - read(state["stamp"], "stamp of an obstacle")
        radius, error = (read_size(state[key], key) for key in ("radius", "position_error"))
        self.size = radius + error
        self._error, self._accel, self._top = (
            read_size(state[key], key, read_bound) for key in ("velocity_error", "accel", "speed")
        )

    def room(self, normal: Vector, center: Vector, start: Interval, end: Interval) -> Interval:
        """Least distance of its points from a place along a unit vector, between two times.

        These count from the tick. Displacements are convex in time, so that both ends decide.
        """
        rooms = []
        for point, velocity in self._corners:
            apart = dot(normal, add(point, scale(-ONE, center)))
            closing, pace = -dot(normal, velocity), length(velocity)
            rooms += [apart - self._advance(closing, pace, self._age + t) for t in (start, end)]
        return least(*rooms)

    def _advance(self, closing: Interval, pace: Interval, s: Interval) -> Interval:
        """How far it can move within `s` of its stamp; before the stamp if `s` is negative."""
        if s.high <= 0:
            closing, s = -closing, -s
        top, accel, error = self._top, self._accel, self._error
        if not (top + error).covers(pace):
            top = pace + error  # it was seen to be faster
        start = least(closing + error, top)
        if not (accel * s).covers(top - start):
            return s * (start + (accel * s).half())
        # Short of the top speed by a triangle at first, if it need not have it at once.
        lost = ZERO if accel.low <= 0 else (top - start) * (top - start) / (accel + accel)
        return top * s - lost
