import numpy as np
import pytest

from armguard.bounds import BrakingMotion, JointMotion
from armguard.exceptions import ArmguardError
from armguard.lab.extremes.arms import make_arm
from armguard.robot import Kinematics, Robot
from armguard.robot.brakes import find_stop, rest_time
from armguard.robot.operating_limits import OperatingLimits
from support.example_arms import load_arm
from support.motion_questions import HAND_POINT, altered, moderate_state, unit


def test_a_braking_arm_rests_after_its_stop_time(robot, models):
    random, braking = np.random.default_rng(5), models["braking"]
    for _ in range(20):
        q, v = moderate_state(robot, random)
        direction = unit(random)
        rest = braking.stop_time(q, v, 0.0, 0.0)
        question = q, v, "panda_hand", HAND_POINT, direction
        at_rest = braking.advance(*question, rest)
        assert braking.advance(*question, rest + 5.0) == pytest.approx(at_rest, rel=1e-9)
        assert at_rest <= models["joint"].advance(*question, rest) * (1.0 + 1e-9)


def test_a_table_ends_no_sooner_than_the_slowest_joint_rests(robot, models):
    """One that speeds up until it brakes, and one that was seen in motion later than that."""
    random, braking = np.random.default_rng(7), models["braking"]
    top, accel, slows = robot.velocity_limit, robot.acceleration_limit, robot.braking_deceleration
    for _ in range(50):
        q, v = moderate_state(robot, random)
        age, horizon = random.choice([-0.5, -0.2, 0.0, 0.01, 0.1]), random.uniform(0.0, 0.02)
        free = horizon + 0.02
        seen = np.abs(v) + robot.velocity_error
        if age < 0.0:
            rest = -age + (np.minimum(seen, top) / slows).max()
            assert braking.tabulate(q, v, age, horizon).time[-1] >= rest
            continue
        rest = free + (np.minimum(seen + accel * (age + free), top) / slows).max()
        assert braking.tabulate(q, v, age, horizon).time[-1] == pytest.approx(rest, rel=1e-12)
        assert braking.stop_time(q, v, age, horizon) == pytest.approx(rest, rel=1e-12)
        # Kept to a pace, it brakes from no more than that.
        for pace in (0.1, 0.5):
            kept = np.minimum(np.abs(v), pace * top) + robot.velocity_error
            fastest = np.minimum(kept + accel * (age + free), pace * top)
            rest = free + (fastest / slows).max()
            end = braking.tabulate(q, v, age, horizon, pace=pace).time[-1]
            assert end == pytest.approx(rest, rel=1e-12)


def test_a_joint_that_has_slowed_down_to_a_pace_since_its_stamp_is_where_its_table_says(
    robot, models
):
    random, braking = np.random.default_rng(8), models["braking"]
    top, accel = robot.velocity_limit, robot.acceleration_limit
    for _ in range(200):
        q, v = moderate_state(robot, random)
        age, pace = random.uniform(0.0, 0.05), random.uniform(0.05, 0.9)
        kept = np.minimum(pace * top, np.abs(v))
        # As late as it can, so that it is no faster from now on, and brakes as late as it may.
        true = np.minimum(np.minimum(kept + accel * age, np.abs(v) + robot.velocity_error), top)
        slowing = np.minimum((true - kept) / accel, age)
        gone = true * age - 0.5 * (true - kept) * slowing
        table = braking.tabulate(q, v, age, 0.02, pace=pace)
        time = table.time[:, None]
        on = np.minimum(time, 0.04)
        braked = np.minimum(time - on, kept / robot.braking_deceleration)
        gone = gone + kept * on + braked * (kept - 0.5 * robot.braking_deceleration * braked)
        room = np.where(v > 0.0, robot.upper_position_limit - q, q - robot.lower_position_limit)
        gone = np.minimum(gone, room)
        assert (np.where(v > 0.0, table.high, -table.low) >= gone * (1.0 - 1e-12)).all()


