import numpy as np
import pinocchio
import pytest

from armguard.bounds import (
    BrakingMotion,
    IsotropicMotion,
    JointMotion,
    ReachMotion,
    levers,
)
from armguard.bounds.arm import ArmMotion
from armguard.robot import Robot
from support.panda_monitor import HOME, panda

V = np.full(7, 0.3)
BASE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -1.0, 2.0), np.array([3.0, -2.0, 1.0]))


@pytest.mark.parametrize("base", [None, BASE])
def test_each_model_is_what_it_is_alone(base):
    robot = panda()
    motion = ArmMotion(robot, 0.05, base)
    alone = {
        "reach": ReachMotion(robot, base),
        "isotropic": IsotropicMotion(robot, base),
        "joint": JointMotion(robot, base),
        "braking": BrakingMotion(robot, 0.05, base),
    }
    point, direction = np.array([0.02, 0.0, 0.05]), np.array([0.6, 0.0, 0.8])
    for name, model in alone.items():
        together = getattr(motion, name)
        for link in robot.links:
            for t in (0.0, 0.03, 0.4):
                question = HOME, V, link, point, direction, t
                assert together.advance(*question) == model.advance(*question)
    assert motion.braking.stop_time(HOME, V, 0.0, 0.003) > 0.05


def test_levers_are_computed_once_for_all_models(monkeypatch):
    computed = []
    walk = levers._walk_inwards
    monkeypatch.setattr(levers, "_walk_inwards", lambda *given: computed.append(0) or walk(*given))
    robot = Robot.load("xarm7")
    ArmMotion(robot, 0.02, with_plans=True)
    # Beside those of all spheres, reach asks for those of the leaves.
    assert len(computed) <= 2 * len(robot.links)


def test_tables_are_those_that_are_filled_tick_by_tick():
    motion = ArmMotion(panda(), 0.02)
    assert motion.table is motion.joint.tabulate(HOME, V, 0.0)
    assert motion.braking_table is motion.braking.tabulate(HOME, V, 0.0, 0.003)
