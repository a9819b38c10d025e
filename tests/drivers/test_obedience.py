import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.drivers.obedience import Obedience, Order
from armguard.verdict import Level
from support.verdict_samples import verdict


@pytest.mark.hazard("H-08")
@given(
    st.sampled_from(Level),
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(0.0, 1e6),
)
def test_nothing_moves_without_a_verdict_that_is_valid_and_allows_it(level, scale, until, now):
    order = Obedience().decide(verdict(level, speed_scale=scale, valid_until=until), now)
    allowed = level is not Level.STOP and now <= until and 0.0 < scale <= 1.0
    assert order.scale == (scale if allowed else 0.0)
    assert bool(order.cause) != allowed


def test_before_the_first_verdict_it_stands():
    assert Obedience().decide(None, 0.0) == Order(0.0, "no verdict yet")


@pytest.mark.parametrize("level", Level)
def test_silence_and_stop_are_told_apart(level):
    obedience = Obedience()
    one = verdict(level, speed_scale=1.0, valid_until=2.0)
    assert obedience.decide(one, 2.1).cause == "no valid verdict"
    assert obedience.decide(one, 1.9).cause == ("STOP" if level is Level.STOP else "")
    assert obedience.decide(one._replace(valid_until=math.nan), 1.9).cause == "no valid verdict"


@pytest.mark.hazard("H-24")
def test_a_monitor_that_counts_from_the_beginning_is_another_one():
    obedience = Obedience()
    for sequence in (5, 6, 6, 9, 200):
        obedience.decide(verdict(Level.CLEAR, sequence=sequence), 0.0)
    assert obedience.restarts == 0
    for sequence in (0, 1, 2, 3):
        obedience.decide(verdict(Level.CLEAR, sequence=sequence), 0.0)
    assert obedience.restarts == 1
