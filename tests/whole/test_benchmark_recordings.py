"""The benchmark beside recorded people runs, and no rule misses a contact."""

import importlib
import math

import numpy as np
import pytest

from armguard.robot import Robot
from armguard.simulation import random_trajectory


@pytest.fixture
def load():
    return importlib.import_module


@pytest.fixture
def trajectory():
    return random_trajectory(Robot.load("panda"), 0, 20.0, speed_fraction=0.3)


def find_recordings(benchmark):
    try:
        return benchmark.find_recordings()
    except SystemExit as missing:
        pytest.skip(str(missing))


def test_a_short_run(load, capsys):
    benchmark = load("bench_recordings")
    find_recordings(benchmark)
    short = {
        "speeds": 0.8,
        "seconds": 0.5,
        "placements": 2,
        "seeds": 1,
        "recordings": 1,
        "pieces": 0,
    }
    arguments = [word for name, value in short.items() for word in (f"--{name}", str(value))]
    rules, going, obeying = benchmark.main(arguments)[0.8]
    printed = capsys.readouterr().out
    assert len(rules) == 7
    for rule, *outcomes in zip(rules, going, obeying, strict=True):
        assert rule.name in printed
        for outcome in outcomes:
            assert outcome.ticks == 200
            assert 0 <= outcome.clear <= outcome.stopped <= outcome.ticks
        assert outcomes[1].missed == 0


def test_a_rule_that_lets_everything_pass_is_found_out(load, trajectory):
    benchmark, rules = load("bench_recordings"), load("scene.stop_rules")
    scene = rules.Scene(trajectory.robot, rules.Timing(0.01, 0.002, 0.02))

    class Blind(rules.Rule):
        def judge(self, scene):
            return True

    # Where people were most of the time.
    placement = benchmark.place_base(0.2, -0.6, -90.0)
    missed = 0
    for path in find_recordings(benchmark)[:2]:
        outcome, rule = benchmark.Outcome(), Blind(scene)
        case = benchmark.Case(benchmark.Recording(path, placement=placement), 0)
        benchmark.play(case, [rule], [outcome], scene, trajectory, 2.0, True)
        assert outcome.ticks == 200
        assert outcome.stopped == 0
        missed += outcome.missed
    assert missed > 0


def test_it_says_what_is_missing(load, monkeypatch, tmp_path):
    monkeypatch.setenv("ARMGUARD_RECORDINGS", str(tmp_path))
    with pytest.raises(SystemExit, match="ARMGUARD_RECORDINGS"):
        load("bench_recordings").main([])


def test_the_arm_keeps_its_promises(load, trajectory):
    robot, random = trajectory.robot, np.random.default_rng(0)
    arm = load("scene.working_arm").WorkingArm(trajectory)
    dt, go, stopped_for = 1e-3, True, 0.0
    longest = np.max(robot.velocity_limit / robot.braking_deceleration)
    rested = False
    for _ in range(6000):
        if random.random() < 0.005:
            go = not go
        before_q, before_v = arm.q, arm.v
        arm.step(dt, go)
        rate = (arm.v - before_v) / dt
        assert (np.abs(rate) <= robot.acceleration_limit * (1.0 + 1e-6)).all()
        assert (np.abs(arm.v) <= robot.velocity_limit).all()
        np.testing.assert_allclose(arm.q - before_q, 0.5 * dt * (arm.v + before_v), atol=1e-4)
        stopped_for = 0.0 if go else stopped_for + dt
        rested = rested or (arm.braking and arm.rests)
        if stopped_for > longest:
            assert arm.rests
    assert rested
    assert 0.0 < arm.progress < 6.0


def test_the_arm_does_what_it_plans(load, trajectory):
    arm = load("scene.working_arm").WorkingArm(trajectory)
    times = np.linspace(0.0, 0.2, 21)
    for go in (True, True, True, False, False, False, True, True):
        if go:
            expected, _ = arm.preview(times)
            for k in range(40):
                if k % 2 == 0:
                    np.testing.assert_allclose(arm.q, expected[k // 2], atol=1e-9)
                arm.step(0.005, True)
        else:
            arm.step(0.3, False)


def test_verdicts_take_effect_when_they_must(load):
    benchmark = load("bench_recordings")
    steps = []

    class Arm:
        def step(self, dt, go):
            steps.append((dt, go))

    brakes = benchmark.Brakes(Arm(), 0.022)
    brakes.tell(0.0, False)
    for tick in range(10):
        brakes.tell(0.005 * tick, tick >= 3)
        brakes.run(0.005 * tick, 0.005)
    ends = np.cumsum([dt for dt, _ in steps])
    assert ends[-1] == pytest.approx(0.05)
    goes = [end for end, (_, go) in zip(ends, steps, strict=True) if go]
    assert max(goes) == pytest.approx(0.015 + 0.022)
    assert min(goes) > 0.002


def test_a_stop_is_held(load):
    benchmark = load("bench_recordings")
    holder = benchmark.Holder()
    assert not holder.update(0.0, True)
    assert holder.update(0.1, False)
    assert holder.update(0.1 + 0.9 * benchmark.RISE_DELAY, True)
    assert not holder.update(0.1 + 1.1 * benchmark.RISE_DELAY, True)


def test_the_recordings_origin_is_where_the_base_sees_it(load):
    placement = load("bench_recordings").place_base(1.0, 2.0, 90.0)
    np.testing.assert_allclose(placement @ [1.0, 2.0, 0.5, 1.0], [0.0, 0.0, 0.5, 1.0], atol=1e-12)
    # What lies ahead of a base that faces along y is along its x.
    np.testing.assert_allclose(placement @ [1.0, 3.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0], atol=1e-12)
    assert math.isclose(np.linalg.det(placement), 1.0)
