"""A second look earns the level of the first one, and changes nothing."""

import numpy as np

from armguard.monitor.second_look import SecondLook
from armguard.verdict import Level
from support.panda_monitor import HOME, make_monitor, see

TURN = np.array([0.5, 0, 0, 0, 0, 0, 0])


def watch(monkeypatch, looks):
    """Verdicts beside a ball that comes and goes; `looks` gets what each second look earned."""
    obstacles, monitor = make_monitor(rate=100.0)
    decided = []
    explain = monitor._judge._doubtful.explain

    def look(tick, level):
        again = monitor._judge._look_again
        assert isinstance(again, SecondLook)
        near = again.find_near(tick)
        looks.append((again.grade(tick, near.pairs), level))
        return explain(tick, level)

    if looks is not None:
        monkeypatch.setattr(monitor._judge._doubtful, "explain", look)
    q = HOME.copy()
    for tick in range(150):
        now = 0.01 * tick
        see(obstacles, now, [1.3 + 0.4 * np.cos(3.0 * now), 0.0, 0.6], speed=1.5, accel=5.0)
        decided.append(monitor.step(now, q, TURN))
        q = q + 0.01 * TURN
    return decided


def test_a_second_look_earns_the_same_level_and_changes_no_verdict(monkeypatch):
    looks = []
    looked = watch(monkeypatch, looks)
    plain = watch(monkeypatch, None)
    assert looked == plain
    levels = {level for _, level in looks}
    assert levels - {Level.CLEAR}
    assert all(again == level for again, level in looks)
