"""Collections between ticks: where there is time, and where they can wait no longer."""

import gc
import weakref

import pytest

from armguard.garbage import OVERDUE, IdleCollector

THRESHOLDS = (50, 3, 3)


@pytest.fixture(autouse=True)
def thresholds():
    before = gc.get_threshold()
    gc.set_threshold(*THRESHOLDS)
    yield
    gc.set_threshold(*before)
    gc.enable()


class SlowClock:
    """Every look at it takes `step` seconds, so that collections cost as much."""

    def __init__(self, step=0.0):
        self.step = step
        self.time = 0.0

    def now(self):
        self.time += self.step
        return self.time

    def sleep_until(self, deadline):
        self.time = max(self.time, deadline)


class Knot:
    """Nothing but a collection gets rid of it."""

    def __init__(self):
        self.itself = self


def make_knots(count):
    return [weakref.ref(Knot()) for _ in range(count)]


def count_living(knots):
    return sum(knot() is not None for knot in knots)


@pytest.mark.parametrize("enabled", [True, False])
def test_python_does_not_collect_inside_and_does_as_before_afterwards(enabled):
    (gc.enable if enabled else gc.disable)()
    frozen = gc.get_freeze_count()
    seen = []

    def be_interrupted():
        with IdleCollector(SlowClock()):
            seen.extend([gc.isenabled(), gc.get_freeze_count() > frozen])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        be_interrupted()
    assert seen == [False, True]
    assert gc.isenabled() == enabled
    assert gc.get_freeze_count() == 0


def test_what_was_there_at_the_start_is_left_out():
    kept = [[] for _ in range(10_000)]
    with IdleCollector(SlowClock()):
        assert len(gc.get_objects()) < len(kept)


def test_garbage_goes_where_there_is_time_for_it():
    with IdleCollector(SlowClock(0.001)) as collector:
        knots = make_knots(2 * THRESHOLDS[0])
        collector.collect(0.0005)
        assert count_living(knots) == len(knots)
        collector.collect(0.0015)
        assert count_living(knots) == 0


def test_few_objects_are_not_worth_a_collection():
    with IdleCollector(SlowClock(0.001)) as collector:
        knots = make_knots(THRESHOLDS[0] // 4)
        collector.collect(10.0)
        assert count_living(knots) == len(knots)


@pytest.mark.parametrize(("idle", "wait"), [(0.0, OVERDUE), (1.0, 1)])
def test_garbage_never_grows_without_bounds(idle, wait):
    """Neither what dies at once nor what dies when it is old, be there ever so little time."""
    living, kept, most = set(), [], 0
    rounds = (THRESHOLDS[1] + 1) * (THRESHOLDS[2] + 1)
    with IdleCollector(SlowClock(0.001)) as collector:
        for _ in range(3000):
            fresh = [Knot() for _ in range(20)]
            living.update(weakref.ref(knot, living.discard) for knot in fresh)
            kept = [*kept[-200:], *fresh[:10]]
            del fresh
            collector.collect(idle)
            most = max(most, len(living))
    # Each object is in a dictionary and a list as well, so a knot counts for less than one.
    assert most < 200 + 2 * wait * THRESHOLDS[0] * rounds < 30_000


def test_old_generations_are_collected_too_where_only_the_youngest_fits():
    """Their cost is that of everything that lives; time for it may never come."""
    clock = SlowClock()
    with IdleCollector(clock) as collector:
        collected = []

        def watch(phase, info):
            if phase == "start":
                clock.time += 0.01 if info["generation"] else 0.0001
                collected.append(info["generation"])

        gc.callbacks.append(watch)
        try:
            for _ in range(2000):
                make_knots(20)
                collector.collect(0.001)
        finally:
            gc.callbacks.remove(watch)
    assert collected.count(0) > collected.count(1) > collected.count(2) > 0
    # Once for each of the two to see what it costs; from then on when they are overdue.
    assert collected.count(1) < collected.count(0) / THRESHOLDS[1] / 2


def test_who_switched_collection_off_has_it_off():
    gc.disable()
    with IdleCollector(SlowClock()) as collector:
        knots = make_knots(10 * OVERDUE * THRESHOLDS[0])
        collector.collect(10.0)
        assert count_living(knots) == len(knots)
    gc.enable()
    gc.set_threshold(0)
    with IdleCollector(SlowClock()) as collector:
        knots = make_knots(100)
        collector.collect(10.0)
        assert count_living(knots) == len(knots)
