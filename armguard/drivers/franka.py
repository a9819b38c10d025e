"""Arms of Franka Robotics, by the Franka Control Interface: `pylibfranka`, the maker's own client.

A robot accepts one client, which sends a position each millisecond. So the robot has no program and
no slider. This driver moves the arm from waypoint to waypoint, as fast as verdicts allow, or along
the commands of a shield. A robot without positions stops by itself within 20 ms, so nothing else
must stop it if the driver hangs or ends.

The library waits for a state without a timeout, so the driver waits for the packet first. During a
wait of the library, no other Python thread runs.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import socket
import stat
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.drivers.arm import (
    LEAST_SCALE,
    ArmLostError,
    ArmState,
    Program,
    WrongArmError,
    describe_overload,
)
from armguard.drivers.franka_steps import PERIOD, Step, find_excess, step_towards
from armguard.drivers.options import DriveOptions
from armguard.drivers.stamp_filter import StampFilter
from armguard.drivers.waypoints import Waypoints

JOINTS = tuple(
    tuple(f"{robot}_joint{number}" for number in range(1, 8)) for robot in ("fr3", "panda")
)
"""Names of the joints in each of the maker's descriptions, in the controller's order."""

WAIT = 0.005
"""How long to wait for a state, in [s]: five periods of the robot."""

SAME_PLACE, SAME_SPEED = 1e-6, 1e-4
"""Positions and velocities that are no farther apart are the same, in [rad] and [rad/s]; the robot
tells its reference in single precision."""

TORQUES = (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
FORCES = (20.0, 20.0, 20.0, 25.0, 25.0, 25.0)
"""At most, the thresholds of a collision, in [N m], and in [N] and [N m]: those of the maker's
example of joint positions (pylibfranka/examples/joint_position_example.py)."""

LEVER = 0.1
"""Distance from an axis at which the torque threshold equals the force, in [m]."""

_TROUBLES = {
    "Other": "takes no commands: unlock its joints and activate FCI in Desk",
    "Guiding": "is guided by hand: switch it to execution in Desk",
    "Reflex": "has stopped by a reflex ({errors}): see what happened, and start the driver anew",
    "UserStopped": "is stopped by its user stop: release it, and start the driver anew",
    "AutomaticErrorRecovery": "recovers from an error",
}
"""Modes in which it cannot be driven, and what to do. It can be driven when idle or moving."""


class FrankaArm:
    """A connected arm; see `Arm`.

    Args:
        options: Which one.

    Raises:
        ArmLostError: It cannot be connected; states why, and what to do.
        WrongArmError: It speaks another version of the protocol.
    """

    comes_back = False

    def __init__(self, options: DriveOptions) -> None:
        # Loaded by the driver's process alone.
        import pylibfranka

        assert options.franka is not None
        force = options.franka.contact_force
        self._library = pylibfranka
        self._errors = (pylibfranka.FrankaException, RuntimeError, ValueError)
        self._names = options.names
        self._payload = options.payload
        self._stamps = StampFilter()
        self._control: Any = None
        """The motion that runs."""
        self._target: NDArray[np.float64] = np.zeros(0)
        self._sent: Step | None = None
        self._is_stopping = False
        self._cause = ""
        """Why the last motion ended without an order."""
        before = _list_datagram_sockets()
        with self._explained():
            # A kernel without real time does as well, with more lost packets.
            self._robot = pylibfranka.Robot(options.host, pylibfranka.RealtimeConfig.kIgnore)
            (self._socket,) = _list_datagram_sockets() - before
            state = self._robot.read_once()
            if options.is_first and state.robot_mode == pylibfranka.RobotMode.Reflex:
                # Somebody has just started the driver, and so has seen what happened.
                self._robot.automatic_error_recovery()
            if force is not None:
                torques, forces = map(list, limit_thresholds(force))
                self._robot.set_collision_behavior(torques, torques, forces, forces)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Convert errors of the client library to `ArmLostError`."""
        try:
            yield
        except self._errors as error:
            text = str(error).removeprefix("libfranka: ")
            kind = WrongArmError if "ncompatible library version" in text else ArmLostError
            raise kind(f"libfranka: {text}") from None

    def read(self) -> ArmState | None:
        """The newest state; None if none arrives in time or a motion has ended."""
        if not select.select([self._socket], [], [], WAIT)[0]:
            return None
        with self._explained():
            try:
                control = self._control
                state = self._robot.read_once() if control is None else control.readOnce()[0]
            except self._library.ControlException:
                self._note_end()
                return None
        stamp = self._stamps.translate(state.time.to_sec(), time.monotonic())
        self._state = state
        return ArmState(
            stamp,
            state.q,
            state.dq,
            self._find_program(),
            self._find_trouble(state),
            self._find_scale(),
        )

    def _note_end(self) -> None:
        """The robot has ended the motion."""
        if not (self._is_stopping or self._cause):
            self._cause = "the robot has ended its motion"
        self._control, self._is_stopping = None, False

    def _find_program(self) -> Program:
        return Program.STOPPED if self._control is None else Program.RUNNING

    def _find_scale(self) -> float:
        return 1.0

    def _find_trouble(self, state: Any) -> str:
        trouble = _TROUBLES.get(state.robot_mode.name)
        if trouble is not None:
            errors = state.current_errors or state.last_motion_errors
            return f"the robot {trouble.format(errors=errors)}"
        overload = describe_overload(state.m_total, self._payload)
        if overload or self._control is not None:
            return overload
        cause, self._cause = self._cause, ""
        return cause

    def _move(self, target: NDArray[np.float64]) -> None:
        """Answer the state with the next position on the way to a target, in [rad]. Shape (7,).

        A motion begins when the target is elsewhere. It is finished when the joints are at rest at
        a target at rest.
        """
        state, library = self._state, self._library
        is_final = np.array_equal(target, self._target)
        self._target = target
        if self._is_stopping:
            return
        with self._explained():
            if self._control is None:
                if np.abs(target - np.array(state.q_d)).max() > SAME_PLACE:
                    mode = library.ControllerMode.JointImpedance
                    self._control = self._robot.start_joint_position_control(mode)
                return
            step = step_towards(target, *self._find_reference())
            excess = find_excess(step, self._names)
            if excess:
                self._cause = f"the arm was stopped: {excess}"
                self._stop()
                return
            command = library.JointPositions(step.q.tolist())
            is_there = np.abs(step.q - target).max() <= SAME_PLACE
            is_resting = np.abs(step.v).max() <= SAME_SPEED
            command.motion_finished = bool(is_final and is_there and is_resting)
            self._control.writeOnce(command)
            self._sent = step
            if command.motion_finished:
                self._control = None

    def _find_reference(self) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
        """Position, velocity and acceleration that the next step follows. Shape (7,) each.

        The last ones sent, if the robot has them; after a lost packet, the robot's substitutes.
        """
        state, sent = self._state, self._sent
        if sent is not None and np.abs(sent.q - np.array(state.q_d)).max() <= SAME_PLACE:
            return sent.q, sent.v, sent.a
        return state.q_d, state.dq_d, state.ddq_d

    def _stop(self) -> None:
        """Have the robot end its motion, with the robot's own deceleration."""
        self._is_stopping = True
        with self._explained(), contextlib.suppress(self._library.CommandException):
            # Refused where no motion runs any more.
            self._robot.stop()

    def leave(self) -> None:
        """Have the robot end its motion."""
        if self._control is not None:
            self._stop()


