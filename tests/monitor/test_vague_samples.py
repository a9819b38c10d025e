"""A body that was hidden comes back with a larger error: what was proved of it before stands."""

import numpy as np
import pytest

from armguard.bounds import Plan
from armguard.verdict import Level
from support.panda_monitor import HOME, make_monitor, see

TIMES = np.linspace(0.0, 0.6, 61)
HIDDEN, BACK = 29, 30
"""The sample that is missing, and the first one after it, whose error is larger."""


def make_plan():
    """From rest to rest, by the first joint alone."""
    angle = np.pi * TIMES / TIMES[-1]
    q, v = np.tile(HOME, (len(TIMES), 1)), np.zeros((len(TIMES), 7))
    q[:, 0] += 0.1 * (1.0 - np.cos(angle))
    v[:, 0] = 0.1 * np.pi / TIMES[-1] * np.sin(angle)
    return Plan(0.0, TIMES, q, v, np.full(7, 2e-3), np.full(7, 0.02))


def see_person(obstacles, k, distance):
    """A person who stands still, unless hidden; known less exactly at first when seen again."""
    if k != HIDDEN:
        error = 1.5 if k == BACK else 0.05
        place, still = [distance, 0.0, 0.6], [[0.0, 0.0, 0.0]]
        see(
            obstacles, float(TIMES[k]), place, velocity=still, position_error=0.01,
            velocity_error=error,
        )  # fmt: skip


@pytest.mark.parametrize("distance", [0.80, 0.86])
def test_an_arm_on_pieces_goes_on_past_a_sample_with_a_larger_error(distance):
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    plan = make_plan()
    for k in range(len(TIMES) - 2):
        see_person(obstacles, k, distance)
        verdict = monitor.step(float(TIMES[k]), plan.q[k], plan.v[k])
        # Before the first piece nothing is known of the arm's way.
        assert k == 0 or verdict.level > Level.STOP
        piece = plan._replace(
            stamp=float(TIMES[k]),
            times=TIMES[k : k + 3] - TIMES[k],
            q=plan.q[k : k + 3],
            v=plan.v[k : k + 3],
        )
        assert monitor.commit(monitor.with_stop(piece)).safe


@pytest.mark.parametrize("schedule", ["deadline", "full", ("powers", "partial")])
def test_a_sample_with_a_larger_error_stops_no_arm_that_the_ones_before_let_go(schedule):
    obstacles, monitor = make_monitor(schedule, rate=100.0)
    plan = make_plan()
    for k in range(len(TIMES)):
        see_person(obstacles, k, 1.1)
        assert monitor.step(float(TIMES[k]), plan.q[k], plan.v[k]).level > Level.STOP
