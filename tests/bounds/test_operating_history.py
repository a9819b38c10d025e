"""Motion within operating limits never fails; a break is found, named, and never forgotten soon."""

import numpy as np
import pytest

from armguard.bounds.operating_history import (
    TOO_FAR,
    TOO_FAST,
    TOO_HARD,
    OperatingHistory,
    keeps_operating_limits,
    make_empty_record,
)
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from support.motion_questions import altered
from support.operating_motions import Law, record_joint
from support.panda_monitor import panda

HOLD = 0.3
VELOCITY, ACCELERATION = 1.0, 2.0
POSITION_ERROR, VELOCITY_ERROR = 1e-3, 0.02


def make(velocity=VELOCITY, acceleration=ACCELERATION, **changes):
    errors = {
        "position_error": np.full(7, POSITION_ERROR),
        "velocity_error": np.full(7, VELOCITY_ERROR),
    }
    robot = altered(panda(), **errors | changes)
    in_force = LimitsInForce(robot, OperatingLimits(velocity, acceleration))
    return OperatingHistory(robot, in_force, HOLD)


def on_axis(value, joint=2):
    return value * np.eye(7)[joint]


def noise(random, size):
    """Errors as large as stated, and none in between, more often than not."""
    return size * np.clip(3.0 * random.uniform(-1.0, 1.0), -1.0, 1.0)


@pytest.mark.parametrize("epoch", [0.0, 1.7e9])
@pytest.mark.parametrize("seed", range(6))
def test_motion_that_keeps_the_limits_never_fails(seed, epoch):
    random = np.random.default_rng([seed, 5])
    share = random.choice([0.02, 0.3, 1.0], 2)
    velocity = share[0] * panda().velocity_limit
    acceleration = share[1] * panda().acceleration_limit
    size = random.choice([0.0, 1.0])
    errors = {
        "position_error": size * panda().position_error,
        "velocity_error": size * panda().velocity_error,
    }
    history = make(velocity, acceleration, **errors)
    times = np.sort(random.uniform(0.0, 10.0, 4000))
    times[100:200] = times[100]  # one stamp again and again
    stamps = epoch + times
    places, rates = np.zeros((2, 7, len(times)))
    for j in range(7):
        law = Law(-1e3, 1e3, velocity[j], acceleration[j], panda().acceleration_limit[j], 1.0)
        begin, q, v = 0, 0.0, random.uniform(-velocity[j], velocity[j])
        # A few motions one after the other, each with its switches.
        for end in range(80, len(times) + 1, 80):
            span = times[begin:end] - (times[begin - 1] if begin else times[0])
            record_joint(
                q, v, np.inf, span, law, random,
                places[j, begin:end], rates[j, begin:end],
            )  # fmt: skip
            q, v, begin = places[j, end - 1], rates[j, end - 1], end
    assert np.abs(rates).max() <= velocity.max() * (1.0 + 1e-12)
    for k, stamp in enumerate(stamps):
        q = places[:, k] + [noise(random, e) for e in errors["position_error"]]
        v = rates[:, k] + [noise(random, e) for e in errors["velocity_error"]]
        assert history.accept(float(stamp), q, v), (k, history.record.finding)


def read_finding(history):
    """Joint, code and amount of the last break."""
    joint, code, amount = history.record.finding
    return int(joint), int(code), amount


def first_break(states, history=None):
    """When a motion of the third joint is found outside, and the finding."""
    history = history or make()
    for stamp, q, v in states:
        if not history.accept(stamp, on_axis(q), on_axis(v)):
            return stamp, read_finding(history)
    return np.inf, None


TIMES = np.arange(0.0, 1.0, 1e-3)


def test_what_speeds_up_twice_as_hard_is_found_once_errors_are_used_up():
    late = 2.0 * VELOCITY_ERROR / ACCELERATION
    for off in (-VELOCITY_ERROR, 0.0, VELOCITY_ERROR):
        stamp, finding = first_break((t, 2.0 * t * t, 4.0 * t + off) for t in TIMES)
        assert stamp == pytest.approx(late, abs=1.1e-3)
        assert finding[:2] == (2, TOO_HARD)
        assert 0.0 < finding[2] < 4e-3
    # An error that goes from one end to the other in that moment hides it for twice as long.
    hidden = ((t, 2.0 * t * t, 4.0 * t + VELOCITY_ERROR * (1 if t == 0.0 else -1)) for t in TIMES)
    assert late < first_break(hidden)[0] <= 2.0 * late + 1.1e-3


