"""The makes of robots that can be driven; the module of each is loaded when asked for."""

from __future__ import annotations

from armguard.drivers.arm import Make


def find_make(name: str) -> Make:
    """The make of a robot, by its name in cell files."""
    if name == "franka":
        from armguard.drivers.franka import MAKE
    else:
        from armguard.drivers.ur import MAKE
    return MAKE
