"""A shield moves an arm only along proved motions; the main class is `Shield`."""

from typing import TYPE_CHECKING

from armguard.lazy import lazy_names

if TYPE_CHECKING:
    from armguard.shield.command import Command
    from armguard.shield.path import MotionLimits, Path
    from armguard.shield.shield import Shield
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "Command": "armguard.shield.command",
            "MotionLimits": "armguard.shield.path",
            "Path": "armguard.shield.path",
            "Shield": "armguard.shield.shield",
        },
    )

__all__ = ["Command", "MotionLimits", "Path", "Shield"]
