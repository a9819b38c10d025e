import numpy as np
import pytest

from armguard.lab.faults.scene import RADIUS
from armguard.lab.faults.truth import OUT_OF_REACH, Witness
from armguard.robot import Robot

STRETCHED = np.array([0.0, 0.5, 0.0, -1.6, 0.0, 2.1, 0.8])
MOVING = np.full(7, 0.1)


@pytest.fixture(scope="module")
def witness():
    return Witness(Robot.load("panda"))


def stand_at(distance):
    """A person at a distance from the base, straight ahead. Shape (1, 2, 3)."""
    return np.array([[[distance, 0.0, 0.1], [distance, 0.0, 0.9]]])


def make_steps(count, q=STRETCHED, v=MOVING):
    return 0.001 * np.arange(count), np.tile(q, (count, 1)), np.tile(v, (count, 1))


def test_distances_are_those_of_the_bodies(witness):
    far = witness.measure(STRETCHED, MOVING, stand_at(1.4))
    near = witness.measure(STRETCHED, MOVING, stand_at(1.2))
    assert far - near == pytest.approx(0.2, abs=0.01)
    assert 0.0 < near < 1.2 - RADIUS
    assert witness.measure(STRETCHED, MOVING, stand_at(0.4)) < 0.0
    both = np.concatenate([stand_at(1.4), stand_at(1.2)])
    assert witness.measure(STRETCHED, MOVING, both) == near
    assert witness.measure(STRETCHED, MOVING, stand_at(OUT_OF_REACH + 0.1)) == np.inf


@pytest.mark.parametrize("pace", [0.5, 2.0])
def test_no_contact_is_missed_between_measurements(witness, pace):
    times, q, v = make_steps(2000)

    def walk_past(time):
        """Towards the arm, and away again."""
        return stand_at(1.2 + pace * abs(time - 0.7) - 0.5)

    found = witness.follow(times, q, v, walk_past)
    every = [witness.measure(q[0], v[0], walk_past(time)) for time in times]
    assert found.contacts == 1
    assert found.distance == pytest.approx(min(every), abs=0.002 * pace)
    assert found.moving == 1.0
    assert witness.follow(times, q, v, walk_past, only_first=True).contacts == 1


def test_who_touches_an_arm_at_rest_is_not_hit(witness):
    times, q, _ = make_steps(1000)
    found = witness.follow(times, q, np.zeros_like(q), lambda time: stand_at(0.4))
    assert found == (0, np.inf, 0.0)
    v = np.zeros_like(q)
    v[500, 3] = 1e-6
    assert witness.follow(times, q, v, lambda time: stand_at(0.4)).contacts == 1
    nothing = np.zeros((0, 7))
    assert witness.follow(np.zeros(0), nothing, nothing, stand_at) == (0, np.inf, 0.0)
