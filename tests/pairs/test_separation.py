import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.pairs import compute_separation


def test_worked_case():
    distance = compute_separation(
        1.0, 0.10, 0.30, intrusion_distance=0.20, human_uncertainty=0.10, robot_uncertainty=0.05
    )
    assert isinstance(distance, float)
    assert distance == pytest.approx(1.24, abs=1e-12)


def test_given_stopping_distance_replaces_the_assumed_one():
    assumed = compute_separation(1.0, 0.1, 0.3)
    assert compute_separation(1.0, 0.1, 0.3, stopping_distance=0.15) == pytest.approx(assumed)
    given = compute_separation(1.0, 0.1, 0.3, stopping_distance=0.5)
    assert given == pytest.approx(assumed + 0.35)


def test_a_robot_at_rest_leaves_the_persons_way():
    assert compute_separation(0.0, 0.1, 0.4) == pytest.approx(0.8)


def test_arrays_broadcast_and_agree_with_single_cases():
    random = np.random.default_rng(0)
    speed, reaction = random.random(4), random.random((3, 1))
    stopping, human = random.random((3, 4)), random.random((2, 1, 1))
    together = compute_separation(speed, reaction, stopping, human_speed=human)
    assert together.shape == (2, 3, 4)
    for k, i, j in np.ndindex(2, 3, 4):
        single = compute_separation(
            speed[j], reaction[i, 0], stopping[i, j], human_speed=human[k, 0, 0]
        )
        assert together[k, i, j] == pytest.approx(single)


def test_never_less_for_more_of_anything():
    random = np.random.default_rng(1)
    keys = ("human_speed", "intrusion_distance", "human_uncertainty", "robot_uncertainty")
    for _ in range(100):
        values = random.random(7)
        base = compute_separation(*values[:3], **dict(zip(keys, values[3:], strict=True)))
        for k in range(7):
            more = values.copy()
            more[k] += 0.1
            found = compute_separation(*more[:3], **dict(zip(keys, more[3:], strict=True)))
            assert found >= base


def test_what_is_unbounded_stays_so():
    assert compute_separation(np.inf, 0.1, 0.3) == np.inf
    assert compute_separation(0.0, 0.1, 0.3, human_uncertainty=np.inf) == np.inf
    assert compute_separation(0.0, np.inf, 0.3, human_speed=0.0) == 0.0


@pytest.mark.parametrize("bad", [-0.1, np.nan, "fast", [0.1, np.nan]])
@pytest.mark.parametrize("name", ["robot_speed", "reaction_time", "stopping_time", "human_speed"])
def test_bad_numbers_are_refused_by_name(name, bad):
    good = {"robot_speed": 1.0, "reaction_time": 0.1, "stopping_time": 0.3, "human_speed": 1.6}
    with pytest.raises(ArmguardError) as caught:
        compute_separation(**{**good, name: bad})
    assert caught.value.offender == name


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ArmguardError, match="broadcast"):
        compute_separation(np.ones(2), np.ones(3), 0.1)
