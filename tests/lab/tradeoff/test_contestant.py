import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.tradeoff.contestant import Contestant
from armguard.lab.tradeoff.ladder import AXES, Rung, Setting
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from support.panda_monitor import ranged_panda
from support.tradeoff_cases import make_site, small_scene

RATE = 200.0
SLOWER = Rung("rate", "200 Hz", {"rate": RATE})


def make(*rungs, scene=None, **settings):
    site = make_site(rate=RATE, **settings)
    return Contestant(Setting("x", rungs), site, scene or small_scene(), site.robot.cover)


def test_it_says_what_a_monitor_says_that_is_led_by_hand():
    scene, table = small_scene(), Obstacles()
    monitor = Monitor(ranged_panda(), table, rate=RATE)
    verdicts, messages = [], list(scene.messages)
    for tick in range(round(scene.seconds * RATE)):
        while messages and messages[0].stamp <= tick / RATE + 1e-9:
            table.update(*messages.pop(0))
        verdicts.append(monitor.step(tick / RATE, *scene.sample(tick / RATE)))
    one = make()
    one.run(scene.seconds)
    track = one.track
    assert track.level.tolist() == [verdict.level for verdict in verdicts[1:]]
    assert track.contact_time.tolist() == [verdict.contact_time for verdict in verdicts[1:]]
    assert track.evaluated.tolist() == [verdict.evaluated for verdict in verdicts[1:]]
    assert (track.spent > 0.0).all()
    assert len(one.intake) == len(scene.messages) - len(messages)


def test_turns_make_no_difference():
    at_once, in_turns = make(), make()
    at_once.run(1.0)
    for until in np.linspace(0.0, 1.0, 30):
        in_turns.run(until)
        assert in_turns.begun == pytest.approx(until)
    for field in ("time", "level", "contact_time", "pace"):
        assert (getattr(at_once.track, field) == getattr(in_turns.track, field)).all()


def test_what_cannot_be_made_says_why():
    with pytest.raises(ArmguardError, match="budget"):
        make(Rung("schedule", "full", {"schedule": "full"}), budget=5)


def test_the_papers_schedule_is_made_for_the_rate_of_its_setting():
    for law in (1, 2):
        schedule = make(AXES["schedule"][law]).monitor.settings.schedule
        assert (schedule.law, schedule.period) == (("powers", "fibonacci")[law - 1], 1.0 / RATE)
