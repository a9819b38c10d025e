import numpy as np
import pinocchio
import pytest

from armguard.bounds import BrakingMotion, JointMotion, table_contact_time
from armguard.bounds.table_time import ArmSphere, is_free_until, obstacle_room
from armguard.contact.bodies import Bounds, Hull
from armguard.jit.numerics import TABLE_END_SLACK
from support.example_arms import load_arm
from support.hostile_joints import (
    STEP,
    chain_to,
    chase,
    limits_of,
    random_script,
    random_state,
    record_motion,
)

NOW = 6
"""Step of a recorded motion that is called now; states are measured up to that many away."""
HORIZON, REACTION = 0.004, 0.02


@pytest.fixture(scope="module")
def joint_motion(robot):
    return JointMotion(robot)


def spheres_of(robot):
    trees = [robot.cover.tree(link) for link in robot.links]
    joints = [robot.joint_index(link) for link in robot.links]
    return [
        (joint, sphere)
        for joint, tree in zip(joints, trees, strict=True)
        for sphere in np.asarray(tree.spheres)
    ]


def pad(points):
    padded = np.zeros((8, 3))
    padded[: len(points)] = points
    return padded


class Scene:
    """A sphere of the moving arm, and a hull that chases it; both are measured with errors."""

    def __init__(self, robot, motion, spheres, random, free):
        steps = 500
        self.row = random.integers(len(spheres))
        joint, sphere = spheres[self.row]
        q, v = random_state(robot, random)
        nv = len(q)
        care = random.integers(2, size=nv)
        chain = chain_to(robot, joint)
        places, qs, vs = np.empty((steps, 3)), np.empty((steps, nv)), np.empty((steps, nv))
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        script = random_script(nv, steps * STEP, random)
        if random.random() < 0.7:
            script[:, 1] = 0.0
        mode = random.integers(2)
        record_motion(
            chain, limits_of(robot), q, v, sphere[:3].copy(), direction, script, mode, care, free,
            places, qs, vs,
        )  # fmt: skip
        count = random.choice([1, 2, 8])
        self.accel, self.speed = random.choice([0.0, 2.0, 10.0]), random.choice([0.5, 2.0])
        body_radius = random.uniform(0.0, 0.2)
        radius = sphere[3] + body_radius
        away = direction + 0.3 * random.normal(size=3)
        away *= (radius + random.uniform(0.01, 0.8)) / np.linalg.norm(away)
        corners = places[NOW] + away + random.normal(size=(count, 3)) * 0.05
        pace = random.normal(size=(count, 3))
        pace *= self.speed * random.uniform(0.0, 1.0) / np.linalg.norm(pace, axis=1, keepdims=True)
        states = np.empty((steps, count, 6))
        first = chase(places, radius, corners, pace, self.accel, self.speed, NOW, states)
        self.contact = np.inf if first < 0 else (first - NOW) * STEP

        measured, seen = random.integers(0, 2 * NOW, size=2)
        self.arm_age, self.age = (NOW - measured) * STEP, (NOW - seen) * STEP
        self.q = qs[measured] + random.choice([-1.0, 0.0, 1.0], nv) * robot.position_error
        self.v = vs[measured] + random.choice([-1.0, 0.0, 1.0], nv) * robot.velocity_error
        self.velocity_error = random.choice([0.0, 0.1])
        position_error = random.choice([0.0, 0.02])
        off = random.normal(size=(2, count, 3))
        off /= np.linalg.norm(off, axis=2, keepdims=True)
        self.points = pad(states[seen, :, :3] + position_error * off[0])
        self.velocities = pad(states[seen, :, 3:] + self.velocity_error * off[1])
        self.count = count
        self.distance = radius + position_error + motion.position_error[self.row]
        data = robot.model.createData()
        self.jacobian = pinocchio.computeJointJacobians(robot.model, data, self.q)
        self.place = data.oMi[joint].act(sphere[:3])

    def time(self, motion, table, free_until=0.0, enough=np.inf):
        sphere, hull = self.pair(motion)
        return table_contact_time(sphere, table, hull, self.distance, free_until, enough)

    def pair(self, motion):
        lever, slope_error = motion.lever[self.row], motion.slope_error[self.row]
        bounds = Bounds(self.accel, self.speed, self.velocity_error, self.age)
        return (
            ArmSphere(*self.place, self.jacobian, lever, slope_error),
            Hull(self.points, self.velocities, self.count, bounds),
        )


@pytest.mark.parametrize("name", ["panda", "tiago"])
@pytest.mark.parametrize("brakes", [False, True])
def test_no_contact_comes_earlier(name, brakes):
    robot, random = load_arm(name), np.random.default_rng(0)
    spheres = spheres_of(robot)
    motion = BrakingMotion(robot, REACTION) if brakes else JointMotion(robot)
    contacts, closest = 0, 0.0
    for _ in range(1000):
        free = NOW * STEP + HORIZON + REACTION if brakes else np.inf
        scene = Scene(robot, motion, spheres, random, free)
        if brakes:
            table = motion.tabulate(scene.q, scene.v, scene.arm_age, HORIZON)
        else:
            table = motion.tabulate(scene.q, scene.v, scene.arm_age)
        time = scene.time(motion, table)
        assert 0.0 <= time <= scene.contact
        assert time <= table.time[-1]
        enough = random.uniform(0.0, 1.2) * min(time + 0.05, scene.contact)
        sooner = scene.time(motion, table, enough=enough)
        assert min(enough, time) <= sooner <= scene.contact
        if scene.contact < np.inf:
            contacts += 1
            if scene.contact > 0.05:
                closest = max(closest, time / scene.contact)
    assert contacts > 200
    assert closest > 0.8


