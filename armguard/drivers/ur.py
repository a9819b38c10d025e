"""Arms of Universal Robots, by RTDE: `ur_rtde`, the client library of SDU Robotics.

Either the robot's own program moves the arm, or the commands of a shield do. A program is scaled by
the speed slider; the dashboard pauses it and lets it go on. Each write of the slider feeds
`input_int_register_47`, on which the program can set a watchdog of the controller's own. Commands
are followed by `servoJ` in the library's own program, with such a watchdog. This module handles
faults of the library: its constructors hang or end the process, and it may report a slider as set
that is not set.
"""

from __future__ import annotations

import contextlib
import math
import re
import threading
import time
from collections.abc import Callable
from typing import Any

from armguard.drivers.arm import (
    LEAST_SCALE,
    REST_SPEED,
    RESTING,
    ArmLostError,
    ArmState,
    Program,
    WrongArmError,
    describe_overload,
)
from armguard.drivers.options import DriveOptions
from armguard.drivers.stamp_filter import StampFilter
from armguard.drivers.ur_lines import REMOTE_CONTROL, Dashboard, check_rtde, stop_by_script

JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
"""Names of the joints in the maker's descriptions, in the controller's order."""

CB_SERIES = ("UR3", "UR5", "UR10")
"""Models before the e-Series; only their software has a version below 5."""

VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "target_speed_fraction",
    "payload",
]
"""Values that the controller must send."""

LOOK_AHEAD, GAIN = 0.03, 1000.0
"""Of `servoJ`, in [s], the least that it takes, and without a unit: how closely it follows."""

FULL_SCALE = 0.999
"""At this fraction or more, a speed slider counts as full."""

STOP_DECELERATION = 10.0
"""Deceleration of `servoStop`, in [m/s²]: the library's default."""

QUESTION_INTERVAL = 1.0
"""Between two questions whether the robot is in remote control, in [s]."""

_RUNNING = 7

_ROBOT_MODES = {
    -1: "has no controller",
    0: "is disconnected",
    1: "waits for its safety settings to be confirmed",
    2: "is starting",
    3: "is switched off",
    4: "has power, and its brakes are on",
    5: "is idle, and its brakes are on",
    6: "is driven back by hand",
    8: "updates its firmware",
}

_SAFETY_MODES = {
    3: "is in a protective stop: see what it hit, and unlock it on the pendant",
    4: "is in recovery mode: move it back within its limits on the pendant",
    5: "is in a safeguard stop: reset the safeguard",
    6: "is in an emergency stop of the system: release it, and switch the robot on",
    7: "is in an emergency stop: release the button, and switch the robot on",
    8: "has a safety violation: restart its safety system on the pendant",
    9: "has a safety fault: restart its safety system on the pendant",
    10: "validates its joints",
    12: "is in a safeguard stop of automatic mode: reset the safeguard",
    13: "is stopped by the three-position enabling device",
}
"""Safety modes in which it stands; 1 is normal, and 2 reduced."""

_PROGRAMS = {
    2: Program.RUNNING,
    0: Program.STOPPED,
    1: Program.STOPPED,
    3: Program.PAUSING,
    4: Program.PAUSED,
    5: Program.RUNNING,
}
"""Of RTDE's runtime states; 0 is stopping, and 5 resuming."""