class FrankaProgramArm(FrankaArm):
    """One that moves from waypoint to waypoint; see `ProgramArm`."""

    def __init__(self, options: DriveOptions) -> None:
        super().__init__(options)
        own = options.franka
        assert own is not None
        self._waypoints = Waypoints(
            own.waypoints, own.velocities, own.accelerations, options.deceleration, PERIOD
        )
        # A program begins when somebody starts the driver, and not after a lost connection.
        self._program = Program.RUNNING if options.is_first else Program.STOPPED
        self._fraction = LEAST_SCALE
        self._answered: Any = None
        self._has_begun = False

    def _find_program(self) -> Program:
        if self._program is not Program.RUNNING and self._control is None:
            self._has_begun = False
            if self._program is Program.PAUSING:
                self._program = Program.PAUSED
        return self._program

    def _find_scale(self) -> float:
        return self._fraction

    def _note_end(self) -> None:
        super()._note_end()
        self._program = Program.STOPPED

    def scale(self, fraction: float) -> None:
        """Move at this fraction of the program's speed; at `LEAST_SCALE` the arm stands."""
        self._fraction = fraction
        state = self._state
        if state is self._answered:
            return
        self._answered = state
        runs = self._program is Program.RUNNING and fraction > LEAST_SCALE
        if runs and not self._has_begun:
            self._waypoints.begin(state.q_d)
            self._has_begun = True
        if self._has_begun:
            self._move(self._waypoints.advance(fraction if runs else 0.0))

    def pause(self) -> None:
        """Slow down to rest."""
        self._program = Program.PAUSING

    def resume(self) -> None:
        """Go on to the next waypoint."""
        self._program = Program.RUNNING

    def stop(self) -> bool:
        """Have the robot end its motion, if one runs, and end the program."""
        if self._control is None:
            self._program = Program.STOPPED
            return False
        self._stop()
        return True


class FrankaMotionArm(FrankaArm):
    """One that follows positions; see `MotionArm`."""

    @property
    def is_braking(self) -> bool:
        """Whether the robot has yet to end its motion after `brake`."""
        return self._is_stopping

    def follow(self, q: list[float]) -> None:
        """Be at these positions now, in [rad]."""
        self._move(np.array(q))

    def hold(self) -> None:
        """Nothing: a robot without a motion holds itself."""

    def brake(self) -> None:
        """Have the robot end its motion."""
        self.leave()


def limit_thresholds(force: float) -> tuple[Sequence[float], Sequence[float]]:
    """Thresholds of a collision, as `set_collision_behavior` has them, for a force.

    The robot compares each component of the force at its tool. One of the three is at least 1/√3 of
    the force. It compares the torque of each joint, and one that is `LEVER` from the force's line
    gets `LEVER` times the force. Neither is more than in the maker's example, whatever the force.

    Args:
        force: In [N].

    Returns:
        Of the joints, in [N m], shape (7,); of the tool, in [N] and [N m], shape (6,).
    """
    component, torque = force / math.sqrt(3.0), force * LEVER
    return (
        [min(most, torque) for most in TORQUES],
        [
            *(min(most, component) for most in FORCES[:3]),
            *(min(most, torque) for most in FORCES[3:]),
        ],
    )


def _list_datagram_sockets() -> set[int]:
    """Descriptors of this process's datagram sockets."""
    found = set()
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):  # that of the listing is closed by now
            if stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                with socket.socket(fileno=os.dup(descriptor)) as duplicate:
                    if duplicate.type == socket.SOCK_DGRAM:
                        found.add(descriptor)
    return found
