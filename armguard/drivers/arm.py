"""What a driver knows of a robot, and what it can ask of one: the same for every maker."""

from __future__ import annotations

import enum
from typing import NamedTuple, Protocol


class ArmLostError(Exception):
    """The robot cannot be reached, refuses, or does not do what it was told; says which."""


class WrongArmError(Exception):
    """What answers is not the robot of the cell file, so that another try is of no use."""


class Program(enum.Enum):
    """What the robot's own program does."""

    STOPPED = "stopped"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"


class ArmState(NamedTuple):
    """What a robot said of itself at one time."""

    stamp: float
    """When it was so, in [s] of this machine's monotonic clock; never too early by more than the
    robot and its network hold it back at least."""
    q: list[float]
    """Positions of its joints, in [rad]."""
    v: list[float]
    """Their velocities, in [rad/s]."""
    program: Program
    trouble: str
    """Why it cannot be driven as it is, and what to do about it; empty where it can."""
    scale: float
    """At which fraction of its speed it runs its program, as it was told last."""


class Arm(Protocol):
    """A connection to a robot. Whatever cannot be done raises `ArmLostError`, and nothing waits."""

    def read(self) -> ArmState | None:
        """The newest state; None where there is none that was not read before."""
        ...

    def scale(self, fraction: float) -> None:
        """Run the program at this fraction of its speed: above 0, up to 1."""
        ...

    def pause(self) -> None:
        """Slow down to rest, so that the program can go on later."""
        ...

    def resume(self) -> None:
        """Let a paused program go on."""
        ...

    def stop(self) -> None:
        """Slow down to rest and end the program, by a way of its own."""
        ...

    def close(self) -> None:
        """End the connection."""
        ...
