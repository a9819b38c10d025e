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
    assert found.timeout == pytest.approx(1.5 * found.longest_silence)


@pytest.mark.parametrize(
    ("stated", "timeout", "uncovered"),
    [(0.7, 1.5 * 0.614, 0), (0.3, 1.5 * 0.244, 1), (0.1, 1.5 * 0.024, 2)],
)
def test_a_timeout_covers_each_silence_that_was_no_stop(stated, timeout, uncovered):
    seen = make(messages=4000)
    stays = np.r_[0:100, 123:300, 360:4000]  # 0.23 and 0.6 s without a message
    found = measure_source(
        seen._replace(stamps=seen.stamps[stays], ages=seen.ages[stays], tracks={}, timeout=stated)
    )
    assert found.timeout == pytest.approx(timeout)
    assert found.quiet_silence <= stated
    assert found.uncovered == uncovered


def test_a_source_slower_than_its_timeout_gets_a_longer_one():
    seen = make(rate=4.0, messages=400)
    found = measure_source(seen._replace(timeout=0.2))
    assert found.timeout >= 1.5 * 0.25
    assert found.uncovered == 0
