import msgspec
import pytest

from armguard.drivers import stop_alone as module
from armguard.drivers.stop_alone import stop_alone
from armguard.lab.simulation.ur_controller import STOPPED, UrController
from support.driven_cell import OPTIONS, find_host
from support.waiting import wait_until

ROS2 = msgspec.structs.replace(OPTIONS, driver="ros2")


@pytest.mark.parametrize(
    ("is_told", "words"), [(True, "was ordered to stop"), (False, "no order reaches the arm")]
)
def test_a_controller_is_told_by_a_script(monkeypatch, is_told, words):
    monkeypatch.setattr(module, "stop_by_script", lambda *_: is_told)
    monkeypatch.setattr(module, "is_in_local_control", lambda _: False)
    assert words in stop_alone(OPTIONS)


@pytest.mark.hazard("H-20")
@pytest.mark.parametrize("is_remote", [False, True])
def test_a_stop_is_not_claimed_of_a_controller_in_local_control(is_remote):
    with UrController(find_host()) as controller:
        controller.is_remote = is_remote
        words = stop_alone(msgspec.structs.replace(OPTIONS, host=controller.host))
        assert ("stop it by hand" in words) == (not is_remote)
        wait_until(lambda: (controller.program == STOPPED) == is_remote)


def test_an_arm_in_a_graph_stops_by_itself(monkeypatch):
    monkeypatch.setattr(module, "stop_by_script", None)
    assert "the driver sends no speed" in stop_alone(ROS2)
    shielded = msgspec.structs.replace(ROS2, follows=True)
    assert "rests at the end of the motion" in stop_alone(shielded)
