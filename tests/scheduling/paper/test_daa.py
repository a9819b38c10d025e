"""The paper's schedule against hand-made cases, a plain model in lists, and a brute-force world."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.exceptions import ArmguardError
from armguard.scheduling import DaaSchedule, Schedule
from armguard.scheduling.paper.partition import make_partition

PERIOD = 0.125  # a power of two, so that sums of ticks are exact
LAWS = [(p, s) for p in ("powers", "fibonacci") for s in ("partial", "total")]
SIZES = {"powers": [1, 2, 4, 8, 16, 32, 64], "fibonacci": [1, 2, 3, 5, 8, 13, 21, 34, 55]}


class PlainDaa:
    """The same rules once more, in lists and loops, sharing nothing with the code under test."""

    def __init__(self, partition, sort):
        self.sizes, self.sort = SIZES[partition], sort
        self.pairs, self.queue, self.watched, self.expiry, self.tick = [], set(), set(), {}, -1

    def turn(self, place):
        """Slot and size of the bucket that a place is in."""
        for size in self.sizes:
            if place <= size:
                return place - 1, size
            place -= size
        raise AssertionError

    def insert(self, pairs):
        self.pairs += pairs
        self.queue |= set(pairs)

    def remove(self, pairs):
        for pair in pairs:
            hole, last = self.pairs.index(pair), self.pairs.pop()
            self.queue.discard(pair)
            self.watched.discard(pair)
            if last != pair:
                self.pairs[hole] = last
                self.queue.add(last)

    def touch(self, pairs):
        self.queue |= set(pairs)

    def due(self):
        self.tick += 1
        self.places = []
        for place, pair in enumerate(self.pairs, 1):
            slot, size = self.turn(place)
            if self.tick % size == slot or pair in self.queue:
                self.places.append(place)
        self.queue = set()
        return [self.pairs[place - 1] for place in self.places]

    def settle(self, contact_times, stop_time):
        now = self.tick * PERIOD
        involved = [self.pairs[place - 1] for place in self.places]
        for pair, time in zip(involved, contact_times, strict=True):
            self.expiry[pair] = now + (0.0 if math.isnan(time) else time)
        if self.sort == "total":
            self.places, involved = list(range(1, len(self.pairs) + 1)), list(self.pairs)
        involved.sort(key=self.expiry.__getitem__)
        for place, pair in zip(self.places, involved, strict=True):
            self.pairs[place - 1] = pair
            slot, size = self.turn(place)
            visit = self.tick + 1
            while visit % size != slot:
                visit += 1
            if self.expiry[pair] > visit * PERIOD + stop_time:
                self.watched.discard(pair)
            else:
                self.watched.add(pair)


def bucket_of(schedule, pair):
    place = schedule.ranking().tolist().index(pair) + 1
    return int(np.searchsorted(make_partition(schedule.law).bases, place, side="right")) - 1


def check_bookkeeping(schedule, members):
    ranking = schedule.ranking().tolist()
    assert sorted(ranking) == sorted(members)
    assert len(schedule) == len(members)
    flagged = schedule.flagged().tolist()
    assert len(set(flagged)) == len(flagged)
    assert set(flagged) <= set(members)


times = st.sampled_from([0.0, 0.1, PERIOD, 0.3, 0.9, 1.0, 1.9, 2.0, 5.0, math.inf, math.nan])


@settings(max_examples=150)
@given(law=st.sampled_from(LAWS), data=st.data())
def test_it_does_what_the_plain_model_does_while_pairs_come_and_go(law, data):
    schedule, model = DaaSchedule(PERIOD, *law), PlainDaa(*law)
    numbers = st.lists(st.integers(0, 40), unique=True)
    for _ in range(data.draw(st.integers(1, 25), label="ticks")):
        if data.draw(st.booleans(), label="change"):
            drawn = data.draw(numbers, label="pairs")
            known = [pair for pair in drawn if pair in model.pairs]
            action = data.draw(st.sampled_from(["insert", "remove", "touch"]), label="action")
            pairs = [pair for pair in drawn if pair not in known] if action == "insert" else known
            getattr(schedule, action)(pairs)
            getattr(model, action)(pairs)
        due = schedule.due().tolist()
        assert due == model.due()
        taus = data.draw(st.lists(times, min_size=len(due), max_size=len(due)), label="taus")
        stop_time = data.draw(st.sampled_from([0.0, 0.25, 1.0]), label="stop_time")
        schedule.settle(taus, stop_time)
        model.settle(taus, stop_time)
        assert schedule.ranking().tolist() == model.pairs
        assert set(schedule.flagged().tolist()) == model.watched
        check_bookkeeping(schedule, model.pairs)


@pytest.mark.parametrize("law", LAWS)
def test_no_pair_goes_without_a_look_beyond_its_certificate_unless_flagged(law):
    rng = np.random.default_rng(7)
    schedule: Schedule = DaaSchedule(PERIOD, *law)
    certificates, next_number = {}, 0
    flags = 0
    for tick in range(1500):
        stop_time = 0.3
        if rng.random() < 0.2:
            fresh = list(range(next_number, next_number + rng.integers(0, 12)))
            next_number += len(fresh)
            schedule.insert(fresh)
            certificates.update(dict.fromkeys(fresh, -math.inf))
            leaving = [pair for pair in certificates if rng.random() < 0.1]
            schedule.remove(leaving)
            for pair in leaving:
                del certificates[pair]
        now = tick * PERIOD
        due = schedule.due()
        taus = rng.exponential(10 ** rng.uniform(-1, 2, due.size))
        certificates.update(zip(due.tolist(), (now + taus).tolist(), strict=True))
        schedule.settle(taus, stop_time)
        watched = set(schedule.flagged().tolist())
        flags += len(watched)
        for pair, expiry in certificates.items():
            assert pair in watched or expiry > now + PERIOD + stop_time - 1e-9
    assert 0 < flags < 1500 * len(certificates)


@pytest.mark.parametrize("law", LAWS)
def test_all_pairs_are_evaluated_and_put_in_order_at_first(law):
    schedule = DaaSchedule(PERIOD, *law)
    pairs = np.random.default_rng(1).permutation(500) * 10**15
    schedule.insert(pairs)
    due = schedule.due()
    assert due.tolist() == pairs.tolist()
    schedule.settle(due * 1e-15, 0.0)
    assert schedule.ranking().tolist() == sorted(pairs.tolist())


@pytest.mark.parametrize(("partition", "sort"), LAWS)
def test_a_tick_evaluates_one_pair_a_bucket(partition, sort):
    schedule = DaaSchedule(PERIOD, partition, sort)
    schedule.insert(np.arange(50_000))
    schedule.settle(np.linspace(0.0, 9.0, schedule.due().size), 0.0)
    limit = math.floor(math.log2(50_000)) + 1 if partition == "powers" else 22
    for _ in range(100):
        due = schedule.due()
        assert limit - 1 <= due.size <= limit
        assert [bucket_of(schedule, pair) for pair in due] == list(range(due.size))
        schedule.settle(np.ones(due.size), 0.0)


@pytest.mark.parametrize("partition", ["powers", "fibonacci"])
def test_a_pair_just_placed_is_looked_at_again_after_exactly_its_bucket_size(partition):
    schedule = DaaSchedule(PERIOD, partition)
    rng = np.random.default_rng(3)
    schedule.insert(np.arange(60))
    schedule.settle(rng.random(schedule.due().size), 0.0)
    appointment = {}
    for tick in range(1, 400):
        due = schedule.due()
        for pair in due.tolist():
            assert appointment.pop(pair, tick) == tick
        schedule.settle(rng.random(due.size), 0.0)
        for pair in due.tolist():
            appointment[pair] = tick + SIZES[partition][bucket_of(schedule, pair)]
        assert all(when > tick for when in appointment.values())


def run_with_constant_times(partition, sort, ticks=3000, count=45):
    taus = np.random.default_rng(5).permutation(count) + 1.0
    schedule = DaaSchedule(PERIOD, partition, sort)
    schedule.insert(np.arange(count))
    schedule.settle(np.zeros(schedule.due().size), 0.0)  # as they came: no order at all
    for _ in range(ticks):
        # Measured from a clock that stands still, lest certificates of total sorting grow old.
        schedule.settle(taus[schedule.due()] + (1000.0 - schedule.tick * PERIOD), 0.0)
    return schedule, taus[schedule.ranking()]


@pytest.mark.parametrize("partition", ["powers", "fibonacci"])
def test_total_sorting_of_constant_times_ends_sorted(partition):
    _, ordered = run_with_constant_times(partition, "total")
    assert (np.diff(ordered) > 0).all()


def test_partial_sorting_of_constant_times_ends_with_fibonacci_buckets_in_order():
    _, ordered = run_with_constant_times("fibonacci", "partial")
    bounds = np.cumsum([0, 1, 2, 3, 5, 8, 13])
    buckets = [ordered[a:b] for a, b in zip(bounds, [*bounds[1:], ordered.size], strict=True)]
    for near, far in itertools.pairwise(buckets):
        assert near.max() < far.min()


def test_partial_sorting_of_constant_times_ends_with_powers_in_heap_order():
    _, ordered = run_with_constant_times("powers", "partial")
    for place in range(2, ordered.size + 1):
        k = place.bit_length() - 1
        before = 2 ** (k - 1) + (place - 2**k) % 2 ** (k - 1)
        assert ordered[before - 1] < ordered[place - 1]
    assert ordered[0] == ordered.min()


@pytest.mark.parametrize("partition", ["powers", "fibonacci"])
def test_total_sorting_ranks_all_pairs_by_the_ends_of_their_certificates(partition):
    schedule, rng = DaaSchedule(PERIOD, partition, "total"), np.random.default_rng(11)
    schedule.insert(np.arange(70))
    end = np.zeros(70)
    for tick in range(200):
        due = schedule.due()
        taus = rng.exponential(5.0, due.size)
        end[due] = tick * PERIOD + taus
        schedule.settle(taus, 0.0)
        assert (np.diff(end[schedule.ranking()]) >= 0.0).all()


@pytest.mark.parametrize(("partition", "sort"), LAWS)
def test_a_place_is_flagged_by_its_own_round_and_the_stop_time(partition, sort):
    # Twenty pairs settled at tick 0, each with its own time to spare beyond stop time and visit.
    stop_time, sizes = 0.5, SIZES[partition]
    rounds = [(slot, size) for size in sizes for slot in range(size)][:20]
    # Slot 0 was in turn at tick 0 and waits a whole round; slot s waits s ticks.
    waits = np.array([slot or size for slot, size in rounds])
    needed = waits * PERIOD + stop_time
    barely = np.maximum.accumulate(needed) + 1e-9 * np.arange(1, 21)
    for times in (barely, np.sort(needed)):
        schedule = DaaSchedule(PERIOD, partition, sort)
        schedule.insert(np.arange(20))
        schedule.settle(times[schedule.due()], stop_time)
        assert schedule.ranking().tolist() == list(range(20))
        expected = np.flatnonzero(~(times > needed))
        assert sorted(schedule.flagged().tolist()) == expected.tolist()


def test_equal_times_keep_their_places():
    schedule = DaaSchedule(PERIOD)
    schedule.insert([9, 4, 7, 1])
    for _ in range(10):
        schedule.settle(np.full(schedule.due().size, math.inf), 0.0)
        assert schedule.ranking().tolist() == [9, 4, 7, 1]


def test_the_flag_is_set_by_the_next_visit_and_the_stop_time():
    schedule = DaaSchedule(PERIOD)
    schedule.insert([10, 20, 30])
    schedule.due()
    # Tick 0: place 1 comes round in 1 tick, place 2 in 2, place 3 (slot 1) in 1.
    schedule.settle([1 * PERIOD + 0.5, 2 * PERIOD + 0.5, 2 * PERIOD + 0.5], 0.5)
    assert set(schedule.flagged().tolist()) == {10, 20}
    assert schedule.due().tolist() == [10, 30]
    schedule.settle([0.7, 0.7], 0.5)
    assert schedule.flagged().tolist() == [20, 30]
    assert schedule.due().tolist() == [10, 20]
    schedule.settle([5.0, 5.0], 0.5)
    assert schedule.flagged().tolist() == [30]
    schedule.remove([30])
    assert not schedule.flagged().size


@pytest.mark.parametrize("law", LAWS)
def test_an_unknown_time_or_stop_time_flags(law):
    schedule = DaaSchedule(PERIOD, *law)
    schedule.insert([1, 2])
    schedule.due()
    schedule.settle([math.inf, math.nan], 0.1)
    assert schedule.ranking().tolist() == [2, 1]
    assert schedule.flagged().tolist() == [2]
    schedule.settle([math.inf] * schedule.due().size, math.nan)
    assert 2 in schedule.flagged()


def test_removal_moves_the_last_pair_into_the_hole_and_has_it_looked_at():
    schedule = DaaSchedule(PERIOD)
    schedule.insert(np.arange(1, 13))
    schedule.settle(schedule.due() * 10.0, 0.0)
    schedule.remove([5])
    assert schedule.ranking()[4] == 12
    # Tick 1: places 1, 3, 5, 9 are in turn; 12 stands at 5 anyway. Remove 6: 11 moves there.
    schedule.remove([6])
    due = schedule.due()
    assert due.tolist() == [1, 3, 12, 11, 9]
    schedule.settle(due * 10.0, 0.0)
    assert schedule.ranking().tolist() == [1, 2, 3, 4, 9, 11, 7, 8, 12, 10]


def test_touched_pairs_take_part_in_the_same_sort():
    schedule = DaaSchedule(PERIOD)
    schedule.insert(np.arange(1, 11))
    schedule.settle(schedule.due() * 10.0, 0.0)
    schedule.touch([10])
    schedule.touch([10, 1])
    assert schedule.due().tolist() == [1, 3, 5, 9, 10]
    schedule.settle([10.0, 30.0, 50.0, 90.0, 20.0], 0.0)
    assert schedule.ranking().tolist() == [1, 2, 10, 4, 3, 6, 7, 8, 5, 9]


@pytest.mark.parametrize("period", [0.0, -1.0, math.nan, math.inf])
def test_a_period_that_is_none_is_refused(period):
    with pytest.raises(ArmguardError, match="period"):
        DaaSchedule(period)


def test_unknown_laws_are_named():
    with pytest.raises(ArmguardError, match="golden"):
        DaaSchedule(PERIOD, "golden")
    with pytest.raises(ArmguardError, match="bubble"):
        DaaSchedule(PERIOD, sort="bubble")
    with pytest.raises(ArmguardError, match="pair 3"):
        DaaSchedule(PERIOD).touch([3])
