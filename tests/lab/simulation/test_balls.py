import numpy as np
import pytest

from armguard.lab.simulation import WanderingBalls
from support.checking_sink import GrowthSink
from support.motion_samples import check_motion


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("accel", "speed"), [(10.0, 2.0), (0.3, 5.0), (50.0, 0.1)])
def test_balls_keep_their_bounds_and_their_box(seed, accel, speed):
    lower, upper = np.array([-2.0, -3.0, 0.1]), np.array([2.0, 1.0, 1.5])
    balls = WanderingBalls(
        8, seed, accel=accel, speed=speed, lower=lower, upper=upper, clearance=0.8
    )
    x, v = check_motion(balls, 20.0, speed, accel)
    assert (x >= lower).all()
    assert (x <= upper).all()
    assert np.hypot(x[..., 0], x[..., 1]).min() >= 0.8
    assert np.abs(v).max(axis=(0, 1)).min() > 0.01  # none of the axes stands still


def test_balls_are_published_by_name_and_never_implausible():
    balls, sink = WanderingBalls(5, 1), GrowthSink()
    for now in np.arange(0.0, 10.0, 0.001):
        balls.publish(sink, now)
    assert set(sink.last) == {f"ball-{number}" for number in range(5)}
    assert not sink.refused
    assert {call[-1] for call in sink.calls} == {"balls"}
