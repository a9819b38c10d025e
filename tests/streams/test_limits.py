import numpy as np
import pytest

from armguard.streams.limits import MessageAllowance


@pytest.mark.parametrize("rate", [0.5, 1.0, 7.0, 1000.0])
def test_an_allowance_keeps_to_its_rate_however_calls_are_spread(rate):
    """In any stretch of time T it grants no more than one second's worth, and rate times T."""
    random = np.random.default_rng(7)
    allowance, now, granted = MessageAllowance(rate, 0.0), 0.0, []
    for _ in range(20_000):
        now += random.exponential(0.3 / rate)
        if allowance.take(now):
            granted.append(now)
    times = np.array(granted)
    for k in (1, 5, 50, 500):
        assert (times[k:] - times[:-k] >= (k - max(1.0, rate)) / rate - 1e-6).all()
    # And it grants most of what there is room for: what comes while it is full is lost.
    assert len(times) >= 0.7 * rate * now


@pytest.mark.parametrize("jumps", [[-1e9, 1e9], [1e300, -1e300], [0.0, 0.0]])
def test_no_jump_of_a_clock_grants_more(jumps):
    allowance = MessageAllowance(2.0, 0.0)
    for now in jumps:
        assert sum(allowance.take(now) for _ in range(10)) <= 2
