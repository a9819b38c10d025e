import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.monitor.settings import make_scheduler
from armguard.obstacles import Obstacles
from armguard.pairs.ignored import IgnoredPairs
from armguard.robot import JointStates
from armguard.robot.operating_limits import LimitsInForce
from armguard.scheduling import SCHEDULES, make_schedule
from armguard.scheduling.pair_scheduler import PairScheduler
from armguard.scheduling.scheduler import Scheduler
from armguard.settings import Settings
from support.panda_monitor import panda


@pytest.mark.parametrize("given", [{"stop": "path"}, {"path_deceleration": 2.0}, {"advances": 8}])
def test_settings_of_earlier_versions_say_what_replaces_them(given):
    with pytest.raises(
        ArmguardError, match=r"no setting any more.*(commits pieces|leave it out)"
    ) as caught:
        Monitor(panda(), Obstacles(), motion="planned", **given)
    assert caught.value.offender == next(iter(given))
    with pytest.raises(TypeError, match="'speed'"):
        Monitor(panda(), Obstacles(), speed=1.0)


def test_a_monitor_of_nothing_is_refused_before_anything_is_made():
    for robot, obstacles, missing in ((None, Obstacles(), "robot"), (panda(), None, "obstacles")):
        with pytest.raises(ArmguardError, match=f"^{missing}: is None; expected an armguard"):
            Monitor(robot, obstacles)


def test_a_record_and_its_keywords_make_the_same_monitor():
    by_record = Monitor(panda(), Obstacles(), Settings(rate=500.0, margin=0.01))
    by_keywords = Monitor(panda(), Obstacles(), rate=500.0, margin=0.01)
    assert by_record.settings == by_keywords.settings
    with pytest.raises(TypeError, match="not as both"):
        Monitor(panda(), Obstacles(), Settings(), margin=0.01)
    with pytest.raises(ArmguardError, match=r"settings: is 500\.0; expected an armguard\.Settings"):
        Monitor(panda(), Obstacles(), 500.0)


def test_a_monitor_leaves_nothing_open_that_its_robot_decides():
    settings = Monitor(panda(), Obstacles(), ignore=[["panda_hand", "post"]]).settings
    assert settings.base_placement == pinocchio.SE3.Identity()
    assert settings.payload == panda().brakes.most_payload
    assert settings.operating is None
    assert settings.ignore == (("panda_hand", "post"),)


def make(**changes):
    ignored = IgnoredPairs([("panda_hand", "*")], panda())
    obstacles = Obstacles(sources=[])
    obstacles.add_static("post", [1.0, 0.0, 0.0], 0.1)
    states = JointStates(panda(), 0.05)
    in_force = LimitsInForce(panda(), None)
    return make_scheduler(panda(), obstacles, Settings(**changes), ignored, states, in_force)


def test_obstacles_by_their_deadlines_unless_a_schedule_of_pairs_is_asked_for():
    assert type(make()) is Scheduler
    for name in set(SCHEDULES) - {"deadline"}:
        assert isinstance(make(schedule=name), PairScheduler)
    own = make_schedule("daa", 0.001)
    assert make(schedule=own).schedule is own


@pytest.mark.parametrize("schedule", ["deadline", "full"])
@pytest.mark.parametrize("motion", ["isotropic", "joint", "planned"])
def test_the_arm_is_as_cautious_as_the_settings_say(schedule, motion):
    arm = make(schedule=schedule, motion=motion, margin=0.07, reaction_time=0.123).arm
    settings = arm.state.scene.settings
    assert settings.margin == 0.07
    assert arm.motion.braking.reaction_time == 0.123
    assert settings.with_joints == (motion != "isotropic")
    assert (arm.motion.planned is None) == (motion != "planned")
    watched = arm.watched_links(arm.obstacles.row("post"))
    assert watched.sum() == len(arm.links) - 1
