"""Contacts in the workplace are those that Coal finds, and count once each."""

import coal
import numpy as np
import pinocchio
import pytest

pytest.importorskip("mujoco", reason="the extra mujoco is not installed")

from armguard.lab.human_reach.workplace import FLOOR, STEP, Workplace
from armguard.lab.simulation.bodies import BODIES, POINTS
from armguard.lab.simulation.mujoco_person import LEGS
from armguard.lab.simulation.person import ProceduralPerson
from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics, Robot

HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
SWING = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
HAND = POINTS.index("left_hand")


class Statue:
    """Stands far away, but for a hand that is where it is put."""

    duration = 100.0

    def __init__(self, hand):
        self.position = np.full((9, 3), 9.0) + np.arange(9)[:, None]
        self.position[HAND] = hand
        self.position[POINTS.index("left_elbow")] = hand

    def sample(self, time):
        return self.position, np.zeros((9, 3))


@pytest.fixture(scope="module")
def robot():
    made = Robot.load("panda")
    placement = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.21]))
    made.attach("part", "panda_hand", coal.Sphere(0.03), placement)
    return made


@pytest.fixture(scope="module")
def place(robot):
    return Workplace(robot, "part")


def find_gripper(robot, q):
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, q)
    return data.oMi[7].act(np.array([0.0, 0.0, 0.21]))


def test_what_is_touched_is_what_coal_finds(robot, place):
    random, kinematics = np.random.default_rng(1), Kinematics(robot)
    reference = HullDistance(robot, kinematics)
    links = [k for k, name in enumerate(robot.links) if name != "part"]
    touched = 0
    for seed in range(60):
        person = ProceduralPerson(seed, 10.0, target=random.uniform(-0.4, 0.4, 3))
        q = HOME + random.uniform(-1.0, 1.0, 7)
        q = np.clip(q, robot.lower_position_limit, robot.upper_position_limit)
        kinematics.compute(q, np.zeros(7))
        # One who comes that much closer, so that there are contacts.
        position = person.sample(5.0)[0] + [0.0, 0.6 * random.random(), 0.0]
        body = Statue([0.0, 0.0, 9.0])
        body.position = position
        expected, doubtful = 0, 0
        for part in (*BODIES, LEGS):
            ends = position[[POINTS.index(name) for name in part.points]]
            if part is LEGS:
                ends = np.array([ends[0], [ends[0, 0], ends[0, 1], FLOOR + part.radius]])
            gap = min(reference.distance(k, ends, part.radius)[0] for k in links)
            expected += gap <= 0.0
            doubtful += abs(gap) < 1e-4
        place.reset(q, body, 0.0)
        assert abs(place.contacts_at_rest - expected) <= doubtful
        assert place.contacts == 0
        touched += expected
    assert touched > 20


def test_an_arm_that_moves_on_while_it_is_touched_counts_once(robot, place):
    place.reset(HOME, Statue(find_gripper(robot, HOME)), 0.0)
    place.move(np.zeros(7), 20)
    # The forearm ends in the hand.
    assert (place.contacts, place.contacts_at_rest) == (0, 3)
    place.move(SWING, 20)
    place.move(np.zeros(7), 20)
    place.move(-SWING, 20)
    assert (place.contacts, place.contacts_at_rest) == (3, 3)


def test_an_arm_that_swings_into_a_hand_touches_it_each_time(robot, place):
    beyond = HOME + 1.0 * np.eye(7)[0]
    place.reset(HOME, Statue(find_gripper(robot, beyond)), 0.0)
    counts = []
    for sign in (1.0, -1.0, 1.0, -1.0):
        for _ in range(100):
            place.move(sign * SWING, 20)
        counts.append(place.contacts)
    assert counts[0] > 0
    assert counts == [counts[0], counts[0], 2 * counts[0], 2 * counts[0]]
    assert place.contacts_at_rest == 0
    assert place.time == pytest.approx(8.0)


def test_a_part_counts_while_it_is_held(robot, place):
    below = find_gripper(robot, HOME) - [0.0, 0.0, 0.03 + 0.13 - 0.005]
    found = []
    for holds in (False, True):
        place.reset(HOME, Statue(below), 0.0)
        before = place.contacts_at_rest
        place.holds_part = holds
        place.move(np.zeros(7), 20)
        found.append(place.contacts_at_rest - before)
    assert found[0] == 0
    assert found[1] > 0


def test_the_arm_keeps_to_velocities_and_to_its_position_limits(robot, place):
    random = np.random.default_rng(0)
    place.reset(HOME, Statue([0.0, 0.0, 9.0]), 0.0)
    expected, asked = HOME.copy(), np.zeros(7)
    for _ in range(100):
        asked = asked + random.uniform(-0.05, 0.05, 7)
        place.move(asked, 20)
        expected += asked * 20 * STEP
        q, v = place.read_joints()
        assert q == pytest.approx(expected, abs=1e-3)
        assert v == pytest.approx(asked, abs=0.01)
    for _ in range(300):
        place.move(np.ones(7), 20)
    assert place.read_joints()[0] == pytest.approx(robot.upper_position_limit, abs=1e-3)