def test_a_stopping_volume_reaches_as_far_as_points_may_get_in_every_direction():
    """Against the bound on single points; a single joint leaves no room between the two."""
    for joints in (1, 4):
        arm, random = make_arm(joints), np.random.default_rng(joints)
        names = "name", "model", "links", "cover", "joint_index"
        errors = {"position_error": np.full(joints, 0.02)}
        wrong = altered(arm, **errors, **{name: getattr(arm, name) for name in names})
        braking, tightest = BrakingMotion(wrong, 0.02), np.inf
        for _ in range(20):
            q, v = moderate_state(arm, random)
            volumes, row = braking.stopping_volume(q, v, 0.0, 0.0), 0
            end = braking.stop_time(q, v, 0.0, 0.0)
            kinematics = Kinematics(arm)
            kinematics.compute(q, v)
            places = kinematics.centers
            for link in arm.links:
                spheres = arm.cover.tree(link).spheres
                for number, local in enumerate(spheres[:, :3]):
                    place, radius = places[row + number], spheres[number, 3]
                    ahead = kinematics.velocities[row + number]
                    ways = [unit(random)]
                    ways += [ahead / np.linalg.norm(ahead)] if ahead.any() else []
                    for way in ways:
                        most = braking.advance(q, v, link, local, way, end)
                        error = braking.position_error[row + number]
                        reached = (volumes[row + number, :3] - place) @ way
                        reached += volumes[row + number, 3] - radius
                        left = reached - most - error
                        assert left >= -1e-12
                        tightest = min(tightest, left)
                row += len(spheres)
        assert joints > 1 or tightest < 1e-6


def test_beyond_the_range_of_brakes_a_point_may_go_as_far_as_without_any():
    robot = Robot.load("panda")
    braking, free = BrakingMotion(robot, 0.02), JointMotion(robot)
    q, direction = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0]), np.array([0.0, 1.0, 0.0])
    for share, is_covered in ((0.2, True), (0.9, False)):
        v = share * robot.velocity_limit[0] * np.eye(7)[0]
        assert braking.covers(q, v, 0.0, 0.0) == is_covered
        question = q, v, "panda_hand", HAND_POINT, direction, 1.0
        assert (braking.advance(*question) < 0.99 * free.advance(*question)) == is_covered


def test_a_joint_that_is_thrown_back_from_its_stop_needs_brakes_too():
    robot = Robot.load("panda")
    operating = OperatingLimits(np.full(7, 2.0), np.full(7, 3.0))
    braking = BrakingMotion(robot, 0.1, operating=operating)
    q, v = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]), np.zeros(7)
    assert braking.covers(q, v, 0.0, 0.1)
    # Thrown back by 7.5 rad/s², it can be at 1.5 rad/s in 0.2 s; brakes are stated up to 1.305.
    q[1] = robot.lower_position_limit[1] + 1e-4
    assert not braking.covers(q, v, 0.0, 0.1)
    assert braking.stop_time(q, v, 0.0, 0.1) == np.inf
    assert braking.covers(q, v, 0.0, 0.05)


@pytest.mark.parametrize("bad", [-0.1, np.nan, np.inf])
def test_impossible_times_are_refused(robot, models, bad):
    with pytest.raises(ArmguardError, match="reaction_time"):
        BrakingMotion(robot, bad)
    q, v = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0]), np.zeros(7)
    with pytest.raises(ArmguardError, match="horizon"):
        models["braking"].stop_time(q, v, 0.0, bad)
    with pytest.raises(ArmguardError, match="horizon"):
        models["braking"].tabulate(q, v, 0.0, bad)


def test_a_joint_that_its_stop_throws_back_rests_before_the_table_ends():
    """Off its stop it speeds up by what the hardware can, which operating limits do not hold."""
    robot = load_arm("panda")
    operating = OperatingLimits.fraction(robot, velocity=0.5, acceleration=0.05)
    model = BrakingMotion(robot, 0.1, operating=operating)
    limits, joint, horizon = model.limits, 3, 0.05
    q = 0.5 * (robot.lower_position_limit + robot.upper_position_limit)
    v = np.zeros(7)
    before = model.tabulate(q, v, 0.0, horizon).time[-1]
    # Right at its stop, and towards it: from then on it may come back.
    q[joint], v[joint] = robot.upper_position_limit[joint], 0.01
    table = model.tabulate(q, v, 0.0, horizon)
    free = horizon + 0.1
    thrown = min(limits.operating_velocity[joint], limits.acceleration[joint] * free)
    lasting = rest_time(find_stop(limits.brakes, joint, thrown), thrown)
    assert table.time[-1] >= free + lasting
    assert table.time[-1] > before
