"""A STOP by late data is told apart from one by nearness, and to say so changes no verdict."""

import numpy as np
import pytest

from armguard.monitor.late_data import FEWEST_SAMPLES, SAMPLES, LateData, UsualAge
from armguard.obstacles import Obstacles, Source
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


def approach(source, rate, latency, phase, *, pause=(), ticks=1600, start=1.4):
    """Verdicts beside a hand that comes nearer at 0.5 m/s, seen by a regular source.

    Its samples are `phase` of a period late on the grid of ticks, and none are taken in the pause.
    """
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=[source]))
    verdicts, number = [], 0
    for k in range(ticks):
        now = k * PERIOD
        while (seen := (number + phase) / rate) + latency <= now:
            if not (pause and pause[0] <= seen < pause[1]):
                place = [[start - 0.5 * seen, 0.0, 0.5]]
                velocity = [[-0.5, 0.0, 0.0]]
                obstacles.update(["hand"], seen, place, velocity, radius=0.1, source="camera")
            number += 1
        verdicts.append(monitor.step(now, HOME, STILL, now))
    return verdicts


def watch_crowd(pause, count=60):
    """Verdicts beside a hand and a crowd behind it, seen by a camera that pauses."""
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=["camera"]))
    random, verdicts = np.random.default_rng(1), []
    places = random.uniform([1.0, -0.4, 0.0], [1.6, 0.4, 1.5], (count, 3))
    places[0] = 0.95, 0.0, 0.5
    for k in range(1300):
        now = k * PERIOD
        if k % 10 == 0 and not pause[0] <= now < pause[1]:
            ids = [f"body{number}" for number in range(count)]
            velocities = np.zeros((count, 3))
            obstacles.update(ids, now - LATENCY, places, velocities, radius=0.1, source="camera")
        verdicts.append(monitor.step(now, HOME, STILL, now))
    return verdicts


def tell(verdict):
    late = ReasonKind.LATE_DATA, ReasonKind.LATE_DATA_UNKNOWN
    return [one for one in verdict.reasons if one.kind in late]


@pytest.mark.hazard("H-01")
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


@pytest.mark.parametrize("rate", [20, 50, 125, 200])
def test_a_regular_source_is_never_late_and_a_pause_of_it_is_named(rate):
    source = Source("camera", timeout=1.0)
    for latency in (0.0, 0.001, 0.3 / rate, 1.7 / rate):
        for phase in (0.0, 0.5, 0.93):
            verdicts = approach(source, rate, latency, phase)
            assert min(one.level for one in verdicts) is Level.STOP
            assert not any(tell(one) for one in verdicts)
    for length in (0.15, 0.19):
        pause = 1.0, 1.0 + length
        verdicts = approach(source, rate, 0.005, 0.5, pause=pause, start=1.6)
        told = [one for one in verdicts if tell(one)]
        assert 100 < len(told) < 250
        assert {one.reasons[0].kind for one in told} == {ReasonKind.LATE_DATA}


def test_at_the_start_the_stated_latency_and_rate_say_what_is_usual():
    def tell_first(**stated):
        source = Source("camera", timeout=1.0, required=False, **stated)
        pause = 0.2, 0.35
        verdicts = approach(source, 100, 0.005, 0.5, pause=pause, ticks=400, start=1.1)
        return next(filter(None, map(tell, verdicts)), [])

    (reason,) = tell_first(latency=0.005, rate=100.0)
    assert "usually 10 ms" in reason.detail
    assert tell_first() == tell_first(latency=0.005) == []


def test_in_a_crowd_the_most_imminent_pairs_tell():
    stops = [one for one in watch_crowd((1.0, 1.17)) if one.level is Level.STOP and not one.held]
    assert stops
    for one in stops:
        assert one.reasons[0].kind is ReasonKind.LATE_DATA
        assert one.reasons[0].detail.endswith(("with fresh data: SLOW", "with fresh data: AWARE"))


def test_where_too_many_pairs_are_near_the_late_source_is_named_without_a_level(monkeypatch):
    monkeypatch.setattr("armguard.monitor.second_look.MOST_PAIRS", 1)
    told = [one for verdict in watch_crowd((1.0, 1.19)) for one in tell(verdict)]
    unknown = {one for one in told if one.kind is ReasonKind.LATE_DATA_UNKNOWN}
    assert len(unknown) > 10
    for one in unknown:
        assert one.subject == "camera"
        assert (
            "usually 10 ms; too many pairs are near to compute the level with fresh data"
            in one.detail
        )


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
    assert UsualAge(0.0, 0.002).find_lateness(0.05) == pytest.approx(0.049)
    assert UsualAge(0.004).find_lateness(0.05) == 0.0
