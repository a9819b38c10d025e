"""What can be asked of a monitor between ticks: pairs, reasons, and what lies ahead.

Nothing here is part of a tick, and nothing here changes what the next one says. Each answer is
about the tick that is handed over, the last one whose joint state was believed.
"""

from __future__ import annotations

from armguard.monitor.explain import Explanation, explain_pair
from armguard.monitor.headroom import Attention, Headroom, predict_headroom, rank_attention
from armguard.monitor.reports import PairReport, Snapshot, report_pair, take_snapshot
from armguard.monitor.settings import MonitorSettings, read_limit
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Tick, Watch


class Queries:
    """Answers from what the pairs' watch knows; `Monitor` says what each of them means.

    Args:
        robot: The arm.
        obstacles: The table.
        settings: What the monitor was told.
        watch: Knows the pairs.
        states: Knows the joint states.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        settings: MonitorSettings,
        watch: Watch,
        states: JointStates,
    ) -> None:
        self._robot = robot
        self._obstacles = obstacles
        self._settings = settings
        self._watch = watch
        self._states = states

    def pairs(self, tick: Tick | None, limit: int) -> list[PairReport]:
        """The most imminent pairs, soonest first; none before the first tick."""
        limit = read_limit("limit", limit)
        if tick is None:
            return []
        self._watch.prepare(tick)
        time, arm, period = tick.time, self._watch.arm, self._settings.period
        listing = self._watch.list_imminent(time, row_limit=0, pair_limit=limit)
        return [
            report_pair(listing, index, time, period, arm.names(int(pair)), arm.state, arm.exact)
            for index, pair in enumerate(listing.pairs)
        ]

    def explain(self, tick: Tick, pair: int) -> Explanation | None:
        """Why the verdict that this pair decided is as it is; None where it is gone since."""
        row = pair // len(self._watch.arm.links)
        if row in self._obstacles.changed_rows():
            return None
        self._watch.prepare(tick)
        response_time = self._settings.horizon + self._settings.reaction_time
        return explain_pair(self._watch, self._robot, tick, pair, response_time)

    def headroom(self, tick: Tick | None) -> Headroom:
        """What looks cost now; nothing is watched before the first tick."""
        watched = len(self._obstacles) if tick is not None else 0
        expected = self._watch.expect_evaluations()
        return predict_headroom(watched, expected, self._settings.period, self._settings.budget)

    def attention(self, tick: Tick | None, limit: int) -> list[Attention]:
        """The obstacles whose fresh states would help most; none before the first tick."""
        limit = read_limit("limit", limit)
        if tick is None:
            return []
        watch = self._watch
        watch.prepare(tick)
        listing = watch.list_imminent(tick.time, row_limit=limit + 1, pair_limit=0)
        watched, ids = watch.watched_pairs(), self._obstacles.ids
        return rank_attention(listing, watch.arm.state, watched, tick, ids, limit)

    def snapshot(self, tick: Tick | None, pair_limit: int, row_limit: int) -> Snapshot:
        """What there is to see; before the first tick, the arm as it is known then."""
        pair_limit = read_limit("pair_limit", pair_limit)
        row_limit = read_limit("row_limit", row_limit)
        watch, q, v = self._watch, self._states.q, self._states.v
        tick = tick or Tick(-1, 0.0, 0.0, q, v, 0.0, 0.0, 0.0)
        watch.prepare(tick)
        listing = watch.list_imminent(tick.time, row_limit=row_limit, pair_limit=pair_limit)
        return take_snapshot(listing, watch.arm.state, q, tick.time)
