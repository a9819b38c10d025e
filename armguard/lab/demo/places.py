"""Placement and workspace of each arm in the demo, away from -y, where people come from."""

from __future__ import annotations

from typing import NamedTuple

Point = tuple[float, float, float]


class Place(NamedTuple):
    """The place of one arm, in [m]."""

    base: Point
    """Of its base, in the world."""
    lower: Point
    """Corner of the box in which it works, in the frame of its base."""
    upper: Point
    """The opposite corner."""


TABLE = Place((0.0, 0.0, 0.0), (-0.3, -0.13, 0.02), (0.9, 0.9, 1.3))
"""Of an arm on the table: above it, not on the side that people come from."""

PLACES = {
    # Both stand on the floor, 0.75 m below the world's origin, and reach farther to the side.
    "baxter": Place((0.0, 1.1, 0.18), (-0.7, -1.0, -0.7), (1.3, 1.25, 1.3)),
    "tiago": Place((0.0, 0.7, -0.75), (-0.4, -0.6, 0.2), (1.1, 0.9, 1.8)),
}


def find_place(robot: str) -> Place:
    """Where an arm that armguard knows stands in the demo."""
    return PLACES.get(robot, TABLE)
