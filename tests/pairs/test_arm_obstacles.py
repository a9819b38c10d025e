"""Another arm as obstacles: whatever it does within its limits, its balls contain it."""

import functools

import coal
import numpy as np
import pinocchio
import pytest

import armguard
from armguard.exceptions import ArmguardError, ObstacleError
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, STILL, panda
from support.row_law import Told, go_on
from support.two_arms import TrueArm, measure

FACING = pinocchio.SE3(pinocchio.utils.rotate("z", np.pi), np.array([1.25, 0.0, 0.0]))
LEFT = np.array([0.6, 0.3, 0.0, -1.7, 0.0, 2.0, 0.8])
RIGHT = np.array([0.6, 0.2, 0.0, -1.9, 0.0, 2.0, 0.8])


@functools.cache
def baxter_left():
    return armguard.Robot.load("baxter", joints=["left_*"])


def limits_of(robot, share):
    return armguard.OperatingLimits(share * robot.velocity_limit, np.full(7, 1.0))


@pytest.mark.parametrize(
    ("make_robot", "share"), [(panda, None), (panda, 0.3), (panda, 1.0), (baxter_left, 0.2)]
)
def test_no_ball_leaves_what_its_row_allows_however_the_joints_move(make_robot, share):
    """Exact positions of the balls' centres along hostile motions, against the law of a row."""
    robot, generator = make_robot(), np.random.default_rng(7)
    operating = None if share is None else limits_of(robot, share)
    other = armguard.ArmObstacles(robot, base_placement=FACING, operating=operating)
    velocity, speeding = robot.velocity_limit, robot.acceleration_limit
    if operating is not None:
        velocity, speeding = operating.resolve(robot)
    arm = TrueArm(robot, FACING, np.zeros(7), velocity, speeding)
    spheres = [
        (robot.joint_index(link), robot.cover.spheres(link, min(1, robot.cover.levels(link) - 1)))
        for link in robot.links
    ]
    joint = np.concatenate([np.full(len(some), number) for number, some in spheres])
    local = np.concatenate([some for _, some in spheres])[:, :3]
    free = armguard.ArmObstacles(robot, base_placement=FACING)
    told, plain, tightest, naive = Told(), Told(), -np.inf, -np.inf
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    for trial in range(60):
        arm.q = lower + generator.uniform(0.2, 0.8, 7) * (upper - lower)
        arm.v = velocity * generator.choice([-1.0, -0.5, 0.0, 0.5, 1.0], 7)
        wrong = generator.choice([-1.0, 1.0], (2, 7))
        measured = arm.q + wrong[0] * robot.position_error, arm.v + wrong[1] * robot.velocity_error
        # Within so long it can have got there.
        other.publish(told, 1e3 * trial, *measured)
        free.publish(plain, 1e3 * trial, *measured)
        centers, velocities, _, accel, speed, error, velocity_error = told.fields
        # Along the row's own velocity, against it, and anywhere: for a while, then another way.
        directions = generator.normal(size=(40, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        wanted = generator.choice([-1.0, 0.0, 1.0], (3, 7)) * velocity
        for step in range(40):
            arm.push(wanted[step // 14], 0.01)
            time = 0.01 * (step + 1)
            places = np.concatenate(
                [
                    arm.points_at(arm.q, int(one), local[joint == one])
                    for one in dict.fromkeys(joint)
                ]
            )
            moved = (places - centers) @ directions.T
            closing = velocities @ directions.T + velocity_error[:, None]
            allowed = go_on(closing, accel[:, None], speed[:, None], time) + error[:, None]
            tightest = max(tightest, float((moved - allowed).max()))
            closing = plain.fields[1] @ directions.T + plain.fields[6][:, None]
            allowed = go_on(closing, accel[:, None], speed[:, None], time) + error[:, None]
            naive = max(naive, float((moved - allowed).max()))
    assert tightest <= 1e-12
    assert not told.problems
    if share is not None and share < 1.0:
        assert naive > 0.01, "a free body with these bounds would not brake so hard"


def fight(*, is_obeying, both=False, seconds=2.0, rate=250.0):
    """Two arms go for one another; what was told, and what happened.

    Returns:
        When they first touched, how fast the watched one moved then, and the first contact that any
        verdict left possible minus when it happened.
    """
    robot, dt = panda(), 1.0 / rate
    operating = limits_of(robot, 0.3)
    velocity, speeding = operating.resolve(robot)
    bases = {"left": pinocchio.SE3.Identity(), "right": FACING}
    arms = {
        name: TrueArm(robot, base, LEFT if name == "left" else RIGHT, velocity, speeding)
        for name, base in bases.items()
    }
    others = {"left": "right", "right": "left"}
    watched = list(arms) if both else ["left"]
    tables, monitors, told = {}, {}, {}
    for name in watched:
        tables[name] = armguard.Obstacles(sources=[others[name]])
        monitors[name] = armguard.Monitor(
            robot, tables[name], rate=rate, operating=operating, base_placement=bases[name]
        )
        told[name] = armguard.ArmObstacles(
            robot, others[name], base_placement=bases[others[name]], operating=operating
        )
        told[name].add_fixed(tables[name])
    generator, latest, levels = np.random.default_rng(3), [], set()
    for tick in range(round(seconds * rate)):
        now = tick * dt
        distance, i, k, here, there = measure(arms["left"], arms["right"])
        if distance <= 0.0:
            return now, {name: np.abs(arm.v).max() for name, arm in arms.items()}, latest, levels
        along = (there - here) / distance
        wanted = {
            "left": arms["left"].towards(i, here, along),
            "right": arms["right"].towards(k, there, -along),
        }
        scale = dict.fromkeys(arms, 1.0)
        measured = {}
        for name, arm in arms.items():
            wrong = generator.choice([-1.0, 1.0], (2, 7))
            measured[name] = (
                arm.q + wrong[0] * robot.position_error,
                arm.v + wrong[1] * robot.velocity_error,
            )
        for name in watched:
            if tick % 2 == 0:
                told[name].publish(tables[name], now, *measured[others[name]])
            verdict = monitors[name].step(now, *measured[name])
            levels.add(verdict.level)
            latest.append((now, verdict.contact_time))
            scale[name] = verdict.speed_scale if is_obeying else 1.0
        for name, arm in arms.items():
            if scale[name] > 0.0:
                arm.push(scale[name] * wanted[name], dt)
            else:
                arm.brake(dt)
    return None, {name: np.abs(arm.v).max() for name, arm in arms.items()}, latest, levels


def test_an_arm_that_obeys_stands_before_an_attacking_one_touches_it_and_another_does_not():
    touched, _, latest, _ = fight(is_obeying=False)
    assert touched is not None, "else there is nothing to be stopped for"
    told = max(at + contact_time for at, contact_time in latest)
    assert told <= touched, "a contact came before it was told to be possible"
    assert max(contact_time for _, contact_time in latest) > 0.1, "else nothing was promised"
    touched, speeds, _, levels = fight(is_obeying=True)
    assert touched is not None, "the other one does not obey"
    assert speeds["left"] == 0.0
    assert {Level.STOP} < levels


@pytest.mark.hazard("H-18")
def test_two_arms_that_obey_go_for_one_another_and_never_touch():
    touched, speeds, _, levels = fight(is_obeying=True, both=True)
    assert touched is None
    assert Level.STOP in levels
    # Either may creep a little nearer at times; neither moves on as it could alone.
    assert max(speeds.values()) < 0.1 * limits_of(panda(), 0.3).resolve(panda())[0].max()


def test_the_two_arms_of_baxter_watch_each_other_and_may_move():
    arms = {"left": baxter_left(), "right": armguard.Robot.load("baxter", joints=["right_*"])}
    for own, other in (("left", "right"), ("right", "left")):
        obstacles = armguard.Obstacles(sources=[other])
        monitor = armguard.Monitor(arms[own], obstacles, operating="published")
        told = armguard.ArmObstacles(arms[other], other, operating="published")
        told.publish(obstacles, 0.0, STILL, STILL)
        verdict = monitor.step(0.0, STILL, STILL)
        assert verdict.level > Level.STOP
        assert verdict.obstacle.startswith(f"{other} ")
        assert 0.0 < verdict.contact_time < np.inf


def test_what_is_fixed_of_an_arm_stands_in_the_table_in_its_place():
    robot = panda()
    other = armguard.ArmObstacles(robot, "right", base_placement=FACING, placement_error=0.01)
    obstacles = armguard.Obstacles(sources=[])
    other.add_fixed(obstacles)
    row = obstacles.row("right panda_link0")
    corners = obstacles.table.points[row, :8]
    points = robot.fixed_points()["panda_link0"] @ FACING.rotation.T + FACING.translation
    assert (points >= corners.min(axis=0) - 1e-12).all()
    assert (points <= corners.max(axis=0) + 1e-12).all()
    assert obstacles.table.radius[row] == 0.01
    with pytest.raises(ObstacleError, match="right panda_link0"):
        other.add_fixed(obstacles)


def test_two_arms_of_one_name_are_refused_by_it():
    obstacles = armguard.Obstacles()
    armguard.ArmObstacles(panda(), "left").publish(obstacles, 0.0, HOME, STILL)
    with pytest.raises(ObstacleError, match="arm 'left': has the name of a source"):
        armguard.ArmObstacles(panda(), "left").publish(obstacles, 0.0, HOME, STILL)
    assert obstacles.fault_count == 1, "the verdict knows of it, too"


@pytest.mark.parametrize(
    ("q", "v"),
    [
        (np.where(np.arange(7) == 3, np.nan, HOME), STILL),
        (HOME, np.where(np.arange(7) == 3, np.inf, STILL)),
        (np.where(np.arange(7) == 3, 9.0, HOME), STILL),
        (HOME, np.where(np.arange(7) == 3, 9.0, STILL)),
    ],
)
def test_a_state_that_cannot_be_is_no_exception_and_no_place(q, v):
    other = armguard.ArmObstacles(panda(), "left")
    obstacles = armguard.Obstacles()
    other.publish(obstacles, 0.0, HOME, STILL)
    other.publish(obstacles, 0.001, q, v)
    assert obstacles.fault_count == len(other.ids)
    assert {fault.kind.name for fault in obstacles.take_faults()} == {"NOT_FINITE"}


@pytest.mark.parametrize("state", [(HOME[:6], STILL), (HOME, STILL[:3]), ("here", STILL)])
def test_a_state_of_another_length_is_refused_and_leaves_a_fault(state):
    other, obstacles = armguard.ArmObstacles(panda(), "left"), armguard.Obstacles()
    with pytest.raises(ObstacleError, match="joint state of arm 'left'"):
        other.publish(obstacles, 0.0, *state)
    assert obstacles.fault_count == 1


@pytest.mark.parametrize("share", [None, 0.3])
def test_what_placements_may_be_off_by_is_an_error_of_every_ball(share):
    robot, exact, displaced = panda(), Told(), Told()
    operating = None if share is None else limits_of(robot, share)
    off = 0.03
    armguard.ArmObstacles(robot, operating=operating).publish(exact, 0.0, HOME, STILL)
    other = armguard.ArmObstacles(robot, operating=operating, placement_error=off)
    other.publish(displaced, 0.0, HOME, STILL)
    grown = displaced.fields[5] - exact.fields[5]
    assert (grown >= off).all()
    assert grown == pytest.approx(off, rel=1e-9)
    # What does not move stands in the same place.
    table = armguard.Obstacles()
    other.add_fixed(table)
    rows = table.table.alive
    assert (table.table.radius[rows] >= off).all()


def test_a_joint_above_its_operating_velocity_puts_the_limits_of_the_robot_in_force():
    robot, told = panda(), Told()
    other = armguard.ArmObstacles(robot, operating=limits_of(robot, 0.3))
    for stamp, speed in ((0.0, 0.2), (1.0, 0.5), (1.5, 0.2), (3.2, 0.2)):
        other.publish(told, stamp, HOME, speed * robot.velocity_limit)
        fastest = told.fields[4].max()
        assert (fastest > 5.0) == (1.0 <= stamp < 3.0), "in m/s: what the hardware can do"
    (problem,) = told.problems
    assert "panda_joint1 breaks its operating limits: at 1.087 rad/s" in problem


def speed_up(robot, other, table, accel, errors):
    """Joint 1 speeds up from rest; what it did wrong is told after a while, in [s]."""
    generator = np.random.default_rng(5)
    first = np.eye(7)[0]
    top = 0.3 * robot.velocity_limit[0]
    for tick in range(100):
        time = 0.002 * tick
        ramp = min(time, top / accel)
        q = HOME + (0.5 * accel * ramp**2 + top * (time - ramp)) * first
        wrong = errors * generator.choice([-1.0, 1.0], (2, 7))
        v = accel * ramp * first + wrong[1] * robot.velocity_error
        other.publish(table, time, q + wrong[0] * robot.position_error, v)
        if table.take_faults():
            return time
    return None


@pytest.mark.parametrize("errors", [0.0, 1.0])
def test_a_joint_that_speeds_up_too_hard_is_told_and_the_hardware_s_limits_count(errors):
    robot = panda()
    hard = robot.acceleration_limit[0]
    late = 4.0 * robot.velocity_error[0] / (hard - 1.0) + 0.002
    operating = limits_of(robot, 0.3)
    other, table = armguard.ArmObstacles(robot, operating=operating), armguard.Obstacles()
    assert 0.0 < speed_up(robot, other, table, hard, errors) <= late + 1e-9
    row = table.row(other.ids[-1])
    assert table.table.speed[row] > 5.0, "in m/s: what the hardware can do"
    other, table = armguard.ArmObstacles(robot, operating=operating), armguard.Obstacles()
    assert speed_up(robot, other, table, 1.0, errors) is None


@pytest.mark.hazard("H-18")
def test_a_break_is_a_stop_that_names_arm_and_joint_and_ends_by_itself():
    robot = panda()
    other = armguard.ArmObstacles(robot, "right", operating=limits_of(robot, 0.3))
    table = armguard.Obstacles(sources=["right"])
    far = pinocchio.SE3(np.eye(3), np.array([0.0, 9.0, 0.0]))
    patient = {"rise_delay": 0.0, "joint_timeout": 9.0, "source_timeout": 9.0}
    monitor = armguard.Monitor(robot, table, base_placement=far, **patient)
    levels, told, speeds = [], [], []
    for stamp, speed in ((0.0, 0.0), (0.01, 0.1), (2.0, 0.0), (2.02, 0.0)):
        other.publish(table, stamp, HOME, speed * np.eye(7)[1])
        verdict = monitor.step(stamp, HOME, STILL)
        levels.append(verdict.level)
        told += [one for one in verdict.reasons if one.kind is ReasonKind.OTHER_ARM_BROKE]
        speeds.append(table.table.speed[table.row(other.ids[-1])])
    assert levels[1] == Level.STOP
    assert min(levels[0], *levels[2:]) > Level.STOP
    (reason,) = told
    assert reason.subject == "right"
    assert "panda_joint2 breaks its operating limits" in reason.detail
    assert [speed > 5.0 for speed in speeds] == [False, True, True, False], (
        "the hardware's, for 2 s"
    )


def test_a_state_that_comes_late_does_not_hide_a_break():
    """From an older state on a joint would have had time to become that fast."""
    robot, told = panda(), Told()
    other = armguard.ArmObstacles(robot, operating=limits_of(robot, 0.3))
    for stamp, speed in ((10.0, 0.0), (9.0, 0.0), (10.01, 0.2)):
        other.publish(told, stamp, HOME, speed * np.eye(7)[0])
    (problem,) = told.problems
    assert "sooner than the operating acceleration" in problem


def test_a_body_that_is_attached_becomes_an_obstacle_and_goes_with_it():
    robot = armguard.Robot.load("panda")
    other, obstacles = armguard.ArmObstacles(robot, "left"), armguard.Obstacles()
    other.publish(obstacles, 0.0, HOME, STILL)
    before = len(obstacles)
    robot.attach("gripper", "panda_hand", coal.Sphere(0.05))
    other.publish(obstacles, 0.001, HOME, STILL)
    assert any("gripper" in id for id in obstacles.ids)
    robot.detach("gripper")
    other.publish(obstacles, 0.002, HOME, STILL)
    assert len(obstacles) == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"name": ""}, "name of an arm"),
        ({"placement_error": np.nan}, "placement_error"),
        ({"level": -1}, "level"),
        ({"operating": 0.3}, "operating"),
    ],
)
def test_arguments_that_cannot_be_are_refused_by_name(arguments, words):
    with pytest.raises(ArmguardError, match=words):
        armguard.ArmObstacles(panda(), **arguments)
