import itertools

import numpy as np
import pytest

from armguard.shield.changes import JointChanges, PaceChanges
from armguard.shield.motion import Rest
from armguard.shield.path import Path, TimedPath
from shield.test_changes import LIMITS


def make_motions():
    path = TimedPath(Path([[0.0, 0.0, 0.0], [0.5, 0.2, -0.1], [0.3, 0.4, 0.4]]), LIMITS)
    along = PaceChanges(LIMITS).go_and_stop(path, (0.3, 0.4, 0.1), 2.0, 0.2, 1.0)
    state = along.sample(np.array([2.1]))
    joints = JointChanges(LIMITS).go_and_stop(state, 2.1, 0.3, np.array([0.4, -0.3, 0.2]))
    return along, joints


@pytest.mark.parametrize("k", [0, 1])
def test_between_knots_the_jerk_is_constant(k):
    motion = make_motions()[k]
    knots = motion.find_knots(2.15)
    assert (np.diff(knots) > 0.0).all()
    assert knots[0] >= 2.15
    assert knots[-1] == pytest.approx(motion.end)
    for first, last in itertools.pairwise(knots):
        if last - first < 1e-3:
            continue
        inner = np.linspace(first + 1e-6, last - 1e-6, 9)
        if k == 0:
            # Along a path it is that of the pace; the path's own bends come in between.
            change = np.array([motion.find_place(t)[2] for t in inner])[:, None]
        else:
            change = motion.sample(inner).a
        assert np.diff(change, 2, axis=0) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("k", [0, 1])
def test_after_its_end_a_motion_rests(k):
    motion = make_motions()[k]
    _, q, v, a = motion.sample(np.array([motion.end, motion.end + 1.0, motion.end + 100.0]))
    assert v == pytest.approx(np.zeros((3, 3)), abs=1e-9)
    assert a == pytest.approx(np.zeros((3, 3)), abs=1e-6)
    assert q[1:] == pytest.approx(q[[0, 0]], abs=1e-7)


def test_rest_stays():
    rest = Rest(np.array([1.0, 2.0]), 3.0)
    assert rest.end == 3.0
    assert rest.find_knots(3.0).size == 0
    _, q, v, a = rest.sample(np.array([3.0, 9.0]))
    assert (q == [1.0, 2.0]).all()
    assert not v.any()
    assert not a.any()
