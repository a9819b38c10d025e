import numpy as np
import pinocchio
import pytest

from armguard.bounds import IsotropicMotion, MotionModel, free_advance
from armguard.exceptions import ArmguardError
from armguard.robot import Kinematics


@pytest.fixture(scope="module")
def motion(robot):
    return IsotropicMotion(robot)


def test_pandas_hand_is_as_fast_as_published(robot, motion):
    hand = Kinematics(robot).spheres.root[robot.links.index("panda_hand")]
    assert 6.0 < motion.speed[hand] < 8.0
    assert 90.0 < motion.accel[hand] < 120.0


def move_chain(model, q, v, a):
    """Spatial velocities and accelerations of a chain of turning joints, for many states at once.

    Shape (len(q), njoints, 12): linear and angular velocity, then acceleration, as Pinocchio's.
    """
    spatial = np.zeros((len(q), model.njoints, 12))
    for joint in range(1, model.njoints):
        place, axis = model.jointPlacements[joint], np.ravel(model.joints[joint].createData().S)[3:]
        x, y, z = axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        angle = q[:, joint - 1, None, None]
        turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
        turn = place.rotation @ turn
        linear, angular, pull, twist = np.split(spatial[:, model.parents[joint]], 4, axis=1)
        linear, pull = (
            part + np.cross(about, place.translation)
            for part, about in ((linear, angular), (pull, twist))
        )
        linear, angular, pull, twist = (
            np.einsum("nij,ni->nj", turn, part) for part in (linear, angular, pull, twist)
        )
        pace = v[:, joint - 1, None] * axis
        angular = angular + pace
        pull = pull + np.cross(linear, pace)
        twist = twist + a[:, joint - 1, None] * axis + np.cross(angular, pace)
        spatial[:, joint] = np.concatenate([linear, angular, pull, twist], axis=1)
    return spatial


def test_no_joint_motion_exceeds_speed_or_acceleration(robot, motion):
    random = np.random.default_rng(0)
    model, data = robot.model, robot.model.createData()
    spheres = Kinematics(robot).spheres
    samples = 100_000
    q = random.uniform(-np.pi, np.pi, (samples, 7)) * (random.random((samples, 1)) < 0.7)
    v = random.choice([-1.0, 1.0], (samples, 7)) * robot.velocity_limit
    a = random.choice([-1.0, 1.0], (samples, 7)) * robot.acceleration_limit
    spatial = move_chain(model, q, v, a)
    for row in range(0, samples, 500):
        pinocchio.forwardKinematics(model, data, q[row], v[row], a[row])
        for joint in range(1, model.njoints):
            expected = np.concatenate([data.v[joint].np, data.a[joint].np])
            np.testing.assert_allclose(spatial[row, joint], expected, atol=1e-9)
    chosen = np.unique(np.concatenate([spheres.root, random.integers(len(spheres), size=12)]))
    for i in chosen:
        local = spheres.local[i]
        v, w, a, dw = np.split(spatial[:, spheres.joint[i]], 4, axis=1)
        velocity = v + np.cross(w, local)
        accel = a + np.cross(dw, local) + np.cross(w, velocity)
        assert np.linalg.norm(velocity, axis=1).max() <= motion.speed[i]
        assert np.linalg.norm(accel, axis=1).max() <= motion.accel[i]


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


def test_velocity_error_is_unknown_before_the_first_update(robot):
    assert np.isinf(IsotropicMotion(robot).velocity_error).all()


