import numpy as np
import pinocchio
import pytest

from armguard.bounds import IsotropicMotion, compute_levers
from armguard.exceptions import ArmguardError
from armguard.robot import Kinematics


@pytest.fixture(scope="module")
def motion(robot):
    return IsotropicMotion(robot)


def test_pandas_hand_is_as_fast_as_published(robot, motion):
    hand = Kinematics(robot).spheres.root[robot.links.index("panda_hand")]
    assert 6.0 < motion.speed[hand] < 8.0
    assert 90.0 < motion.accel[hand] < 120.0


def test_no_joint_motion_exceeds_speed_or_acceleration(robot, motion):
    random, data = np.random.default_rng(0), robot.model.createData()
    spheres = Kinematics(robot).spheres
    fastest, hardest = np.zeros((2, len(spheres)))
    for _ in range(4000):
        q = random.uniform(-np.pi, np.pi, 7) * (random.random() < 0.7)
        v = random.choice([-1.0, 1.0], 7) * robot.velocity_limit
        a = random.choice([-1.0, 1.0], 7) * robot.acceleration_limit
        pinocchio.forwardKinematics(robot.model, data, q, v, a)
        motions = np.array([[*data.v[k].np, *data.a[k].np] for k in range(robot.model.njoints)])
        v, w, a, dw = np.split(motions[spheres.joint], 4, axis=1)
        velocity = v + np.cross(w, spheres.local)
        accel = a + np.cross(dw, spheres.local) + np.cross(w, velocity)
        fastest = np.maximum(fastest, np.linalg.norm(velocity, axis=1))
        hardest = np.maximum(hardest, np.linalg.norm(accel, axis=1))
    assert (fastest <= motion.speed).all()
    assert (hardest <= motion.accel).all()
    assert (fastest / motion.speed).max() > 0.9
    assert (hardest / motion.accel).max() > 0.7


def test_joint_errors_stay_within_their_bounds(robot, motion):
    random = np.random.default_rng(1)
    measured, true = Kinematics(robot), Kinematics(robot)
    for _ in range(2000):
        q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
        v = random.uniform(-1.0, 1.0, 7) * robot.velocity_limit
        measured.compute(q, v)
        motion.update(v)
        true.compute(
            q + random.choice([-1.0, 1.0], 7) * robot.position_error,
            v + random.choice([-1.0, 1.0], 7) * robot.velocity_error,
        )
        moved = np.linalg.norm(true.centers - measured.centers, axis=1)
        faster = np.linalg.norm(true.velocities - measured.velocities, axis=1)
        assert (moved <= motion.position_error).all()
        assert (faster <= motion.velocity_error).all()


def test_surfaces_move_no_faster_than_their_bound(robot, motion):
    random = np.random.default_rng(2)
    data = robot.model.createData()
    for index, link in enumerate(robot.links):
        joint, points = robot.joint_index(link), robot.hull(link)
        for _ in range(200):
            q = random.uniform(-np.pi, np.pi, 7) * (random.random() < 0.5)
            v = random.choice([-1.0, 1.0], 7) * robot.velocity_limit
            pinocchio.forwardKinematics(robot.model, data, q, v)
            spatial = data.v[joint]
            speeds = np.linalg.norm(spatial.linear + np.cross(spatial.angular, points), axis=1)
            assert speeds.max() <= motion.surface_speed[index]
        own = motion.surface_speed[index], motion.surface_position_error[index]
        root = Kinematics(robot).spheres.root[index]
        assert own[0] > 0.0
        assert own[1] > 0.0
        assert own[0] < motion.speed[root] + 3.0


def test_measured_speed_above_its_limit_counts_and_passes(robot):
    motion = IsotropicMotion(robot)
    calm = motion.speed.copy(), motion.accel.copy(), motion.surface_speed.copy()
    arrays = motion.speed, motion.accel, motion.surface_speed, motion.velocity_error
    v = np.zeros(7)
    v[1] = -(robot.velocity_limit[1] + 0.01)
    motion.update(v)
    hand = Kinematics(robot).spheres.root[robot.links.index("panda_hand")]
    expected = calm[0][hand] + 0.01 * motion.lever[hand, 1]
    np.testing.assert_allclose(motion.speed[hand], expected, rtol=1e-9)
    assert motion.accel[hand] > calm[1][hand]
    assert motion.surface_speed[-1] > calm[2][-1]
    motion.update(np.zeros(7))
    for now, before in zip(arrays, calm, strict=False):
        assert (now == before).all()
    assert arrays[3] is motion.velocity_error


def test_bounds_that_grow_are_told(robot):
    motion = IsotropicMotion(robot)
    over = robot.velocity_limit + 0.01
    first, second = np.diag(over)[0], np.diag(over)[1]
    steps = [np.zeros(7), robot.velocity_limit, first, 0.5 * first, -first, first, second, first]
    grew = [False, False, True, False, True, False, True, True]
    assert [motion.update(v) for v in steps] == grew


def test_arrays_cannot_be_written(motion, models):
    names = "lever", "accel", "speed", "position_error", "velocity_error", "surface_speed"
    reach = models["reach"]
    arrays = [getattr(motion, name) for name in names] + [reach.link_balls, reach.arm_ball]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_velocity_errors_count_in_full_however_short_the_time(robot, motion):
    q, t = np.array([0.0, 0.3, 0.0, -1.5, 0.0, 1.8, 0.0]), 1e-6
    for link in robot.links:
        lever = compute_levers(robot, link, [[0.0, 0.1, 0.2]])[0]
        bound = motion.advance(q, np.zeros(7), link, [0.0, 0.1, 0.2], [0.0, 0.6, 0.8], t)
        assert t * lever @ robot.velocity_error <= bound < 2.0 * t * lever @ robot.velocity_error


def test_moving_away_is_credited(robot, motion):
    q = np.array([0.0, 0.3, 0.0, -1.5, 0.0, 1.8, 0.0])
    v = np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    sideways = np.array([0.0, 1.0, 0.0])
    ahead = motion.advance(q, v, "panda_hand", np.zeros(3), sideways, 0.005)
    behind = motion.advance(q, v, "panda_hand", np.zeros(3), -sideways, 0.005)
    assert behind == 0.0
    assert ahead > 0.003


@pytest.mark.parametrize("v", [np.zeros(6), np.full(7, np.nan), np.zeros((1, 7)), None])
def test_bad_velocities_change_nothing(robot, v):
    motion = IsotropicMotion(robot)
    assert np.isinf(motion.velocity_error).all()
    motion.update(np.zeros(7))
    before = motion.velocity_error.copy()
    with pytest.raises(ArmguardError, match="joint velocities"):
        motion.update(v)
    assert (motion.velocity_error == before).all()
