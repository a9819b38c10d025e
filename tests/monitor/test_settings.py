import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.monitor.settings import make_scheduler, read_limit, read_number, read_settings
from armguard.obstacles import Obstacles
from armguard.pairs.ignored import IgnoredPairs
from armguard.robot import JointStates, Robot
from armguard.robot.operating_limits import LimitsInForce
from armguard.scheduling import SCHEDULES, make_schedule
from armguard.scheduling.deadline import DeadlineScheduler
from armguard.scheduling.pair_scheduler import PairScheduler
from support.panda_monitor import panda


@pytest.mark.parametrize("value", [0, -3, 2.5, 10**30, math.inf, np.float32(0.5), np.int8(7)])
def test_numbers_are_read_as_what_they_are(value):
    assert read_number(value) == float(value)
    assert type(read_number(value)) is float


@pytest.mark.parametrize(
    "value",
    [
        None,
        "1",
        b"1",
        True,
        np.bool_(True),
        1j,
        [1.0],
        np.ones(1),
        Decimal(1),
        Fraction(1, 2),
        math.nan,
        10**400,
        -(10**400),
        pytest.param(object(), id="object"),
    ],
    ids=repr,
)
def test_whatever_else_there_is_is_none(value):
    assert math.isnan(read_number(value))


@pytest.mark.parametrize("given", [{"stop": "path"}, {"path_deceleration": 2.0}, {"advances": 8}])
def test_settings_of_earlier_versions_say_what_replaces_them(given):
    with pytest.raises(
        ArmguardError, match=r"no setting any more.*(commits pieces|leave it out)"
    ) as caught:
        Monitor(panda(), Obstacles(), motion="planned", **given)
    assert caught.value.offender == next(iter(given))
    with pytest.raises(TypeError, match="'speed'"):
        Monitor(panda(), Obstacles(), speed=1.0)


class Refusing(float):
    """A number that will not be read."""

    def __float__(self):
        raise ValueError("no")


class Nameless:
    """What will not even say what it is, as a proxy of something gone."""

    @property
    def __class__(self):
        raise ReferenceError("gone")


def test_what_raises_when_it_is_read_is_no_number():
    for value in (Refusing(1.0), Nameless()):
        assert math.isnan(read_number(value))


AMOUNTS = (
    "reaction_time",
    "latency",
    "slow_margin",
    "aware_margin",
    "rise_delay",
    "source_timeout",
)


def settings(**changes):
    usual = dict.fromkeys((*AMOUNTS, "margin"), 0.01) | {
        "rate": 500.0,
        "schedule": "deadline",
        "motion": "joint",
        "joint_timeout": None,
        "max_staleness": 0.25,
        "budget": None,
        "base_placement": None,
    }
    made = {"robot": panda(), "obstacles": Obstacles()}
    return read_settings(**made | usual | changes)


def test_usual_settings_and_what_follows_from_them():
    usual = settings(latency=0.004)
    assert (usual.period, usual.response_time) == (0.002, 0.002 + 0.004)
    assert (usual.schedule, usual.motion, usual.budget) == (None, "joint", None)
    assert usual.with_joints
    assert usual.base_placement == pinocchio.SE3.Identity()
    assert [getattr(usual, name) for name in AMOUNTS[2:]] == [0.01] * 4
    # At least 50 ms, and five ticks of a slow loop.
    assert usual.joint_timeout == 0.1
    assert settings(rate=20.0).joint_timeout == pytest.approx(0.25)
    assert settings(joint_timeout=0.0).joint_timeout == 0.0


def test_joint_bounds_are_left_out_where_they_are_not_wanted():
    assert not settings(motion="isotropic").with_joints
    assert not settings(schedule="distance").with_joints
    assert settings(schedule="full").with_joints
    own = make_schedule("daa", 0.002)
    assert settings(schedule=own).schedule is own


@pytest.mark.parametrize("name", [*AMOUNTS, "margin", "joint_timeout"])
def test_durations_and_lengths_are_finite_and_not_negative(name):
    for value in (0, 0.0, 5, 1e300, np.float64(0.1)):
        assert getattr(settings(**{name: value}), name) == value
    for wrong in (-1e-300, -1, math.inf, math.nan, "0", True, [1.0]):
        with pytest.raises(ArmguardError, match=name):
            settings(**{name: wrong})


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("robot", [None, "panda", Robot, Obstacles()]),
        ("obstacles", [None, [], Obstacles, panda()]),
        ("rate", [0.0, -1.0, math.inf, math.nan, None, "1000", True]),
        ("max_staleness", [-0.1, 1.0, math.nan, None, True]),
        ("motion", ["hope", "", None, 3, "Joint", ["joint"], np.array(["joint"])]),
        ("leave", ["any", "later", None, 3]),  # without plans there is nothing to leave
        ("schedule", ["sometimes", None, 3]),
        ("base_placement", [np.eye(4), "here", 1.0]),
        ("budget", [0, -1, 1.0, math.inf, True, "5", [5]]),
    ],
)
def test_whatever_makes_no_sense_is_refused_by_name(name, wrong):
    for value in wrong:
        with pytest.raises(ArmguardError, match=name) as caught:
            settings(**{name: value})
        assert caught.value.offender == name
        assert caught.value.expected


def test_a_monitor_of_nothing_is_refused_before_anything_is_made():
    for robot, obstacles, missing in ((None, Obstacles(), "robot"), (panda(), None, "obstacles")):
        with pytest.raises(ArmguardError, match=f"^{missing}: is None; expected an armguard"):
            Monitor(robot, obstacles)


def test_a_limit_is_a_whole_number():
    for given, meant in ((5, 5), (0, 0), (-3, 0), (np.int8(127), 127), (10**30, 10**30)):
        assert read_limit("limit", given) == meant
        assert type(read_limit("limit", given)) is int
    for wrong in (None, "5", "x", 1.5, 2.0, math.inf, True, np.float64(3.0), [5]):
        with pytest.raises(ArmguardError, match=r"limit: is .*expected a whole number"):
            read_limit("limit", wrong)


def test_a_budget_is_for_deadlines_alone():
    assert settings(budget=np.int32(5)).budget == 5
    assert type(settings(budget=np.int32(5)).budget) is int
    # Larger than compiled code can count: no limit then.
    assert settings(budget=10**30).budget == 2**62
    with pytest.raises(ArmguardError, match="deadline"):
        settings(budget=5, schedule="full")


def make(**changes):
    usual = dict.fromkeys((*AMOUNTS, "margin"), 0.01) | {
        "rate": 1000.0,
        "schedule": "deadline",
        "motion": "joint",
        "joint_timeout": None,
        "max_staleness": 0.25,
        "budget": None,
        "base_placement": None,
    }
    ignored = IgnoredPairs([("panda_hand", "*")], panda())
    obstacles = Obstacles(sources=[])
    obstacles.add_static("post", [1.0, 0.0, 0.0], 0.1)
    states = JointStates(panda(), 0.05)
    settings = read_settings(panda(), obstacles, **usual | changes)
    in_force = LimitsInForce(panda(), None)
    return make_scheduler(panda(), obstacles, settings, ignored, states, in_force)


def test_obstacles_by_their_deadlines_unless_a_schedule_of_pairs_is_asked_for():
    assert isinstance(make(), DeadlineScheduler)
    for name in set(SCHEDULES) - {"deadline"}:
        assert isinstance(make(schedule=name), PairScheduler)
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
