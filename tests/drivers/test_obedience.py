import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.drivers.obedience import Obedience, Order
from armguard.verdict import Level
from support.verdict_samples import verdict

AGREED = 0.05

ANY = st.floats(allow_nan=True, allow_infinity=True)


@pytest.mark.hazard("H-08")
@given(
    st.sampled_from(Level),
    ANY,
    ANY | st.floats(0.0, 1e6),
    ANY | st.floats(0.0, 1e6),
    st.floats(0.0, 1e6),
    st.floats(0.0, 2.0 * AGREED),
)
def test_nothing_moves_without_a_verdict_that_is_valid_and_allows_it(
    level, scale, stamp, until, now, after
):
    obedience = Obedience(AGREED)
    one = verdict(level, speed_scale=scale, stamp=stamp, valid_until=until)
    for time in (now, now + after):
        order = obedience.decide(one, time)
        is_valid = time <= until and time <= stamp + AGREED and time <= now + AGREED
        allowed = level is not Level.STOP and is_valid and 0.0 < scale <= 1.0
        assert order.scale == (scale if allowed else 0.0)
        assert bool(order.cause) != allowed
        assert (order.since is None) == allowed
        assert is_valid or order.since <= time
    assert obedience.decide(one, now, "trouble").scale == 0.0


def test_a_verdict_that_claims_to_be_valid_for_too_long_expires_when_it_was_agreed():
    obedience = Obedience(AGREED)
    one = verdict(Level.CLEAR, speed_scale=1.0, stamp=10.0, valid_until=math.inf)
    assert obedience.decide(one, 10.04).scale == 1.0
    assert obedience.decide(one, 10.06) == Order(0.0, "no valid verdict", 10.05)
    ahead = verdict(Level.CLEAR, speed_scale=1.0, stamp=1e9, valid_until=1e9)
    assert obedience.decide(ahead, 11.0).scale == 1.0
    assert obedience.decide(ahead, 11.06).cause == "no valid verdict"


def test_before_the_first_verdict_it_stands():
    assert Obedience(AGREED).decide(None, 0.0) == Order(0.0, "no verdict yet")


@pytest.mark.parametrize("level", Level)
def test_silence_and_stop_are_told_apart(level):
    obedience = Obedience(1.0)
    one = verdict(level, speed_scale=1.0, stamp=1.5, valid_until=2.0)
    assert obedience.decide(one, 2.1).cause == "no valid verdict"
    assert obedience.decide(one, 1.9).cause == ("STOP" if level is Level.STOP else "")
    assert obedience.decide(one._replace(valid_until=math.nan), 1.9).cause == "no valid verdict"


@pytest.mark.hazard("H-24")
@pytest.mark.parametrize("sequence", [0, 1, 8, 5000])
def test_a_verdict_of_another_run_tells_a_restart_whatever_was_missed(sequence):
    obedience = Obedience(AGREED)
    for number in (0, 0, 6, 6, 7, 0):
        obedience.decide(verdict(Level.CLEAR, sequence=number, run="old"), 0.0)
    assert obedience.restarts == 0
    for number in (sequence, sequence + 1):
        obedience.decide(verdict(Level.CLEAR, sequence=number, run="new"), 0.0)
    assert obedience.restarts == 1


@pytest.mark.hazard("H-24")
def test_a_verdict_that_names_no_run_may_be_of_any_monitor():
    obedience = Obedience(AGREED)
    one = verdict(Level.CLEAR, run="")
    for _ in range(3):
        obedience.decide(one, 0.0)
    assert obedience.restarts == 0
    obedience.decide(verdict(Level.CLEAR, sequence=2, run=""), 0.0)
    assert obedience.restarts == 1
