import pytest

from armguard.cover import Cover
from armguard.exceptions import CoverError
from armguard.lab.tradeoff.covers import Covers
from armguard.lab.tradeoff.ladder import AXES, Setting
from armguard.robot import Robot
from support.panda_monitor import ranged_panda


def test_settings_choose_among_covers_and_each_is_fitted_once(monkeypatch):
    panda = ranged_panda()
    asked = []

    def fit(robot, protrusion):
        asked.append(protrusion)
        return robot.cover.cut(1)

    monkeypatch.setattr(Cover, "fit", fit)
    covers = Covers(panda)
    level, fine = AXES["cover"][0], AXES["cover"][-1]
    assert covers.choose(Setting("default")) is panda.cover
    assert covers.choose(Setting("one", (level,))).levels("panda_hand") == 1
    for _ in range(2):
        assert covers.choose(Setting("two", (fine,))).levels("panda_hand") == 2
    assert asked == [0.01]
    with pytest.raises(CoverError):
        covers.choose(Setting("three", (fine, level._replace(level=7))))
    with pytest.raises(CoverError, match=r"cover 10 mm: would take many minutes.*armguard cover"):
        Covers(Robot.load("ur10")).choose(Setting("two", (fine,)))
