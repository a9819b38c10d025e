"""What users may state, and what is refused, by name."""

from types import SimpleNamespace

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.robot.operating_limits import (
    LimitsInForce,
    OperatingLimits,
    put_in_force,
    read_operating,
)
from support.motion_questions import altered
from support.panda_monitor import panda


def test_one_number_is_for_all_joints_and_what_is_left_out_is_the_hardware_s():
    velocity, acceleration = OperatingLimits(velocity=0.5).resolve(panda())
    assert (velocity == 0.5).all()
    np.testing.assert_array_equal(acceleration, panda().acceleration_limit)
    each = np.linspace(0.1, 0.7, 7)
    velocity, acceleration = OperatingLimits(each, 2).resolve(panda())
    np.testing.assert_array_equal(velocity, each)
    assert (acceleration == 2.0).all()


def test_a_fraction_is_one_of_each_joint_s_limit():
    limits = OperatingLimits.fraction(panda(), velocity=0.3, acceleration=0.2)
    velocity, acceleration = limits.resolve(panda())
    np.testing.assert_allclose(velocity, 0.3 * panda().velocity_limit)
    np.testing.assert_allclose(acceleration, 0.2 * panda().acceleration_limit)
    whole = OperatingLimits.fraction(panda()).resolve(panda())
    np.testing.assert_array_equal(whole[0], panda().velocity_limit)
    np.testing.assert_array_equal(whole[1], panda().acceleration_limit)


BAD = [0.0, -1.0, np.nan, np.inf, [1.0, 0.0], [1.0, np.nan], "1", None, True, [], [[1.0]], 1j, {}]


@pytest.mark.parametrize("bad", [one for one in BAD if one is not None])
@pytest.mark.parametrize("name", ["velocity", "acceleration"])
def test_what_is_no_number_above_0_is_refused_by_name(name, bad):
    with pytest.raises(ArmguardError, match=f"operating {name}"):
        OperatingLimits(**{name: bad})


def test_masked_and_hostile_values_are_refused():
    class Hostile:
        def __array__(self, *_, **__):
            raise ValueError

    for bad in (np.ma.MaskedArray([1.0] * 7, [True] * 7), Hostile()):
        with pytest.raises(ArmguardError, match="operating velocity"):
            OperatingLimits(velocity=bad)


def test_no_limits_are_refused():
    with pytest.raises(ArmguardError, match="neither"):
        OperatingLimits()


@pytest.mark.parametrize("bad", [0.0, -0.1, 1.0 + 1e-9, np.nan, "half", [0.5] * 7, None])
def test_fractions_are_numbers_up_to_1(bad):
    with pytest.raises(ArmguardError, match="operating velocity"):
        OperatingLimits.fraction(panda(), velocity=bad)
    with pytest.raises(ArmguardError, match="operating acceleration"):
        OperatingLimits.fraction(panda(), acceleration=bad)


def test_limits_above_the_robot_s_are_refused_by_joint():
    velocity = 0.5 * panda().velocity_limit
    velocity[3] = np.nextafter(panda().velocity_limit[3], np.inf)
    with pytest.raises(ArmguardError, match="operating velocity of joint 'panda_joint4'"):
        OperatingLimits(velocity=velocity).resolve(panda())
    with pytest.raises(ArmguardError, match="operating acceleration of joint 'panda_joint1'"):
        OperatingLimits(acceleration=1e3).resolve(panda())
    with pytest.raises(ArmguardError, match="has 6 values"):
        OperatingLimits(velocity=[0.1] * 6).resolve(panda())


def test_published_limits_count_when_asked_for_and_are_missed_clearly():
    published = panda().published_operating_limits
    velocity, acceleration = OperatingLimits.published(panda()).resolve(panda())
    np.testing.assert_array_equal(velocity, published.velocity)
    np.testing.assert_array_equal(acceleration, published.acceleration)
    figures = SimpleNamespace(velocity=np.full(7, 1.0), acceleration=np.full(7, 2.0), source="x")
    robot = altered(panda(), published_operating_limits=figures)
    for limits in (OperatingLimits.published(robot), read_operating(robot, "published")):
        assert (limits.resolve(robot)[1] == 2.0).all()
    with pytest.raises(ArmguardError, match="not published"):
        read_operating(altered(panda(), published_operating_limits=None), "published")


@pytest.mark.parametrize("bad", ["publish", 0.3, {"velocity": 1.0}, [1.0]])
def test_something_else_is_refused(bad):
    with pytest.raises(ArmguardError, match="operating"):
        read_operating(panda(), bad)


def test_limits_in_force_change_in_place():
    in_force = LimitsInForce(panda(), OperatingLimits(velocity=0.5, acceleration=1.0))
    velocity, acceleration = in_force.velocity, in_force.acceleration
    assert (velocity == 0.5).all()
    assert (acceleration == 1.0).all()
    in_force.suspend()
    assert in_force.is_suspended
    np.testing.assert_array_equal(velocity, panda().velocity_limit)
    np.testing.assert_array_equal(acceleration, panda().acceleration_limit)
    in_force.resume()
    assert not in_force.is_suspended
    assert (velocity == 0.5).all()
    assert (acceleration == 1.0).all()
    assert in_force.revision == 2
    assert put_in_force(panda(), in_force) is in_force
    np.testing.assert_array_equal(put_in_force(panda(), None).velocity, panda().velocity_limit)
