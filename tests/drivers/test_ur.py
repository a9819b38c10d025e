"""What the driver asks of a robot before the client library; test_watch.py has the library."""

import math
import time

import msgspec
import numpy as np
import pytest

from armguard.drivers.arm import REST_SPEED, ArmLostError, Program, WrongArmError
from armguard.drivers.stamp_filter import StampFilter
from armguard.drivers.ur import UrArm, UrMotionArm, UrProgramArm
from armguard.drivers.ur_lines import Dashboard
from armguard.lab.simulation.ur_controller import PAUSED, STOPPED, UrController
from support.driven_cell import OPTIONS, find_host
from support.waiting import wait_until

FAMILIES = ["UR3", "UR3e", "UR5", "UR5e", "UR10", "UR10e"]


class _Checked(Exception):  # noqa: N818
    """The dashboard has agreed."""


@pytest.fixture
def connect(monkeypatch):
    """Connects up to where the client library would be loaded."""

    def stop(self, options):
        raise _Checked

    monkeypatch.setattr(UrArm, "_connect", stop)

    def connect(controller, **changes):
        with controller:
            UrArm(msgspec.structs.replace(OPTIONS, host=controller.host, **changes))

    return connect


OLD, NEW = (3, 15, 8, 106339), (5, 12, 6, 1102099)
"""Versions of the CB series and of the e-Series."""


@pytest.mark.hazard("H-15")
@pytest.mark.parametrize("model", FAMILIES)
@pytest.mark.parametrize("answer", ["UR3", "UR5", "UR10", "UR5e"])
@pytest.mark.parametrize("version", [OLD, NEW])
def test_the_model_and_the_series_are_those_of_the_cell(connect, model, answer, version):
    same_size = model.removesuffix("e") == answer.removesuffix("e")
    same_series = model.endswith("e") == (version is NEW)
    with pytest.raises(_Checked if same_size and same_series else WrongArmError):
        connect(UrController(find_host(), answer, version=version), model=model)


@pytest.mark.parametrize(("version", "error"), [(OLD, WrongArmError), (NEW, _Checked)])
def test_a_newer_model_than_the_e_series_has_no_e(connect, version, error):
    with pytest.raises(error):
        connect(UrController(find_host(), "UR20", version=version), model="UR20")


def test_a_robot_that_does_not_tell_its_version_is_not_driven(connect):
    controller = UrController(find_host())
    answer = controller._answer
    controller._answer = lambda line: "?" if line == "PolyscopeVersion" else answer(line)
    with pytest.raises(ArmLostError, match=r"version of its software: '\?'"):
        connect(controller)


def test_a_robot_in_local_control_is_refused(connect):
    controller = UrController(find_host())
    controller.is_remote = False
    with pytest.raises(ArmLostError, match="not in remote control: switch remote control on"):
        connect(controller)


def test_each_safety_mode_in_which_it_stands_has_words():
    arm = object.__new__(UrArm)
    arm._payload, arm._is_local, arm._refusal = 5.0, False, ""
    for mode in (1, 2):
        assert arm._find_trouble(7, mode, 5.0) == ""
    for mode in range(3, 20):
        assert "the robot " in arm._find_trouble(7, mode, 5.0)
    for mode in (-1, 0, 1, 2, 3, 4, 5, 6, 8, 99):
        assert "switch it on" in arm._find_trouble(mode, 1, 5.0)
    for payload in (5.1, float("nan"), float("inf")):
        assert "payload" in arm._find_trouble(7, 1, payload)


class Receive:
    """Receives one state."""

    def __init__(self, **changes):
        values = {"isConnected": True, "getTimestamp": 1.0, "getActualQ": [0.0] * 6}
        values |= {"getActualQd": [0.0] * 6, "getRobotMode": 7, "getSafetyMode": 1}
        values |= {"getRuntimeState": 2, "getTargetSpeedFraction": 1.0, "getPayload": 0.0}
        for name, value in (values | changes).items():
            setattr(self, name, lambda value=value: value)


@pytest.mark.parametrize(("state", "program"), [(1, Program.STOPPED), (9, Program.RUNNING)])
def test_of_a_program_whose_state_is_not_known_the_worst_is_assumed(state, program):
    with UrController(find_host()) as controller:
        arm = make_arm(UrArm, controller)
        arm._receive = Receive(getRuntimeState=state)
        assert arm.read().program is program
        arm._dashboard.close()


class Slider:
    """Takes whatever is set."""

    def setSpeedSlider(self, fraction):  # noqa: N802  # the library's name
        return True


