import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.tradeoff.ladder import (
    AUTO,
    AXES,
    DEFAULT,
    FINEST,
    OPERATING,
    check_axes,
    list_settings,
)
from armguard.robot import Robot
from armguard.robot.operating_limits import OperatingLimits
from support.panda_monitor import ranged_panda


def names(axes, **usual):
    return [one.name for one in list_settings(axes, ranged_panda().cover, usual)]


def test_axes_are_checked_and_put_in_order():
    assert check_axes([]) == [*AXES, AUTO]
    assert check_axes([AUTO, "cover"]) == ["cover", AUTO]
    assert check_axes(["budget", "cover"]) == ["cover", "budget"]
    with pytest.raises(
        ArmguardError, match=r"--axis: 'colour' is no axis; expected some of operating, cover"
    ):
        check_axes(["cover", "colour"])


def test_one_axis_at_a_time_around_the_default():
    settings = list_settings(AXES, ranged_panda().cover, {})
    assert [one.name for one in settings[:2]] == [DEFAULT, FINEST]
    assert settings[0].rungs == ()
    assert all(len(one.rungs) == 1 and one.axis == one.rungs[0].axis for one in settings[2:])
    assert {one.axis for one in settings[2:]} == set(AXES)
    assert all(one.is_choice == (one.axis != OPERATING) for one in settings)
    assert settings[1].monitor({}) == {"schedule": "full"}
    assert len({one.name for one in settings}) == len(settings)
    assert "cover 10 mm" in map(str, settings[1].rungs)
    _, finest, *_ = list_settings(AXES, Robot.load("ur10").cover, {})
    assert "cover 10 mm" not in map(str, finest.rungs), "to fit it would take many minutes"


def test_levels_beyond_the_tree_and_what_the_default_is_anyway_are_left_out():
    assert [name for name in names(["cover"]) if "level" in name] == [
        f"cover level {level}" for level in range(3)
    ]
    assert "rate 500 Hz" not in names(["rate"], rate=500.0)
    assert "motion planned" not in names(["motion"], motion="planned")


def test_operating_limits_are_stated_where_none_are_and_left_out_where_some_are():
    assert names([OPERATING])[2:] == names([OPERATING], operating=None)[2:]
    assert names([OPERATING])[2:] == ["operating published"]
    stated = OperatingLimits(velocity=0.5)
    assert names([OPERATING], operating=stated)[2:] == ["operating none"]


def test_the_finest_has_no_budget():
    _, finest, *_ = list_settings([], ranged_panda().cover, {"budget": 5})
    assert finest.monitor({"budget": 5}) == {"budget": None, "schedule": "full"}
