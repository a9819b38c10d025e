"""A monitor that is told what the controller keeps to: what it gains, and what it never misses.

ARMGUARD_PAIR_TICKS sets how many pairs are watched for how many ticks before they touch.
"""

import os

import coal
import numpy as np
import pytest

from armguard.bounds import Plan
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import OperatingLimits
from armguard.verdict import Level, ReasonKind
from support.operating_motions import Law, record_joint
from support.panda_monitor import (
    HOME,
    PERIOD,
    STILL,
    kinds,
    make_monitor,
    panda,
    see,
    steps,
    subjects,
)

PAIR_TICKS = int(os.environ.get("ARMGUARD_PAIR_TICKS", "12000"))
THIRD = np.eye(7)[2]
QUARTER = OperatingLimits.fraction(panda(), velocity=0.25, acceleration=0.25)
WHOLE = OperatingLimits.fraction(panda())
HARD = 0.046  # within a tick no more than the hardware can do, errors included, [rad/s]


def run(schedule, motion, operating):
    """Verdicts of an arm that swings beside a ball that comes and goes."""
    obstacles, monitor = make_monitor(
        schedule, motion=motion, operating=operating, source_timeout=1.0
    )
    random, verdicts = np.random.default_rng(0), []
    for k in range(600):
        now = k * PERIOD
        if k % 7 == 0:
            away = [0.9 + 0.4 * np.cos(2.0 * now), 0.3, 0.6]
            see(obstacles, now, away, velocity=[[-0.8 * np.sin(2.0 * now), 0.0, 0.0]])
        noise = random.uniform(-1.0, 1.0, (2, 7))
        # Ages from 4 ms to -2 ms, no stamp before the last one.
        stamp = now - 0.001 + 0.003 * np.sin(20.0 * now) * (k % 100 > 50)
        stamp = max(stamp, verdicts[-1].stamp) if verdicts else stamp
        q = HOME + 0.1 * np.sin(3.0 * stamp) * THIRD + noise[0] * panda().position_error
        v = 0.3 * np.cos(3.0 * stamp) * THIRD + noise[1] * panda().velocity_error
        verdicts.append(monitor.step(float(stamp), q, v, now))
    return verdicts


@pytest.mark.parametrize(
    ("schedule", "motion"),
    [("deadline", "joint"), ("deadline", "isotropic"), ("deadline", "planned"), ("full", "joint")],
)
def test_the_hardware_s_limits_as_operating_limits_change_nothing_to_the_bit(schedule, motion):
    without, whole = run(schedule, motion, None), run(schedule, motion, WHOLE)
    assert without == whole
    assert len({verdict.contact_time for verdict in without}) > 100


def test_a_quarter_of_the_limits_never_says_less_and_often_more():
    without, quarter = run("deadline", "joint", None), run("deadline", "joint", QUARTER)
    assert not any(ReasonKind.OPERATING_LIMITS_BROKEN in kinds(verdict) for verdict in quarter)
    gained = [
        two.stop_time < one.stop_time and two.level >= one.level
        for one, two in zip(without, quarter, strict=True)
    ]
    assert all(gained)
    assert sum(one.level for one in quarter) > sum(one.level for one in without)
    assert sum(one.speed_scale < 1.0 for one in quarter) < sum(
        one.speed_scale < 1.0 for one in without
    )


@pytest.mark.hazard("H-17")
@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_a_break_is_a_stop_that_names_it_and_the_hardware_counts_until_it_is_long_over(schedule):
    operating = OperatingLimits.fraction(panda(), velocity=0.25, acceleration=0.25)
    obstacles, monitor = make_monitor(
        schedule, obstacles=Obstacles(sources=[]), operating=operating, rise_delay=0.05
    )
    _, plain = make_monitor(schedule, obstacles=Obstacles(sources=[]), rise_delay=0.05)
    obstacles.add_static("post", [2.5, 0.0, 0.5], 0.1)
    before = steps(monitor, 0, 100)[-1]
    assert before.level is Level.CLEAR
    top = 0.25 * panda().velocity_limit[2]
    # From rest to half a velocity error beyond what errors can hide.
    fast = (top + 1.5 * panda().velocity_error[2]) * THIRD
    q, now = HOME.copy(), 0.1
    for v in (0.2 * fast, 0.4 * fast, 0.6 * fast, 0.8 * fast, fast):
        now += 0.04
        q = q + 0.04 * v
        verdict = monitor.step(now, q, v)
        reference = plain.step(now, q, v)
    assert verdict.level is Level.STOP
    assert subjects(verdict, ReasonKind.OPERATING_LIMITS_BROKEN) == {"panda_joint3"}
    assert verdict.stop_time == reference.stop_time
    assert verdict.speed_scale == 0.0
    limits = monitor._scheduler.arm.state.scene.limits
    np.testing.assert_array_equal(limits.operating_velocity, panda().velocity_limit)
    np.testing.assert_array_equal(limits.operating_acceleration, panda().acceleration_limit)
    broken = now
    # It slows down as hard as it likes, and then keeps its limits.
    levels, last = [], 0
    for k in range(1, 120):
        v = max(0.0, 1.0 - 0.015 * k) * fast
        q = q + PERIOD * v
        verdict = monitor.step(broken + k * PERIOD, q, v)
        levels.append((verdict.level, monitor._operating.in_force.is_suspended))
        if ReasonKind.OPERATING_LIMITS_BROKEN in kinds(verdict):
            last = k
    for k, (level, suspended) in enumerate(levels, start=1):
        # To the tick the same, whichever way the last one is rounded.
        assert suspended == (level is Level.STOP)
        assert k == last + 50 or suspended == (k < last + 50)
    assert not suspended
    np.testing.assert_allclose(limits.operating_velocity, 0.25 * panda().velocity_limit)


