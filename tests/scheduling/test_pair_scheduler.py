import gc
import math
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest

from armguard.pairs.evaluate import TickState, evaluate
from armguard.verdict import Level
from support.panda_monitor import (
    PERIOD,
    SCHEDULES,
    make_monitor,
    panda,
    see,
    steps,
)
from support.tick_states import begin_tick


def all_times(monitor, obstacles, now, arm_age=0.0):
    """Contact time of every pair, by a look of our own at the monitor's tick."""
    arm = monitor._scheduler.arm
    state = TickState(arm.kinematics, arm.motion, obstacles, margin=0.0)
    begin_tick(state, now, arm_age, monitor._last[0].refinement_threshold)
    links = len(panda().links)
    rows = np.flatnonzero(obstacles.table.alive)
    pairs = (rows[:, None] * links + np.arange(links)).ravel()
    times = np.zeros(len(pairs))
    nodes, bounds = np.zeros(len(pairs), dtype=np.int64), np.zeros(len(pairs), dtype=np.int8)
    evaluate(state, pairs, times, nodes, bounds)
    return dict(zip(pairs.tolist(), times.tolist(), strict=True))


def test_full_sees_every_pair_while_ids_come_and_go():
    rng = np.random.default_rng(0)
    obstacles, monitor = make_monitor("full", ignore=[("panda_link1", "b*"), ("*", "c?")])
    links = panda().links
    for i in range(60):
        names = [f"{kind}{n}" for kind in "abc" for n in range(9) if rng.random() < 0.5]
        far = rng.normal(size=(len(names), 3))
        far *= rng.uniform(1.5, 6.0, (len(names), 1)) / np.linalg.norm(far, axis=1, keepdims=True)
        # A jump is refused and watched on both tracks; a removal starts anew.
        obstacles.update(names, i * PERIOD, far, radius=0.1, snapshot=bool(rng.random() < 0.8))
        (verdict,) = steps(monitor, i, 1)
        watched = {
            pair: time
            for pair, time in all_times(monitor, obstacles, i * PERIOD).items()
            if not obstacles.ids[pair // len(links)].startswith("c")
            and not (
                links[pair % len(links)] == "panda_link1"
                and obstacles.ids[pair // len(links)][0] == "b"
            )
        }
        assert verdict.contact_time == pytest.approx(min(watched.values(), default=math.inf))
        assert verdict.complete
        if watched:
            pair = obstacles.row(verdict.obstacle) * len(links) + links.index(verdict.link)
            # Of what is far off, no link is evaluated by itself; and of links that are nearly as
            # soon as the soonest one, any may be named, since none is refined beyond that.
            is_far = verdict.contact_time >= monitor._last[0].refinement_threshold
            assert is_far or watched[pair] <= 1.1 * verdict.contact_time
        reported = {(one.link, one.obstacle) for one in monitor.pairs(10**6)}
        assert len(reported) == len(watched)


class Chosen:
    """Names and flags what it is told to, and remembers what it was told."""

    def __init__(self):
        self.names = self.flags = np.zeros(0, dtype=np.int64)
        self.members, self.touched, self.settled = set(), [], []

    def insert(self, pairs):
        assert not self.members & set(pairs.tolist())
        self.members |= set(pairs.tolist())

    def remove(self, pairs):
        assert self.members >= set(pairs.tolist())
        self.members -= set(pairs.tolist())

    def touch(self, pairs):
        self.touched = pairs.tolist()

    def due(self):
        return self.names

    def settle(self, contact_times, stop_time):
        self.settled = contact_times.tolist()

    def flagged(self):
        return self.flags

    def ranking(self):
        return np.array(sorted(self.members), dtype=np.int64)


@pytest.mark.parametrize("pair", [-5, 5000, 10**7])
@pytest.mark.parametrize("where", ["names", "flags"])
def test_a_pair_that_does_not_exist_is_a_stop_that_names_it(where, pair):
    chosen = Chosen()
    obstacles, monitor = make_monitor(chosen)
    see(obstacles, 0.0, [2.0, 0.0, 0.5])
    assert steps(monitor, 0, 1)[0].level is not Level.STOP
    setattr(chosen, where, np.array([pair]))
    (verdict,) = steps(monitor, 1, 1)
    assert verdict.level is Level.STOP
    assert any(f"names pairs [{pair}]" in str(reason) for reason in verdict.reasons)


def test_what_a_schedule_names_and_flags_is_evaluated_in_that_tick():
    schedule = Chosen()
    obstacles, monitor = make_monitor(schedule)
    places = {"touches": 0.9, "near": 1.9, "middle": 2.5, "far": 9.0, "farther": 12.0}
    still = {"velocity": np.zeros((5, 3)), "speed": 0.2, "accel": 0.5}
    see(obstacles, 0.0, [[x, 0.0, 0.5] for x in places.values()], list(places), **still)
    steps(monitor, 0, 1)
    links = len(panda().links)
    pairs = {name: obstacles.row(name) * links + 2 for name in places}
    assert schedule.members == set(range(5 * links))

    def evaluated(tick):
        steps(monitor, tick, 1)
        at = monitor._scheduler.certificates.evaluated_at
        return {name for name in places if at[obstacles.row(name)] == tick * PERIOD}

    assert evaluated(1) <= {"touches"}
    schedule.names = np.array([pairs["far"], pairs["middle"]])
    assert evaluated(2) >= {"far", "middle"}
    expiry = monitor._scheduler.certificates.pair_expiry.reshape(-1)[schedule.names]
    assert schedule.settled == pytest.approx(expiry - 2 * PERIOD, abs=1e-12)
    # Of what is flagged, what could be touched before the arm rests, or else the most imminent.
    schedule.names = schedule.names[:0]
    schedule.flags = np.array([pairs[name] for name in ("near", "farther", "far")])
    for tick in (3, 4):
        assert evaluated(tick) - {"touches"} == {"near"}
    schedule.flags = np.array([pairs[name] for name in ("touches", "farther")])
    assert evaluated(5) == {"touches"}
    # News make all pairs of their obstacle due out of turn.
    see(obstacles, 5.5 * PERIOD, [9.0, 0.0, 0.5], ["far"], accel=7.0)
    assert "far" in evaluated(6)
    assert schedule.touched == list(range(pairs["far"] - 2, pairs["far"] - 2 + links))
    monitor._scheduler.invalidate_all()
    assert evaluated(7) == set(places)
    assert set(schedule.touched) == schedule.members
    obstacles.remove(["far"])
    steps(monitor, 8, 1)
    assert not schedule.members & set(range(pairs["far"] - 2, pairs["far"] - 2 + links))


def test_full_evaluates_all_even_where_a_stop_is_certain():
    obstacles, monitor = make_monitor("full")
    see(obstacles, 0.0, np.tile([0.3, 0.0, 0.6], (300, 1)), [f"b{k}" for k in range(300)])
    for tick in range(2):
        assert steps(monitor, tick, 1)[0].level is Level.STOP
        at = monitor._scheduler.certificates.evaluated_at
        assert (at[obstacles.table.alive] == tick * PERIOD).all()


@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_a_new_obstacle_counts_in_its_first_tick(schedule):
    obstacles, monitor = make_monitor(schedule)
    far = [[30.0 + i, 0.0, 0.5] for i in range(40)]
    for i in range(20):
        see(obstacles, i * PERIOD, far, [f"far{k}" for k in range(40)])
        steps(monitor, i, 1)
    see(obstacles, 20 * PERIOD, [0.6, 0.0, 0.5], ["near"])
    (verdict,) = steps(monitor, 20, 1)
    assert (verdict.level, verdict.obstacle) == (Level.STOP, "near")
    assert verdict.complete
    obstacles.remove(["near"])
    (verdict,) = steps(monitor, 21, 1)
    assert verdict.contact_time > 1.0


@pytest.mark.parametrize("schedule", ["deadline", "full", "daa"])
def test_reports_of_pairs(schedule):
    obstacles, monitor = make_monitor(schedule)
    assert monitor.pairs() == []
    see(obstacles, 0.0, [[0.9, 0.0, 0.5], [9.0, 0.0, 0.5]], ["near", "far"])
    (verdict,) = steps(monitor, 0, 1)
    reports = monitor.pairs()
    assert len(reports) == 2 * len(panda().links)
    assert [one.contact_time for one in reports] == sorted(one.contact_time for one in reports)
    first = reports[0]
    assert (first.link, first.obstacle) == (verdict.link, verdict.obstacle)
    assert first.contact_time == verdict.contact_time
    assert first.age == 0.0
    bounds = {
        name: {one.bound for one in reports if one.obstacle == name} for name in ("near", "far")
    }
    assert bounds["near"] <= {"reach", "isotropic", "joint"}
    assert first.bound == "joint"
    assert bounds["far"] == {"reach"}
    assert np.linalg.norm(first.point_on_obstacle - [0.9, 0.0, 0.5]) == pytest.approx(0.1, abs=1e-4)
    assert len(monitor.pairs(3)) == 3
    obstacles.remove(["near"])
    assert {one.obstacle for one in monitor.pairs()} == {"far"}
    see(obstacles, 0.001, [math.nan, 0.0, 0.0], ["lost"])
    steps(monitor, 1, 1)
    lost = monitor.pairs()[0]
    assert (lost.obstacle, lost.contact_time, lost.bucket) == ("lost", 0.0, 0)
    assert lost.bound == "unknown"
    assert np.isnan(lost.point_on_link).all()


@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_reports_leave_out_rows_that_changed_since(schedule):
    obstacles, monitor = make_monitor(schedule)
    see(obstacles, 0.0, [[1.5, 0.0, 0.5], [9.0, 0.0, 0.5]], ["near", "far"])
    steps(monitor, 0, 1)
    row = obstacles.row("near")
    obstacles.remove(["near"])
    # The table grows, and somebody else takes the row.
    crowd = [f"crowd{k}" for k in range(100)]
    see(obstacles, 0.001, np.full((100, 3), 50.0), crowd)
    assert obstacles.ids[row].startswith("crowd")
    assert {one.obstacle for one in monitor.pairs()} == {"far"}
    obstacles.remove(["far", *crowd])
    assert monitor.pairs() == []


@pytest.mark.parametrize("schedule", ["deadline", "daa"])
def test_memory_does_not_grow_while_ids_come_and_go(schedule):
    obstacles, monitor = make_monitor(schedule)

    def churn(start, count):
        for i in range(start, start + count):
            names = [f"{i}-{k}" for k in range(8)]
            far = np.full((8, 3), 5.0)
            obstacles.update(names, i * PERIOD, far, radius=0.1, snapshot=True)
            steps(monitor, i, 1)
        monitor.pairs(4)
        gc.collect()

    churn(0, 550)  # Past the number of removals that are remembered.
    tracemalloc.start()
    churn(550, 550)  # By now all that is remembered was allocated under the tracer's eyes.
    held = []
    for start in range(1100, 2000, 150):
        held.append(tracemalloc.get_traced_memory()[0])
        churn(start, 150)
    held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    # What was allocated before the tracer looked is replaced bit by bit; a leak grows for ever.
    assert min(np.diff(held)) < 5_000


COMPILED_IN_A_TICK = """
import sys
import numpy as np
from numba.core import event
from numba.core.dispatcher import Dispatcher
from support.panda_monitor import HOME, SCHEDULES, STILL, make_monitor, see

def kernels():
    return {
        (name, key): len(value.overloads)
        for name, module in list(sys.modules.items()) if name.startswith("armguard")
        for key, value in vars(module).items() if isinstance(value, Dispatcher)
    }

for schedule, settings in [*((each, {}) for each in SCHEDULES), ("deadline", {"certify": True})]:
    obstacles, monitor = make_monitor(schedule, **settings)
    before = kernels()
    with event.install_recorder("numba:compile") as recorder:
        for i in range(40):
            t = i * 1e-3
            see(obstacles, t, [[1.2, 0, 0.5], [9, 0, 0.5]], ["near", "far"])
            obstacles.update(["box"], t, np.full((1, 8, 3), 4.0), radius=0.1)
            obstacles.update([f"brief{i}"], t, [[8.0, i, 0.0]], radius=0.1)
            if i == 0:
                obstacles.add_static("table", [2.0, 0.0, 0.0], 0.1)
            if i > 2:
                obstacles.remove([f"brief{i - 1}"])
            if i == 10:
                see(obstacles, t, [9.0, 3.0, 0.5], ["far"])
            if i == 12:
                see(obstacles, t, [float("nan"), 3.0, 0.5], ["far"])
            if i == 20:
                see(obstacles, t, [9.0, 0.0, 0.5], ["far"], accel=12.0)
            if i == 24:
                see(obstacles, t + 1.0, [9.0, 0.0, 0.5], ["far"])
            if i == 30:
                monitor.step(t, HOME * 9.0, STILL)
                monitor.reset()
            if i == 32:
                names = [f"many{k}" for k in range(99)]
                see(obstacles, t, np.full((99, 3), 7.0), names)
            verdict = monitor.step(t, HOME, STILL, t + 1e-4)
            monitor.pairs()
            if i == 15:
                # A question between ticks loads what answers it when it is first asked.
                unasked, compiled = kernels(), len(recorder.buffer)
                monitor.explain()
                monitor.attention()
                monitor.headroom()
                monitor.snapshot(pair_limit=3, row_limit=3)
                del recorder.buffer[compiled:]
                for name, count in kernels().items():
                    before[name] = before.get(name, 0) + count - unasked.get(name, 0)
            assert not any("inside" in str(reason) for reason in verdict.reasons), verdict
    changed = {name for name, count in kernels().items() if before.get(name) != count}
    assert not recorder.buffer and not changed, (schedule, changed, recorder.buffer)
"""


def test_nothing_is_compiled_in_a_tick(request):
    done = subprocess.run(
        [sys.executable, "-c", COMPILED_IN_A_TICK],
        cwd=request.path.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
