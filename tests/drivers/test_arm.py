from armguard.drivers.arm import Arm, Program
from armguard.drivers.ur import _PROGRAMS, UrArm


def test_every_state_of_a_program_is_one_that_the_robot_can_tell():
    assert set(_PROGRAMS.values()) == set(Program)


def test_the_drivers_have_all_that_an_arm_can_be_asked():
    asked = {name for name in vars(Arm) if not name.startswith("_")}
    assert asked <= set(vars(UrArm))
