"""Obstacles scheduled by their deadlines: nothing is ever missed, whatever happens to them."""

import math

import numpy as np
import pytest

from armguard.scheduling.tournament import ROOT, entries_of
from armguard.verdict import Level, ReasonKind
from support.adversary import Hunt
from support.panda_monitor import (
    FAR,
    HOME,
    PERIOD,
    kinds,
    make_monitor,
    panda,
    see,
    steps,
)

NEAR = [0.9, 0.3, 0.5]


@pytest.mark.parametrize(
    ("seed", "count", "pair_ticks", "settings"),
    [
        (4, 40, 6e5, {}),
        (2, 30, 4e5, {"max_staleness": 0.9}),
        (3, 30, 4e5, {"rate": 250.0, "latency": 0.004}),
        (5, 20, 4e5, {"budget": 300}),
    ],
)
def test_attackers_that_know_the_schedule_are_never_missed(seed, count, pair_ticks, settings):
    score = Hunt(panda(), seed, count, 12, **settings).run(pair_ticks)
    assert score.pair_ticks >= pair_ticks
    assert (score.missed, score.hits, score.early) == (0, 0, 0), score
    # It was no walk in the park: attacks were tried at close range, and came close.
    assert score.goes > 0.05 * score.ticks
    assert score.tried > 5
    assert score.worst < 0.3


def test_attackers_find_what_is_wrong():
    """Else the test above would prove nothing: here the arm takes longer than it says."""
    score = Hunt(panda(), 2, 60, 12, true_reaction=0.06).run(3e5)
    assert score.missed > 0


def check_book(obstacles, monitor):
    """Each obstacle that is there is in the wheel or waits, once; nobody else is."""
    certificates = monitor._scheduler.certificates
    alive = np.flatnonzero(obstacles.table.alive)
    wheel = certificates.wheel
    waiting = wheel.heap[: wheel.numbers[0]].tolist()
    turning = []
    for first in wheel.first[wheel.first >= 0]:
        entry = first
        while entry >= 0:
            turning.append(int(entry))
            entry = wheel.after[entry]
    assert sorted(waiting + turning) == alive.tolist()
    least = entries_of(certificates.expiry_tree)[: len(certificates.watched)]
    assert certificates.expiry_tree[ROOT] == least.min(initial=math.inf)
    assert np.isinf(np.delete(least, alive)).all()
    for row in alive:
        expiry = certificates.pair_expiry[row][certificates.watched[row]]
        assert least[row] <= expiry.min() or least[row] == -math.inf


def test_ids_that_come_and_go_in_each_tick():
    rng = np.random.default_rng(7)
    obstacles, monitor = make_monitor("deadline", source_timeout=10.0)
    for k in range(150):
        count = rng.choice([0, 1, 5, 40])
        names = [f"{k}-{i}" for i in range(count)]
        place = rng.normal(size=(count, 3))
        place *= rng.uniform(1.5, 9.0) / np.linalg.norm(place, axis=1)[:, None]
        if count or k == 0:
            obstacles.update(names, k * PERIOD, place, radius=0.1, snapshot=True)
        else:
            obstacles.remove([name for name in obstacles.ids if name])
        # One that goes and comes back under its name within a tick, elsewhere.
        see(obstacles, (k - 0.5) * PERIOD, FAR, ["again"])
        obstacles.remove(["again"])
        see(obstacles, k * PERIOD, [8.0, 0.1 * k, 0.0], ["again"])
        (verdict,) = steps(monitor, k, 1)
        assert verdict.complete
        assert verdict.obstacle in obstacles.ids
        check_book(obstacles, monitor)


def test_without_staleness_every_answer_is_that_of_full():
    """Both look at everything in each tick, so both say the same."""
    rng = np.random.default_rng(8)
    worlds = [
        make_monitor("deadline", max_staleness=0.0, rise_delay=0.0, source_timeout=10.0),
        make_monitor("full", rise_delay=0.0, source_timeout=10.0),
    ]
    stale = make_monitor("deadline", rise_delay=0.0, source_timeout=10.0)
    place = rng.normal(size=(30, 3))
    place *= rng.uniform(1.35, 4.0, (30, 1)) / np.linalg.norm(place, axis=1)[:, None]
    velocity = rng.uniform(-0.3, 0.3, (30, 3))
    levels = set()
    for k in range(250):
        now, names = k * PERIOD, [f"b{i}" for i in range(30)]
        v = np.zeros(7)
        v[0] = 0.4
        answers = []
        for obstacles, monitor in [*worlds, stale]:
            if k % 20 == 0:
                see(
                    obstacles, now, place + velocity * now, names, velocity=velocity,
                    speed=0.6, accel=2.0,
                )  # fmt: skip
            answers.append(monitor.step(now, HOME + v * now, v))
        fresh, full, lazy = answers
        # Sharing looks among links costs a little of the time, never of the safety.
        assert fresh.contact_time == pytest.approx(full.contact_time, rel=2e-2, abs=1e-3)
        assert fresh.level == full.level
        # A stale answer is lower by what time passed since, and max_staleness limits that.
        assert lazy.contact_time <= 1.05 * full.contact_time + 2e-3
        assert lazy.contact_time >= (1.0 - 0.25) * full.contact_time - 0.1
        assert lazy.level <= full.level
        if full.level is Level.STOP:
            assert lazy.level is Level.STOP
        levels.add(full.level)
    assert len(levels) > 1


