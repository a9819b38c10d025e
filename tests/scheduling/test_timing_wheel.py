"""Against a plain model: a set of entries, each with the ticks within which it has to come out."""

import math

import numpy as np
import pytest

from armguard.scheduling.timing_wheel import (
    ABSENT,
    DUE,
    EARLY,
    NOBODY,
    SLOTS,
    TICK,
    TURNING,
    WAITING,
    grow_wheel,
    make_due,
    make_wheel,
    most_urgent,
    put_off,
    take_out,
    turn,
)

HOUR = 3_600_000
"""Ticks of an hour at 1 kHz."""


def read(wheel):
    """What waits, in the order of the heap, and what turns: lists, so that doubles show."""
    waiting = wheel.heap[: wheel.numbers[WAITING]].tolist()
    turning = []
    for slot in np.flatnonzero(wheel.load):
        entry, before, count = wheel.first[slot], NOBODY, 0
        while entry != NOBODY:
            assert (wheel.slot[entry], wheel.before[entry]) == (slot, before)
            turning.append(int(entry))
            before, entry, count = entry, wheel.after[entry], count + 1
        assert count == wheel.load[slot]
    assert (wheel.first[wheel.load == 0] == NOBODY).all()
    assert len(turning) == wheel.numbers[TURNING]
    return waiting, turning


class Model:
    """Entries with the deadline of each, the first tick at which it may and must come out."""

    def __init__(self):
        self.clock, self.due, self.turning = 0, {}, {}

    def put_off(self, entry, tick, deadline):
        wait = max(min(tick - self.clock, SLOTS - 1), 1)
        self.due.pop(entry, None)
        self.turning[entry] = (self.clock + wait - wait // EARLY, self.clock + wait, deadline)

    def make_due(self, entry, deadline):
        self.turning.pop(entry, None)
        self.due[entry] = deadline

    def take_out(self, entry):
        self.turning.pop(entry, None)
        self.due.pop(entry, None)

    def turn(self, tick, waiting):
        self.clock = max(self.clock, tick)
        for entry, (earliest, latest, deadline) in list(self.turning.items()):
            if entry in waiting:
                assert earliest <= self.clock, "too early"
                self.make_due(entry, deadline)
            assert entry in waiting or latest > self.clock, "too late"


def check(wheel, model):
    waiting, turning = read(wheel)
    assert sorted(waiting) == sorted(model.due)
    assert sorted(turning) == sorted(model.turning)
    assert wheel.numbers[TICK] == model.clock
    for place, entry in enumerate(waiting):
        assert wheel.slot[entry] == DUE
        assert wheel.after[entry] == place
        assert wheel.deadline[entry] == model.due[entry]
        assert model.due[waiting[(place - 1) // 2]] <= model.due[entry] or place == 0
    most = most_urgent(wheel)
    assert (most == NOBODY) == (not waiting)
    assert not waiting or model.due[most] == min(model.due.values())
    absent = set(range(len(wheel.slot))) - set(waiting) - set(turning)
    assert (wheel.slot[sorted(absent)] == ABSENT).all()


@pytest.mark.parametrize("seed", range(4))
def test_random_operations_are_those_of_the_model(seed):
    rng = np.random.default_rng(seed)
    capacity, jumps = 40, [1, 1, 1, 3, 50, -20, SLOTS - 1, SLOTS, HOUR]
    wheel, model, crowds = make_wheel(capacity), Model(), (0, 0)
    for operation in rng.integers(0, 10, 1500):
        entry = int(rng.integers(capacity))
        deadline = float(rng.choice([rng.normal(), -math.inf, math.inf, 0.0]))
        if operation < 4:
            tick = model.clock + int(rng.choice([-5, 0, 1, 2, 7, 100, 5000, SLOTS, 3 * SLOTS]))
            put_off(wheel, entry, tick, deadline)
            model.put_off(entry, tick, deadline)
        elif operation < 5:
            make_due(wheel, entry, deadline)
            model.make_due(entry, deadline)
        elif operation < 6:
            take_out(wheel, entry)
            model.take_out(entry)
        elif operation < 9:
            tick = model.clock + int(rng.choice(jumps))
            turn(wheel, tick)
            model.turn(tick, wheel.heap[: wheel.numbers[WAITING]].tolist())
        elif capacity < 320 and rng.random() < 0.05:
            capacity *= 2
            wheel = grow_wheel(wheel, capacity)
        check(wheel, model)
        crowds = max(crowds[0], len(model.due)), max(crowds[1], len(model.turning))
    assert min(crowds) > 10


def test_what_waits_comes_out_in_the_order_of_its_deadlines():
    rng = np.random.default_rng(0)
    deadlines = rng.normal(size=500).round(1)
    wheel = make_wheel(500)
    for entry, deadline in enumerate(deadlines):
        make_due(wheel, entry, deadline)
    for entry in rng.permutation(500)[:100]:
        take_out(wheel, entry)
        deadlines[entry] = math.inf
    out = []
    while (entry := most_urgent(wheel)) != NOBODY:
        out.append(deadlines[entry])
        take_out(wheel, entry)
    assert out == sorted(deadlines[deadlines < math.inf])


def test_an_entry_never_comes_out_in_the_tick_that_put_it_off():
    """Else a tick that looks at what is due would not end."""
    wheel = make_wheel(300)
    for tick in (5, 6, 7 + HOUR):
        turn(wheel, tick)
        for entry in range(300):
            put_off(wheel, entry, tick - entry % 3, 0.0)
        turn(wheel, tick)
        assert most_urgent(wheel) == NOBODY
        turn(wheel, tick + 1)
        assert wheel.numbers[WAITING] == 300


@pytest.mark.parametrize("count", [3, 100, 5000])
def test_the_load_stays_level_while_entries_come_round(count):
    wait = 100
    wheel = make_wheel(count)
    for entry in range(count):
        make_due(wheel, entry, 0.0)
    done = []
    for tick in range(1, 15 * wait):
        turn(wheel, tick)
        due = wheel.heap[: wheel.numbers[WAITING]].tolist()
        for entry in due:
            put_off(wheel, entry, tick + wait, 0.0)
        done.append(len(due))
    settled = np.array(done[10 * wait :])
    share = count / wait
    assert share - 1.0 <= settled.mean() <= share * EARLY / (EARLY - 1) + 1.0
    assert settled.max() <= 2.0 * share + 4.0


def test_growing_loses_nothing():
    wheel = make_wheel(8)
    for entry in range(4):
        put_off(wheel, entry, 10 * entry, float(entry))
        make_due(wheel, entry + 4, float(entry))
    grown = grow_wheel(wheel, 100)
    assert read(grown) == read(wheel)
    assert (grown.slot[8:] == ABSENT).all()
    put_off(grown, 99, 5, 0.0)
    turn(grown, 30)
    assert sorted(read(grown)[0]) == [*range(8), 99]
