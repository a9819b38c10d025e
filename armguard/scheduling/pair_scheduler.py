"""A scheduler with a schedule of pairs, which chooses further evaluations.

A schedule of pairs is a policy over the same certificates. It makes obstacles due before their
deadlines: those of the pairs that it names, and of the pairs that it flags, those that could be
touched before the arm rests and the most imminent one. An obstacle is evaluated with all its
watched links, for one state of it is what all of its certificates rest on. One whose certificate
ends is due in any case, so that no schedule can leave a pair without a look. This is what the
schedules of the paper run on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armguard.bounds.operating_history import OperatingHistory
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.arm import WatchedArm
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import AdvanceResult, Scheduler, Tick, TickResult
from armguard.scheduling.timing_wheel import make_due
from armguard.scheduling.tournament import entries_of
from armguard.settings.schedule import Schedule
from armguard.settings.settings import MOST_EVALUATIONS, Settings


class PairScheduler(Scheduler):
    """Evaluates what a schedule demands, and what must not wait any longer.

    Args:
        schedule: Says which pairs to evaluate.
        robot: As for `Scheduler`, like all that follow.
        obstacles: The table.
        make_arm: Lays out an arm as it is.
        states: Where joint positions and velocities of each tick stand.
        settings: When verdicts are obeyed.
        operating: What tests joint states against operating limits; None: there are none.
    """

    def __init__(
        self,
        schedule: Schedule,
        robot: Robot,
        obstacles: Obstacles,
        make_arm: Callable[[Robot], WatchedArm],
        states: JointStates,
        settings: Settings,
        operating: OperatingHistory | None = None,
    ) -> None:
        self.schedule = schedule
        self._evaluated = 0
        super().__init__(robot, obstacles, make_arm, states, settings, operating)

    def restart(self) -> None:
        """Start again with all obstacles that are there, whatever happened before."""
        self.schedule.remove(self.schedule.ranking())
        super().restart()

    def advance(
        self,
        stamp: float,
        q: FloatArray,
        v: FloatArray,
        now: float,
        epoch: float,
        number: int,
        may_evaluate: bool,
    ) -> AdvanceResult:
        """Accept a joint state; evaluations come later, when the schedule was asked."""
        return super().advance(stamp, q, v, now, epoch, number, may_evaluate=False)

    def evaluate_due(self, tick: Tick) -> TickResult:
        """Evaluate what the schedule names, and what is due in any case."""
        schedule, certificates, links = self.schedule, self.certificates, self._links
        news = certificates.news
        changed = news.changed[: news.changed_count[0]]
        if self._all_invalid:
            changed = np.flatnonzero(certificates.watched.any(axis=1))
        schedule.touch(self._pairs_of(changed))
        # What is flagged has been so since the last tick; its pairs may have been removed since.
        flagged = np.unique(self._read_pairs(schedule.flagged()) // links)
        due = self._read_pairs(schedule.due())
        expiry = entries_of(certificates.expiry_tree)[flagged]
        latest = max(tick.time + tick.stop_time, expiry.min(initial=np.inf))
        _make_rows_due(self._handle, np.union1d(due // links, flagged[~(expiry > latest)]))
        result = super().evaluate_due(tick)
        times = certificates.pair_expiry.reshape(-1)[due] - tick.time
        schedule.settle(times, tick.stop_time)
        self._evaluated = result.evaluated
        return result

    def _read_pairs(self, named: ArrayLike) -> IntArray:
        """The pairs that a schedule names; compiled code takes none that does not exist."""
        pairs = np.array(named, dtype=np.int64)
        count = self.certificates.watched.size
        if not ((pairs >= 0) & (pairs < count)).all():
            raise ArmguardError(
                f"schedule {type(self.schedule).__name__}",
                f"names pairs {pairs[(pairs < 0) | (pairs >= count)].tolist()}",
                expected="pairs that were inserted and not removed",
            )
        return pairs

    def expect_evaluations(self) -> float:
        """How many evaluations a tick costs: as many as the last one."""
        return float(self._evaluated)

    def _find_limits(self, settings: Settings) -> tuple[float, int]:
        """An answer may look stale until it ends, and no obstacle that is due waits."""
        return 1.0, MOST_EVALUATIONS

    def _insert(self, rows: IntArray) -> None:
        super()._insert(rows)
        self.schedule.insert(self._pairs_of(rows))

    def _remove(self, rows: IntArray) -> None:
        self.schedule.remove(self._pairs_of(rows))
        super()._remove(rows)

    def _prepare(self) -> None:
        """Lay out everything for the links that the robot has now: pairs have other numbers."""
        self.schedule.remove(self.schedule.ranking())
        super()._prepare()

    def _compile(self) -> None:
        super()._compile()
        _make_rows_due(self._handle, np.zeros(0, dtype=np.int64))


@kernel
def _make_rows_due(handle: Any, rows: IntArray) -> None:
    """Let watched rows be evaluated in this tick; `handle` is on certificates."""
    certificates = handle.content
    for row in rows:
        if certificates.watched[row].any():
            make_due(certificates.wheel, row, certificates.wheel.deadline[row])
