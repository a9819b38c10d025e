import math

import numpy as np
import pytest

from armguard import ContactLimit, ContactLimits
from armguard.exceptions import ArmguardError
from armguard.scheduling import make_schedule
from armguard.settings import Settings

AMOUNTS = (
    "reaction_time",
    "latency",
    "slow_margin",
    "aware_margin",
    "rise_delay",
    "source_timeout",
)


def test_usual_settings_and_what_follows_from_them():
    usual = Settings(rate=500.0, latency=0.004, reaction_time=0.03)
    assert (usual.period, usual.response_time) == (0.002, 0.002 + 0.004)
    assert usual.braking_delay == 0.002 + 0.004 + 0.03
    assert (usual.schedule, usual.motion, usual.budget) == ("deadline", "joint", None)
    assert usual.by_deadline
    assert usual.with_joints
    # At least 100 ms, and five ticks of a slow loop.
    assert usual.longest_joint_step == 0.1
    assert Settings(rate=20.0).longest_joint_step == pytest.approx(0.25)
    assert Settings(joint_timeout=0.0).longest_joint_step == 0.0


def test_free_bodies_have_no_contact_limits():
    limits = ContactLimits({"hand": ContactLimit(speed=0.5, source="assumed")})
    for motion in ("joint", "planned"):
        assert Settings(motion=motion, contact_limits=limits).contact_limits == limits
    with pytest.raises(ArmguardError, match=r"^contact_limits: .*isotropic.*; free bodies may"):
        Settings(motion="isotropic", contact_limits=limits)


def test_joint_bounds_are_left_out_where_they_are_not_wanted():
    assert not Settings(motion="isotropic").with_joints
    assert Settings(schedule="full").with_joints
    own = make_schedule("daa", 0.002)
    assert Settings(schedule=own).schedule is own


@pytest.mark.parametrize("name", [*AMOUNTS, "margin", "joint_timeout"])
def test_durations_and_lengths_are_finite_and_not_negative(name):
    for value in (0, 0.0, 5, 1e300, np.float64(0.1)):
        assert getattr(Settings(**{name: value}), name) == value
    for wrong in (-1e-300, -1, math.inf, math.nan, "0", True, [1.0]):
        with pytest.raises(ArmguardError, match=name):
            Settings(**{name: wrong})


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("rate", [0.0, -1.0, math.inf, math.nan, None, "1000", True]),
        ("max_staleness", [-0.1, 1.0, math.nan, None, True]),
        ("motion", ["hope", "", None, 3, "Joint", ["joint"], np.array(["joint"])]),
        ("leave", ["any", "later", None, 3]),  # without plans there is nothing to leave
        ("schedule", ["sometimes", None, 3]),
        ("base_placement", [np.eye(4), "here", 1.0]),
        ("ignore", [None, 3]),
        ("contact_limits", [{"hand": 0.5}, 0.5]),
        ("operating", ["fast", 1.0]),
        ("payload", [-1.0, math.nan, "1"]),
        ("separation", [1.6, {}]),
        ("certify", [None, 1, "yes"]),
        ("budget", [0, -1, 1.0, math.inf, True, "5", [5]]),
    ],
)
def test_whatever_makes_no_sense_is_refused_by_name(name, wrong):
    for value in wrong:
        with pytest.raises(ArmguardError, match=name) as caught:
            Settings(**{name: value})
        assert caught.value.offender == name
        assert caught.value.expected


def test_a_budget_is_for_deadlines_alone():
    assert Settings(budget=np.int32(5)).budget == 5
    assert type(Settings(budget=np.int32(5)).budget) is int
    # Larger than compiled code can count: no limit then.
    assert Settings(budget=10**30).budget == 2**62
    with pytest.raises(ArmguardError, match="deadline"):
        Settings(budget=5, schedule="full")


def test_pairs_to_ignore_that_come_from_an_iterator_are_kept_for_every_monitor():
    pairs = [("panda_hand", "table"), ("panda_hand", "part*", "camera")]
    settings = Settings(ignore=iter(pairs))
    assert [list(settings.ignore) for _ in range(2)] == [pairs, pairs]
