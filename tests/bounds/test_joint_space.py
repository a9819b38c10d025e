import numpy as np
import pinocchio
import pytest

from armguard.bounds.joint_space import GRID_STEP, grid
from armguard.exceptions import ArmguardError
from armguard.robot import Kinematics
from support.hostile_joints import random_state

READY = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0])


def test_the_grid_is_as_dense_as_displacements_need():
    times = grid(40)
    assert times[0] == 0.0
    assert (np.diff(times) > 0.0).all()
    # What grows like t² grows by no more than twice its root from node to node.
    assert np.diff(np.sqrt(times)) == pytest.approx(np.sqrt(GRID_STEP))


@pytest.mark.parametrize("name", ["joint", "braking"])
def test_no_measured_place_is_off_by_more_than_said(robot, models, name):
    model, random = models[name], np.random.default_rng(0)
    true, measured = Kinematics(robot), Kinematics(robot)
    largest = 0.0
    for _ in range(200):
        q, v = random_state(robot, random)
        true.compute(q, v)
        measured.compute(q + random.choice([-1.0, 1.0], len(q)) * robot.position_error, v)
        off = np.linalg.norm(true.centers - measured.centers, axis=1)
        assert (off <= model.position_error).all()
        largest = max(largest, (off / model.position_error).max())
    assert largest > 0.5


@pytest.mark.parametrize("name", ["joint", "braking"])
def test_no_slope_is_off_by_more_than_said(robot, models, name):
    model, random = models[name], np.random.default_rng(1)
    data, spheres = robot.model.createData(), Kinematics(robot).spheres
    chosen = random.integers(len(spheres), size=10)

    def slopes(q):
        jacobian = pinocchio.computeJointJacobians(robot.model, data, q)
        places = [data.oMi[int(spheres.joint[i])].act(spheres.local[i]) for i in chosen]
        moved = model.lever[chosen] > 0.0
        columns = [jacobian[:3] + np.cross(jacobian[3:].T, place).T for place in places]
        return np.array(columns) * moved[:, None, :]

    for _ in range(50):
        q, _ = random_state(robot, random)
        wrong = q + random.choice([-1.0, 1.0], len(q)) * robot.position_error
        off = np.linalg.norm(slopes(q) - slopes(wrong), axis=1)
        assert (off <= model.slope_error[chosen] + 1e-12).all()


@pytest.mark.parametrize(
    ("q", "v", "age"),
    [
        (READY[:6], np.zeros(6), 0.0),
        (READY.astype(np.float32), np.zeros(7), 0.0),
        (READY, np.zeros((7, 1)), 0.0),
        (READY, np.full(7, np.nan), 0.0),
        (READY, np.zeros(7), np.nan),
        (READY, np.zeros(7), np.inf),
    ],
)
def test_what_no_table_can_be_filled_for_is_refused(models, q, v, age):
    with pytest.raises(ArmguardError):
        models["joint"].tabulate(q, v, age)
    with pytest.raises(ArmguardError):
        models["braking"].tabulate(q, v, age, 0.1)
