import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.drivers.arm import ArmLostError
from armguard.drivers.stamp_filter import DRIFT, StampFilter

PERIOD = 0.002


@given(
    st.floats(-1e6, 1e6),
    st.lists(st.floats(0.0, 0.02), min_size=1, max_size=200),
    st.floats(0.0, 0.001),
)
def test_a_stamp_lies_between_the_measurement_and_the_arrival(apart, jitter, least):
    stamps = StampFilter()
    for number, more in enumerate(jitter):
        measured = 100.0 + PERIOD * number
        arrived = measured + least + more
        stamp = stamps.translate(measured - apart, arrived)
        assert measured + least - 1e-6 <= stamp <= arrived + 1e-6


def test_states_that_arrive_together_keep_their_distance():
    stamps = StampFilter()
    stamps.translate(5.0, 100.0)
    held_up = [stamps.translate(5.0 + PERIOD * k, 100.3) for k in range(1, 100)]
    apart = [second - first for first, second in itertools.pairwise(held_up)]
    assert apart == pytest.approx([PERIOD] * 98, abs=1e-9)
    assert held_up[0] == pytest.approx(100.0 + PERIOD, abs=DRIFT * 0.3 + 1e-9)


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_clocks_that_drift_are_followed(drift):
    stamps = StampFilter()
    worst = 0.0
    for number in range(int(60.0 / PERIOD)):
        measured = PERIOD * number
        stamp = stamps.translate(measured * (1.0 + drift), measured + 0.0005)
        worst = max(worst, abs(stamp - measured - 0.0005))
        assert stamp <= measured + 0.0005 + 1e-9
    assert worst <= 1e-6


def test_a_stream_that_lags_more_and_more_is_never_stamped_as_fresh():
    stamps = StampFilter()
    for number in range(int(60.0 / PERIOD)):
        measured = PERIOD * number
        arrived = measured + 0.0005 + 0.01 * measured
        stamp = stamps.translate(measured, arrived)
        assert stamp <= measured + 0.0005 + DRIFT * arrived + 1e-9


def test_another_clock_or_one_that_goes_back_is_refused():
    stamps = StampFilter()
    stamps.translate(7.0, 100.0)  # nothing is known of the first one
    stamps.translate(7.5, 100.9)
    for stamp in (0.1, 7.4, 7.5, 1e300, float("nan"), float("inf")):
        with pytest.raises(ArmLostError, match="clock jumped"):
            stamps.translate(stamp, 100.95)
    assert stamps.newest == 7.5
    stamps.translate(7.6, 101.0)