def test_arrays_cannot_be_written(motion):
    for name in ("lever", "accel", "speed", "position_error", "velocity_error", "surface_speed"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(motion, name)[...] = 0.0


def pushed(arm, q, v, joint, local, direction, steps, step, random, greedy):
    """Displacements of a point along a direction, under joint motions as hard as limits allow."""
    model, data = arm.model, arm.model.createData()
    v = np.clip(v, -arm.velocity_limit, arm.velocity_limit)
    accel = random.choice([-1.0, 1.0], 7) * arm.acceleration_limit
    way = np.empty(steps + 1)
    for k in range(steps + 1):
        pinocchio.forwardKinematics(model, data, q, v)
        way[k] = direction @ data.oMi[joint].act(local)
        if greedy:
            jacobian = pinocchio.computeJointJacobian(model, data, q, joint)
            point = jacobian[:3] - pinocchio.skew(local) @ jacobian[3:]
            push = direction @ data.oMi[joint].rotation @ point
            accel = np.where(push >= 0.0, 1.0, -1.0) * arm.acceleration_limit
        elif random.random() < 0.05:
            accel = random.choice([-1.0, 0.0, 1.0], 7) * arm.acceleration_limit
        after = np.clip(v + accel * step, -arm.velocity_limit, arm.velocity_limit)
        q, v = q + 0.5 * step * (v + after), after
    return way - way[0]


# Displacement


@pytest.mark.parametrize("greedy", [False, True])
def test_no_joint_motion_gets_further(robot, motion, greedy):
    random = np.random.default_rng(3)
    step, steps = 2e-3, 150
    closest = 0.0
    for _ in range(150):
        link = robot.links[random.integers(len(robot.links))]
        joint, local = robot.joint_index(link), random.normal(size=3) * 0.1
        q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
        q = np.where(random.random(7) < random.random(), q, 0.0)
        v = random.uniform(-1.0, 1.0, 7) * robot.velocity_limit * random.choice([0.0, 0.3, 1.0])
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        true_q = q + random.choice([-1.0, 1.0], 7) * robot.position_error
        true_v = v + random.choice([-1.0, 1.0], 7) * robot.velocity_error
        way = pushed(robot, true_q, true_v, joint, local, direction, steps, step, random, greedy)
        for k in (1, 10, 40, 150):
            bound = motion.advance(q, v, link, local, direction, k * step)
            assert way[: k + 1].max() <= bound
            if bound > 0.0:
                closest = max(closest, way[: k + 1].max() / bound)
    assert closest > (0.5 if greedy else 0.1)


def test_advance_is_a_motion_model_that_starts_at_zero_and_grows(robot, motion):
    model: MotionModel = motion
    random = np.random.default_rng(4)
    for _ in range(20):
        q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
        v = random.uniform(-1.0, 1.0, 7) * robot.velocity_limit
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        times = np.linspace(0.0, 1.0, 40)
        advances = [model.advance(q, v, "panda_hand", [0, 0, 0.1], direction, t) for t in times]
        assert advances[0] == 0.0
        assert (np.diff(advances) >= 0.0).all()
        hand_speed = 9.0
        assert advances[-1] <= hand_speed


def test_moving_away_is_credited(robot, motion):
    q = np.array([0.0, 0.3, 0.0, -1.5, 0.0, 1.8, 0.0])
    v = np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    sideways = np.array([0.0, 1.0, 0.0])
    ahead = motion.advance(q, v, "panda_hand", np.zeros(3), sideways, 0.005)
    behind = motion.advance(q, v, "panda_hand", np.zeros(3), -sideways, 0.005)
    assert behind == 0.0
    assert ahead > 0.003


def test_direction_is_the_worlds(robot, motion):
    base = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.4, 1.1, -2.0), np.array([3.0, 2.0, 1.0]))
    placed = IsotropicMotion(robot, base)
    q, v = np.linspace(-1.0, 1.0, 7), np.linspace(1.0, -1.0, 7)
    direction = np.array([0.6, 0.0, 0.8])
    here = motion.advance(q, v, "panda_link7", [0.1, 0.0, 0.0], direction, 0.02)
    there = placed.advance(q, v, "panda_link7", [0.1, 0.0, 0.0], base.rotation @ direction, 0.02)
    np.testing.assert_allclose(there, here, rtol=1e-9)


@pytest.mark.parametrize("closing", [-3.0, -0.5, 0.0, 0.7, 2.0])
@pytest.mark.parametrize("accel", [0.0, 1e-9, 4.0, 1e3, np.inf])
def test_free_advance_is_the_integral_of_the_fastest_start(closing, accel):
    speed = 2.0
    times = np.linspace(0.0, 3.0, 30_001)
    pace = np.full_like(times, closing)
    if accel > 0.0:
        pace = np.minimum(speed, closing + accel * np.maximum(times, 1e-300))
    way = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(times))])
    found = [free_advance(closing, accel, speed, t) for t in times[::1000]]
    np.testing.assert_allclose(found, way[::1000], atol=1e-5)


def test_free_advance_without_bounds():
    assert free_advance(1.0, np.inf, np.inf, 0.0) == 0.0
    assert free_advance(1.0, np.inf, np.inf, 1e-9) == np.inf
    assert free_advance(1.0, 2.0, np.inf, 3.0) == pytest.approx(12.0)


# Bad input


@pytest.mark.parametrize(
    ("change", "offender"),
    [
        ({"q": np.zeros(6)}, "joint positions"),
        ({"q": [np.nan] * 7}, "joint positions"),
        ({"q": ["a"] * 7}, "joint positions"),
        ({"v": np.zeros((7, 1))}, "joint velocities"),
        ({"v": [np.inf] * 7}, "joint velocities"),
        ({"link": "panda_link0"}, "panda_link0"),
        ({"link": "nothing"}, "nothing"),
        ({"point": [0.0, 0.0]}, "point"),
        ({"point": [0.0, np.nan, 0.0]}, "point"),
        ({"direction": [0.0, 0.0, 2.0]}, "direction"),
        ({"direction": [0.0, 0.0, 0.0]}, "direction"),
        ({"t": -1e-9}, "t"),
        ({"t": np.nan}, "t"),
        ({"t": np.inf}, "t"),
    ],
)
def test_bad_questions_are_refused(motion, change, offender):
    good = {
        "q": np.zeros(7),
        "v": np.zeros(7),
        "link": "panda_hand",
        "point": [0.0, 0.0, 0.0],
        "direction": [0.0, 0.0, 1.0],
        "t": 0.1,
    }
    motion.advance(**good)
    with pytest.raises(ArmguardError) as caught:
        motion.advance(**{**good, **change})
    assert offender in caught.value.offender


@pytest.mark.parametrize("v", [np.zeros(6), np.full(7, np.nan), np.zeros((1, 7)), None])
def test_bad_velocities_change_nothing(robot, v):
    motion = IsotropicMotion(robot)
    motion.update(np.zeros(7))
    before = motion.velocity_error.copy()
    with pytest.raises(ArmguardError, match="joint velocities"):
        motion.update(v)
    assert (motion.velocity_error == before).all()
