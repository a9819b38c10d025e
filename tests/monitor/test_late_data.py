"""A STOP by late data is told apart from one by nearness, and to say so changes no verdict."""

import numpy as np
import pytest

from armguard.monitor.late_data import FEWEST_SAMPLES, SAMPLES, LateData, UsualAge
from armguard.obstacles import Obstacles
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, PERIOD, STILL, kinds, make_monitor

LATENCY = 0.005


def watch(pause=(), held_up=(), distance=0.95, ticks=3000, schedule="deadline", seen=None):
    """Verdicts beside a hand that a camera sees 100 times a second, 5 ms late, with pauses.

    What observers see of each tick of the first pause is added to `seen`, where that is a list.
    """
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles(sources=["camera"]))
    verdicts, stamp = [], 0.0
    for k in range(ticks):
        now = k * PERIOD
        if k % 10 == 0 and not (pause and pause[0] <= now < pause[1]):
            place = [[distance, 0.0, 0.5]]
            obstacles.update(
                ["hand"], now - LATENCY, place, np.zeros((1, 3)), radius=0.1, source="camera"
            )
        if not (held_up and held_up[0] <= now < held_up[1]):
            stamp = now
        verdicts.append(monitor.step(stamp, HOME, STILL, now))
        if seen is not None and pause[0] <= now < pause[1]:
            seen.append(monitor.snapshot(pair_limit=10, row_limit=2).sphere_times)
    return verdicts


def tell(verdict):
    return [one for one in verdict.reasons if one.kind is ReasonKind.LATE_DATA]


@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_a_pause_of_a_camera_is_named_where_it_alone_stops_the_arm(schedule):
    on_time, paused = watch(schedule=schedule), watch((2.0, 2.17), schedule=schedule)
    assert min(one.level for one in on_time) is Level.AWARE
    assert not any(tell(one) for one in on_time)
    stops = [one for one in paused if one.level is Level.STOP]
    assert stops
    first = stops[0]
    (reason,) = tell(first)
    assert reason.subject == "camera"
    assert "usually 10 ms" in reason.detail
    assert reason.detail.endswith("with fresh data: AWARE")
    # It is the weightiest reason, and what the STOP is held for.
    assert first.reasons[0] == reason
    assert all(one.held is None or one.held.reason.kind is ReasonKind.LATE_DATA for one in stops)


def test_late_joint_states_are_named_too():
    verdicts = watch(held_up=(2.0, 2.045), distance=0.835)
    late = [one for verdict in verdicts for one in tell(verdict)]
    assert late
    assert {one.subject for one in late} == {"joint states"}


def test_a_body_that_is_near_is_near_however_late_it_is_seen():
    verdicts = watch((2.0, 2.17), distance=0.6)
    assert {one.level for one in verdicts} == {Level.STOP}
    assert not any(tell(one) for one in verdicts)


@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_what_is_said_of_late_data_changes_nothing_else(monkeypatch, schedule):
    seen, unmoved = [], []
    told = watch((2.0, 2.17), schedule=schedule, seen=seen)
    monkeypatch.setattr("armguard.monitor.late_data.LateData.explain", lambda *_: [])
    untold = watch((2.0, 2.17), schedule=schedule, seen=unmoved)
    for one, other in zip(told, untold, strict=True):
        fields = {"reasons": (), "held": None}
        assert one._replace(**fields) == other._replace(**fields)
        assert kinds(one) - {ReasonKind.LATE_DATA} == kinds(other)
    np.testing.assert_array_equal(seen, unmoved)


def test_what_fresh_data_would_give_is_asked_a_few_times_and_told_in_every_tick(monkeypatch):
    looks, look = [], LateData._look
    monkeypatch.setattr(LateData, "_look", lambda *some: looks.append(some[1].now) or look(*some))
    verdicts = watch((2.0, 2.17))
    told = [verdict.stamp for verdict in verdicts if tell(verdict)]
    assert len(told) > 50
    assert len(looks) <= 8
    # Ages go on with time between two looks.
    ages = {reason.detail.split(" ms")[0] for one in verdicts for reason in tell(one)}
    assert len(ages) > 0.8 * len(told)


def test_the_usual_age_is_the_median_of_the_last_samples():
    random, usual = np.random.default_rng(0), UsualAge()
    assert usual.median is None
    seen = []
    for k in range(3 * SAMPLES):
        seen.append(float(random.lognormal(-4.0 + k / SAMPLES, 0.7)))
        usual.add(seen[-1])
        if k + 1 < FEWEST_SAMPLES:
            assert usual.median is None
        elif k % 50 == 0:
            assert usual.median == pytest.approx(np.median(seen[-SAMPLES:]), rel=0.1)
    for odd in (-1.0, 0.0, np.inf, np.nan, 1e300):
        usual.add(odd)
    assert usual.find_lateness(np.nan) == 0.0
    assert UsualAge(0.001).find_lateness(0.05) == pytest.approx(0.049)