@pytest.mark.parametrize("velocity", [0.25, 1.0])
def test_no_certificate_survives_a_break(velocity):
    """Nor where accelerations alone are limited, so that no bound on speed grows."""
    operating = OperatingLimits.fraction(panda(), velocity=velocity, acceleration=0.25)
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=[]), operating=operating)
    for k in range(10):
        obstacles.add_static(f"post{k}", [2.5, 0.1 * k, 0.5], 0.1)
    everything = steps(monitor, 0, 1)[0].evaluated
    assert steps(monitor, 1, 30)[-1].evaluated < everything
    verdict = monitor.step(31 * PERIOD, HOME, HARD * THIRD)
    assert ReasonKind.OPERATING_LIMITS_BROKEN in kinds(verdict)
    assert verdict.evaluated >= everything
    assert verdict.complete


def test_what_breaks_the_limits_in_a_form_that_takes_a_closer_look_is_found_as_well():
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=[]), operating=QUARTER)
    obstacles.add_static("post", [2.5, 0.0, 0.5], 0.1)
    steps(monitor, 0, 10)
    verdict = monitor.step(10 * PERIOD, list(HOME), list(HARD * THIRD))
    assert ReasonKind.OPERATING_LIMITS_BROKEN in kinds(verdict)


def test_a_joint_above_its_operating_velocity_within_errors_counts_with_what_was_measured():
    obstacles, monitor = make_monitor(
        obstacles=Obstacles(sources=[]), operating=QUARTER, motion="isotropic"
    )
    obstacles.add_static("post", [2.5, 0.0, 0.5], 0.1)
    top = 0.25 * panda().velocity_limit[2]
    v = (top + 0.9 * panda().velocity_error[2]) * THIRD
    verdict = monitor.step(0.0, HOME, v)
    assert not kinds(verdict) & {ReasonKind.OPERATING_LIMITS_BROKEN}
    arm = monitor._scheduler.arm
    assert arm.motion.isotropic.is_widened
    monitor.step(PERIOD, HOME + PERIOD * v, (top - 0.01) * THIRD)
    assert not arm.motion.isotropic.is_widened


def test_a_piece_rests_on_the_robot_s_own_limits_and_may_be_finished_though_others_are_broken():
    _, monitor = make_monitor(obstacles=Obstacles(sources=[]), operating=QUARTER, motion="planned")
    steps(monitor, 0, 10)
    rest = Plan(0.01, [0.0, 0.5], [HOME, HOME], [STILL, STILL], np.full(7, 0.01), np.full(7, 5.0))
    assert monitor.commit(rest).safe
    steps(monitor, 10, 5)
    verdict = monitor.step(15 * PERIOD, HOME, HARD * THIRD)
    assert ReasonKind.OPERATING_LIMITS_BROKEN in kinds(verdict)
    assert (verdict.level, verdict.stop) == (Level.STOP, "finish")


