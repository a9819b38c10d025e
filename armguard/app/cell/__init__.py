"""Makes robot, obstacles and monitor from a cell file."""

from armguard.app.cell.cell import Cell

__all__ = [
    "Cell",
]
