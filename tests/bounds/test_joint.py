import numpy as np
import pinocchio
import pytest

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion
from armguard.bounds.joint import GRID_STEP, grid
from armguard.exceptions import ArmguardError
from armguard.robot import Kinematics, Robot
from support.example_arms import load_arm
from support.hostile_joints import random_state
from support.motion_questions import HAND_POINT, altered, moderate_state, unit
from support.urdf_arms import limits_for, two_links

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


def test_in_the_long_run_the_ranges_of_joints_decide(robot, models):
    q, v = moderate_state(robot, np.random.default_rng(7))
    question = q, v, "panda_hand", HAND_POINT, np.array([0.0, 0.6, 0.8])
    later = [models["joint"].advance(*question, t) for t in (20.0, 80.0, 1e6, 1e15)]
    assert max(later) == min(later) < 12.0


@pytest.mark.parametrize("name", ["panda", "xarm7", "ur5", "tiago"])
def test_joint_bounds_are_a_fraction_of_isotropic_ones(name):
    robot, random = load_arm(name), np.random.default_rng(3)
    isotropic, joint = IsotropicMotion(robot), JointMotion(robot)
    ratios = {0.05: [], 0.1: [], 0.2: []}
    for _ in range(60):
        q, v = moderate_state(robot, random)
        direction = unit(random)
        for t, found in ratios.items():
            question = q, v, robot.links[-1], HAND_POINT, direction, t
            free = isotropic.advance(*question)
            found.append(joint.advance(*question) / free if free > 0.0 else 1.0)
    medians = [np.median(found) for found in ratios.values()]
    assert medians[0] <= 0.2
    assert medians[1] <= 0.25
    assert medians[2] <= 0.6


def test_joint_bound_is_the_taylor_bound_or_less(robot, models):
    random = np.random.default_rng(4)
    data = robot.model.createData()
    joint = robot.joint_index("panda_hand")
    levers = models["isotropic"].lever
    hand = Kinematics(robot).spheres.root[robot.links.index("panda_hand")]
    lever, center = levers[hand], Kinematics(robot).spheres.local[hand]
    distal = np.maximum(np.arange(7)[:, None], np.arange(7)[None, :])
    both = np.where(np.outer(lever, lever) > 0.0, lever[distal], 0.0)
    slower = altered(
        robot,
        position_error=np.zeros(7),
        velocity_error=np.zeros(7),
        upper_position_limit=np.full(7, np.inf),
        lower_position_limit=np.full(7, -np.inf),
    )
    motion = JointMotion(slower)
    for _ in range(100):
        q, v = moderate_state(robot, random)
        direction, t = unit(random), random.uniform(0.01, 0.1)
        accel = robot.acceleration_limit
        # Short enough that no joint reaches its top speed, and that bounds rise to their ends.
        high, low = (v + 0.5 * accel * t) * t, (v - 0.5 * accel * t) * t
        jacobian = pinocchio.computeJointJacobians(robot.model, data, q)
        place = data.oMi[joint].act(center)
        slope = direction @ (jacobian[:3] + np.cross(jacobian[3:].T, place).T)
        size = np.maximum(np.maximum(high, 0.0), np.maximum(-low, 0.0))
        taylor = np.maximum(0.0, np.maximum(slope * high, slope * low)).sum()
        taylor += 0.5 * size @ both @ size
        assert motion.advance(q, v, "panda_hand", center, direction, t) <= taylor * (1.0 + 1e-9)


def test_a_joint_at_its_limit_goes_no_further(robot, models):
    q = np.array([robot.upper_position_limit[0], 0.3, 0.0, -1.5, 0.0, 1.8, 0.0])
    sideways = np.array([0.0, 1.0, 0.0])
    still = altered(robot, acceleration_limit=np.r_[15.0, np.full(6, 1e-9)],
                    braking_deceleration=np.r_[3.0, np.full(6, 1e-10)],
                    position_error=np.zeros(7), velocity_error=np.zeros(7))  # fmt: skip
    data = robot.model.createData()
    jacobian = pinocchio.computeJointJacobians(robot.model, data, q)
    place = data.oMi[robot.joint_index("panda_hand")].translation
    outwards = sideways * np.sign(
        sideways @ (jacobian[:3] + np.cross(jacobian[3:].T, place).T)[:, 0]
    )
    motion = JointMotion(still)
    assert motion.advance(q, np.zeros(7), "panda_hand", np.zeros(3), outwards, 0.1) < 1e-3
    assert motion.advance(q, np.zeros(7), "panda_hand", np.zeros(3), -outwards, 0.1) > 1e-2


@pytest.mark.parametrize("slices", [0, -3, 2.0, True, "many"])
def test_slices_are_a_whole_number(robot, slices):
    with pytest.raises(ArmguardError, match="slices"):
        JointMotion(robot, slices=slices)


def test_tables_of_any_number_of_slices_tell_the_same_displacements(robot):
    rng = np.random.default_rng(5)
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    coarse, fine = JointMotion(robot, slices=4), JointMotion(robot, slices=32)
    for _ in range(20):
        q = lower + rng.uniform(0.05, 0.95, len(lower)) * (upper - lower)
        v = rng.uniform(-0.3, 0.3, len(lower)) * robot.velocity_limit
        few, many = coarse.tabulate(q, v, 0.0), fine.tabulate(q, v, 0.0)
        assert few.time[-1] == many.time[-1]
        shared = np.searchsorted(many.time, few.time - 1e-9)
        np.testing.assert_allclose(many.time[shared], few.time, atol=1e-12)
        np.testing.assert_allclose(many.high[shared], few.high, atol=1e-9)
        np.testing.assert_allclose(many.low[shared], few.low, atol=1e-9)


def test_an_arm_with_a_single_joint_is_bounded_as_any(tmp_path):
    robot = Robot.from_urdf(two_links(tmp_path), limits=limits_for("shoulder"))
    q, v, t = np.array([0.5]), np.array([0.6]), 0.1
    placement = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    point, data = np.array([0.2, 0.1, 0.3]), robot.model.createData()
    for motion in (JointMotion(robot), BrakingMotion(robot, 0.05)):
        pinocchio.forwardKinematics(robot.model, data, q)
        before = data.oMi[1].act(point)
        pinocchio.forwardKinematics(robot.model, data, q + 0.05 * v)
        moved = data.oMi[1].act(point) - before
        distance = np.linalg.norm(moved)
        bound = motion.advance(q, v, "upper", point, moved / distance, t)
        assert distance <= bound <= np.linalg.norm(point) * t * robot.velocity_limit[0] * 1.1
    volumes = BrakingMotion(robot, 0.05, placement).stopping_volume(q, v, 0.0, 0.0)
    spheres = robot.cover.tree("upper").spheres
    for angle in q + np.array([0.0, 0.02, 0.05]) * v:
        pinocchio.forwardKinematics(robot.model, data, np.array([angle]))
        for (*center, radius), (x, y, z, reach) in zip(spheres.tolist(), volumes, strict=True):
            gone = placement.act(data.oMi[1].act(np.array(center))) - [x, y, z]
            assert np.linalg.norm(gone) + radius <= reach
