import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.commission.findings import commission
from armguard.lab.commission.pictures import draw
from support.commissioned_arms import Arm, sample


def find(stops):
    return commission(sample(Arm([0.6, 1.0], [2.0, 3.0], [5.0, 4.0], 0.03), stops, 3.0))


def test_there_is_a_picture_of_all_that_was_found():
    pytest.importorskip("matplotlib")
    assert list(draw(find([0.7]))) == ["stops.png", "stopping.png"]
    assert draw(find([])) == {}


def test_without_matplotlib_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ArmguardError, match=r'pip install "armguard\[plot\]"$'):
        draw(find([]))