class UrArm:
    """A connected arm; see `Arm`.

    Args:
        options: Which one.

    Raises:
        ArmLostError: It cannot be connected; says why, and what to do.
        WrongArmError: It is not the one of the cell file.
    """

    comes_back = False

    def __init__(self, options: DriveOptions) -> None:
        self._host = options.host
        self._deceleration = options.deceleration
        self._payload = options.payload
        self._stop_within = options.stop_within
        self._stamps = StampFilter()
        self._is_local, self._refusal, self._next_question = False, "", math.inf
        with contextlib.ExitStack() as opened:
            self._dashboard = Dashboard(options.host)
            opened.callback(self._dashboard.close)
            self._check_dashboard(options)
            check_rtde(options.host)
            try:
                self._receive = self._connect(options)
            except (RuntimeError, ValueError, OSError) as error:
                raise _explain(error) from None
            opened.pop_all()

    def _check_dashboard(self, options: DriveOptions) -> None:
        model, version = map(self._dashboard.ask, ("get robot model", "PolyscopeVersion"))
        major = re.match(r"URSoftware (\d+)\.", version)
        if major is None:
            raise ArmLostError(
                f"the robot does not report the version of its software: {version!r}"
            )
        # Controllers of the e-Series leave out the "e"; their software tells them from the others.
        is_old = int(major[1]) < 5
        wanted = options.model.upper()
        if model.upper().removesuffix("E") != wanted.removesuffix("E") or is_old != (
            wanted in CB_SERIES
        ):
            raise WrongArmError(
                f"the robot at {options.host} is a {model} with {version}, no {options.model}"
            )
        answer = self._dashboard.ask(REMOTE_CONTROL).lower()
        # Controllers of the CB series know no such mode, and do not understand.
        if answer == "true":
            self._next_question = time.monotonic()
        if answer == "false":
            raise ArmLostError(
                "the robot is not in remote control: switch remote control on at the pendant"
            )

    def _connect(self, options: DriveOptions) -> Any:
        """Connect the client library; returns the receiver of the robot's states."""
        # Loaded by the driver's process alone.
        import rtde_receive

        return rtde_receive.RTDEReceiveInterface(options.host, options.rate, VARIABLES)

    def read(self) -> ArmState | None:
        """The newest state; None where there is none that was not read before."""
        receive = self._receive
        self._hear()
        try:
            if not receive.isConnected():
                raise ArmLostError("the robot has ended the connection")
            # Its values are read one by one: the same stamp before and after says that they
            # belong together.
            stamp = receive.getTimestamp()
            if stamp == self._stamps.newest:
                return None
            q, v = receive.getActualQ(), receive.getActualQd()
            modes = receive.getRobotMode(), receive.getSafetyMode()
            # Of a state that is not known the worst is assumed.
            program = _PROGRAMS.get(receive.getRuntimeState(), Program.RUNNING)
            scale, payload = receive.getTargetSpeedFraction(), receive.getPayload()
            now = time.monotonic()
            if receive.getTimestamp() != stamp:
                return None
        except RuntimeError as error:
            raise _explain(error) from None
        if program is not Program.PAUSED:
            self._refusal = ""
        trouble = self._find_trouble(*modes, payload)
        return ArmState(self._stamps.translate(stamp, now), q, v, program, trouble, scale)

    def _hear(self) -> None:
        """Read the dashboard's answers, and ask at times whether the robot takes orders."""
        has_modes = self._next_question < math.inf
        for answer in self._dashboard.read_answers():
            if answer.lower() in ("true", "false"):
                self._is_local = answer.lower() == "false"
            elif "not allowed" in answer:
                self._is_local = has_modes
            elif answer.startswith("Failed to execute: play"):
                self._refusal = answer
        if (now := time.monotonic()) >= self._next_question:
            self._next_question = now + QUESTION_INTERVAL
            self._dashboard.order(REMOTE_CONTROL)

    def _await_rest(self, order: str) -> None:
        """Wait until the arm and its program are seen at rest after an order."""
        deadline = time.monotonic() + self._stop_within
        while True:
            state = self.read()
            speeds = [] if state is None or state.program not in RESTING else state.v
            if speeds and all(abs(v) <= REST_SPEED for v in speeds):
                return
            if not time.monotonic() < deadline:
                raise ArmLostError(
                    f"the arm was not seen at rest {self._stop_within:.2g} s after {order}"
                )
            time.sleep(0.001)

    def _find_trouble(self, mode: int, safety: int, payload: float) -> str:
        if safety not in (1, 2):
            return f"the robot {_SAFETY_MODES.get(safety, f'is in safety mode {safety}')}"
        if mode != _RUNNING:
            return f"the robot {_ROBOT_MODES.get(mode, f'is in mode {mode}')}: switch it on"
        if self._is_local:
            return (
                "the robot is in local control and ignores pause and scripts: stop it by hand, and "
                "switch remote control on at the pendant"
            )
        if self._refusal:
            return f"the program does not go on ({self._refusal}): start it again by hand"
        return describe_overload(payload, self._payload)