def test_updates_within_bounds_cost_nothing():
    """A hundred messages in each tick, as from a source at 1e5 a second."""
    spent = []
    for messages in (1, 100):
        obstacles, monitor = make_monitor("deadline", source_timeout=10.0)
        names = [f"b{i}" for i in range(100)]
        place = np.array([[2.0 + 0.05 * i, 0.0, 0.5] for i in range(100)])
        see(obstacles, 0.0, place, names)
        steps(monitor, 0, 1)
        evaluated = 0
        for k in range(1, 100):
            for part in range(messages):
                see(obstacles, (k - 1 + (part + 1) / messages) * PERIOD, place, names)
            (verdict,) = steps(monitor, k, 1)
            assert verdict.complete
            assert not kinds(verdict) & {ReasonKind.BOUND_BROKEN, ReasonKind.OBSTACLE_REFUSED}
            evaluated += verdict.evaluated
        spent.append(evaluated)
    assert spent[1] <= spent[0]


@pytest.mark.parametrize(
    "growth",
    [
        {"radius": 0.4},
        {"accel": 30.0},
        {"speed": 5.0},
    ],
)
def test_growth_is_due_at_once(growth):
    obstacles, monitor = make_monitor("deadline", source_timeout=10.0)
    place, fields = [2.5, 0.0, 0.5], {"velocity": [[0.0, 0.0, 0.0]]}
    see(obstacles, 0.0, place, **fields)
    before = steps(monitor, 0, 10)[-1]
    see(obstacles, 10 * PERIOD, place, **(fields | growth))
    (verdict,) = steps(monitor, 10, 1)
    assert verdict.complete
    assert verdict.contact_time < before.contact_time - 1.5 * PERIOD
    fresh, other = make_monitor("deadline", source_timeout=10.0)
    see(fresh, 10 * PERIOD, place, **(fields | growth))
    (alike,) = steps(other, 10, 1)
    assert verdict.contact_time == pytest.approx(alike.contact_time, abs=1e-9)


def test_a_state_that_breaks_what_certificates_rest_on_is_due_at_once():
    """Slow at first by its own bounds, then fast: the first record allows no such thing."""
    obstacles, monitor = make_monitor("deadline", source_timeout=10.0, rise_delay=0.05)
    still = {"velocity": [[0.0, 0.0, 0.0]], "velocity_error": 0.01}
    see(obstacles, 0.0, [3.0, 0.0, 0.5], accel=0.01, speed=0.02, **still)
    steps(monitor, 0, 10)
    # Five agreeing samples of another track are believed; then its certificates hold no longer.
    seen = set()
    for k in range(10, 40):
        see(obstacles, k * PERIOD, [2.0, 0.0, 0.5], accel=0.01, speed=0.02, **still)
        (verdict,) = steps(monitor, k, 1)
        seen |= kinds(verdict)
        if k < 14:
            # Both may be true: no answer is later than that of either alone.
            assert ReasonKind.OBSTACLE_REFUSED in kinds(verdict)
            alone, other = make_monitor("deadline", source_timeout=10.0)
            see(alone, k * PERIOD, [2.0, 0.0, 0.5], accel=0.01, speed=0.02, **still)
            assert verdict.contact_time <= steps(other, k, 1)[0].contact_time + 1e-9
    assert seen >= {ReasonKind.OBSTACLE_REFUSED, ReasonKind.BOUND_BROKEN}
    assert steps(monitor, 40, 60)[-1].level > Level.STOP


def test_ticks_may_come_late_but_clocks_may_not_jump():
    obstacles, monitor = make_monitor("deadline", source_timeout=1e9)
    see(obstacles, 0.0, [6.0, 0.0, 0.5], velocity=[[0.0, 0.0, 0.0]], speed=0.1)
    now, rng = 0.0, np.random.default_rng(10)
    for _ in range(200):
        now += rng.choice([0.0, 1e-4, PERIOD, 7 * PERIOD, 0.049])
        verdict = monitor.step(now, HOME, np.zeros(7))
        assert verdict.complete
        assert verdict.level > Level.STOP
    verdict = monitor.step(now + 1e5, HOME, np.zeros(7))
    assert ReasonKind.JOINT_STATE_GAP in kinds(verdict)
    monitor.reset()
    verdict = monitor.step(now + 1e5, HOME, np.zeros(7))
    # The ball was last heard of long ago: it could be anywhere.
    assert (verdict.level, verdict.complete, verdict.contact_time) == (Level.STOP, True, 0.0)
    monitor.step(now, HOME, np.zeros(7))
    monitor.reset()
    see(obstacles, now, [6.0, 0.0, 0.5], velocity=[[0.0, 0.0, 0.0]], speed=0.1)
    verdict = monitor.step(now, HOME, np.zeros(7))
    assert (verdict.contact_time > 1.0, verdict.complete) == (True, True)
    check_book(obstacles, monitor)


def test_the_table_grows_and_widens_under_way():
    obstacles, monitor = make_monitor("deadline", source_timeout=10.0)
    shapes = {"ball": 1, "capsule": 2, "box": 8}
    tick, count = 0, 0
    for shape, points in shapes.items():
        for size in (1, 30, 300):
            names = [f"{shape}{count + i}" for i in range(size)]
            count += size
            corners = np.tile([7.0, 0.0, 0.5], (size, points, 1))
            corners += np.linspace(0.0, 0.3, points)[None, :, None]
            obstacles.update(names, tick * PERIOD, corners, radius=0.05)
            (verdict,) = steps(monitor, tick, 1)
            assert verdict.complete
            assert verdict.obstacle in obstacles.ids
            check_book(obstacles, monitor)
            tick += 1
    near = np.tile(NEAR, (1, 8, 1)) + np.linspace(0.0, 0.2, 8)[None, :, None]
    obstacles.update(["near"], tick * PERIOD, near, radius=0.05)
    (verdict,) = steps(monitor, tick, 1)
    assert verdict.obstacle == "near"
    assert verdict.contact_time < 0.2
