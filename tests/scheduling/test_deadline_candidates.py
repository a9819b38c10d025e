"""Who could be touched soon: as brute force says, or as certificates know better."""

import numpy as np
import pytest

from armguard.pairs.evaluate import find_unsafe_pair
from armguard.scheduling.scheduler import Tick
from armguard.scheduling.timing_wheel import NOBODY
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, PERIOD, STILL, kinds, make_monitor, panda, see


def scatter(rng, count, nearest, farthest):
    """Places around the arm."""
    place = rng.normal(size=(count, 3))
    place /= np.linalg.norm(place, axis=1)[:, None]
    return place * rng.uniform(nearest, farthest, (count, 1)) + (0.0, 0.0, 0.4)


def test_unsafe_pairs_are_those_that_brute_force_finds():
    rng, links = np.random.default_rng(4), len(panda().links)
    found = []
    for _ in range(30):
        obstacles, monitor = make_monitor("deadline")
        names = [f"b{k}" for k in range(25)]
        speeds = rng.uniform(0.1, 2.0, 25)
        nearest = rng.choice([0.9, 1.3])
        see(obstacles, 0.0, scatter(rng, 25, nearest, 3.0), names, speed=speeds)
        v = rng.uniform(-0.1, 0.1, 7) * panda().velocity_limit
        verdict = monitor.step(0.0, HOME, v)
        watch = monitor._watch
        table = watch.arm.motion.braking.tabulate(HOME, v, 0.0, PERIOD + 0.002)
        end = float(table.time[-1])
        tick = Tick(1, 0.0, 0.0, HOME, v, 0.0, verdict.stop_time, end)
        pair, spent, left = watch.find_unsafe(tick, end)
        assert spent >= 0
        assert left == 0
        truth, _ = find_unsafe_pair(watch.arm.state, np.arange(25 * links))
        if truth == NOBODY:
            assert pair == NOBODY
        elif pair == NOBODY:
            # Brute force knows nothing but braking; certificates may know better.
            row, link = divmod(truth, links)
            assert watch.book.pair_expiry[row, link] > end
        found.append(pair == NOBODY)
        assert (verdict.level is Level.STOP) == (pair != NOBODY)
    assert any(found)
    assert not all(found)


def stand_beside(copies, place, *, schedule="deadline", **settings):
    """Verdicts of an arm that stands still beside so many of one and the same thing."""
    obstacles, monitor = make_monitor(schedule, rise_delay=0.0, **settings)
    for k in range(copies):
        obstacles.add_static(f"post{k}", place, 0.05)
    return [monitor.step(tick * PERIOD, HOME, STILL) for tick in range(10)]


def places_near_the_hand(count):
    """Nearer and farther, from where there is no time to stop to where there is."""
    _, monitor = make_monitor()
    monitor.step(0.0, HOME, STILL)
    monitor._watch.prepare(monitor._last[0])
    hand = monitor._watch.arm.kinematics.centers[-1].copy()
    return [hand + np.array([away, 0.0, 0.1]) for away in np.linspace(0.1, 0.35, count)]


@pytest.mark.parametrize(("schedule", "copies"), [("deadline", 1500), ("daa", 160)])
def test_many_copies_of_one_thing_are_as_good_as_one(schedule, copies):
    """How many things are near is no reason for a STOP: nobody set a limit to that."""
    stops, settings = [], {"max_staleness": 0.0} if schedule == "deadline" else {}
    for place in places_near_the_hand(6):
        one = stand_beside(1, place, schedule=schedule, **settings)
        many = stand_beside(copies, place, schedule=schedule, **settings)
        assert [v.level is Level.STOP for v in many] == [v.level is Level.STOP for v in one]
        if schedule == "deadline":
            assert [v.level for v in many] == [v.level for v in one]
            assert [v.speed_scale for v in many] == [v.speed_scale for v in one]
        assert not any(ReasonKind.BUDGET_SPENT in kinds(v) for v in many)
        stops.append(one[-1].level is Level.STOP)
    assert stops[0]
    assert not stops[-1]


def test_a_budget_that_is_spent_is_told_with_its_numbers():
    """A look that was begun is finished; what follows may find too little left for its question."""
    told = set()
    for place in places_near_the_hand(8):
        free = stand_beside(1, place)
        for budget in (2, 4, 12, 10**6):
            for verdict, without in zip(stand_beside(1, place, budget=budget), free, strict=True):
                reasons = [r for r in verdict.reasons if r.kind is ReasonKind.BUDGET_SPENT]
                assert verdict.level is without.level or reasons or not verdict.complete
                assert verdict.level <= without.level
                for reason in reasons:
                    told.add((budget, verdict.level))
                    assert reason.subject == f"budget={budget}"
                    assert (
                        reason.detail == f"1 obstacle not decided about after {budget} evaluations"
                    )
    assert {4, 12} <= {budget for budget, _ in told} <= {2, 4, 12}
    assert {level for _, level in told} >= {Level.STOP, Level.SLOW}


@pytest.mark.parametrize("budget", [1, 20])
def test_without_a_budget_for_a_closer_look_near_is_a_stop(budget):
    rng = np.random.default_rng(2)
    places = scatter(rng, 20, 1.15, 1.3)
    obstacles, monitor = make_monitor("deadline", budget=budget, rise_delay=0.0)
    see(obstacles, 0.0, places, [f"b{k}" for k in range(20)], speed=0.3)
    verdict = monitor.step(0.0, HOME, np.zeros(7))
    assert verdict.level is Level.STOP
    assert verdict.speed_scale == 0.0
    assert ReasonKind.BUDGET_SPENT in kinds(verdict) or not verdict.complete
