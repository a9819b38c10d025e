import numpy as np
import pytest

from armguard.bounds import append_stop
from armguard.bounds.planned.check import StopCheck, check_path_stop
from support.example_arms import load_holding
from support.short_plans import HOME, TIMES, check, moved, resting


@pytest.fixture(scope="module")
def robot():
    return load_holding("panda")


def test_a_stop_harder_than_brakes_guarantee_is_told(robot):
    braking = robot.braking_deceleration
    plan = moved(0, 0.1 * TIMES, 0.1)
    for part, is_fine in ((0.5, True), (1.0, True), (1.01, False), (2.0, False)):
        stopped = append_stop(plan, part * braking, on_path=False)
        checked = check(robot, stopped, stops=False)
        refusal = StopCheck(robot, robot.brakes.make_curves()).check(checked)
        assert (refusal is None) is is_fine
        if refusal is not None:
            assert refusal.subject == robot.joints[0]
            assert f"brakes guarantee {braking[0]:.4g}" in refusal.detail
        # However long it rests then.
        later = stopped._replace(
            times=np.append(stopped.times, stopped.times[-1] + [1.0, 2.0]),
            q=np.concatenate([stopped.q, stopped.q[-1:], stopped.q[-1:]]),
            v=np.concatenate([stopped.v, stopped.v[-1:], stopped.v[-1:]]),
        )
        found = StopCheck(robot, robot.brakes.make_curves()).check(check(robot, later, stops=False))
        assert (found is None) is is_fine


def test_a_path_that_bends_more_than_brakes_guarantee_is_told(robot):
    braking = robot.braking_deceleration[0]
    for part in (0.9, 1.1):
        times = np.linspace(0.0, 1.0, 101)
        size = part * braking / 36.0
        q, v = np.tile(HOME, (101, 1)), np.zeros((101, 7))
        q[:, 0] += size * (1.0 - np.cos(6.0 * times))
        v[:, 0] = 6.0 * size * np.sin(6.0 * times)
        plan = resting(times=times, q=q, v=v)
        stopped = append_stop(plan, 0.5 * robot.braking_deceleration, on_path=False)
        refusal = check_path_stop(check(robot, stopped), robot, robot.brakes.make_curves())
        assert (refusal is None) is (part < 1.0)
        if refusal is not None:
            assert refusal.subject == robot.joints[0]
            assert "no stop on the path" in refusal.detail


@pytest.mark.parametrize("on_path", [False, True])
def test_an_appended_stop_goes_on_smoothly_and_no_harder_than_brakes(robot, on_path):
    random, braking = np.random.default_rng(0), robot.braking_deceleration
    for _ in range(50):
        pace = random.uniform(-0.5, 0.5, 7) * (random.random(7) < 0.8)
        q = HOME + np.outer(TIMES, pace)
        plan = resting(q=q, v=np.tile(pace, (21, 1)))
        stopped = append_stop(plan, braking, on_path=on_path)
        times, q, v = stopped.times, stopped.q, stopped.v
        assert (v[-1] == 0.0).all()
        # Quadratic between samples: displacements are those of the mean velocity.
        steps = np.diff(times)[:, None]
        np.testing.assert_allclose(np.diff(q, axis=0), 0.5 * steps * (v[1:] + v[:-1]), atol=1e-12)
        rates = np.abs(np.diff(v, axis=0) / steps)
        assert (rates <= braking * (1.0 + 1e-9) + 1e-9).all()
        longest = (np.abs(pace) / braking).max()
        assert times[-1] - TIMES[-1] == pytest.approx(longest, abs=2e-6)
        if on_path and pace.any():
            off = q[-1] - plan.q[-1]
            np.testing.assert_allclose(off, 0.5 * (times[-1] - TIMES[-1]) * pace, atol=1e-12)
        assert (
            StopCheck(robot, robot.brakes.make_curves()).check(check(robot, stopped, stops=False))
            is None
        )
