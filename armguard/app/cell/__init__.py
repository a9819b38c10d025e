"""A cell file made into robot, obstacles and monitor."""

from armguard.app.cell.cell import Cell

__all__ = [
    "Cell",
]
