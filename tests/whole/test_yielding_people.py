"""Recorded people who yield, and the arm that presses them, both simulated."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra `mujoco` simulates arm and people")


def find_recordings(benchmark):
    try:
        return {path.stem: path for path in benchmark.find_recordings()}
    except SystemExit as missing:
        pytest.skip(str(missing))


def let_press(load, *, seconds):
    """An arm that obeys nobody, through a recorded person who yields; what it presses."""
    bench = load("bench_recordings")
    path = find_recordings(bench)["handover-0"]
    runs, yielding = load("scene.short_runs"), load("scene.yielding_people")
    workplace = bench.Workplace(runs.make_run(bench.Scope((), (), ()), seconds), 0.8)
    case = bench.Case(0.8, path, 0, 0)
    people = runs.place_people(case, yielding.YieldingPeople, workplace.robot)
    trajectory = bench.make_trajectory(workplace.robot, workplace.fraction, path, 0, seconds)
    arm = load("scene.working_arm").WorkingArm(trajectory)
    leaves = load("scene.clearance").Leaves(workplace.robot)
    log = yielding.PressLog(people, np.full(len(people.mass), 0.5))
    unbroken = np.zeros(len(people.mass), dtype=bool)
    for tick in range(round(1e3 * seconds)):
        arm.step(1e-3, True)
        since = 1e-3 * (tick + 1)
        people.advance(since, 1e-3, arm)
        leaves.place(*arm.measured)
        log.follow(since, 1e-3, leaves, people.ends_at(since), unbroken)
        if not log.touches:
            # Nothing touches them, so both are where they want to be.
            assert np.abs(arm.deviation[0]).max() < 1e-3
            assert np.abs(people.offset).max() < 1e-9
    return people, log.touches


def test_a_skin_stores_no_more_than_what_its_body_and_the_arm_bring(load):
    """A surface that moves at v runs into a mass that moves at w: at most m (v + w)² / 2."""
    people, touches = let_press(load, seconds=4.0)
    names = load("scene.recorded_people").NAMES
    assert len(touches) >= 3
    for touch in touches:
        body = names.index(touch.body)
        # A link may have faster points than the one that touches first, and none is faster.
        most = 0.5 * people.mass[body] * (0.8 + touch.body_speed) ** 2
        assert 0.0 < touch.energy <= most
        stored = 0.5 * people.stiffness[body] * touch.depth**2
        assert touch.energy == pytest.approx(stored)
        assert touch.way > touch.depth
        assert touch.is_beyond == (touch.energy > touch.energy_limit)


def test_people_who_yield_begin_each_case_anew(load):
    people, _ = let_press(load, seconds=3.5)
    assert np.abs(people.offset).max() > 1e-3
    people.reset()
    np.testing.assert_array_equal(people.offset, 0.0)
    np.testing.assert_array_equal(people.drift, 0.0)


def test_the_benchmark_of_yielding_people_runs(load, capsys):
    find_recordings(load("bench_recordings"))
    arguments = "--speeds 0.8 --reactions 0.02 --seconds 0.3 --recordings 2"
    scores = load("bench_yielding").main(arguments.split())
    assert {score.rule for score in scores} == set(load("scene.limited").RULES)
    for score in scores:
        assert 0 <= score.outcome.stopped <= score.outcome.ticks <= 30
        assert score.outcome.progress <= score.free
    assert "work lost" in capsys.readouterr().out
