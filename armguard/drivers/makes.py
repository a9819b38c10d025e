"""What is particular to a make of robot: its module has a `MAKE`, and is loaded when asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from armguard.drivers.arm import MotionArm, ProgramArm
from armguard.drivers.options import DriveOptions


class Make(NamedTuple):
    """What drives the robots of one maker."""

    joints: tuple[tuple[str, ...], ...]
    """Names of the joints in the controller's order, as each of the maker's descriptions has
    them."""
    rates: tuple[float, float]
    """How many joint states a second it can send at least and at most, in [Hz]."""
    library: str
    """Module of the client library, which the driver's process alone loads."""
    package: str
    """Whose module it is."""
    connect_program: Callable[[DriveOptions], ProgramArm]
    """Connect a robot that a program moves."""
    connect_motion: Callable[[DriveOptions], MotionArm]
    """Connect a robot that follows joint positions."""
    stop: Callable[[DriveOptions], str]
    """Stop the robot without the client library and without a connection; says whether it did."""


def find_make(name: str) -> Make:
    """The make of a robot, by its name in cell files."""
    assert name == "ur"
    from armguard.drivers.ur import MAKE

    return MAKE
