import numpy as np
import pytest

from armguard.lab.commission.observations import SourceObservations
from armguard.lab.commission.sources import measure_source


def make(rate=100.0, spread=0.01, messages=400, late=0.004, accel=2.0, seed=0):
    random = np.random.default_rng(seed)
    stamps = np.arange(messages) / rate
    way = np.stack([0.5 * stamps, np.zeros(messages), 0.1 * accel * np.sin(3.0 * stamps)], axis=1)
    positions = way + random.normal(0.0, spread, way.shape)
    ages = np.full(messages, late)
    ages[7] = 0.05
    return SourceObservations(stamps, ages, {"ball": (stamps, positions)})


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("spread", [0.002, 0.02])
def test_rate_age_and_spread_are_found(seed, spread):
    found = measure_source(make(spread=spread, messages=4000, seed=seed))
    assert found.rate == pytest.approx(100.0)
    assert spread <= found.spread <= 1.1 * spread
    assert (found.median_age, found.oldest) == pytest.approx((0.004, 0.05))


def test_the_longest_silence_is_found():
    seen = make()
    gone = np.r_[0:100, 160:400]
    found = measure_source(seen._replace(stamps=seen.stamps[gone], ages=seen.ages[gone], tracks={}))
    # From a stamp until the next message arrived, 4 ms after its own.
    assert found.usual_silence == pytest.approx(0.014)
    assert found.longest_silence == pytest.approx(0.614)
    assert found.rate == pytest.approx(100.0)
    assert np.isnan(found.spread)


def test_a_source_that_hardly_spoke_tells_nothing():
    assert measure_source(make(messages=10)) is None
    seen = make(messages=100)
    assert measure_source(seen._replace(stamps=np.zeros(100))) is None


def test_silences_are_those_of_data_that_arrive_late():
    """Stamps every 10 ms that arrive in bursts: the monitor counts what passed as silence."""
    seen = make(messages=4000)
    arrivals = np.ceil(seen.stamps / 0.2) * 0.2 + 1e-4 * np.arange(4000)
    found = measure_source(seen._replace(ages=arrivals - seen.stamps))
    assert found.usual_silence > 0.19
    # A timeout below would be a STOP in quiet times.
    timeout = 1.5 * found.usual_silence
    silent = np.diff(np.r_[arrivals, np.inf])[:-1] + (arrivals - seen.stamps)[:-1]
    assert (silent <= timeout).mean() > 0.99
