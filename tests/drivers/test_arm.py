from armguard.drivers.arm import MotionArm, Program, ProgramArm
from armguard.drivers.ur import _PROGRAMS, UrMotionArm, UrProgramArm


def test_every_state_of_a_program_is_one_that_the_robot_can_tell():
    assert set(_PROGRAMS.values()) == set(Program)


def test_the_drivers_have_all_that_an_arm_can_be_asked():
    for kind, asked in ((UrProgramArm, ProgramArm), (UrMotionArm, MotionArm)):
        names = {name for name in dir(asked) if not name.startswith("_")}
        assert names >= {"read", "leave"}
        assert names <= set(dir(kind))
