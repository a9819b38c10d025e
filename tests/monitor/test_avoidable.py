"""What would have avoided a STOP does avoid it, asked of a monitor that was made so."""

import re

import numpy as np
import pytest

from armguard.verdict import Level
from support.panda_monitor import HOME, make_monitor, ranged_panda, see

MOVING = 0.3 * np.ones(7)
REACTION = 0.04
RESPONSE = 0.003


def judge(distance, v=MOVING, **settings):
    """The first verdict of an arm beside a person who comes to a distance, and its monitor."""
    settings = {"reaction_time": REACTION, **settings}
    obstacles, monitor = make_monitor(robot=ranged_panda(), **settings)
    see(obstacles, 0.0, [distance, 0.0, 0.6], velocity=[[-1.0, 0.0, 0.0]])
    return monitor.step(0.0, HOME, v), monitor


def find(remedies, pattern):
    return next((one for one in remedies if re.search(pattern, one)), None)


DISTANCES = (0.75, 0.85, 0.95, 1.05, 1.15, 1.25, 1.35, 1.45)


def test_each_remedy_avoids_the_stop_and_what_is_not_told_does_not():
    told = {"payload of 0 kg": 0, "published": 0, "delay": 0, "speed": 0}
    stops = 0
    for distance in DISTANCES:
        verdict, monitor = judge(distance)
        remedies = monitor.explain().remedies
        if verdict.level is not Level.STOP:
            assert remedies == ()
            continue
        stops += 1
        for words, settings in (
            ("payload of 0 kg", {"payload": 0.0}),
            ("published", {"operating": "published"}),
        ):
            avoided = judge(distance, **settings)[0].level > Level.STOP
            assert (find(remedies, words) is not None) is avoided
            told[words] += avoided
        delay = find(remedies, "delay")
        if delay is not None:
            told["delay"] += 1
            less = 1e-3 * float(re.search(r"delay of ([\d.]+) ms", delay)[1])
            shorter = max(less - RESPONSE - 1e-4, 0.0)
            if less > RESPONSE:
                assert judge(distance, reaction_time=shorter)[0].level > Level.STOP
                longer = less - RESPONSE + 1.5 * (REACTION + RESPONSE) / 2**7
                assert judge(distance, reaction_time=longer)[0].level is Level.STOP
        slower = find(remedies, "of its speed")
        if slower is not None:
            told["speed"] += 1
            share = 0.01 * (int(re.search(r"(\d+)%", slower)[1]) - 1)
            assert judge(distance, max(share, 0.0) * MOVING)[0].level > Level.STOP
    assert stops > 2
    assert min(told.values()) > 0, told


def test_asking_changes_nothing():
    verdicts = []
    for asks in (False, True):
        obstacles, monitor = make_monitor(robot=ranged_panda(), reaction_time=REACTION)
        some = []
        for k in range(30):
            now = 0.01 * k
            see(obstacles, now, [1.2 - now, 0.0, 0.6], velocity=[[-1.0, 0.0, 0.0]])
            some.append(monitor.step(now, HOME + now * MOVING, MOVING))
            if asks:
                monitor.explain()
        verdicts.append(some)
    assert verdicts[0] == verdicts[1]
    assert any(one.level is Level.STOP for one in verdicts[0])


def test_beside_another_reason_to_stop_no_remedy_is_told():
    obstacles, monitor = make_monitor(
        robot=ranged_panda(), reaction_time=REACTION, ignore=[("panda_hand", "missing*")]
    )
    see(obstacles, 0.0, [1.05, 0.0, 0.6], velocity=[[-1.0, 0.0, 0.0]])
    assert monitor.step(0.0, HOME, MOVING).level is Level.STOP
    assert monitor.explain().remedies == ()


@pytest.mark.parametrize("settings", [{"motion": "isotropic"}, {"schedule": "full"}])
def test_other_settings_are_asked_as_well_or_not_at_all(settings):
    verdict, monitor = judge(0.95, **settings)
    assert verdict.level is Level.STOP
    assert bool(monitor.explain().remedies) is ("schedule" in settings)


def test_the_explanation_reads_them_out():
    text = str(judge(1.05)[1].explain())
    assert "the STOP would have been avoided by" in text
