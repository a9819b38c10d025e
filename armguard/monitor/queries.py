"""What can be asked of a monitor between ticks: pairs, reasons, and what lies ahead.

Nothing here is part of a tick, and nothing here changes what the next one says.
"""

from __future__ import annotations

from armguard.monitor.explain import Explanation, explain_pair
from armguard.monitor.headroom import Attention, Headroom, predict_headroom, rank_attention
from armguard.monitor.reports import PairReport, Snapshot, report_pair, take_snapshot
from armguard.monitor.settings import MonitorSettings, read_limit
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Look, Tick, Watch
from armguard.scheduling.timing_wheel import NOBODY


class MonitorAnswers:
    """The questions; what they are answered from belongs to `Monitor`.

    Attributes:
        robot: The arm.
        obstacles: The table.
        settings: What the monitor was told.
        period: Of ticks, in [s].
    """

    robot: Robot
    obstacles: Obstacles
    settings: MonitorSettings
    period: float
    _watch: Watch
    _states: JointStates
    _unplaced: bool

    def _recall(self) -> tuple[Tick | None, Look]:
        """The last tick whose state was believed, and what the last look found."""
        raise NotImplementedError("the monitor, which makes ticks, recalls them")

    def pairs(self, limit: int = 64) -> list[PairReport]:
        """The most imminent pairs as of the last tick, soonest first, at most `limit`.

        Raises:
            ArmguardError: The limit is no whole number.
        """
        limit = read_limit("limit", limit)
        tick, _ = self._recall()
        if tick is None:
            return []
        self._watch.prepare(tick)
        time, arm = tick.time, self._watch.arm
        listing = self._watch.list_imminent(time, row_limit=0, pair_limit=limit)
        return [
            report_pair(
                listing,
                index,
                time,
                self.period,
                arm.names(int(pair)),
                arm.state,
                arm.hull_distance,
            )
            for index, pair in enumerate(listing.pairs)
        ]

    def explain(self) -> Explanation | None:
        """Why the last verdict is as it is, and what would have made it better.

        None where no pair decided it: there are none, or its reasons alone did. None as well where
        the obstacle was removed since, so that nothing is known of it any more.
        """
        tick, look = self._recall()
        if tick is None or look.pair == NOBODY or self._unplaced:
            return None
        row = look.pair // len(self._watch.arm.links)
        if row in self.obstacles.changed_rows():
            return None
        self._watch.prepare(tick)
        response_time = self.settings.horizon + self.settings.reaction_time
        return explain_pair(self._watch, self.robot, tick, look.pair, response_time)

    def headroom(self) -> Headroom:
        """What looks cost now, and at how many obstacles or which rate the budget would break."""
        watched = len(self.obstacles) if self._recall()[0] is not None else 0
        expected = self._watch.expect_evaluations()
        return predict_headroom(watched, expected, self.period, self.settings.budget)

    def attention(self, limit: int = 8) -> list[Attention]:
        """The obstacles whose fresh states would raise the verdict's contact time most.

        Args:
            limit: At most so many, first things first.

        Raises:
            ArmguardError: The limit is no whole number.
        """
        limit = read_limit("limit", limit)
        tick, _ = self._recall()
        if tick is None:
            return []
        watch = self._watch
        watch.prepare(tick)
        listing = watch.list_imminent(tick.time, row_limit=limit + 1, pair_limit=0)
        watched, ids = watch.watched_pairs(), self.obstacles.ids
        return rank_attention(listing, watch.arm.state, watched, tick, ids, limit)

    def snapshot(self, *, pair_limit: int, row_limit: int) -> Snapshot:
        """What there is to see of the last tick, for observers; cheap, and their own to keep.

        Args:
            pair_limit: At most so many pairs, the most imminent ones.
            row_limit: At most so many obstacles, likewise.

        Raises:
            ArmguardError: A limit is no whole number.
        """
        pair_limit = read_limit("pair_limit", pair_limit)
        row_limit = read_limit("row_limit", row_limit)
        watch, q, v = self._watch, self._states.q, self._states.v
        tick = self._recall()[0] or Tick(-1, 0.0, 0.0, q, v, 0.0, 0.0, 0.0)
        watch.prepare(tick)
        listing = watch.list_imminent(tick.time, row_limit=row_limit, pair_limit=pair_limit)
        return take_snapshot(listing, watch.arm.state, q, tick.time)
