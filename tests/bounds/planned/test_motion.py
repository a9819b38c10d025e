import numpy as np
import pinocchio
import pytest

from armguard.bounds import (
    CheckedPlan,
    PlannedMotion,
    check_plan,
)
from armguard.exceptions import ArmguardError
from armguard.obstacles import Obstacles
from support.example_arms import load_holding
from support.hostile_joints import STEP
from support.motion_questions import HAND_POINT, unit
from support.plan_cases import Attack, Follower, Skin, Waves, all_pairs, make_plan, place_course

BITE = 0.05


def ask(motion, course, obstacles, links, now, margin=0.0):
    table = obstacles.table
    return motion.contact_time(
        course,
        all_pairs(obstacles, links),
        now,
        margin,
        table.accepted,
        table.refused_states,
        table.marks,
    )


@pytest.mark.parametrize("name", ["panda", "kinova", "tiago"])
def test_no_contact_comes_before_the_proved_time(name):
    robot, random = load_holding(name), np.random.default_rng(0)
    motion, skin = PlannedMotion(robot), Skin(robot, random)
    contacts, closest, free = 0, 0.0, 0
    for k in range(160):
        scene = Attack(robot, skin, random, BITE, stated=k % 2 == 0)
        plan = check_plan(scene.plan, robot, scene.now, scene.q, scene.v, scene.stamp)
        assert isinstance(plan, CheckedPlan), plan
        course = motion.lay_out(plan)
        if scene.is_stopped:
            course = motion.lay_out_left(plan)
        assert scene.rest <= course.end[-1] + STEP
        found = ask(motion, course, scene.obstacles, len(robot.links), scene.now)
        assert 0.0 <= found.time <= scene.contact
        free += found.time == np.inf
        if scene.contact < np.inf:
            contacts += 1
            if scene.contact > 0.05:
                closest = max(closest, found.time / scene.contact)
    assert contacts > 90
    assert closest > 0.55


@pytest.fixture(scope="module")
def motion(robot):
    return PlannedMotion(robot)


def lay_out(robot, motion, random, speed=0.3, duration=0.2):
    """A random motion, its plan as checked where it begins, and the plan's course."""
    waves = Waves(robot, random, speed)
    times = np.linspace(0.0, duration, 21)
    plan = make_plan(robot, waves, 0.0, times, np.full(7, 1e-3), np.full(7, 0.02))
    checked = check_plan(plan, robot, 0.0, waves.position(0.0), waves.velocity(0.0), 0.0)
    return plan, waves, checked, motion.lay_out(checked)


def test_advance_is_never_exceeded_and_never_falls(robot, motion):
    random, data, closest = np.random.default_rng(1), robot.model.createData(), 0.0
    joint = robot.joint_index("panda_hand")
    for _ in range(20):
        plan, waves, checked, course = lay_out(robot, motion, random)
        along = unit(random)
        qs = Follower(robot, waves, plan, random, 1, 0.0, 0.1).q[:, 0]
        pinocchio.forwardKinematics(robot.model, data, waves.position(0.0))
        start = along @ data.oMi[joint].act(HAND_POINT)
        before = furthest = 0.0
        for k in range(0, len(qs), 20):
            t = k * STEP
            bound = motion.advance(course, checked, "panda_hand", HAND_POINT, along, t)
            pinocchio.forwardKinematics(robot.model, data, qs[k])
            furthest = max(furthest, along @ data.oMi[joint].act(HAND_POINT) - start)
            assert bound >= before
            assert bound >= furthest
            before = bound
            if bound > 0.02:
                closest = max(closest, furthest / bound)
    assert closest > 0.8


def test_a_moved_base_moves_everything(robot, motion):
    random = np.random.default_rng(3)
    place = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.4, -1.0, 2.0), np.array([3.0, -1.0, 0.5]))
    moved = PlannedMotion(robot, place)
    for _ in range(10):
        _, _, checked, course = lay_out(robot, motion, random)
        there = moved.lay_out(checked)
        centers = place_course(motion, course)
        assert place_course(moved, there)[5] == pytest.approx(
            np.array([place.act(p) for p in centers[5]]), abs=1e-9
        )
        point = centers[0, 30] + unit(random) * random.uniform(0.3, 0.8)
        times = []
        for where, model, path in ((point, motion, course), (place.act(point), moved, there)):
            obstacles = Obstacles()
            obstacles.update(["ball"], 0.0, [where], np.zeros((1, 3)), radius=0.1)
            times.append(ask(model, path, obstacles, len(robot.links), 0.0).time)
        assert times[0] == pytest.approx(times[1], abs=1e-6)


def test_what_was_not_checked_for_this_robot_is_refused(robot, motion):
    plan, _, checked, course = lay_out(robot, motion, np.random.default_rng(4))
    for wrong in (plan, None, checked._replace(q=checked.q[:, :6])):
        with pytest.raises(ArmguardError, match="check_plan"):
            motion.lay_out(wrong)
    q = checked.measured_q
    for wrong in (q.astype(np.float32), np.repeat(q, 2)[::2], list(q)):
        # Compiled code would read other numbers from these.
        with pytest.raises(ArmguardError, match="with other arrays; expected what check_plan"):
            motion.lay_out(checked._replace(measured_q=wrong))
    with pytest.raises(ArmguardError, match="direction"):
        motion.advance(course, checked, "panda_hand", HAND_POINT, [0.0, 0.0, 2.0], 0.1)
    with pytest.raises(ArmguardError, match="t: "):
        motion.advance(course, checked, "panda_hand", HAND_POINT, [0.0, 0.0, 1.0], -0.1)


def test_a_deviation_without_end_frees_nothing(robot, motion):
    waves = Waves(robot, np.random.default_rng(5), 0.3)
    plan = make_plan(robot, waves, 0.0, np.linspace(0.0, 0.2, 21), np.full(7, 1e308))
    checked = check_plan(plan, robot, 0.0, waves.position(0.0), waves.velocity(0.0), 0.0)
    obstacles = Obstacles()
    obstacles.update(["ball"], 0.0, [[1.0, 0.0, 0.5]], np.zeros((1, 3)), radius=0.1)
    found = ask(motion, motion.lay_out(checked), obstacles, len(robot.links), 0.0)
    assert found.time == 0.0


def test_whole_numbers_are_asked_for_as_any_others(robot, motion):
    _, _, plan, _ = lay_out(robot, motion, np.random.default_rng(4))
    course = motion.lay_out(plan._replace(now=0))
    place = place_course(motion, course)[0, motion._arm.tree.root[-1]] + [0.0, 0.0, 0.6]
    obstacles, links = Obstacles(accel=0.0, speed=0.0), len(robot.links)
    obstacles.update(["ball"], 0.0, [place], np.zeros((1, 3)), radius=0.1)
    assert ask(motion, course, obstacles, links, 0, 0).time == np.inf
    later = motion.lay_out(plan._replace(now=0.001))
    assert ask(motion, later, obstacles, links, 0.001, 0.9).time == 0.0
    assert ask(motion, later, obstacles, links, 0.0, 0.0).time == 0.0, "before it begins"
