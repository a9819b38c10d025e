"""A shield that moves arms along proved motions alone; `Shield` is where to begin."""

import importlib.util
from typing import TYPE_CHECKING

from armguard.exceptions import ArmguardError
from armguard.lazy import lazy_names

for _package in ("ruckig", "scipy"):
    if importlib.util.find_spec(_package) is None:
        raise ArmguardError(
            "a shield", f"needs {_package}", remedy="pip install 'armguard[shield]'"
        )

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
