import numpy as np
import pytest

from armguard.bounds import IsotropicMotion, JointMotion
from armguard.bounds.arm import ArmMotion
from armguard.obstacles import Obstacles
from armguard.pairs.evaluate import TickState
from armguard.robot import Kinematics
from support.panda_monitor import HOME, panda
from support.tick_states import begin_tick

KINEMATICS = Kinematics(panda())
SPHERES = KINEMATICS.spheres
TABLE = ("high", "low", "highest", "lowest")


@pytest.mark.parametrize("with_joints", [False, True])
@pytest.mark.parametrize("age", [0.0, 0.01, -0.004])
def test_the_arm_is_prepared_as_its_models_say(with_joints, age):
    rng, robot = np.random.default_rng(0), panda()
    v = rng.uniform(-0.5, 0.5, 7) * robot.velocity_limit
    motion = ArmMotion(robot, 0.02, with_joints=with_joints)
    state = TickState(KINEMATICS, motion, Obstacles(), margin=0.0)
    for name in TABLE:
        getattr(motion.table, name)[...] = 7.0
    begin_tick(state, 0.0, age, 0.0)
    KINEMATICS.place(HOME)
    state.prepare_arm(HOME, v)
    other = Kinematics(robot)
    other.compute(HOME, v)
    assert state.scene.arm.centers == pytest.approx(other.centers, abs=1e-12)
    assert state.scene.arm.velocities == pytest.approx(other.velocities, abs=1e-12)
    isotropic, joint = IsotropicMotion(robot), JointMotion(robot)
    isotropic.update(v)
    assert np.array_equal(state.scene.arm.velocity_error, isotropic.velocity_error)
    expected = joint.tabulate(HOME, v, age)
    for name in TABLE:
        filled = getattr(state.scene.table, name)
        assert (
            np.array_equal(filled, getattr(expected, name)) if with_joints else (filled == 7).all()
        )