def test_after_a_reset_limits_must_be_kept_before_they_count():
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=[]), operating=QUARTER)
    obstacles.add_static("post", [2.5, 0.0, 0.5], 0.1)
    steps(monitor, 0, 10)
    speed = monitor._scheduler.arm.motion.isotropic.speed.copy()
    monitor.step(10 * PERIOD, HOME, HARD * THIRD)
    assert (monitor._scheduler.arm.motion.isotropic.speed >= 2.0 * speed).all()
    monitor.reset()
    verdicts = steps(monitor, 0, 300)
    assert (monitor._scheduler.arm.motion.isotropic.speed >= 2.0 * speed).all()
    verdicts += steps(monitor, 300, 2)
    np.testing.assert_array_equal(monitor._scheduler.arm.motion.isotropic.speed, speed)
    assert not any(ReasonKind.OPERATING_LIMITS_BROKEN in kinds(verdict) for verdict in verdicts)
    assert verdicts[-1].level is Level.CLEAR


def test_after_a_reset_no_limit_counts_before_a_second_state_has_kept_it():
    """Not even where limits count as soon as they are kept: of one state there is no telling."""
    sources = Obstacles(sources=[])
    _, monitor = make_monitor(obstacles=sources, operating=QUARTER, rise_delay=0.0)
    steps(monitor, 0, 10)
    monitor.step(10 * PERIOD, HOME, HARD * THIRD)
    limits = monitor._scheduler.arm.state.scene.limits
    monitor.reset()
    steps(monitor, 0, 1)
    np.testing.assert_array_equal(limits.operating_velocity, panda().velocity_limit)
    steps(monitor, 1, 1)
    assert (limits.operating_velocity < panda().velocity_limit).all()


def test_while_states_are_not_believed_no_limits_come_back():
    _, monitor = make_monitor(obstacles=Obstacles(sources=[]), operating=QUARTER)
    steps(monitor, 0, 10)
    monitor.step(10 * PERIOD, HOME, HARD * THIRD)
    for k in range(11, 1000):
        monitor.step(k * PERIOD, np.full(7, np.nan), STILL)
    limits = monitor._scheduler.arm.state.scene.limits
    np.testing.assert_array_equal(limits.operating_velocity, panda().velocity_limit)
    monitor.reset()
    steps(monitor, 1000, 1)
    np.testing.assert_array_equal(limits.operating_velocity, panda().velocity_limit)


def test_a_tool_attached_meanwhile_has_the_limits_in_force():
    robot, obstacles = Robot.load("panda"), Obstacles(sources=[])
    obstacles.add_static("post", [2.5, 0.0, 0.5], 0.1)
    monitor = Monitor(robot, obstacles, operating=QUARTER)
    steps(monitor, 0, 10)
    monitor.step(10 * PERIOD, HOME, HARD * THIRD)
    robot.attach("tool", "panda_hand", coal.Sphere(0.05))
    monitor.step(11 * PERIOD, HOME, HARD * THIRD)
    isotropic, limits = (
        monitor._scheduler.arm.motion.isotropic,
        monitor._scheduler.arm.state.scene.limits,
    )
    assert "tool" in monitor._scheduler.arm.links
    np.testing.assert_array_equal(limits.operating_velocity, panda().velocity_limit)
    np.testing.assert_array_equal(isotropic._fastest, panda().velocity_limit)


@pytest.mark.parametrize(
    "bad",
    [
        OperatingLimits(velocity=100.0),
        OperatingLimits(acceleration=[1.0] * 6),
        "published soon",
        0.3,
    ],
)
def test_limits_that_do_not_fit_are_refused(bad):
    with pytest.raises(ArmguardError, match="operating"):
        make_monitor(operating=bad)


# ---- pairs that touch soon ----

OBSTACLES, TICKS = 12, 60
POSITION_ERROR, VELOCITY_ERROR = 0.01, 0.05
LAGS = (-3, 0, 0, 0, 5)
KINEMATICS = Kinematics(panda())


def at_bounds(random, shape, size):
    vectors = random.normal(size=shape)
    return vectors * (0.999 * size / np.linalg.norm(vectors, axis=-1, keepdims=True))


def move_arm(random, velocity, acceleration):
    """Joint positions and velocities at all ticks, or None where a joint runs into its stop."""
    robot, times = panda(), np.arange(TICKS + 10) * PERIOD
    places, rates = np.zeros((2, 7, len(times)))
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    for j in range(7):
        law = Law(
            lower[j], upper[j], velocity[j], acceleration[j], robot.acceleration_limit[j],
            robot.braking_deceleration[j],
        )  # fmt: skip
        q = random.uniform(lower[j] + 0.2, upper[j] - 0.2)
        v = random.uniform(-1.0, 1.0) * velocity[j] * random.choice([0.3, 1.0])
        hit = record_joint(q, v, np.inf, times, law, random, places[j], rates[j])
        if hit:
            return None
    return places.T.copy(), rates.T.copy()