def test_what_another_proof_has_shown_is_kept(robot, joint_motion):
    random = np.random.default_rng(1)
    spheres = spheres_of(robot)
    for _ in range(200):
        scene = Scene(robot, joint_motion, spheres, random, np.inf)
        table = joint_motion.tabulate(scene.q, scene.v, scene.arm_age)
        alone = scene.time(joint_motion, table)
        assert scene.time(joint_motion, table, alone) >= alone
        assert scene.time(joint_motion, table, 0.3) >= 0.3
        assert scene.time(joint_motion, table, 5.0) == 5.0


@pytest.mark.parametrize("accel", [0.0, 5.0, np.inf])
def test_a_body_that_breaks_its_speed_bound_may_go_on_as_fast_as_it_was_seen(accel):
    """In straight lines at its measured speed and its error, from before its stamp on."""
    random, closest = np.random.default_rng(3), np.inf
    for _ in range(300):
        speed, error = random.uniform(0.0, 1.0), random.choice([0.0, 0.1])
        point, heading = random.uniform(-1.0, 1.0, 3), random.normal(size=3)
        heading /= np.linalg.norm(heading)
        pace = (speed + error) * random.uniform(1.01, 4.0)
        normal = -heading if random.random() < 0.5 else random.normal(size=3)
        normal /= np.linalg.norm(normal)
        start = random.uniform(-0.5, 0.5)
        end = start + random.uniform(0.0, 1.0)
        hull = Hull(pad([point]), pad([pace * heading]), 1, Bounds(accel, speed, error, 0.0))
        room = obstacle_room(tuple(normal), (0.0, 0.0, 0.0), hull, start, end)
        for t in (start, 0.5 * (start + end), end):
            for truth in ((pace + error) * heading, pace * heading - error * normal):
                along = normal @ (point + truth * t)
                assert room <= along
                closest = min(closest, along - room)
    assert closest < 1e-9


def far_question(robot, motion, **changes):
    q = np.clip(np.zeros(7), robot.lower_position_limit, robot.upper_position_limit)
    data = robot.model.createData()
    arguments = {
        "place": np.array([0.3, 0.0, 0.5]),
        "points": pad([[1.0, 0.0, 0.5]]),
        "velocities": np.zeros((8, 3)),
        "count": 1,
        "accel": 10.0,
        "speed": 2.0,
        "velocity_error": 0.0,
        "age": 0.0,
        "contact_distance": 0.1,
        "free_until": 0.0,
        "enough": np.inf,
    } | changes
    place, points, velocities, count, *bounds, distance, free_until, enough = arguments.values()
    jacobian = pinocchio.computeJointJacobians(robot.model, data, q)
    table = motion.tabulate(q, np.zeros(7), 0.0)
    sphere = ArmSphere(*place, jacobian, motion.lever[-1], motion.slope_error[-1])
    hull = Hull(points, velocities, count, Bounds(*bounds))
    return table_contact_time(sphere, table, hull, distance, free_until, enough)


@pytest.mark.parametrize(
    "change",
    [
        {"place": np.array([np.nan, 0.0, 0.0])},
        {"points": np.full((8, 3), np.nan)},
        {"points": np.full((8, 3), np.inf)},
        {"velocities": np.full((8, 3), np.nan)},
        {"count": 0},
        {"accel": np.nan},
        {"accel": -1.0},
        {"speed": np.nan},
        {"speed": -1.0},
        {"velocity_error": np.nan},
        {"velocity_error": -0.1},
        {"age": np.nan},
        {"age": np.inf},
        {"contact_distance": np.nan},
        {"contact_distance": -0.1},
        {"contact_distance": 1.0},
        {"free_until": np.nan, "contact_distance": 1.0},
        {"accel": np.inf, "speed": np.inf},
    ],
)
def test_nonsense_and_contact_are_contact_now(robot, joint_motion, change):
    assert far_question(robot, joint_motion) > 0.1
    assert far_question(robot, joint_motion, **change) == 0.0
    assert far_question(robot, joint_motion, **change, enough=0.05) == 0.0


def test_a_far_obstacle_is_free_to_the_end_of_the_table(robot, joint_motion):
    time = far_question(robot, joint_motion, points=pad([[40.0, 0.0, 0.5]]))
    assert time == pytest.approx(1.024)


@pytest.mark.parametrize("name", ["panda", "tiago"])
def test_whether_the_end_is_reached_is_what_the_search_says(name):
    """And where one says more, the search is not far from it."""
    robot, random = load_arm(name), np.random.default_rng(5)
    spheres, motion = spheres_of(robot), BrakingMotion(robot, REACTION)
    answers = []
    for _ in range(400):
        scene = Scene(robot, motion, spheres, random, NOW * STEP + HORIZON + REACTION)
        table = motion.tabulate(scene.q, scene.v, scene.arm_age, HORIZON)
        end = float(table.time[-1]) * (1.0 - TABLE_END_SLACK)
        searched = scene.time(motion, table) >= end
        sphere, hull = scene.pair(motion)
        answer = is_free_until(sphere, table, hull, scene.distance, len(table.time) - 1)
        assert answer >= searched
        assert not answer or scene.contact >= end
        answers.append((answer, searched))
    agree = np.mean([one == other for one, other in answers])
    assert agree > 0.97
    assert 0.1 < np.mean([one for one, _ in answers]) < 0.9
