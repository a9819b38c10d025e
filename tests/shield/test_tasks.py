import numpy as np
import pytest

from armguard.shield.changes import MotionError
from armguard.shield.motion import Rest
from armguard.shield.path import Path
from armguard.shield.tasks import FollowPaths, FollowPoints, KeepVelocity
from shield.test_changes import LIMITS

PERIOD, AHEAD = 0.01, 0.06
LOWER, UPPER = np.full(3, -1.0), np.full(3, 1.0)


def first(task, motion, begin):
    return next(iter(task.offer(motion, begin)), None)


def test_the_best_motion_comes_first_and_all_begin_as_the_arm_goes_on():
    task = FollowPaths([Path([[0.0] * 3, [0.5, 0.2, -0.3]])], LIMITS, PERIOD, AHEAD)
    motion, begin = Rest(np.zeros(3), 0.0), 0.0
    for _ in range(60):
        motion = first(task, motion, begin) or motion
        begin += PERIOD
    offered = list(task.offer(motion, begin))
    assert len(offered) == 3
    state = motion.sample(np.array([begin]))
    for one in offered:
        other = one.sample(np.array([begin]))
        for k in range(1, 4):
            assert other[k] == pytest.approx(state[k], abs=1e-9)
    paces = [one.find_place(begin + PERIOD)[1] for one in offered]
    assert paces == sorted(paces, reverse=True)
    assert 0.0 < task.progress < task.duration


def test_of_several_paths_a_resting_arm_is_offered_all_and_goes_on_along_one():
    start = [0.0, 0.0, 0.0]
    paths = [Path([start, [0.4, 0.0, 0.0]]), Path([start, [0.0, 0.4, 0.0]])]
    task = FollowPaths(paths, LIMITS, PERIOD, AHEAD)
    offered = list(task.offer(Rest(np.zeros(3), 0.0), 0.0))
    ends = [one.sample(np.array([one.end])).q[0] for one in offered]
    assert [end[0] > 0.0 for end in ends] == [True, False, True, False]
    # Looked at first is what goes on for longest.
    assert ends[0][0] > ends[2][0]
    task_motion = offered[1]
    further = list(task.offer(task_motion, 0.1))
    assert all(one.path is task_motion.path for one in further)


def test_back_to_the_path_leads_to_where_it_was_left():
    path = Path([[0.0] * 3, [0.5, 0.2, -0.3]])
    task = FollowPaths([path], LIMITS, PERIOD, AHEAD)
    motion, begin = Rest(np.zeros(3), 0.0), 0.0
    for _ in range(80):
        motion = first(task, motion, begin) or motion
        begin += PERIOD
    left = motion.sample(np.array([begin])).q[0]
    beside = Rest(left + np.array([0.0, 0.01, 0.0]), begin)
    motion = beside
    for _ in range(400):
        motion = first(task, motion, begin) or motion
        begin += PERIOD
    end = motion.sample(np.array([motion.end])).q[0]
    assert end == pytest.approx([0.5, 0.2, -0.3], abs=1e-6)


def test_a_jog_is_slower_as_a_whole_beyond_limits_and_halts_before_the_ends():
    task = KeepVelocity(LIMITS, LOWER, UPPER, PERIOD, AHEAD)
    task.velocity = np.array([10.0, 4.0, 0.0])
    motion, begin = Rest(np.array([-0.9, 0.0, 0.0]), 0.0), 0.0
    for _ in range(60):
        motion = first(task, motion, begin)
        begin += PERIOD
    v = motion.sample(np.array([begin])).v[0]
    assert v[0] / v[1] == pytest.approx(2.5, rel=0.05)
    for _ in range(600):
        motion = first(task, motion, begin) or motion
        begin += PERIOD
    q = motion.sample(np.array([begin])).q[0]
    assert (q <= UPPER).all()
    assert q[0] > 0.95


def test_points_that_nobody_accepts_are_dropped():
    task = FollowPoints(LIMITS, LOWER, UPPER, PERIOD, AHEAD, 0.05)
    task.take(0.01 * np.arange(1, 9)[:, None] * np.ones(3))
    rest = Rest(np.zeros(3), 0.0)
    assert len(list(task.offer(rest, 0.0))) == 2
    assert list(task.offer(rest, 0.0)) == []
    assert task.count_passed(rest) == 0
    task.take(0.01 * np.arange(1, 9)[:, None] * np.ones(3))
    motion = first(task, rest, 0.0)
    assert task.count_passed(motion) == 1
    # It goes on to where its stop begins, also where no more is proved.
    assert len(list(task.offer(motion, 0.01))) == 2
    assert list(task.offer(motion, 0.02)) == []
    assert task.count_passed(motion) == 1
    assert task.find_scale(motion, AHEAD) == 1.0
    assert task.find_scale(motion, AHEAD + 0.01) == 0.0
    # A motion that some other task made passes none.
    other = KeepVelocity(LIMITS, LOWER, UPPER, PERIOD, AHEAD)
    other.velocity = np.ones(3)
    assert task.count_passed(first(other, rest, 0.0)) == 0
    # On another motion the rest of the points counts no more.
    task.take(0.01 * np.arange(1, 9)[:, None] * np.ones(3))
    assert first(task, rest, 0.0) is not None
    assert list(task.offer(Rest(np.ones(3) * 0.5, 0.1), 0.1)) == []


def test_points_beyond_position_limits_are_clipped():
    task = FollowPoints(LIMITS, LOWER, UPPER, PERIOD, AHEAD, 0.5)
    task.take(np.array([[3.0, 0.0, 0.0], [9.0, 0.0, 0.0]]))
    motion, begin = Rest(np.array([0.9, 0.0, 0.0]), 0.0), 0.0
    for _ in range(300):
        motion = first(task, motion, begin) or motion
        begin += PERIOD
    assert motion.sample(np.array([begin])).q[0][0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("far", [10.5, 1e5, 1e300])
def test_far_from_its_path_an_arm_is_not_led_back(far):
    """A joint that turns for ever may be that far from it."""
    paths = FollowPaths([Path([[0.0] * 3, [0.5, 0.2, -0.3]])], LIMITS, PERIOD, AHEAD)
    with pytest.raises(MotionError, match="path: is more than 10 rad or m from"):
        list(paths.offer(Rest(np.full(3, far), 0.0), 0.1))
