import numpy as np
import pytest

from armguard.shield.changes import FULL_PACE, JointChanges, PaceChanges
from armguard.shield.motion import Rest, Samples
from armguard.shield.path import MotionLimits, Path, TimedPath

STEP = 1e-3  # [s]
LIMITS = MotionLimits(
    np.array([1.0, 0.8, 1.5]),
    np.array([2.0, 3.0, 2.0]),
    np.array([4.0, 3.0, 5.0]),
    np.array([80.0, 60.0, 90.0]),
)


def check(motion, begin, *, top=LIMITS.velocity, limits=LIMITS):
    """That a motion keeps all limits, by differences, and rests at its end."""
    times = np.arange(begin, motion.end + 0.01, STEP)
    _, q, v, a = motion.sample(times)
    assert np.diff(q, axis=0) / STEP == pytest.approx(0.5 * (v[1:] + v[:-1]), abs=1e-4)
    assert np.diff(v, axis=0) / STEP == pytest.approx(0.5 * (a[1:] + a[:-1]), abs=5e-2)
    assert (np.abs(v) <= top + 1e-9).all()
    assert (np.abs(a) <= limits.braking + 1e-9).all()
    speeding = np.where(v * a > 1e-9, np.abs(a), 0.0)
    assert (speeding <= limits.acceleration + 1e-6).all()
    jerk = np.abs(np.diff(a, axis=0)) / STEP
    assert (jerk <= limits.jerk * (1.0 + 1e-6)).all()
    assert v[-1] == pytest.approx(np.zeros(3), abs=1e-9)
    assert a[-1] == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_every_stop_on_a_path_keeps_the_limits_and_the_path(seed):
    random = np.random.default_rng(seed)
    places = np.cumsum(random.uniform(-0.6, 0.6, (5, 3)), axis=0)
    path = TimedPath(Path(places), LIMITS)
    changes = PaceChanges(LIMITS)
    place, begin = (0.0, 0.0, 0.0), 3.0
    passed = 0
    for _ in range(100):
        motion = changes.go_and_stop(path, place, begin, 0.05, random.uniform(0.0, 1.0))
        if motion is None:
            continue
        check(motion, begin)
        passed += 1
        begin += 0.02
        place = motion.find_place(begin)
        if place[0] >= path.duration:
            break
    assert passed > 50 or place[0] >= path.duration


@pytest.mark.parametrize("seed", range(10))
def test_a_stop_that_is_left_speeds_up_no_harder_than_the_joints_may(seed):
    limits = LIMITS._replace(braking=4.0 * LIMITS.acceleration)
    random = np.random.default_rng(seed)
    path = TimedPath(Path(np.cumsum(random.uniform(-2.0, 2.0, (2, 3)), axis=0)), limits)
    changes = PaceChanges(limits)
    left = 0
    for _ in range(10):
        start = random.uniform(0.0, path.duration), random.uniform(0.0, 1.0), 0.0
        stopping = changes.go_and_stop(path, start, 0.0, 0.0, 0.0)
        if stopping is None:
            continue
        begin = random.uniform(0.0, stopping.end)
        place = stopping.find_place(begin)
        for share in (0.3, 0.6, 0.9):
            motion = changes.go_and_stop(path, place, begin, 0.2, share * place[1])
            if motion is not None:
                check(motion, begin, limits=limits)
                left += 1
    assert left > 10


def test_an_arm_at_rest_can_set_off_however_hard_it_brakes():
    """A Panda's at 30 % speed without a load: a timed path might use all of its acceleration."""
    acceleration = np.array([3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0])
    velocity = np.array([0.6525] * 4 + [0.783] * 3)
    way = np.array([-1.957, -0.522, 1.048, 1.473, 1.161, -0.509, -1.061])
    for braking in (0.5, 1.0, 2.0, 10.0):
        limits = MotionLimits(velocity, acceleration, braking * acceleration, np.full(7, 500.0))
        path = TimedPath(Path([0.0 * way, way]), limits)
        motion = PaceChanges(limits).go_and_stop(path, (0.0, 0.0, 0.0), 3.0, 0.03, 1.0)
        assert motion is not None, braking
        assert motion.end > 3.03


@pytest.mark.parametrize("seed", range(20))
def test_no_pace_overshoots_the_clock_of_a_path(seed):
    random = np.random.default_rng(seed)
    path = TimedPath(Path(np.cumsum(random.uniform(-0.6, 0.6, (5, 3)), axis=0)), LIMITS)
    changes = PaceChanges(LIMITS)
    made = 0
    for _ in range(50):
        # The pace grows, as it did where the path let it do so faster.
        place = (
            random.uniform(0.0, path.duration),
            random.uniform(0.0, 1.0),
            random.uniform(0.0, 3.0),
        )
        motion = changes.go_and_stop(path, place, 0.0, 0.05, random.uniform(0.0, 1.0))
        if motion is None:
            continue
        made += 1
        paces = [motion.find_place(time)[1] for time in np.arange(0.0, motion.end, 0.005)]
        assert max(paces) <= FULL_PACE
    assert made > 10


@pytest.mark.parametrize("seed", range(20))
def test_every_stop_of_joints_keeps_the_limits(seed):
    random = np.random.default_rng(seed)
    changes = JointChanges(LIMITS)
    motion, begin = Rest(np.zeros(3), 0.0), 0.0
    for _ in range(60):
        state = motion.sample(np.array([begin]))
        wanted = random.uniform(-1.0, 1.0, 3) * LIMITS.velocity * 0.97
        motion = changes.go_and_stop(state, begin, 0.04, wanted)
        check(motion, begin)
        begin += random.uniform(0.01, 0.1)


def test_points_are_passed_in_their_time():
    changes = JointChanges(LIMITS)
    state = Rest(np.zeros(3), 0.0).sample(np.array([0.0]))
    phases = []
    for k in range(1, 11):
        q, v = np.full(3, 2e-4 * k**2), np.full(3, 2e-4 * 2 * k / 0.05)
        phase = changes.track(state, 0.05 * (k - 1), 0.05, q, v)
        phases.append(phase)
        whole = changes.stop_after(phases, 0.05 * k)
        state = whole.sample(np.array([0.05 * k]))
        if k > 2:
            assert state.q[0] == pytest.approx(q, abs=1e-6)
        check(whole, 0.0)


def test_samples_hold_one_state_each():
    rest = Rest(np.array([1.0, 2.0, 3.0]), 5.0)
    assert isinstance(rest.sample(np.array([6.0])), Samples)
