import math

import numpy as np
import pytest

from armguard.bounds import Plan
from armguard.recording.inputs import make_plan, make_state, restore_plan, restore_state
from armguard.recording.json_form import read_json, write_json
from support.panda_monitor import HOME, STILL, make_monitor
from support.short_plans import resting


class Awkward:
    """Nothing that can be made into an array."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("no")

    def __repr__(self):
        return "awkward"


VECTORS = [
    HOME,
    HOME.tolist(),
    tuple(HOME),
    HOME.astype(np.float32),
    HOME[::-1][::-1],
    np.arange(7),
    [math.nan] * 7,
    np.array([math.inf, *HOME[1:]]),
    HOME[:6],
    list(HOME[:6]),
    np.zeros((7, 1)),
    [],
    "seven",
    None,
    3.0,
    np.array(["a"] * 7),
    [1j] * 7,
    [10**400] * 7,
    [10**30] * 7,
    np.ma.masked_array(HOME, mask=[0, 1, 0, 0, 0, 0, 0]),
    Awkward(),
    {"q": 1},
    [True] * 7,
]
TIMES = [0.003, 3, np.float32(0.25), np.float64(0.003), math.nan, -math.inf, True, "soon", None]


JOINTS = [f"panda_joint{number}" for number in range(1, 8)]


def through_file(message):
    return read_json(type(message), write_json(message))


def judge(stamp, q, v, now):
    """The verdict on a state after a good one, and on a good one after it."""
    _, monitor = make_monitor(motion="planned")
    monitor.step(0.002, HOME, STILL)
    return monitor.step(stamp, q, v, now), monitor.step(0.004, HOME, STILL)


@pytest.mark.parametrize("number", range(len(VECTORS)))
def test_whatever_a_step_is_given_has_the_same_effect_when_it_is_restored(number):
    vector = VECTORS[number]
    for q, v in ((vector, STILL), (HOME, vector), (vector, vector)):
        event = through_file(make_state(JOINTS, 0.003, q, v, 0.003))
        assert repr(judge(*restore_state(event))) == repr(judge(0.003, q, v, 0.003))


@pytest.mark.parametrize("time", TIMES, ids=repr)
def test_so_do_times(time):
    for stamp, now in ((time, 0.003), (0.003, time)):
        # A journal is told the stamp where no other time is given.
        judged = stamp if now is None else now
        event = through_file(make_state(JOINTS, stamp, HOME, STILL, judged))
        told = judge(*restore_state(event))
        assert repr(told) == repr(judge(stamp, HOME, STILL, now))


PLANS = [
    resting(stamp=0.003),
    resting(stamp=0.003, q=np.full((21, 7), math.nan)),
    resting(stamp="now"),
    resting(stamp=0.003, v=[[0.0] * 7] * 21, tracking_error=[0.01] * 7),
    resting(stamp=0.003, v=np.zeros((21, 6))),
    resting(stamp=0.003, times=["a"]),
    resting(stamp=0.003, times=None),
    resting(stamp=0.003, velocity_tracking_error="wide"),
    resting(stamp=0.003, q=Awkward()),
    "a plan",
    None,
]


@pytest.mark.parametrize("number", range(len(PLANS)))
def test_so_does_a_plan(number):
    plan = PLANS[number]
    answers = []
    for one in (plan, restore_plan(through_file(make_plan(JOINTS, 1, plan)))):
        _, monitor = make_monitor(motion="planned")
        monitor.step(0.003, HOME, STILL)
        answers.append(monitor.commit(one))
    assert repr(answers[0]) == repr(answers[1])


def test_a_plan_is_kept_to_the_bit():
    plan = resting(velocity_tracking_error=np.full(7, 1.0 / 3.0))
    again = restore_plan(through_file(make_plan(JOINTS, 1, plan)))
    for name in Plan._fields:
        one, other = getattr(plan, name), getattr(again, name)
        assert (one is None and other is None) or np.asarray(one).tobytes() == np.asarray(
            other
        ).tobytes()


@pytest.mark.parametrize("q", [[-0.0, 5e-324, 1.7976931348623157e308, math.inf, -math.inf, 0.1, 0]])
def test_a_state_is_kept_to_the_bit(q):
    stamp, found, v, now = restore_state(
        through_file(make_state(JOINTS, -0.0, np.array(q), np.array(q[::-1]), math.inf))
    )
    assert (str(stamp), now) == ("-0.0", math.inf)
    assert found.tobytes() == np.array(q, float).tobytes()
    assert v.tobytes() == np.array(q[::-1], float).tobytes()
