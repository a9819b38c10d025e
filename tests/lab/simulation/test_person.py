"""The simulated person: bounds held at every time, plausible samples."""

import numpy as np
import pytest

from armguard.lab.simulation import ProceduralPerson
from armguard.lab.simulation.bodies import BODIES, POINTS
from armguard.obstacles import Obstacles
from support.checking_sink import GrowthSink
from support.motion_samples import check_motion, sample_densely


@pytest.mark.parametrize("duration", [8.0, 9.5, 12.4, 14.0, 20.0, 60.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_person_moves_as_people_can_for_any_duration(duration, seed):
    person = ProceduralPerson(seed, duration)
    x, _ = check_motion(person, duration, 1.6, 8.0, dt=5e-3)
    hip = np.hypot(x[:, 2, 0], x[:, 2, 1])
    assert hip[0] == pytest.approx(person.far)
    assert hip[-1] == pytest.approx(person.far)
    assert hip.min() == pytest.approx(1.0, abs=1e-3)
    assert person.far == 6.0 or duration < 12.5
    assert person.far > 3.0


def test_a_person_reaches_the_arm_and_is_far_away_before_and_after():
    person = ProceduralPerson(3)
    target = [0.0, -0.4, 0.35]
    times = np.arange(0.0, 20.0, 0.02)
    x, _ = sample_densely(person, times)
    hands = x[:, [POINTS.index("left_hand"), POINTS.index("right_hand")]]
    distance = np.linalg.norm(hands - target, axis=2)
    assert (distance.min(axis=0) < 0.2).all()
    working = distance.max(axis=1) < 0.25
    assert working.sum() * 0.02 > 4.0
    horizontal = np.hypot(x[..., 0], x[..., 1])
    for still in (times < 0.9, times > 19.1):
        assert horizontal[still].min() > 5.7
    assert x[..., 2].min() > -0.75  # the floor, below the table


def test_arms_keep_their_lengths_and_stretch_no_further():
    random = np.random.default_rng(0)
    for seed in range(12):
        person = ProceduralPerson(seed, 10.0, target=random.uniform(-2.0, 2.0, 3))
        x, _ = check_motion(person, 10.0, 1.6, 8.0, dt=0.01)
        for side in ("left", "right"):
            shoulder, elbow, hand = (
                x[:, POINTS.index(f"{side}_{part}")] for part in ("shoulder", "elbow", "hand")
            )
            assert np.allclose(np.linalg.norm(elbow - shoulder, axis=1), 0.30)
            assert np.allclose(np.linalg.norm(hand - elbow, axis=1), 0.33)


def test_a_person_is_nine_bodies_none_of_which_a_table_ever_refuses():
    assert {body.name for body in BODIES} == set(POINTS)
    assert len(BODIES) == 9
    person, sink, table = ProceduralPerson(4), GrowthSink(), Obstacles()
    twin = ProceduralPerson(4)
    for now in np.arange(0.0, 20.01, 0.01):
        person.publish(sink, now)
        twin.publish(table, now)
    assert set(sink.last) == set(POINTS)
    assert not sink.refused
    assert sink.taken == 9 * 2001
    assert len(table) == 9
    assert table.take_faults() == []
