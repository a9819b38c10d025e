import math

import numpy as np
import pytest

from armguard.monitor.headroom import predict_headroom
from support.panda_monitor import HOME, PERIOD, STILL, make_monitor, see

BUDGET = 4
NEAREST = "panda_hand", "panda_leftfinger", "panda_rightfinger"


def place_crowd(count):
    """Balls that stand about the arm, even over the floor. Shape (count, 3)."""
    random = np.random.default_rng(0)
    turn = random.uniform(0.0, 2.0 * np.pi, count)
    distance = np.sqrt(random.uniform(2.2**2, 5.0**2, count))
    height = random.uniform(0.0, 1.5, count)
    return np.column_stack([distance * np.cos(turn), distance * np.sin(turn), height])


def watch_crowd(count, *, rate=1000.0, budget=BUDGET, duration=0.4):
    """Headroom after a crowd was watched, the share of late ticks in which answers got staler than
    they may, and evaluations."""
    obstacles, monitor = make_monitor(budget=budget, rate=rate, max_staleness=0.25)
    places, names = place_crowd(count), [f"ball {number}" for number in range(count)]
    # At first all are due at once, and that takes as long as it takes.
    backlog = math.ceil(count / budget)
    late, spent = [], []
    for tick in range(backlog + round(duration * rate)):
        if tick % round(0.02 * rate) == 0:
            see(obstacles, tick / rate, places, names, velocity=np.zeros((count, 3)))
        monitor.step(tick / rate, HOME, STILL)
        late.append(monitor._scheduler.waiting > 0)
        # Closer looks before a stop are no part of what the budget is for.
        spent.append(monitor._last[1].evaluated)
    last = slice(-round(0.3 * duration * rate), None)
    return monitor.headroom(), float(np.mean(late[last])), float(np.mean(spent[last]))


def test_the_budget_breaks_about_where_headroom_says():
    headroom, stale, evaluations = watch_crowd(400)
    assert (headroom.obstacles, headroom.budget, stale) == (400, BUDGET, 0.0)
    assert headroom.evaluations == pytest.approx(evaluations, rel=0.3)
    most = headroom.most_obstacles
    assert 400 < most < math.inf
    assert watch_crowd(round(most / 2.0))[1] == 0.0
    assert watch_crowd(round(most * 2.0))[1] == 1.0
    # The same crowd, looked at less often: too much falls due in each tick.
    assert watch_crowd(400, rate=2.0 * headroom.slowest_rate)[1] == 0.0
    assert watch_crowd(400, rate=0.5 * headroom.slowest_rate)[1] == 1.0


def test_without_a_budget_nothing_can_break():
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, [1.0, 0.0, 0.5])
    monitor.step(0.0, HOME, STILL)
    headroom = monitor.headroom()
    assert (headroom.obstacles, headroom.budget) == (1, math.inf)
    assert (headroom.most_obstacles, headroom.slowest_rate) == (math.inf, 0.0)
    assert headroom.evaluations > 0.0


def test_headroom_is_a_matter_of_proportion():
    once, twice = (predict_headroom(count, 0.1 * count, 1e-3, 50) for count in (100, 200))
    assert once.most_obstacles == pytest.approx(twice.most_obstacles) == 500.0
    assert twice.slowest_rate == pytest.approx(2.0 * once.slowest_rate) == 400.0
    # At its slowest rate a budget is spent by as many as there are.
    slow = predict_headroom(
        100, 0.1 * 100 * 1000.0 / once.slowest_rate, 1.0 / once.slowest_rate, 50
    )
    assert slow.most_obstacles == pytest.approx(100.0)


def approach(seed, count=5, age=60):
    """A monitor, and balls that it has not heard of for a while."""
    random = np.random.default_rng(seed)
    obstacles, monitor = make_monitor()
    turn, distance = random.uniform(0.0, 2.0 * np.pi, count), random.uniform(1.2, 2.5, count)
    height = random.uniform(0.2, 0.9, count)
    places = np.column_stack([distance * np.cos(turn), distance * np.sin(turn), height])
    paces = random.normal(0.0, 0.3, (count, 3))
    names = [f"ball {number}" for number in range(count)]
    see(obstacles, 0.0, places, names, velocity=paces)
    for tick in range(age):
        verdict = monitor.step(tick * PERIOD, HOME, STILL)
    # All are looked at once more, so that what comes of fresh states is theirs alone.
    monitor._scheduler.invalidate_all()
    verdict = monitor.step(verdict.stamp, HOME, STILL)
    return (
        obstacles,
        monitor,
        verdict,
        dict(zip(names, zip(places, paces, strict=True), strict=True)),
    )


@pytest.mark.parametrize("seed", range(6))
def test_fresh_states_of_those_named_first_gain_what_is_promised(seed):
    obstacles, monitor, verdict, balls = approach(seed)
    named = monitor.attention(4)
    assert named[0].obstacle == verdict.obstacle
    assert named[0].contact_time == pytest.approx(verdict.contact_time)
    assert named[0].gain > 0.0
    before = verdict.contact_time
    for one in named:
        assert one.age == pytest.approx(verdict.stamp)
        place, pace = balls[one.obstacle]
        see(obstacles, verdict.stamp, place + verdict.stamp * pace, [one.obstacle], velocity=[pace])
        monitor._scheduler.invalidate_all()  # let all be looked at again, as they are in time
        after = monitor.step(verdict.stamp, HOME, STILL).contact_time
        assert after - before == pytest.approx(one.gain, abs=5.0 * PERIOD)
        before = after


def test_there_are_as_many_as_asked_for_and_no_more_than_there_are():
    _, monitor, _, balls = approach(1)
    everyone = monitor.attention(99)
    assert {one.obstacle for one in everyone} == set(balls)
    times = [one.contact_time for one in everyone]
    assert times == sorted(times)
    assert all(one.gain >= 0.0 for one in everyone)
    for limit in (-1, 0, 1, 2):
        assert monitor.attention(limit) == everyone[: max(limit, 0)]
    _, idle = make_monitor()
    assert idle.attention() == []
    idle.step(0.0, HOME, STILL)
    assert idle.attention() == []


def test_a_link_that_need_not_be_watched_costs_nobody_attention():
    """The hand may touch the ball: how long that takes is no matter to a fresh look."""
    for ignore in ([], [(link, "ball") for link in NEAREST]):
        obstacles, monitor = make_monitor(ignore=ignore)
        see(obstacles, 0.0, [1.0, 0.0, 0.5], velocity=[[0.0, 0.0, 0.0]])
        for tick in range(60):
            verdict = monitor.step(tick * PERIOD, HOME, STILL)
        (one,) = monitor.attention()
        see(obstacles, verdict.stamp, [1.0, 0.0, 0.5], velocity=[[0.0, 0.0, 0.0]])
        monitor._scheduler.invalidate_all()
        after = monitor.step(verdict.stamp, HOME, STILL)
        assert after.contact_time - verdict.contact_time == pytest.approx(one.gain, abs=1e-9)
        assert one.gain > 0.0


def test_what_stands_for_ever_has_nothing_to_gain_from_a_look():
    obstacles, monitor = make_monitor()
    obstacles.add_static("post", [0.9, 0.0, 0.5], 0.1)
    for tick in range(3):
        verdict = monitor.step(tick * PERIOD, HOME, STILL)
    (one,) = monitor.attention()
    assert (one.obstacle, one.age) == ("post", 0.0)
    # Only that the monitor itself has not looked again.
    assert one.gain <= verdict.stamp + 1e-12
