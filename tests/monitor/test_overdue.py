"""Pairs that nobody has looked at in time stop the arm."""

import numpy as np
import pytest

from armguard.verdict import Level, ReasonKind
from support.panda_monitor import PERIOD, kinds, make_monitor, see, steps


class ForgetfulSchedule:
    """Never names the pairs that it was given."""

    def __init__(self):
        self.pairs = np.zeros(0, dtype=np.int64)

    def insert(self, pairs):
        self.pairs = np.union1d(self.pairs, pairs)

    def remove(self, pairs):
        self.pairs = np.setdiff1d(self.pairs, pairs)

    def touch(self, pairs):
        pass

    def settle(self, contact_times, stop_time):
        pass

    def due(self):
        return np.zeros(0, dtype=np.int64)

    flagged = due

    def ranking(self):
        return self.pairs


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
def test_a_schedule_that_names_no_pair_leaves_none_without_a_look(motion):
    """What its certificates require is done, whatever a schedule says."""
    obstacles, monitor = make_monitor(ForgetfulSchedule(), motion=motion)
    by_all, reference = make_monitor("full", motion=motion)
    evaluated = 0
    for i in range(1500):
        for table in (obstacles, by_all):
            see(table, i * PERIOD, [3.0 - 1e-3 * i, 0.0, 0.5], velocity=[[-1.0, 0.0, 0.0]])
        (verdict,), (fresh,) = steps(monitor, i, 1), steps(reference, i, 1)
        assert verdict.complete
        assert 0.0 < verdict.contact_time <= fresh.contact_time + 1e-9
        evaluated += verdict.evaluated
    assert verdict.level is not Level.CLEAR
    assert evaluated > 0


BUDGET = 100


def ring(count, distance):
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return distance * np.column_stack([np.cos(turn), np.sin(turn), np.full(count, 0.2)])


@pytest.mark.hazard("H-09")
def test_a_budget_that_does_not_suffice_is_told():
    """Not all of them can be looked at in time: the arm stops, until all of them were, closely or
    by the stop decision."""
    names = [f"b{k}" for k in range(60)]
    told = {}
    for budget in (None, BUDGET):
        obstacles, monitor = make_monitor(budget=budget, rise_delay=0.0)
        see(obstacles, 0.0, ring(60, 2.0), names)
        told[budget] = []
        for k in range(100):
            told[budget] += steps(monitor, k, 1)
            # Nothing further is begun: what was begun may take it a little beyond.
            assert budget is None or monitor._last[1].evaluated < BUDGET + 300
    assert all(verdict.complete for verdict in told[None])
    assert told[None][0].level > Level.STOP
    assert told[None][0].evaluated > 2 * BUDGET
    first = told[BUDGET][0]
    assert (first.level, first.complete, first.contact_time) == (Level.STOP, False, 0.0)
    assert ReasonKind.OVERDUE in kinds(first)
    for verdict in told[BUDGET]:
        assert verdict.complete == (ReasonKind.OVERDUE not in kinds(verdict))
        assert verdict.complete or verdict.level is Level.STOP
        # Each question of the stop decision may spend the budget again.
        assert verdict.evaluated < 9 * (BUDGET + 300)
    assert any(verdict.complete for verdict in told[BUDGET])
