"""Laws of the steps: no harder than the target, no overshoot, and within the robot's limits."""

import math

import numpy as np
import pytest

from armguard.drivers.franka import JOINTS
from armguard.drivers.franka_steps import (
    ACCELERATION,
    JERK,
    PERIOD,
    Step,
    find_excess,
    step_towards,
)

NAMES = JOINTS[0]
HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785])
REST = Step(HOME, *np.zeros((3, 7)))


def follow(targets):
    """Positions, with those before the first, by which the robot takes differences."""
    q = v = a = None
    path = []
    for target in targets:
        if q is None:
            q, v, a = target, np.zeros(7), np.zeros(7)
            path = [q, q, q]
        step = step_towards(target, q, v, a)
        q, v, a = step.q, step.v, step.a
        path.append(q)
        # What is claimed of the step is what the robot finds.
        assert np.allclose(v, (path[-1] - path[-2]) / PERIOD, atol=1e-9)
        assert np.allclose(a, np.diff(path[-3:], 2, axis=0)[0] / PERIOD**2, atol=1e-6)
        assert np.allclose(step.jerk, np.diff(path[-4:], 3, axis=0)[0] / PERIOD**3, atol=1e-2)
    return np.array(path[3:])


def differences(path, order):
    return np.diff(path, order, axis=0) / PERIOD**order


def test_a_target_that_jumps_is_reached_without_overshoot():
    far = HOME + 0.01
    path = follow([HOME, *([far] * 400)])
    assert (np.diff(path, axis=0) >= -1e-15).all()
    assert (path <= far + 1e-12).all()
    assert np.abs(path[-1] - far).max() < 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_joints_go_no_faster_and_change_no_harder_than_the_target_has(seed):
    random = np.random.default_rng(seed)
    accelerations = np.repeat(random.uniform(-5.0, 5.0, (20, 7)), 50, axis=0)
    speeds = np.cumsum(accelerations * PERIOD, axis=0)
    targets = HOME + np.cumsum(speeds * PERIOD, axis=0)
    targets = np.vstack([HOME, HOME, HOME, targets])
    path = follow(targets)
    for order, slack in ((1, 1e-9), (2, 1e-6)):
        most, least = differences(targets, order).max(0), differences(targets, order).min(0)
        found = differences(path, order)
        assert (found <= most + slack).all()
        assert (found >= least - slack).all()
    assert np.abs(differences(path, 3)).max() < JERK
    lag = np.abs(targets - path).max(0) / np.abs(speeds).max(0)
    assert (lag < 0.03).all(), "which docs/franka.md states"


def test_steps_from_any_reference_come_to_rest():
    random = np.random.default_rng(1)
    for _ in range(50):
        q, v, a = HOME, random.uniform(-1.0, 1.0, 7), random.uniform(-5.0, 5.0, 7)
        for _ in range(600):
            q, v, a, _ = step_towards(HOME, q, v, a)
        assert np.abs(q - HOME).max() < 1e-9


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize(
    ("field", "value", "word"),
    [
        ("q", 4.6, "position"),
        ("q", -3.1, "position"),
        ("v", 5.3, "velocity"),
        ("a", ACCELERATION, "acceleration"),
        ("a", -ACCELERATION, "acceleration"),
        ("jerk", JERK, "jerk"),
        ("q", math.nan, "position"),
        ("v", math.nan, "velocity"),
        ("a", math.nan, "acceleration"),
        ("jerk", -math.inf, "jerk"),
    ],
)
def test_what_exceeds_a_limit_is_named(joint, field, value, word):
    values = getattr(REST, field).copy()
    values[joint] = value
    excess = find_excess(REST._replace(**{field: values}), NAMES)
    assert excess.startswith(f"{NAMES[joint]} would have a {word} of ")


def test_joints_slow_down_before_their_ends_and_may_rest_there():
    assert find_excess(REST, NAMES) == ""
    near = HOME.copy()
    near[0] = 2.74
    assert find_excess(REST._replace(q=near), NAMES) == ""
    v = np.zeros(7)
    v[0] = 1.0
    assert "velocity" in find_excess(REST._replace(q=near, v=v), NAMES)
    assert find_excess(REST._replace(q=near, v=-v), NAMES) == ""
    assert find_excess(REST._replace(v=v), NAMES) == ""
    # As libfranka 0.21 has it: -0.30 + sqrt(12 (2.7501 - q)), at q = 2.5.
    near[0], v[0] = 2.5, -0.30 + math.sqrt(12.0 * 0.2501) - 0.002
    assert find_excess(REST._replace(q=near, v=v), NAMES) == ""
    v[0] += 0.002
    assert "velocity" in find_excess(REST._replace(q=near, v=v), NAMES)