def attack(random):
    """Balls that touch a corner of a link each at the last tick, at their bounds all the time."""
    robot = panda()
    links = random.integers(0, len(robot.links), OBSTACLES)
    touched = np.empty((OBSTACLES, 3))
    for k, link in enumerate(links):
        name = robot.links[link]
        corners = robot.triangles(name).reshape(-1, 3)
        corner = corners[random.integers(len(corners))]
        touched[k] = KINEMATICS.data.oMi[robot.joint_index(name)].act(corner)
    radius = random.uniform(0.02, 0.15, OBSTACLES)
    side = random.normal(size=(OBSTACLES, 3))
    side /= np.linalg.norm(side, axis=1)[:, None]
    end = touched + side * (radius * (1.0 - 1e-9))[:, None]
    accel = random.normal(size=(OBSTACLES, 3)) * 6.0
    last = -side * random.uniform(0.0, 2.5, OBSTACLES)[:, None] + random.normal(size=(OBSTACLES, 3))
    left = (TICKS - np.arange(TICKS + 10)) * PERIOD
    velocity = last - accel * left[:, None, None]
    position = end - last * left[:, None, None] + 0.5 * accel * (left**2)[:, None, None]
    speed = np.linalg.norm(velocity, axis=2).max(axis=0)
    return links, radius, np.linalg.norm(accel, axis=1), speed, position, velocity


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
def test_no_pair_touches_before_its_time(motion, record_property):
    robot, random = panda(), np.random.default_rng(3)
    watched, closest, scene = 0, 0.0, 0
    for share in ((0.25, 0.1), (1.0, 0.27)):
        velocity = share[0] * robot.velocity_limit
        acceleration = share[1] * robot.acceleration_limit
        operating = OperatingLimits(velocity, acceleration)
        obstacles, monitor = make_monitor(operating=operating, motion=motion, source_timeout=1e6)
        until = watched + PAIR_TICKS // 4
        while watched < until:
            moved = move_arm(random, velocity, acceleration)
            if moved is None:
                continue
            scene += 1
            start = 10.0 * scene
            KINEMATICS.compute(moved[0][TICKS], moved[1][TICKS])
            links, radius, accel, speed, position, rate = attack(random)
            names = np.array([f"{scene}-{k}" for k in range(OBSTACLES)])
            obstacles.remove([name for name in obstacles.ids if name])
            monitor.reset()
            contact = start + TICKS * PERIOD
            lag = random.choice(LAGS)
            newest = -1
            for tick in range(5, TICKS):
                now = start + tick * PERIOD
                seen = min(max(tick - random.choice(LAGS), newest, 0), TICKS + 9)
                newest = seen
                some = np.arange(OBSTACLES) if tick == 5 else random.random(OBSTACLES) < 0.2
                if tick == 5 or some.any():
                    shape = len(radius[some]), 3
                    obstacles.update(
                        list(names[some]), start + seen * PERIOD,
                        position[seen, some] + at_bounds(random, shape, POSITION_ERROR),
                        rate[seen, some] + at_bounds(random, shape, VELOCITY_ERROR),
                        radius=radius[some], accel=accel[some], speed=speed[some],
                        position_error=POSITION_ERROR, velocity_error=VELOCITY_ERROR,
                    )  # fmt: skip
                state = tick - lag
                noise = np.clip(3.0 * random.uniform(-1.0, 1.0, (2, 7)), -0.999, 0.999)
                verdict = monitor.step(
                    start + state * PERIOD,
                    moved[0][state] + noise[0] * robot.position_error,
                    moved[1][state] + noise[1] * robot.velocity_error,
                    now,
                )
                assert not kinds(verdict) & {
                    ReasonKind.OPERATING_LIMITS_BROKEN,
                    ReasonKind.OBSTACLE_REFUSED,
                    ReasonKind.BOUND_BROKEN,
                    ReasonKind.JOINT_STATE_JUMPED,
                    ReasonKind.JOINT_STATE_BEYOND_LIMITS,
                }, verdict.reasons
                assert now + verdict.contact_time <= contact + 1e-9
                scheduler, epoch = monitor._scheduler, monitor._epoch
                for k in range(OBSTACLES):
                    pair = obstacles.row(names[k]) * len(robot.links) + links[k]
                    expiry = scheduler.recall(int(pair)).expiry + epoch
                    assert expiry <= contact + 1e-9
                    if expiry > now:
                        closest = max(closest, (expiry - now) / (contact - now))
                    watched += contact - now <= 0.05
    record_property("pair-ticks, closest", (watched, closest))
    assert closest > (0.8 if motion == "joint" else 0.5)