class UrProgramArm(UrArm):
    """An arm that its own program moves; see `ProgramArm`."""

    def _connect(self, options: DriveOptions) -> Any:
        import rtde_io

        receive = super()._connect(options)
        # The upper range of registers leaves the lower one to programs that use the library.
        self._io = rtde_io.RTDEIOInterface(options.host, False, True)
        return receive

    def scale(self, fraction: float) -> None:
        """Set the speed slider, above 0 and up to 1."""
        try:
            is_taken = self._io.setSpeedSlider(fraction)
        except RuntimeError as error:
            raise _explain(error) from None
        if not is_taken:
            raise ArmLostError("the robot no longer accepts a speed slider")

    def pause(self) -> None:
        """Pause the program."""
        self._dashboard.order("pause")

    def resume(self) -> None:
        """Let the paused program continue."""
        self._dashboard.order("play")

    def stop(self) -> bool:
        """Stop the joints by `stopj`, which ends the program."""
        if not stop_by_script(self._host, self._deceleration):
            raise ArmLostError("no script reaches the robot: stop it by hand")
        return not self._is_local

    def leave(self) -> None:
        """Pause the program, if one runs, and wait until the arm rests."""
        self.scale(LEAST_SCALE)
        self.pause()
        self._await_rest("`pause`")


class UrMotionArm(UrArm):
    """An arm that follows positions by `servoJ`, in the library's own program; see `MotionArm`.

    The controller ends that program if it receives nothing for the longest silence.
    """

    def _connect(self, options: DriveOptions) -> Any:
        import rtde_control

        receive = super()._connect(options)
        modes = receive.getRobotMode(), receive.getSafetyMode()
        trouble = self._find_trouble(*modes, receive.getPayload())
        if trouble:
            raise ArmLostError(trouble)  # no program would start
        self._period = 1.0 / options.rate
        self._braking: threading.Thread | None = None
        self._has_braked_in_vain = False
        self._control = rtde_control.RTDEControlInterface(options.host, options.rate)
        self._do(self._control.setWatchdog, 1.0 / options.longest_silence)
        return receive

    def read(self) -> ArmState | None:
        """The newest state; `servoJ` moves the arm only at full speed."""
        state = super().read()
        if state is None or state.trouble or state.scale >= FULL_SCALE:
            return state
        trouble = f"the speed slider is at {state.scale:.0%}: set it to 100%"
        return state._replace(trouble=trouble)

    @property
    def is_braking(self) -> bool:
        """Whether it slows down: the library waits for it, in a thread."""
        if self._has_braked_in_vain:
            raise ArmLostError("the robot does not accept the order to brake")
        return self._braking is not None and self._braking.is_alive()

    def follow(self, q: list[float]) -> None:
        """Be at these positions now, in [rad]."""
        self._do(self._control.servoJ, q, 0.0, 0.0, self._period, LOOK_AHEAD, GAIN)

    def hold(self) -> None:
        """Feed the controller's watchdog."""
        self._do(self._control.kickWatchdog)

    def brake(self) -> None:
        """Slow down to rest by `servoStop`."""
        self._braking = threading.Thread(target=self._stop_servo, daemon=True)
        self._braking.start()

    def _stop_servo(self) -> None:
        is_taken = False
        with contextlib.suppress(RuntimeError):
            is_taken = self._control.servoStop(STOP_DECELERATION)
        self._has_braked_in_vain = not is_taken

    def leave(self) -> None:
        """Stop the joints by `stopj`, which ends the program, and wait until the arm rests."""
        if not stop_by_script(self._host, self._deceleration):
            raise ArmLostError("no script reaches the robot: stop it by hand")
        self._await_rest("`stopj`")

    def _do(self, order: Callable[..., bool], *arguments: object) -> None:
        try:
            is_done = order(*arguments)
        except (RuntimeError, ValueError) as error:
            raise _explain(error) from None
        if not is_done:
            raise ArmLostError("the robot has ended the program by which it follows commands")


def _explain(error: Exception) -> ArmLostError:
    """Convert an error of the client library."""
    if "already in use" in str(error):
        return ArmLostError(
            "another client of the robot has the speed slider: end it (a fieldbus, or another "
            "driver)"
        )
    return ArmLostError(f"ur_rtde: {error}")
