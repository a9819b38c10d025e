"""A person made of a recording moves as one can who keeps bounds, wherever markers jump."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.bodies import POINTS
from armguard.lab.simulation.bounded_person import LAG, BoundedPerson
from armguard.obstacles import Obstacles
from support.checking_sink import GrowthSink

RATE = 100.0


class Markers:
    """Stands for a recording."""

    name, rate = "made", RATE

    def __init__(self, position):
        self.position = position
        self.duration = (len(position) - 1) / RATE


def make_wild(seed, frames=400):
    """Markers that walk, jump, and vanish."""
    random = np.random.default_rng(seed)
    position = np.cumsum(random.normal(0.0, 0.01, (frames, 9, 3)), axis=0)
    position[random.random((frames, 9)) < 0.02] += random.uniform(-3.0, 3.0, 3)
    position[random.random((frames, 9)) < 0.1] = np.nan
    position[:30, 4] = np.nan
    return Markers(position)


@pytest.mark.parametrize("seed", range(4))
def test_bounds_are_kept_at_every_time(seed):
    person = BoundedPerson(make_wild(seed), accel=8.0, speed=1.5)
    dt = 1.7e-3  # no part of a frame
    times = np.arange(0.0, person.duration + 4.0, dt)
    x, v = (np.array(part) for part in zip(*map(person.sample, times), strict=True))
    assert np.linalg.norm(v, axis=2).max() <= 1.5
    assert np.linalg.norm(np.diff(v, axis=0), axis=2).max() <= 8.0 * dt + 1e-12
    # Velocities are the derivatives: v changes by at most 8 m/s² in a step.
    travel = 0.5 * dt * (v[:-1] + v[1:])
    assert np.linalg.norm(np.diff(x, axis=0) - travel, axis=2).max() <= 8.0 * dt**2 / 4.0
    assert np.linalg.norm(v, axis=2).max() > 0.5
    assert not v[-1].any()


def test_no_table_ever_refuses_it():
    person, sink, table = BoundedPerson(make_wild(1)), GrowthSink(), Obstacles()
    for stamp in np.arange(0.0, 5.0, 0.02):
        position, velocity = person.sample(stamp)
        for taker in (sink, table):
            taker.update(list(POINTS), stamp, position, velocity, np.full(9, 0.1))
    assert not sink.refused
    assert table.take_faults() == []


def test_it_is_a_little_late_and_arrives():
    position = np.zeros((300, 9, 3))
    position[:200, :, 0] = 0.8 * np.arange(200)[:, None] / RATE
    position[200:, :, 0] = 0.8 * 2.0
    person = BoundedPerson(Markers(position))
    late = 1.5 - person.sample(1.5)[0][:, 0] / 0.8
    assert (late > LAG).all()
    assert (late < 0.1).all()
    assert person.sample(9.0)[0][:, 0] == pytest.approx(1.6, abs=1e-3)


def test_a_point_that_is_never_seen_is_named():
    markers = make_wild(0)
    markers.position[:, POINTS.index("left_hand")] = np.nan
    with pytest.raises(ArmguardError, match="never shows left_hand"):
        BoundedPerson(markers)
