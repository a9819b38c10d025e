import sys

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.commission.findings import commission
from armguard.lab.commission.pictures import draw
from support.commissioned_arms import Arm, sample


def find(stops):
    return commission(sample(Arm([0.6, 1.0], [2.0, 3.0], [5.0, 4.0], 0.03), stops, 3.0))


def test_there_is_a_picture_of_all_that_was_found(tmp_path):
    pytest.importorskip("matplotlib")
    assert [path.name for path in draw(find([0.7]), tmp_path)] == [
        "stops.png",
        "stopping.png",
        "velocities.png",
    ]
    assert [path.name for path in draw(find([]), tmp_path)] == ["velocities.png"]


def test_without_matplotlib_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.setitem(sys.modules, "matplotlib.backends.backend_agg", None)
    with pytest.raises(ArmguardError, match=r"armguard\[plot\]"):
        draw(find([]), tmp_path)


def test_a_folder_that_is_none_is_a_mistake(tmp_path):
    pytest.importorskip("matplotlib")
    with pytest.raises(ArmguardError, match="cannot be written"):
        draw(find([]), tmp_path / "none")
