import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from armguard.robot.wrap_angle import MOST_TURNS, TURN, find_continuous, nearest_turn

angles = st.floats(-1e6, 1e6)


@given(angles, angles)
def test_the_nearest_is_whole_turns_away_and_no_farther_than_half_of_one(position, reference):
    found = nearest_turn(position, reference)
    turns = (found - position) / TURN
    assert abs(turns - round(turns)) < 1e-9
    assert abs(found - reference) <= math.pi + 1e-8


@given(angles, st.floats(-math.pi * (1 - 1e-9), math.pi * (1 - 1e-9)))
def test_what_is_near_already_stays_to_the_bit(position, off):
    reference = position + off
    if abs(reference - position) < math.pi * (1 - 1e-9):
        assert nearest_turn(position, reference) == position


@given(st.floats(), st.floats())
def test_what_is_no_place_or_too_far_away_stays_as_it_is(position, reference):
    found = nearest_turn(position, reference)
    if not abs(reference - position) <= MOST_TURNS * TURN * 1.001:
        assert found == position or (math.isnan(found) and math.isnan(position))


def test_a_joint_is_continuous_without_limits_at_both_ends():
    lower, upper = np.array([-math.inf, -1.0, -math.inf]), np.array([math.inf, 1.0, 1.0])
    assert find_continuous(lower, upper).tolist() == [True, False, False]
