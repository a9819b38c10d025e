import pytest

from armguard.monitor_arguments import read_settings
from armguard.obstacles import Obstacles
from armguard.pairs.arm import IgnoredPairs
from armguard.robot import JointStates
from armguard.scheduling import SCHEDULES, make_schedule
from armguard.scheduling.deadline import ObstacleWatch
from armguard.scheduling.pair_scheduler import PairWatch
from armguard.watches import make_watch
from support.panda_monitor import panda

AMOUNTS = ("reaction_time", "latency", "slow_margin", "aware_margin", "hold", "source_timeout")


def make(**changes):
    usual = dict.fromkeys((*AMOUNTS, "margin"), 0.01) | {
        "rate": 1000.0,
        "schedule": "deadline",
        "motion": "joint",
        "joint_timeout": None,
        "freshness": 0.25,
        "budget": None,
        "base_placement": None,
    }
    ignored = IgnoredPairs([("panda_hand", "*")], panda())
    obstacles = Obstacles(sources=[])
    obstacles.add_static("post", [1.0, 0.0, 0.0], 0.1)
    states = JointStates(panda(), 0.05)
    settings = read_settings(panda(), obstacles, **usual | changes)
    return make_watch(panda(), obstacles, settings, ignored, states)


def test_obstacles_by_their_deadlines_unless_a_schedule_of_pairs_is_asked_for():
    assert isinstance(make(), ObstacleWatch)
    for name in set(SCHEDULES) - {"deadline"}:
        assert isinstance(make(schedule=name), PairWatch)
    own = make_schedule("daa", 0.001)
    assert make(schedule=own).schedule is own


@pytest.mark.parametrize("schedule", ["deadline", "full", "distance"])
@pytest.mark.parametrize("motion", ["isotropic", "joint", "planned"])
def test_the_arm_is_as_cautious_as_the_settings_say(schedule, motion):
    arm = make(schedule=schedule, motion=motion, margin=0.07, reaction_time=0.123).arm
    settings = arm.state.scene.settings
    assert settings.margin == 0.07
    assert arm.motion.braking.reaction_time == 0.123
    assert settings.by_distance == (schedule == "distance")
    assert settings.with_joints == (motion != "isotropic" and schedule != "distance")
    assert (arm.motion.planned is None) == (motion != "planned")
    watched = arm.watched_links(arm.obstacles.row("post"))
    assert watched.sum() == len(arm.links) - 1
