import numpy as np
import pinocchio
import pytest

from armguard.lab.tradeoff.truth import TrueArm, find_contacts, measure
from support.nearest_points import closest_in_hull
from support.panda_monitor import HOME, ranged_panda
from support.tradeoff_cases import make_message

BOUNDS = {"accel": 10.0, "speed": 2.0}
SWIFT = {"accel": 1e5, "speed": 2.0}
AWAY = np.array([0.5, 0.0, 0.0])


class Way:
    """A scene whose arm turns slowly about its first joint."""

    def __init__(self, messages, pace=0.1):
        self.messages, self._pace = messages, np.array([pace, *[0.0] * 6])

    def sample(self, time):
        return HOME + time * self._pace, self._pace


def test_distances_from_a_segment_are_those_of_a_hull():
    random = np.random.default_rng(0)
    for count in (1, 2):
        ends, points = random.normal(size=(count, 3)), random.normal(size=(20, 3))
        expected = [np.linalg.norm(closest_in_hull(ends - point)) for point in points]
        np.testing.assert_allclose(measure(points, ends), expected, atol=1e-9)
    same = np.ones((2, 3))
    np.testing.assert_allclose(measure(np.zeros((1, 3)), same), [np.sqrt(3.0)])


@pytest.mark.parametrize("base", [None, pinocchio.SE3(np.eye(3), np.array([1.0, 2.0, 0.3]))])
def test_corners_are_where_pinocchio_puts_the_links(base):
    robot = ranged_panda()
    arm = TrueArm(robot, base)
    arm.place(HOME)
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, HOME)
    for link, name in enumerate(robot.links):
        placed = data.oMi[robot.joint_index(name)]
        expected = np.array([placed.act(corner) for corner in robot.hull(name)])
        if base is not None:
            expected += base.translation
        np.testing.assert_allclose(arm.corners(link), expected, atol=1e-12)
        # What is farther than asked for need not be told; what is near is told exactly.
        place = expected.mean(axis=0) + np.array([0.0, 0.0, 3.0])
        nearest = min(np.linalg.norm(arm.corners(k) - place, axis=1).min() for k in range(10))
        assert arm.gap(place[None], 0.1, within=9.0)[0] == pytest.approx(nearest - 0.1)
        assert arm.gap(place[None], 0.1)[0] == np.inf


def contacts(places, *, pace=0.1, bounds=BOUNDS):
    messages = [make_message(0.01 * k, place, **bounds) for k, place in enumerate(places)]
    return find_contacts(Way(messages, pace), TrueArm(ranged_panda(), None), 10.0, 2.0)


def hand():
    arm = TrueArm(ranged_panda(), None)
    arm.place(HOME)
    return arm.corners(7).mean(axis=0)


def test_a_contact_is_found_once_while_it_lasts():
    away = np.array([0.015, 0.0, 0.0])
    places = [hand() + max(20 - k, 0) * away for k in range(40)]
    (contact,) = contacts(places, bounds=SWIFT)
    assert (contact.body, contact.first_seen, contact.is_beyond) == ("ball", 0.0, False)
    assert 0.05 < contact.time < 0.2
    there = [place for place in places for _ in range(2)]
    assert (
        len(contacts([*there, hand() + 1.0, *there], bounds={"accel": np.inf, "speed": np.inf}))
        == 2
    )


def test_what_rests_or_was_there_from_the_first_is_no_contact():
    assert contacts([hand()] * 5) == []
    assert contacts([hand() + AWAY, hand()], pace=0.0) == []


@pytest.mark.parametrize(
    ("bounds", "is_beyond"),
    [
        ({}, True),
        (SWIFT, True),
        ({"accel": 10.0, "speed": 60.0}, True),
        ({"accel": 1e5, "speed": 60.0}, False),
        ({"accel": 0.0, "speed": 0.0, "position_error": 1.0, "velocity_error": 99.0}, False),
    ],
)
def test_a_body_that_jumps_breaks_its_bounds_unless_they_allow_it(bounds, is_beyond):
    (contact,) = contacts([hand() + AWAY, hand()], bounds=bounds)
    assert contact.is_beyond is is_beyond
