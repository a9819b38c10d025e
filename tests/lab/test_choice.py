"""What is chosen is cheap, says what the finest says, and leaves nothing out."""

import functools

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab import choice
from armguard.monitor import Monitor, TrialTick
from armguard.obstacles import Obstacles
from armguard.scheduling import DaaSchedule
from support.panda_monitor import HOME, STILL, panda, see
from support.trials import RATE, lead, make_auto, make_robot, make_trial

FAR = functools.partial(make_trial, nearest=20.0, farthest=21.0)
FINEST = {"schedule": "full"}


@pytest.fixture(scope="module")
def near():
    return make_auto()


def test_states_that_were_not_tried_are_judged_as_by_the_finest(near):
    other = make_trial(1.0, -0.8)
    settings = {"rate": RATE, "operating": "published"}
    said = lead(make_auto(), other)
    finest = lead(Monitor(make_robot(), Obstacles(), **settings, **FINEST), other)
    levels = np.array([[one.level for one in verdicts] for verdicts in (said, finest)])
    assert len(set(levels[1].tolist())) >= 3, "else this would show nothing"
    assert (levels[0] == levels[1]).mean() >= 0.97
    evaluated = [sum(one.evaluated for one in verdicts) for verdicts in (said, finest)]
    # The ball is faster than its bound for a while: each state that may be true is evaluated.
    assert evaluated[0] < 0.6 * evaluated[1]
    assert near.choice.is_same
    assert near.choice.same_level >= choice.SAME_LEVEL
    assert 0.0 < near.choice.price < 1.0


def test_the_same_trial_gives_the_same_choice(near):
    assert make_auto().choice == near.choice


def test_a_farther_obstacle_requires_less(near):
    farther = make_auto(make_trial(1.8)).choice
    assert farther.settings["max_staleness"] > near.choice.settings["max_staleness"]
    assert farther.evaluated < 0.5 * near.choice.evaluated
    assert farther.is_same
    assert farther.settings["budget"] == choice.LEAST_BUDGET


def test_every_link_is_watched_and_those_out_of_reach_are_told(near):
    far = make_auto(FAR())
    assert far.choice.out_of_reach == far.robot.links == panda().links
    assert not set(near.choice.out_of_reach) & {"panda_hand", "panda_link7"}
    assert near.choice.reasons[2].startswith("all links are watched")
    # Whatever was out of reach in the trial is found as soon as it is not.
    stop_time = lead(far, make_trial(0.3)[:150])[-1].stop_time
    link, soon = far.robot.links[0], stop_time + far.settings.aware_margin
    assert any(pair.link == link and pair.contact_time < soon for pair in far.pairs())


def test_what_is_given_stands():
    given = {"motion": "isotropic", "max_staleness": 0.3, "budget": None}
    robot = make_robot()
    cover = robot.cover
    monitor = make_auto(make_trial(2.0), robot=robot, keeps_cover=True, **given)
    assert {name: getattr(monitor.settings, name) for name in given} == given
    assert robot.cover is cover
    assert monitor.choice.settings == {}
    assert monitor.choice.level is None
    first = monitor.choice.reasons[0]
    assert first.endswith("motion and max_staleness and budget as given")
    assert make_auto(FAR()[:20], budget=50).settings.budget == 50


def test_nothing_of_the_trial_is_left():
    robot, obstacles = make_robot(), Obstacles()
    obstacles.add_static("post", [9.0, 0.0, 0.5], 0.1)
    monitor = make_auto(robot=robot, obstacles=obstacles)
    assert monitor.ticks == 0
    assert len(obstacles) == 1
    assert obstacles.is_untouched
    assert monitor.robot is robot
    assert monitor.obstacles is obstacles
    told = monitor.choice
    deepest = max(robot.cover.levels(link) for link in robot.links)
    whole = max(panda().cover.levels(link) for link in robot.links)
    assert deepest == (whole if told.level is None else told.level + 1)
    assert monitor.settings.budget == told.settings["budget"] >= choice.ROOM * told.evaluated_max
    assert Monitor(robot, Obstacles()).choice is None


@pytest.mark.parametrize(
    ("trial", "sources", "level"), [(make_trial()[:60], ["silent"], "STOP"), (FAR(), None, "CLEAR")]
)
def test_a_trial_of_one_level_shows_nothing(trial, sources, level):
    told = make_auto(trial, obstacles=Obstacles(sources=sources)).choice
    usual = {"motion": "joint", "max_staleness": 0.1, "budget": None}
    assert (told.settings, told.level) == (usual, None)
    assert told.summary[1].endswith(f"ticks, is nothing but {level}")


def test_where_nothing_is_as_good_the_nearest_is_chosen(monkeypatch):
    monkeypatch.setattr(choice, "SAME_LEVEL", 1.5)
    told = make_auto().choice
    assert not told.is_same
    assert told.same_level > 0.98
    assert told.summary[1].startswith("is the nearest that was found to the finest")
    assert told.settings["max_staleness"] <= 0.05


def test_a_scale_that_differs_is_told_from_the_finest(monkeypatch, near):
    monkeypatch.setattr(choice, "SAME_SCALE", -1.0)
    assert not make_auto().choice.is_same
    assert near.choice.scale_difference <= 0.01


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trial": []}, "trial: has no ticks"),
        ({"trial": 5}, "trial: has no ticks: 5; expected joint states"),
        ({"trial": [None]}, r"trial\[0\]: is a NoneType; expected .* each a TrialTick"),
        ({"trial": [(0.0, HOME, STILL)]}, r"trial\[0\]: is a tuple"),
        (
            {"trial": [TrialTick(0.0, HOME, STILL, tell=5)]},
            r"trial\[0\]: is a TrialTick; expected .* its `tell`",
        ),
        ({"schedule": "full"}, "schedule: is 'full'; expected \"deadline\""),
        ({"schedule": DaaSchedule(0.005, "powers")}, "schedule: is one of the application's own"),
        ({"rate": -1.0}, "rate: is -1"),
        ({"motion": "sideways"}, "motion: is 'sideways'"),
    ],
)
def test_what_cannot_be_tried_is_refused(changes, words):
    with pytest.raises(ArmguardError, match=words):
        make_auto(**changes)


def test_a_table_that_was_told_already_is_refused():
    obstacles = Obstacles()
    see(obstacles, 0.0, [2.0, 0.0, 0.5])
    with pytest.raises(ArmguardError, match="obstacles: are in the table already"):
        make_auto(obstacles=obstacles)
