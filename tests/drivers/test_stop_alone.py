import msgspec
import pytest

from armguard.drivers import stop_alone as module
from armguard.drivers.stop_alone import stop_alone
from support.driven_cell import OPTIONS

ROS2 = msgspec.structs.replace(OPTIONS, driver="ros2")


@pytest.mark.parametrize(
    ("is_told", "words"), [(True, "was ordered to stop"), (False, "no order reaches the arm")]
)
def test_a_controller_is_told_by_a_script(monkeypatch, is_told, words):
    monkeypatch.setattr(module, "stop_by_script", lambda *_: is_told)
    assert words in stop_alone(OPTIONS)


def test_an_arm_in_a_graph_stops_by_itself(monkeypatch):
    monkeypatch.setattr(module, "stop_by_script", None)
    assert "the driver sends no speed" in stop_alone(ROS2)
    shielded = msgspec.structs.replace(ROS2, follows=True)
    assert "rests at the end of the motion" in stop_alone(shielded)
