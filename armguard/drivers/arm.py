"""State and orders of a robot, the same for every maker."""

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
"""Greatest speed of joints at rest, in [rad/s]."""

PAYLOAD_TOLERANCE = 0.001
"""By how much a robot's own payload may exceed the cell's, in [kg]."""


def describe_overload(payload: float, most: float) -> str:
    """Why an arm must not move with a payload; empty if it may.

    Args:
        payload: Payload that the robot reports, in [kg].
        most: Greatest payload that the monitor assumes, in [kg].
    """
    if payload <= most + PAYLOAD_TOLERANCE:
        return ""
    return (
        f"the robot carries {payload:.3g} kg, and the monitor assumes {most:.3g} kg at most: "
        "state `payload` in the cell file"
    )


class ArmLostError(Exception):
    """The robot cannot be reached, or does not obey. The message says which."""


class WrongArmError(Exception):
    """Another robot than that of the cell file answers, so another try is useless."""


class Program(enum.Enum):
    """State of the robot's own program."""

    STOPPED = "stopped"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"


RESTING = Program.PAUSED, Program.STOPPED
"""States in which a program moves no joint."""


class ArmState(NamedTuple):
    """State that a robot reported at one time."""

    stamp: float
    """When it was measured, in [s] of this machine's monotonic clock; too late by at most the least
    delay of the robot and its network."""
    q: list[float]
    """Positions of its joints, in [rad]."""
    v: list[float]
    """Their velocities, in [rad/s]."""
    program: Program
    trouble: str
    """Why the robot cannot be driven, and what to do; empty if it can."""
    scale: float
    """Fraction of its speed at which it runs its program."""


class Arm(Protocol):
    """A connection to a robot. A failed order raises `ArmLostError`, and nothing waits."""

    comes_back: bool
    """Whether the same connection can receive states again after a silence."""

    def read(self) -> ArmState | None:
        """The newest state; None if there is no new one."""
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
        """Slow down to rest, so that the program can continue later."""
        ...

    def resume(self) -> None:
        """Let a paused program continue."""
        ...

    def stop(self) -> bool:
        """Slow down to rest and end the program, by a means independent of `pause`.

        Returns:
            Whether a motion of the robot may be what is stopped; otherwise people move the arm.
        """
        ...


class OverrideArm(Arm, Protocol):
    """A robot that multiplies its speed by the number that it receives, or by 0 without one."""

    acknowledgement: str
    """What lets it move again after a restart, in words; empty: a restart does not hold it."""
    is_acknowledged: bool
    """Whether it came between the last two calls of `read`."""

    def set_speed(self, scale: float) -> None:
        """Move at this fraction of the speed, from 0 to 1."""
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
        """Whether it slows down after `brake` and accepts no other order."""
        ...

    def follow(self, q: list[float]) -> None:
        """Be at these positions now, in [rad]; called with each state."""
        ...

    def hold(self) -> None:
        """Stay at rest; called with each state if there is nothing to follow."""
        ...

    def brake(self) -> None:
        """Slow down to rest by the robot's own means."""
        ...


class TrajectoryArm(MotionArm, Protocol):
    """A robot that follows whole trajectories, each of which replaces the one before."""

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
