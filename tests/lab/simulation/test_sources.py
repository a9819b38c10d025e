import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.simulation import ProceduralPerson, WanderingBalls
from support.checking_sink import GrowthSink


@pytest.mark.parametrize("make", [lambda: WanderingBalls(3, 9), lambda: ProceduralPerson(9, 8.0)])
def test_every_sample_is_published_once_and_in_order_whatever_the_ticks(make):
    slow, quick = GrowthSink(), GrowthSink()
    source = make()
    for now in (-1.0, 0.0, 0.0, 3.21, 3.0, 8.0):
        source.publish(slow, now)
    source = make()
    for tick in range(8001):
        source.publish(quick, tick / 1000)
    assert len(slow.calls) == len(quick.calls)
    for one, other in zip(slow.calls, quick.calls, strict=True):
        assert one[:2] == other[:2]
        assert np.array_equal(one[2], other[2])
        assert np.array_equal(one[3], other[3])
    stamps = sorted({call[1] for call in quick.calls})
    assert stamps == [k / source.rate for k in range(int(8.0 * source.rate) + 1)]
    assert [call[1] for call in quick.calls] == sorted(call[1] for call in quick.calls)


def test_seeds_decide():
    def at(seed):
        return ProceduralPerson(seed).sample(9.0)[0]

    assert np.array_equal(at(1), at(1))
    assert not np.array_equal(at(1), at(2))
    assert not np.array_equal(WanderingBalls(2, 1).sample(1.0), WanderingBalls(2, 2).sample(1.0))


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: ProceduralPerson(0, 7.9), "8 to 3600 s"),
        (lambda: ProceduralPerson(0, float("nan")), "8 to 3600 s"),
        (lambda: WanderingBalls(1, 0, clearance=9.0), "no room"),
    ],
)
def test_bad_input_is_refused_by_name(make, named):
    with pytest.raises(ArmguardError, match=named):
        make()