def make_arm(kind, controller):
    """An arm that reads this controller without the client library."""
    arm = object.__new__(kind)
    arm._host, arm._deceleration, arm._stop_within = controller.host, 4.0, 0.5
    arm._dashboard, arm._io = Dashboard(controller.host), Slider()
    arm._stamps, arm._payload, arm._receive = StampFilter(), 0.0, Receive()
    arm._is_local, arm._refusal, arm._next_question = False, "", 0.0
    arm._receive.getTimestamp = lambda: time.monotonic() // 0.002 * 0.002
    arm._receive.getRuntimeState = lambda: controller.program
    arm._receive.getActualQd = lambda: controller.v.tolist()
    return arm


def read_trouble(arm, words):
    """Read states until one has a trouble with these words; empty: none."""

    def is_there():
        state = arm.read()
        return state is not None and (words in state.trouble if words else not state.trouble)

    wait_until(is_there)


@pytest.mark.hazard("H-19")
def test_local_control_is_noticed_and_no_stop_is_claimed(monkeypatch):
    monkeypatch.setattr("armguard.drivers.ur.QUESTION_INTERVAL", 0.1)
    with UrController(find_host()) as controller:
        arm = make_arm(UrProgramArm, controller)
        read_trouble(arm, "")
        controller.is_remote = False
        read_trouble(arm, "is in local control and ignores pause and scripts: stop it by hand")
        assert not arm.stop()
        controller.is_remote = True
        read_trouble(arm, "")
        assert arm.stop()
        arm._dashboard.close()


@pytest.mark.parametrize(("question", "words"), [(0.0, "local control"), (math.inf, "")])
def test_an_order_that_is_not_allowed_tells_of_local_control(question, words):
    """But not of a controller that knows no such control."""
    with UrController(find_host()) as controller:
        arm = make_arm(UrProgramArm, controller)
        arm._next_question = question
        arm.read()
        controller.is_remote = False
        arm.pause()
        time.sleep(0.1)
        read_trouble(arm, words)
        arm._dashboard.close()


def test_a_program_that_does_not_go_on_is_told_until_somebody_starts_it():
    with UrController(find_host()) as controller:
        arm = make_arm(UrProgramArm, controller)
        controller.program, play, controller.play = PAUSED, controller.play, lambda: False
        arm.resume()
        read_trouble(arm, "does not go on (Failed to execute: play)")
        time.sleep(0.05)
        read_trouble(arm, "does not go on")
        play()
        read_trouble(arm, "")
        arm._dashboard.close()


@pytest.fixture
def leave():
    """Has an arm of this kind leave a controller with these changes."""

    def leave(kind, changes):
        with UrController(find_host()) as controller:
            wait_until(lambda: controller.pace > 0.9)
            for name, value in changes.items():
                setattr(controller, name, value)
            arm = make_arm(kind, controller)
            try:
                arm.leave()
            finally:
                arm._dashboard.close()
            assert controller.program in (PAUSED, STOPPED)
            assert np.abs(controller.v).max() <= REST_SPEED

    return leave


@pytest.mark.hazard("H-20")
@pytest.mark.parametrize("kind", [UrProgramArm, UrMotionArm])
@pytest.mark.parametrize("changes", [{}, {"program": STOPPED}])
def test_an_arm_rests_when_it_has_been_left(leave, kind, changes):
    leave(kind, changes)


@pytest.mark.hazard("H-20")
@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        (UrProgramArm, {"obeys_pause": False}),
        (UrProgramArm, {"is_remote": False}),
        (UrProgramArm, {"_obey": "Failed to execute: {}".format}),
        (UrMotionArm, {"is_remote": False}),
    ],
)
def test_an_arm_that_is_not_seen_at_rest_is_not_left_alone(leave, kind, changes):
    with pytest.raises(ArmLostError, match=r"not seen at rest 0\.5 s after"):
        leave(kind, changes)


class DeafControl:
    """Takes no order to brake."""

    def __init__(self, error=None):
        self._error = error

    def servoStop(self, deceleration):  # noqa: N802  # the library's name
        if self._error is not None:
            raise self._error
        return False


@pytest.mark.parametrize("error", [None, RuntimeError("lost")])
def test_an_order_to_brake_that_is_not_taken_is_no_braking(error):
    arm = object.__new__(UrMotionArm)
    arm._control, arm._braking, arm._has_braked_in_vain = DeafControl(error), None, False
    arm.brake()
    arm._braking.join(5.0)
    with pytest.raises(ArmLostError, match="order to brake"):
        _ = arm.is_braking