def test_what_slows_down_as_hard_as_the_hardware_can_is_no_break():
    accel = panda().acceleration_limit[2]
    stop = 1.0 / accel
    motion = [
        (t, t - 0.5 * accel * t * t, 1.0 - accel * t)
        if t < stop
        else (t, 0.5 * stop - 0.5 * 2.0 * (t - stop) ** 2, -2.0 * (t - stop))
        for t in TIMES[TIMES < 0.5]
    ]
    assert first_break(motion) == (np.inf, None)
    # On the other side of rest it speeds up, and must not do so as hard.
    on = [(t, t - 0.5 * accel * t * t, 1.0 - accel * t) for t in TIMES[TIMES < 0.3]]
    assert stop < first_break(on)[0] <= stop + 2.0 * VELOCITY_ERROR / (accel - 2.0) + 2.1e-3


def test_what_is_faster_than_the_operating_velocity_is_found_at_once():
    over = VELOCITY + VELOCITY_ERROR
    assert first_break([(0.0, 0.0, over)])[0] == np.inf
    stamp, finding = first_break([(0.0, 0.0, -(over + 1e-6))])
    assert stamp == 0.0
    assert finding == (2, TOO_FAST, pytest.approx(1e-6, rel=1e-6))


def test_what_reads_slow_but_moves_fast_is_found_by_its_way():
    stamp, finding = first_break((t, 1.1 * t, 1.0) for t in TIMES)
    assert stamp == pytest.approx(2.0 * POSITION_ERROR / 0.1, abs=1.1e-3)
    assert finding[:2] == (2, TOO_FAR)


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_what_reads_at_rest_is_found_by_how_far_it_got_whichever_way(way):
    """It cannot have sped up as hard as it may brake."""
    far = 0.5 * ACCELERATION * 0.1**2 + VELOCITY_ERROR * 0.1 + 2.0 * POSITION_ERROR
    for excess, is_found in ((-1e-6, False), (1e-6, True)):
        stamp, finding = first_break([(0.0, 0.0, 0.0), (0.1, way * (far + excess), 0.0)])
        assert (stamp == 0.1) == is_found
        assert not is_found or finding == (2, TOO_FAR, pytest.approx(excess, rel=1e-3))


def test_a_break_is_found_again_until_it_is_over_and_the_limits_are_kept_after_that():
    history = make()
    fast = on_axis(1.5)
    for k in range(5):
        assert not history.accept(0.01 * k, 0.01 * k * fast, fast)
        history.suspend(0.01 * k)
    assert history.in_force.is_suspended
    # Back within the limits: what comes next is tested again, but against nothing before.
    assert history.accept(0.05, on_axis(0.07), on_axis(0.9))
    assert not history.accept(0.06, on_axis(0.079), on_axis(0.3))
    history.suspend(0.06)
    assert not history.resumes(0.35)
    assert history.in_force.is_suspended
    assert history.resumes(0.36)
    assert not history.in_force.is_suspended
    assert not history.resumes(0.37)


def test_reset_forgets_states_and_puts_no_limits_in_force_that_were_not_kept():
    history = make()
    history.accept(0.0, on_axis(0.0), on_axis(0.0))
    assert not history.accept(0.001, on_axis(0.0), on_axis(0.5))
    history.suspend(0.001)
    history.reset()
    # Time may begin anew, too.
    assert history.accept(-5.0, on_axis(2.0), on_axis(0.9))
    assert not history.resumes(-5.0)
    assert not history.resumes(-4.71)
    assert history.in_force.is_suspended
    assert history.resumes(-4.69)
    assert not history.in_force.is_suspended


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_a_break(bad):
    impossible = np.where(np.arange(7) == 2, bad, 0.0)
    assert not make().accept(0.0, on_axis(0.0), impossible)
    history = make()
    history.accept(0.0, on_axis(0.0), on_axis(0.0))
    assert not history.accept(0.0, impossible, on_axis(0.0))


def test_without_operating_limits_there_is_nothing_to_break():
    record = make_empty_record()
    assert keeps_operating_limits(record, 0.0, np.full(7, np.nan), np.full(7, 1e9))
