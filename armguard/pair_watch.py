"""The watch over all pairs of link and obstacle: the part of a tick that grows with their number.

It follows the obstacle table, asks the schedule whom to look at, evaluates those, checks flagged
ones exactly, and keeps the certificates of all. What follows from the earliest of them is the
monitor's business.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.bounds import IsotropicMotion
from armguard.contact import Certificate
from armguard.exact import ExactGeometry
from armguard.exceptions import ArmguardError
from armguard.flagged import FlaggedCheck
from armguard.ignored_pairs import IgnoredPairs
from armguard.kinematics import Kinematics
from armguard.ledger import PairLedger
from armguard.obstacles import Obstacles
from armguard.pair_proof import prove_pair
from armguard.pair_reports import PairReport, report_pair
from armguard.pairs import TickState, evaluate
from armguard.robot import Robot
from armguard.schedules import Schedule
from armguard.verdict import Reason, ReasonKind

ADVANCES = 8
"""Tangent advances per evaluation; nearly every pair has converged by then."""


class PairWatch:
    """Looks at pairs as a schedule demands, and knows for each until when it is safe.

    Args:
        robot: The arm.
        obstacles: The table; this watch is the one that follows its rows from now on.
        schedule: Says which pairs to look at.
        ignored: Pairs that nobody watches.
        margin: Distance that counts as contact already, [m].
        base_placement: Of the robot's base in the world; None: at the origin.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        schedule: Schedule,
        ignored: IgnoredPairs,
        margin: float,
        base_placement: pinocchio.SE3 | None,
    ) -> None:
        self.robot = robot
        self.obstacles = obstacles
        self.schedule = schedule
        self._ignored = ignored
        self._margin = margin
        self._base_placement = base_placement
        self._prepare()

    def follow_robot(self) -> None:
        """Take in what was attached to the robot or detached from it: all pairs are new then.

        Nothing is compiled again, but the tick that does it takes some 20 ms of computing for a
        Panda, 60 for Baxter's two arms, and 170 for Kinova's fine meshes, whose hulls are made
        anew. Beyond a monitor's `joint_timeout`, the joint state after it is a gap and latches a
        STOP: then change tools while the arm stands, and reset.
        """
        if self.robot.revision == self._revision or self.obstacles.watcher != self._watcher:
            return
        self.schedule.remove(self.schedule.ranking())
        self._prepare()

    def _prepare(self) -> None:
        """Lay out everything for the links that the robot has now."""
        # What is attached meanwhile, in another thread, does not reach the copy.
        robot = copy.copy(self.robot)
        self._links = robot.links
        self.kinematics = Kinematics(robot, self._base_placement)
        self.motion = IsotropicMotion(robot, self._base_placement)
        self.state = TickState(
            self.kinematics,
            self.motion,
            self.obstacles,
            margin=self._margin,
            advances=ADVANCES,
            by_distance=self.schedule.measure == "distance",
        )
        self.ledger = PairLedger(
            len(robot.links),
            self._watched_links,
            keeps_certificates=not self.schedule.every_tick,
        )
        self._ignored.follow(robot)
        self._exact = ExactGeometry(robot, self.kinematics)
        self._flagged = FlaggedCheck(self._exact, self.motion, self.state)
        self._contact_times = np.zeros(0)
        self._spheres = np.zeros(0, dtype=np.int64)
        self._compile()
        self._watcher = self.obstacles.start_watching()
        self._revision = robot.revision

    def restart(self) -> None:
        """Start again with all obstacles that are there, whatever happened before.

        An error may have struck anywhere, so nothing that is known of pairs is kept.
        """
        self.schedule.remove(self.schedule.ranking())
        self.ledger.clear()
        self._watcher = self.obstacles.start_watching()

    def follow_rows(self) -> None:
        """Take in obstacles that came and let go of those that went.

        Raises:
            ArmguardError: Another watch follows the table, so that news of it is lost.
        """
        if self.obstacles.watcher != self._watcher:
            raise ArmguardError(
                "obstacles",
                "are watched by another monitor, which came later",
                remedy="give each monitor obstacles of its own",
            )
        added, removed = self.obstacles.drain_membership()
        if not len(added) and not len(removed):
            return
        fresh, gone = self.ledger.change(added, removed, len(self.obstacles.table.alive))
        self.schedule.remove(gone)
        self.schedule.insert(fresh)
        if len(self._contact_times) < len(self.ledger.active):
            self._contact_times = np.zeros(len(self.ledger.active))
            self._spheres = np.zeros(len(self.ledger.active), dtype=np.int64)

    def move_arm(self, q: NDArray[np.float64], v: NDArray[np.float64]) -> None:
        """Place the arm for this tick: joint positions and velocities, each of shape (nv,)."""
        self.kinematics.compute(q, v)
        if self.motion.update(v):
            self.ledger.doubt()

    def look(
        self,
        now: float,
        time: float,
        tick: int,
        arm_age: float,
        stop_time: float,
        opening_time: float,
    ) -> tuple[int, list[Reason]]:
        """Evaluate the pairs that are due and check the flagged ones exactly.

        Args:
            now: Time of this tick on the obstacles' clock, in [s].
            time: The same, since the epoch of certificates.
            tick: Its number.
            arm_age: Age of the joint state, in [s].
            stop_time: By which a certificate must outlast the next look, in [s].
            opening_time: What could be touched before this, in [s], is looked at closer.

        Returns:
            Evaluations spent, and obstacles that broke the bounds behind their certificates.
        """
        ledger, state, schedule = self.ledger, self.state, self.schedule
        state.begin(now, arm_age, opening_time)
        grown, broken = ledger.disturbed(state, self.obstacles.table.revision)
        for disturbed in (grown, broken):
            if len(disturbed):
                ledger.void(disturbed)
                schedule.touch(disturbed)
        due = np.array(schedule.due())
        times = self._contact_times[: len(due)]
        spheres = self._spheres[: len(due)]
        evaluated = evaluate(state, due, times, spheres)
        ledger.record(due, times, spheres, time, tick, state)
        schedule.settle(times, stop_time)
        for pair in schedule.flagged().tolist():
            contact_time = self._flagged.contact_time(*divmod(pair, ledger.link_count))
            ledger.extend(pair, contact_time, time, tick, state)
        return evaluated, [
            Reason(ReasonKind.BOUND_BROKEN, self.obstacles.ids[row])
            for row in dict.fromkeys((broken // ledger.link_count).tolist())
        ]

    def names(self, pair: int) -> tuple[str, str]:
        """Of the link and the obstacle."""
        row, link = divmod(pair, self.ledger.link_count)
        return self._links[link], self.obstacles.ids[row]

    def prove(self, pair: int) -> tuple[Certificate, dict[str, Any]] | None:
        """A certificate of one pair in this tick and what it is about; see `prove_pair`."""
        row = pair // self.ledger.link_count
        return prove_pair(self.state, int(self.ledger.sphere[pair]), row)

    def report(self, time: float, period: float, limit: int) -> list[PairReport]:
        """The most imminent pairs, soonest first.

        Args:
            time: Of the last tick, in [s] since the epoch of certificates.
            period: Of ticks, in [s].
            limit: At most so many.
        """
        ledger, state = self.ledger, self.state
        # Obstacles may have been removed since, and others taken their rows.
        rows = ledger.pairs // ledger.link_count
        there = ledger.pairs[~np.isin(rows, self.obstacles.changed_rows())]
        order = np.argsort(ledger.expiry[there], kind="stable")[:limit]
        return [
            report_pair(pair, time, period, self.names(pair), ledger, state, self._exact)
            for pair in there[order].tolist()
        ]

    def _watched_links(self, row: int) -> NDArray[np.bool_]:
        """Which links are watched against the obstacle in `row`. Shape (links,)."""
        return self._ignored.watched_links(self.obstacles.ids[row])

    def _compile(self) -> None:
        """Run every kernel once on nothing, so that none is compiled in a tick."""
        zeros = np.zeros(len(self.robot.joints))
        self.move_arm(zeros, zeros)
        self.state.begin(0.0, 0.0, 0.0)
        none = np.zeros(0, dtype=np.int64)
        evaluate(self.state, none, self._contact_times, self._spheres)
        self.ledger.compile(self.state, self.obstacles.table.revision)
