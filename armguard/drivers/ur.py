"""Arms of Universal Robots, by RTDE: `ur_rtde`, the client library of SDU Robotics.

The robot's own program moves the arm. The speed slider scales it, and the dashboard pauses it and
lets it go on. Each write of the slider feeds `input_int_register_47`, on which the program can set
a watchdog of the controller's own. What the library gets wrong is met here: its constructors hang
or end the process, and a slider that it says it has set need not be set.
"""

from __future__ import annotations

import contextlib
import time
from typing import Any

from armguard.drivers.arm import ArmLostError, ArmState, Program, WrongArmError
from armguard.drivers.options import DriveOptions
from armguard.drivers.stamp_filter import StampFilter
from armguard.drivers.ur_lines import Dashboard, check_rtde, stop_by_script

JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
"""Names of the joints in the maker's descriptions, in the controller's order."""

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
"""What the controller is asked to send."""

PAYLOAD_SLACK = 0.001
"""By how much the controller's payload may exceed the cell's, in [kg]."""

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

    def __init__(self, options: DriveOptions) -> None:
        self._host = options.host
        self._deceleration = options.deceleration
        self._payload = options.payload
        self._stamps = StampFilter()
        self._timestamp = -1.0
        with contextlib.ExitStack() as opened:
            self._dashboard = Dashboard(options.host)
            opened.callback(self._dashboard.close)
            self._check_dashboard(options)
            check_rtde(options.host)
            self._receive, self._io = self._connect(options)
            opened.pop_all()

    def _check_dashboard(self, options: DriveOptions) -> None:
        model = self._dashboard.ask("get robot model")
        # Controllers of the e-Series leave out the "e".
        if model.rstrip("e").upper() != options.model.rstrip("e").upper():
            raise WrongArmError(f"the robot at {options.host} is a {model}, no {options.model}")
        answer = self._dashboard.ask("is in remote control")
        # Controllers of the CB series know no such mode, and do not understand.
        if answer.lower() == "false":
            raise ArmLostError("the robot is not in remote control: switch it on at the pendant")

    def _connect(self, options: DriveOptions) -> tuple[Any, Any]:
        # Loaded by the driver's process alone.
        import rtde_io
        import rtde_receive

        try:
            receive = rtde_receive.RTDEReceiveInterface(options.host, options.rate, VARIABLES)
            # The upper range of registers leaves the lower one to programs that use the library.
            return receive, rtde_io.RTDEIOInterface(options.host, False, True)
        except (RuntimeError, OSError) as error:
            if "already in use" in str(error):
                raise ArmLostError(
                    "another client of the robot has the speed slider: end it (a fieldbus, or "
                    "another driver)"
                ) from None
            raise ArmLostError(f"ur_rtde: {error}") from None

    def read(self) -> ArmState | None:
        """The newest state; None where there is none that was not read before."""
        receive = self._receive
        try:
            if not receive.isConnected():
                raise ArmLostError("the robot has ended the connection")
            # Its values are read one by one: the same stamp before and after says that they
            # belong together.
            stamp = receive.getTimestamp()
            if stamp == self._timestamp:
                return None
            q, v = receive.getActualQ(), receive.getActualQd()
            modes = receive.getRobotMode(), receive.getSafetyMode()
            program = _PROGRAMS.get(receive.getRuntimeState(), Program.STOPPED)
            scale, payload = receive.getTargetSpeedFraction(), receive.getPayload()
            now = time.monotonic()
            if receive.getTimestamp() != stamp:
                return None
        except RuntimeError as error:
            raise ArmLostError(f"ur_rtde: {error}") from None
        if stamp < self._timestamp or not self._stamps.fits(stamp, now):
            raise ArmLostError("the robot's clock jumped: it was started anew, or sends nonsense")
        self._timestamp = stamp
        trouble = self._find_trouble(*modes, payload)
        return ArmState(self._stamps.translate(stamp, now), q, v, program, trouble, scale)

    def _find_trouble(self, mode: int, safety: int, payload: float) -> str:
        if safety not in (1, 2):
            return f"the robot {_SAFETY_MODES.get(safety, f'is in safety mode {safety}')}"
        if mode != _RUNNING:
            return f"the robot {_ROBOT_MODES.get(mode, f'is in mode {mode}')}: switch it on"
        if not payload <= self._payload + PAYLOAD_SLACK:
            return (
                f"the robot carries {payload:.3g} kg, and the monitor reckons with "
                f"{self._payload:.3g} kg at most: state `payload` in the cell file"
            )
        return ""

    def scale(self, fraction: float) -> None:
        """Set the speed slider, above 0 and up to 1."""
        try:
            is_taken = self._io.setSpeedSlider(fraction)
        except RuntimeError as error:
            raise ArmLostError(f"ur_rtde: {error}") from None
        if not is_taken:
            raise ArmLostError("the robot takes no speed slider any more")

    def pause(self) -> None:
        """Pause the program."""
        self._order("pause")

    def resume(self) -> None:
        """Let the paused program go on."""
        self._order("play")

    def _order(self, line: str) -> None:
        for answer in self._dashboard.read_answers():
            if "not allowed" in answer:
                raise ArmLostError(f"the robot is not in remote control any more: {answer}")
        self._dashboard.order(line)

    def stop(self) -> None:
        """Stop the joints by `stopj`, which ends the program."""
        if not stop_by_script(self._host, self._deceleration):
            raise ArmLostError("no script reaches the robot: stop it by hand")

    def close(self) -> None:
        """Disconnect."""
        self._dashboard.close()
        for one in (self._io, self._receive):
            with contextlib.suppress(RuntimeError):
                one.disconnect()
