"""Queries of a monitor between ticks: pairs, explanations, proofs and predictions.

No query is part of a tick, or changes the next verdict. Each answer is about the given tick, which
is the last one with a believed joint state. The modules of explanations and predictions are
imported by the first query of their kind, since most monitors need none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.monitor.reports import PairReport, Snapshot, report_pair, take_snapshot
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.joint_states import JointStates
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.settings.settings import Settings

if TYPE_CHECKING:
    from armguard.messages.proof import Proof
    from armguard.monitor.explain import Explanation
    from armguard.monitor.headroom import Attention, Headroom
    from armguard.monitor.proof import Prover
    from armguard.verdict import Verdict


class Queries:
    """Answers queries from the pairs' scheduler; `Monitor` documents each of them.

    Args:
        robot: The arm.
        obstacles: The table.
        settings: Settings of the monitor.
        scheduler: Knows the pairs.
        states: Knows the joint states.
        in_force: The limits and brakes in force.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        settings: Settings,
        scheduler: Scheduler,
        states: JointStates,
        in_force: LimitsInForce,
    ) -> None:
        self._robot = robot
        self._obstacles = obstacles
        self._settings = settings
        self._scheduler = scheduler
        self._states = states
        self._in_force = in_force
        self._prover: Prover | None = None

    def pairs(self, tick: Tick | None, limit: int) -> list[PairReport]:
        """The most imminent pairs, by contact time; none before the first tick."""
        limit = read_limit("limit", limit)
        if tick is None:
            return []
        self._scheduler.prepare(tick)
        time, arm, period = tick.time, self._scheduler.arm, self._settings.period
        listing = self._scheduler.list_imminent(time, row_limit=0, pair_limit=limit)
        return [
            report_pair(
                listing, index, time, period, arm.names(int(pair)), arm.state, arm.hull_distance
            )
            for index, pair in enumerate(listing.pairs)
        ]

    def explain(self, tick: Tick, pair: int, *, by_braking: bool) -> Explanation | None:
        """Explain the verdict that this pair decided; None if the pair was removed since.

        Args:
            tick: The last one.
            pair: Row × links + link.
            by_braking: Whether it was a STOP because of the brakes alone.
        """
        from armguard.monitor.avoidable import list_remedies
        from armguard.monitor.explain import explain_pair

        row = pair // len(self._scheduler.arm.links)
        if row in self._obstacles.membership_changes():
            return None
        self._scheduler.prepare(tick)
        settings, robot, scheduler = self._settings, self._robot, self._scheduler
        explanation = explain_pair(scheduler, robot, tick, pair, settings.braking_delay)
        if not (settings.with_joints and by_braking):
            return explanation
        remedies = list_remedies(
            scheduler,
            robot,
            self._in_force,
            tick,
            settings.response_time,
            has_operating=settings.has_operating,
        )
        return explanation._replace(remedies=remedies)

    def prove(self, tick: Tick, pair: int, verdict: Verdict) -> Proof | None:
        """The proof about the deciding pair of the last verdict; None if there is none.

        Args:
            tick: The last one.
            pair: Row × links + link.
            verdict: Its verdict.
        """
        scheduler = self._scheduler
        if pair // len(scheduler.arm.links) in self._obstacles.membership_changes():
            return None
        prover = self.prepare_proofs()
        scheduler.prepare(tick)
        return prover.prove(tick, pair, verdict)

    def prepare_proofs(self) -> Prover:
        """Make the prover for the robot's present links."""
        from armguard.monitor.proof import Prover

        arm = self._scheduler.arm
        if self._prover is None or self._prover.arm is not arm:
            self._prover = Prover(arm, self._settings)
        return self._prover

    def headroom(self, tick: Tick | None) -> Headroom:
        """The present headroom; without pairs before the first tick."""
        from armguard.monitor.headroom import predict_headroom

        watched = len(self._obstacles) if tick is not None else 0
        expected = self._scheduler.expect_evaluations()
        return predict_headroom(watched, expected, self._settings.period, self._settings.budget)

    def attention(self, tick: Tick | None, limit: int) -> list[Attention]:
        """The obstacles whose fresh states would help most; none before the first tick."""
        from armguard.monitor.headroom import rank_attention

        limit = read_limit("limit", limit)
        if tick is None:
            return []
        scheduler = self._scheduler
        scheduler.prepare(tick)
        listing = scheduler.list_imminent(tick.time, row_limit=limit + 1, pair_limit=0)
        watched, ids = scheduler.watched_pairs(), self._obstacles.ids
        return rank_attention(listing, scheduler.arm.state, watched, tick, ids, limit)

    def snapshot(self, tick: Tick | None, pair_limit: int, row_limit: int) -> Snapshot:
        """The data for observers; before the first tick, the arm in its present state."""
        pair_limit = read_limit("pair_limit", pair_limit)
        row_limit = read_limit("row_limit", row_limit)
        scheduler, q, v = self._scheduler, self._states.q, self._states.v
        tick = tick or Tick(-1, 0.0, 0.0, q, v, 0.0, 0.0, 0.0)
        scheduler.prepare(tick)
        listing = scheduler.list_imminent(tick.time, row_limit=row_limit, pair_limit=pair_limit)
        return take_snapshot(listing, q, tick.time)


def read_limit(name: str, limit: object) -> int:
    """Read the argument `limit`; a negative number counts as 0.

    Args:
        name: What to call it in errors.
        limit: The given value.

    Raises:
        ArmguardError: It is not an integer.
    """
    if isinstance(limit, bool) or not isinstance(limit, (int, np.integer)):
        raise ArmguardError(name, f"is {limit!r}", expected="an integer")
    return max(int(limit), 0)
