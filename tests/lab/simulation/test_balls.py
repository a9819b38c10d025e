import numpy as np
import pytest

from armguard.lab.simulation import WanderingBalls
from armguard.lab.simulation.balls import ACCEL, BOX, SPEED
from support.checking_sink import GrowthSink
from support.motion_samples import check_motion


@pytest.mark.parametrize("seed", range(3))
def test_balls_keep_their_bounds_and_their_box(seed):
    x, v = check_motion(WanderingBalls(8, seed, clearance=0.8), 20.0, SPEED, ACCEL)
    assert (x >= BOX[0]).all()
    assert (x <= BOX[1]).all()
    assert np.hypot(x[..., 0], x[..., 1]).min() >= 0.8
    assert np.abs(v).max(axis=(0, 1)).min() > 0.01  # none of the axes stands still


def test_balls_are_published_by_name_and_never_implausible():
    balls, sink = WanderingBalls(5, 1), GrowthSink()
    for now in np.arange(0.0, 10.0, 0.001):
        balls.publish(sink, now)
    assert set(sink.last) == {f"ball-{number}" for number in range(5)}
    assert not sink.refused
    assert {call[-1] for call in sink.calls} == {"balls"}
