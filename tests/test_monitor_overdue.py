"""Pairs that nobody has looked at in time stop the arm."""

import numpy as np
import pytest
from scenes import PERIOD, keep, kinds, make_monitor, panda, see, steps

from armguard.verdict import Level, ReasonKind


class ForgetfulSchedule:
    """Never names the pairs that it was given."""

    measure, every_tick = "contact_time", False

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


def test_pairs_without_a_look_are_overdue():
    obstacles, monitor = make_monitor(ForgetfulSchedule())
    for verdict in keep(obstacles, monitor, 0, 3):
        assert (verdict.level, verdict.complete) == (Level.STOP, False)
        assert verdict.contact_time == 0.0
        assert ReasonKind.OVERDUE in kinds(verdict)


def test_a_certificate_that_ran_out_is_overdue():
    obstacles, monitor = make_monitor(ForgetfulSchedule())
    evaluate_once = np.arange(len(panda().links))
    monitor._watch.schedule.due = lambda: evaluate_once
    see(obstacles, 0.0, [8.0, 0.0, 0.5])
    (first,) = steps(monitor, 0, 1)
    assert (first.level, first.complete) == (Level.CLEAR, True)
    del monitor._watch.schedule.due
    for i in range(1, 2000):
        obstacles.update([], i * PERIOD)
        (verdict,) = steps(monitor, i, 1)
        left = first.contact_time - i * PERIOD
        assert verdict.contact_time <= max(left, 0.0) + 1e-12
        assert verdict.complete == (verdict.contact_time > 0.0)
        if not verdict.complete:
            break
    assert ReasonKind.OVERDUE in kinds(verdict)
    assert i * PERIOD == pytest.approx(first.contact_time, abs=2.0 * PERIOD)
