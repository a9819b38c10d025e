"""Who could be touched soon: as brute force says, or as certificates know better."""

import numpy as np
import pytest
from scenes import HOME, PERIOD, make_monitor, panda, see

from armguard.pairs import find_unsafe_pair
from armguard.schedules.wheel import NOBODY
from armguard.verdict import Level
from armguard.watch import CLOSE_LOOKS, Tick


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
        pair, spent = watch.find_unsafe(tick, end)
        assert 0 <= spent <= CLOSE_LOOKS
        truth, _ = find_unsafe_pair(watch.arm.state, np.arange(25 * links), 10**9)
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


def test_a_crowd_of_suspects_has_its_price_and_counts_in_the_verdict():
    obstacles, monitor = make_monitor("deadline")
    rng = np.random.default_rng(1)
    for k, place in enumerate(scatter(rng, 600, 0.9, 1.0)):
        obstacles.add_static(f"post{k}", place, 0.01)
    for tick in range(30):
        verdict = monitor.step(tick * PERIOD, HOME, np.zeros(7))
        # The first tick looks at all that came; from then on a stop may take a closer look, and
        # the speed scale searches.
        if tick:
            assert verdict.evaluated <= 8 * CLOSE_LOOKS


@pytest.mark.parametrize("budget", [1, 20])
def test_without_a_budget_for_a_closer_look_near_is_a_stop(budget):
    rng = np.random.default_rng(2)
    places = scatter(rng, 20, 1.15, 1.3)
    obstacles, monitor = make_monitor("deadline", budget=budget, hold=0.0)
    see(obstacles, 0.0, places, [f"b{k}" for k in range(20)], speed=0.3)
    verdict = monitor.step(0.0, HOME, np.zeros(7))
    assert verdict.level is Level.STOP
    assert verdict.speed_scale == 0.0
