"""What a driver knows of a robot, and what it can ask of one: the same for every maker."""

from __future__ import annotations

import enum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from armguard.verdict import Verdict

LEAST_SCALE = 0.01
"""Fraction of its speed at which a program runs for a stop, until it is paused: a speed slider at 0
makes real controllers stop protectively."""

REST_SPEED = 0.01
"""What joints at rest do not exceed, in [rad/s]."""

PAYLOAD_TOLERANCE = 0.001
"""By how much a robot's own payload may exceed the cell's, in [kg]."""


def describe_overload(payload: float, most: float) -> str:
    """Why an arm must not move with a payload; empty where it may.

    Args:
        payload: What the robot says that it carries, in [kg].
        most: What the monitor takes it to carry at most, in [kg].
    """
    if payload <= most + PAYLOAD_TOLERANCE:
        return ""
    return (
        f"the robot carries {payload:.3g} kg, and the monitor reckons with {most:.3g} kg at most: "
        "state `payload` in the cell file"
    )


class ArmLostError(Exception):
    """The robot cannot be reached, or does not obey. The message says which."""


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
    """Fraction of its speed at which it runs its program."""


class Arm(Protocol):
    """A connection to a robot. Whatever cannot be done raises `ArmLostError`, and nothing waits."""

    comes_back: bool
    """Whether a robot that was silent can be heard again by the same connection."""

    def read(self) -> ArmState | None:
        """The newest state; None where there is none that was not read before."""
        ...

    def leave(self) -> None:
        """Bring it to rest, since this process is about to end."""
        ...


class ProgramArm(Arm, Protocol):
    """A robot whose own program moves it."""

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


class OverrideArm(Arm, Protocol):
    """A robot that multiplies its speed by a number that is sent to it, or by 0 without one."""

    def set_speed(self, scale: float) -> None:
        """Go on at this fraction of the speed, from 0 to 1."""
        ...

    def report(self, verdict: Verdict | None, problem: str) -> None:
        """Show a verdict to people and programs; where there is none, why the arm stands."""
        ...

    def stop(self) -> bool:
        """Slow down to rest by another way; whether there is one."""
        ...


class MotionArm(Arm, Protocol):
    """A robot that follows joint positions."""

    @property
    def is_braking(self) -> bool:
        """Whether it slows down after `brake`, and can be told nothing else."""
        ...

    def follow(self, q: list[float]) -> None:
        """Be at these positions now, in [rad]; called with each state."""
        ...

    def hold(self) -> None:
        """Go on resting; called with each state where there is nothing to follow."""
        ...

    def brake(self) -> None:
        """Slow down to rest by the robot's own means."""
        ...


class TrajectoryArm(MotionArm, Protocol):
    """A robot that follows whole trajectories, each in place of the one before."""

    def send(
        self,
        stamp: float,
        times: NDArray[np.float64],
        q: NDArray[np.float64],
        v: NDArray[np.float64],
    ) -> None:
        """Be at these positions with these velocities at these times, and rest at the end.

        Args:
            stamp: From which the times count, in [s] of the monotonic clock.
            times: In [s], rising. Shape (k,).
            q: In [rad]. Shape (k, nv).
            v: In [rad/s]. Shape (k, nv).
        """
        ...

    def report(self, verdict: Verdict | None, problem: str) -> None:
        """Show a verdict to people and programs; where there is none, why the arm stands."""
        ...
