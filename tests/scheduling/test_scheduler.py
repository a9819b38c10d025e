"""What the monitor asks of a scheduler, asked of each scheduler there is."""

import math

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.scheduling.scheduler import Tick
from armguard.scheduling.timing_wheel import NOBODY
from support.panda_monitor import FAR, HOME, PERIOD, STILL, make_monitor, panda, see

LINKS = len(panda().links)
NEAR, MIDDLE = [0.6, 0.0, 0.5], [2.5, 0.0, 0.5]


class World:
    """A scheduler, and ticks that are told to it as a monitor does."""

    def __init__(self, schedule, **settings):
        self.obstacles, monitor = make_monitor(schedule, **settings)
        self.scheduler = monitor._scheduler
        self.number = 0
        self.tick = None

    def evaluate_due(self, stop_time=0.1):
        self.number += 1
        now = self.number * PERIOD
        self.scheduler.follow()
        self.tick = Tick(
            number=self.number, now=now, time=now, q=HOME, v=STILL, arm_age=0.0,
            stop_time=stop_time, refinement_threshold=0.6,
        )  # fmt: skip
        return self.scheduler.evaluate_due(self.tick)

    def list(self, rows=10**4, pairs=10**4):
        return self.scheduler.list_imminent(self.tick.time, row_limit=rows, pair_limit=pairs)

    def see(self, positions, names, **fields):
        see(self.obstacles, (self.number + 1) * PERIOD, positions, names, **fields)


@pytest.fixture(params=["deadline", "full", "daa"])
def schedule(request):
    return request.param


@pytest.fixture
def world(schedule):
    return World(schedule)


def test_without_obstacles_there_is_nothing_to_see(world):
    look = world.evaluate_due()
    assert (look.pair, look.expiry, look.overdue, look.evaluated) == (NOBODY, math.inf, 0, 0)
    assert not look.broken
    assert world.scheduler.find_unsafe(world.tick, 10.0)[0] == NOBODY
    listing = world.list()
    assert len(listing.rows) == len(listing.pairs) == 0
    assert np.isinf(listing.sphere_expiry).all()


def test_who_comes_is_looked_at_at_once_and_who_goes_is_gone(world):
    world.see([FAR, MIDDLE], ["far", "middle"])
    first = world.evaluate_due()
    assert first.overdue == 0
    assert world.obstacles.ids[first.pair // LINKS] == "middle"
    assert first.expiry > world.tick.time
    world.see([NEAR], ["near"])
    second = world.evaluate_due()
    assert world.obstacles.ids[second.pair // LINKS] == "near"
    assert second.expiry < first.expiry
    assert (second.overdue, second.evaluated > 0) == (0, True)
    world.obstacles.remove(["near", "middle"])
    third = world.evaluate_due()
    assert world.obstacles.ids[third.pair // LINKS] == "far"
    assert set(world.list().rows) == {world.obstacles.row("far")}


def test_the_soonest_is_the_soonest_of_all(world):
    rng = np.random.default_rng(0)
    for _ in range(8):
        positions = rng.normal(size=(30, 3))
        positions *= rng.uniform(1.2, 4.0, (30, 1)) / np.linalg.norm(positions, axis=1)[:, None]
        world.obstacles.remove([name for name in world.obstacles.ids if name])
        world.see(positions, [f"b{world.number}-{k}" for k in range(30)])
        look = world.evaluate_due()
        listing = world.list()
        assert (look.pair, look.expiry) == (listing.pairs[0], listing.expiry[0])
        assert (listing.rows[0], listing.row_expiry[0]) == (look.pair // LINKS, look.expiry)
        assert len(listing.pairs) == 30 * LINKS
        assert len(set(listing.pairs.tolist())) == 30 * LINKS
        assert (np.diff(listing.expiry) >= 0.0).all()
        assert (np.diff(listing.row_expiry) >= 0.0).all()
        for row, expiry in zip(listing.rows, listing.row_expiry, strict=True):
            assert expiry == listing.expiry[listing.pairs // LINKS == row].min()
        of_link = world.scheduler.arm.state.link_of[listing.sphere]
        assert np.array_equal(of_link, listing.pairs % LINKS)
        assert (listing.evaluated_at <= world.tick.time).all()
        few = world.list(rows=3, pairs=5)
        assert np.array_equal(few.pairs, listing.pairs[:5])
        assert np.array_equal(few.rows, listing.rows[:3])


def test_certificates_wait_until_they_are_doubted_or_restarted(schedule):
    world = World(schedule)
    world.see([FAR, [0.0, 20.0, 0.5]], ["a", "b"])
    first = world.evaluate_due()
    for _ in range(3):
        idle = world.evaluate_due()
    for renew in (world.scheduler.invalidate_all, world.scheduler.restart):
        renew()
        again = world.evaluate_due()
        assert again.evaluated >= first.evaluated
        assert again.overdue == 0
        assert again.expiry == pytest.approx(first.expiry + again.expiry - first.expiry)
    assert schedule != "deadline" or idle.evaluated < first.evaluated


def test_news_that_break_a_bound_are_told_once(schedule):
    world = World(schedule)
    world.see([FAR], ["ball"], position_error=0.05)
    world.evaluate_due()
    broken = []
    for i in range(1, 8):
        world.see([[FAR[0] - 0.09 * i, 0.0, 0.5]], ["ball"], position_error=0.05)
        look = world.evaluate_due()
        assert look.overdue == 0
        broken += look.broken
    # A schedule that evaluates it in every tick compares each state with the one before alone.
    assert set(broken) == ({world.obstacles.row("ball")} if schedule == "deadline" else set())
    assert not world.evaluate_due().broken


def test_a_watch_whose_table_another_one_follows_says_so(world):
    world.evaluate_due()
    world.obstacles.start_watching()
    with pytest.raises(ArmguardError, match="another monitor"):
        world.evaluate_due()
    world.scheduler.restart()
    world.evaluate_due()


def test_who_is_named_is_watched_even_where_nothing_can_touch(schedule):
    world = World(schedule, ignore=[("*", "table")])
    for k, name in enumerate(("gone", "table", "post")):
        world.obstacles.add_static(name, [5.0 + k, 0.0, 0.5], 0.1)
    world.evaluate_due()
    world.obstacles.remove(["gone"])
    look = world.evaluate_due()
    assert world.obstacles.ids[look.pair // LINKS] == "post"
    assert look.expiry == math.inf
    world.obstacles.remove(["post"])
    assert world.evaluate_due()[:2] == (NOBODY, math.inf)
