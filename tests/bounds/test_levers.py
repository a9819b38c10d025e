from types import SimpleNamespace

import numpy as np
import pinocchio
import pytest

from armguard.bounds import compute_levers
from armguard.exceptions import ArmguardError
from armguard.robot import Robot
from support.joint_axes import distances_from_axes, find_axes


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


def make_chain(joints, placements, parents=None, travel=(-0.2, 0.5)):
    """A bare arm: joint models one after the other, or as `parents` says; link i rides joint i."""
    model = pinocchio.Model()
    parents = range(len(joints)) if parents is None else parents
    for number, (parent, joint, placement) in enumerate(
        zip(parents, joints, placements, strict=True), start=1
    ):
        model.addJoint(parent, joint, placement, f"joint{number}")
    slides = np.array(["P" in joint.shortname()[10:12] for joint in joints])
    count = len(joints)
    return SimpleNamespace(
        model=model,
        joints=tuple(model.names)[1:],
        links=tuple(f"link{i}" for i in range(1, count + 1)),
        joint_index=lambda link: int(link.removeprefix("link")),
        lower_position_limit=np.where(slides, travel[0], -np.inf),
        upper_position_limit=np.where(slides, travel[1], np.inf),
        position_error=np.full(count, 1e-3),
        slides=slides,
    )


def shift(x, y, z):
    return pinocchio.SE3(np.eye(3), np.array([x, y, z], dtype=float))


def random_chain(random):
    def axis():
        vector = random.normal(size=3)
        return vector / np.linalg.norm(vector)

    kinds = [
        pinocchio.JointModelRX(),
        pinocchio.JointModelRZ(),
        pinocchio.JointModelPY(),
        pinocchio.JointModelRevoluteUnaligned(axis()),
        pinocchio.JointModelPrismaticUnaligned(axis()),
    ]
    joints = [kinds[k] for k in random.integers(len(kinds), size=random.integers(2, 6))]
    placements = [pinocchio.SE3.Random() for _ in joints]
    for placement in placements:
        placement.translation = random.normal(size=3) * random.choice([0.0, 0.1, 1.0])
    return make_chain(joints, placements)


def place(data, joint, points):
    return points @ data.oMi[joint].rotation.T + data.oMi[joint].translation


def test_planar_arm_by_hand():
    arm = make_chain([pinocchio.JointModelRZ()] * 2, [shift(0, 0, 0.3), shift(0.7, 0, 0.1)])
    levers = compute_levers(arm, "link2", [[0.4, 0.0, 5.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(levers, [[1.1, 0.4], [0.7, 0.0]], atol=2e-3)
    assert (levers >= [[1.1, 0.4], [0.7, 0.0]]).all()
    np.testing.assert_allclose(compute_levers(arm, "link1", [[0.3, 0.4, 9.0]]), [[0.5, 0.0]])


def test_a_joint_of_another_branch_does_not_move_a_link():
    arm = make_chain(
        [pinocchio.JointModelRX(), pinocchio.JointModelRY(), pinocchio.JointModelRZ()],
        [shift(0, 0, 1)] * 3,
        parents=[0, 1, 1],
    )
    (levers,) = compute_levers(arm, "link3", [[0.2, 0.1, 0.3]])
    assert levers[1] == 0.0
    assert levers[0] > 0.0
    assert levers[2] > 0.0


@pytest.mark.parametrize("seed", range(12))
def test_levers_of_random_chains_hold_and_are_tight(seed):
    random = np.random.default_rng(seed)
    arm = random_chain(random)
    model, data = arm.model, arm.model.createData()
    joint = model.njoints - 1
    points = random.normal(size=(3, 3)) * [[0.0], [0.1], [1.0]]
    levers = compute_levers(arm, arm.links[-1], points)
    seen = np.zeros_like(levers)
    candidates = np.empty((len(points), model.nv, model.nq))
    axes = find_axes(model, joint)

    def look(q):
        pinocchio.forwardKinematics(model, data, q)
        return distances_from_axes(model, data, joint, place(data, joint, points), axes)

    slack = 2.0 * arm.position_error
    ends = np.where(arm.slides, np.vstack([[-0.2], [0.5]]) + np.outer([-1, 1], slack), 0.0)

    def draw():
        slid = ends[random.integers(2, size=model.nq), np.arange(model.nq)]
        return np.where(arm.slides, slid, random.uniform(-np.pi, np.pi, model.nq))

    for _ in range(1500):
        q = draw()
        found = look(q)
        better = found > seen
        seen[better] = found[better]
        candidates[better] = q
    # Climb from the best sample of each lever.
    for i, j in np.ndindex(*seen.shape):
        q, width = candidates[i, j], 0.3
        for _ in range(300):
            trial = np.where(arm.slides, q, q + random.normal(size=model.nq) * width)
            found = look(trial)[i, j]
            if found > seen[i, j]:
                seen[i, j], q = found, trial
            else:
                width = max(0.97 * width, 1e-4)
    assert (seen <= levers).all()
    assert (seen >= 0.97 * levers - 1e-9).all()


@pytest.mark.parametrize("points", [np.zeros(3), np.zeros((2, 4)), [[np.inf, 0.0, 0.0]]])
def test_bad_points_are_refused(robot, points):
    with pytest.raises(ArmguardError, match="points on panda_hand"):
        compute_levers(robot, "panda_hand", points)


def test_a_slide_without_an_end_is_refused():
    arm = make_chain(
        [pinocchio.JointModelPZ(), pinocchio.JointModelRX()],
        [shift(0, 0, 0)] * 2,
        travel=(-np.inf, np.inf),
    )
    with pytest.raises(ArmguardError, match="joint1: slides"):
        compute_levers(arm, "link2", np.zeros((1, 3)))


def test_a_screw_is_refused():
    arm = make_chain([pinocchio.JointModelHX(0.1)], [shift(0, 0, 0)])
    with pytest.raises(ArmguardError, match="JointModelHX"):
        compute_levers(arm, "link1", np.zeros((1, 3)))
