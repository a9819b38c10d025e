import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from support.panda_monitor import HOME, PERIOD, SCHEDULES, STILL, make_monitor, panda, see, steps

NAMES = [f"ball {number}" for number in range(12)]


def ask_everything(monitor):
    return (
        monitor.explain(),
        monitor.attention(),
        monitor.headroom(),
        monitor.pairs(5),
        monitor.snapshot(pair_limit=5, row_limit=5),
    )


def test_before_the_first_tick_there_is_nothing_to_tell():
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, [1.0, 0.0, 0.5])
    why, first, headroom, pairs, snapshot = ask_everything(monitor)
    assert (why, first, pairs) == (None, [], [])
    assert headroom.obstacles == 0
    assert snapshot is not None


def test_what_is_no_limit_is_refused_before_and_after_the_first_tick():
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, [1.0, 0.0, 0.5])
    for tick in range(2):
        for wrong in (None, "x", 1.5, True):
            for ask in (monitor.pairs, monitor.attention):
                with pytest.raises(ArmguardError, match=r"limit: is .*expected an integer"):
                    ask(wrong)
            for name in ("pair_limit", "row_limit"):
                with pytest.raises(ArmguardError, match=f"{name}: is "):
                    monitor.snapshot(**{"pair_limit": 5, "row_limit": 5} | {name: wrong})
        monitor.step(tick * PERIOD, HOME, STILL)
    assert len(monitor.pairs(10**30)) == len(panda().links)
    assert len(monitor.attention(10**30)) == 1
    assert monitor.pairs(-1) == monitor.attention(-1) == []


def test_all_of_them_tell_of_the_same_tick():
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, [[1.2, 0.0, 0.5], [2.0, 0.5, 0.5]], ("near", "far"))
    for tick in range(20):
        verdict = monitor.step(tick * PERIOD, HOME, STILL)
        why, first, headroom, pairs, _ = ask_everything(monitor)
        assert why.contact_time == verdict.contact_time
        assert pairs[0].contact_time == pytest.approx(verdict.contact_time)
        assert first[0].contact_time == pytest.approx(verdict.contact_time)
        assert why.obstacle == pairs[0].obstacle == first[0].obstacle == verdict.obstacle == "near"
        assert why.link == pairs[0].link == verdict.link
        assert headroom.obstacles == 2


@pytest.mark.parametrize("schedule", SCHEDULES[:4])
def test_whatever_comes_and_goes_between_ticks_they_answer_and_change_nothing(schedule):
    random = np.random.default_rng(0)
    tables = [make_monitor(schedule) for _ in range(2)]
    present = set()
    for tick in range(150 if schedule == "deadline" else 60):
        verdicts = []
        name, place = str(random.choice(NAMES)), random.uniform([0.8, -1.5, 0.1], [3.0, 1.5, 1.0])
        leaves, now = random.random() < 0.4, tick * PERIOD
        present = present - {name} if leaves else present | {name}
        for asks, (obstacles, monitor) in enumerate(tables):
            verdicts.append(monitor.step(now, HOME, STILL))
            if leaves:
                obstacles.remove([name])
            else:
                see(obstacles, now, place, (name,))
            if asks:
                # Of the last tick, in which there was somebody who may have left since.
                why, first, _, pairs, _ = ask_everything(monitor)
                assert why is None or (why.link in panda().links and why.obstacle in NAMES)
                assert {one.obstacle for one in first} <= set(NAMES)
                assert {pair.obstacle for pair in pairs} <= set(NAMES)
        assert verdicts[0] == verdicts[1]


def test_after_a_reset_and_while_stopped_they_answer_still():
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, [1.2, 0.0, 0.5])
    monitor.step(0.0, HOME, STILL)
    monitor.step(PERIOD, np.full(7, np.nan), STILL)
    ask_everything(monitor)
    monitor.reset()
    why, first, _, pairs, _ = ask_everything(monitor)
    assert (why, first, pairs) == (None, [], [])
    monitor.step(2.0 * PERIOD, HOME, STILL)
    assert monitor.explain().obstacle == "ball"


@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_observers_see_the_state_that_was_believed(schedule):
    """A refused state is nowhere to be seen, however well formed it is."""
    obstacles, monitor = make_monitor(schedule)
    see(obstacles, 0.0, [1.2, 0.0, 0.5])
    steps(monitor, 0, 3)
    before = monitor.pairs(), monitor.snapshot(pair_limit=5, row_limit=5)
    for q, v in ((HOME + 0.3, STILL), (HOME, STILL + 1.5), (HOME + 9.0, STILL)):
        monitor.step(0.003, q, v)
        assert (monitor._last[0].q == HOME).all()
        after = monitor.pairs(), monitor.snapshot(pair_limit=5, row_limit=5)
        for one, other in zip(before[0], after[0], strict=True):
            np.testing.assert_array_equal(one.point_on_link, other.point_on_link)
        assert (after[1].q == before[1].q).all()
