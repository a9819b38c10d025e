"""The scheduler that lets a schedule of pair numbers decide what is evaluated.

It follows the obstacle table, asks the schedule, evaluates those pairs, checks flagged ones
exactly, and keeps the certificates of all. This is what the schedules of the paper run on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.operating_history import UNKEPT, OperatingHistory
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.table import clear_changed_rows
from armguard.pairs.arm import WatchedArm
from armguard.pairs.evaluate import evaluate, find_unsafe_pair
from armguard.pairs.hull_gap import lay_out_hulls
from armguard.pairs.scene import REACH
from armguard.robot.joint_acceptance import BELIEVED
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.certificates import IN_VAIN
from armguard.scheduling.flagged_pairs import FlaggedCheck
from armguard.scheduling.layouts import Layouts
from armguard.scheduling.pair_certificates import PairCertificates
from armguard.scheduling.scheduler import (
    AdvanceResult,
    Listing,
    PairResult,
    Tick,
    TickResult,
    Unsafe,
)
from armguard.settings.schedule import Schedule


class PairScheduler:
    """Evaluates pairs as a schedule demands, and knows for each until when it is safe.

    Args:
        robot: The arm.
        obstacles: The table; this scheduler is the one that follows its rows from now on.
        schedule: Says which pairs to evaluate.
        make_arm: Lays out an arm as it is.
        states: Where joint positions and velocities of each tick stand.
        operating: What tests joint states against operating limits; None: there are none.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        schedule: Schedule,
        make_arm: Callable[[Robot], WatchedArm],
        states: JointStates,
        operating: OperatingHistory | None = None,
    ) -> None:
        self._robot = robot
        self._obstacles = obstacles
        self.schedule = schedule
        self._layouts = Layouts(make_arm)
        self._states = states
        self._operating = operating
        self._prepare()

    @property
    def waiting(self) -> int:
        """Obstacles that were due in the last tick and still wait: none ever does."""
        return 0

    def follow(self) -> None:
        """Take in what was attached to the robot, and obstacles that came or went.

        Raises:
            ArmguardError: Another scheduler follows the table, so that news of it is lost.
        """
        if self._obstacles.watcher != self._watcher:
            raise ArmguardError(
                "obstacles",
                "are watched by another monitor, which came later",
                remedy="give each monitor obstacles of its own",
            )
        if self._robot.revision != self.arm.revision:
            self.schedule.remove(self.schedule.ranking())
            self._layouts.keep(self.arm)
            self._prepare()
        if not self._obstacles.has_membership_changes:
            return
        self._change(*self._obstacles.drain_membership())

    def prepare_arm(self, robot: Robot) -> None:
        """Lay out an arm ahead, for a later tick in which the robot has become like this one."""
        self._layouts.prepare(robot)

    def watch_anew(self, rows: IntArray) -> None:
        """Take in which links are watched against some obstacles now, after `follow`."""
        self._change(rows, rows)

    def _change(self, added: IntArray, removed: IntArray) -> None:
        fresh, gone = self.certificates.change(added, removed, len(self._obstacles.table.alive))
        self.schedule.remove(gone)
        self.schedule.insert(fresh)
        if len(self._contact_times) < len(self.certificates.active):
            self._make_room(len(self.certificates.active))

    def restart(self) -> None:
        """Start again with all obstacles that are there, whatever happened before.

        An error may have struck anywhere, so nothing that is known of pairs is kept.
        """
        self.schedule.remove(self.schedule.ranking())
        self.certificates.clear()
        self._watcher = self._obstacles.start_watching()

    def invalidate_all(self) -> None:
        """Invalidate all certificates: the arm's bounds or state have changed."""
        self.certificates.invalidate_all()

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
        """Accept a joint state; evaluations come later."""
        found, joint, stop_time, late_stop_time = self._states.accept(stamp, q, v, now)
        operating = self._operating
        if operating is not None and found >= BELIEVED:
            kept = operating.accept(stamp, self._states.q, self._states.v)
            found |= 0 if kept else UNKEPT
        return found, joint, stop_time, late_stop_time, None

    def evaluate_due(self, tick: Tick) -> TickResult:
        """Evaluate the pairs that are due and check the flagged ones exactly."""
        certificates, state, schedule = self.certificates, self.arm.state, self.schedule
        self.arm.kinematics.place(tick.q)
        state.begin(tick.now, tick.arm_age, tick.refinement_threshold)
        state.prepare_arm(tick.q, tick.v)
        grown, broken = certificates.disturbed(state, self._obstacles.table.revision)
        for disturbed in (grown, broken):
            if len(disturbed):
                certificates.invalidate(disturbed)
                schedule.touch(disturbed)
        due = np.array(schedule.due())
        times = self._contact_times[: len(due)]
        spheres = self._spheres[: len(due)]
        bounds = self._bounds[: len(due)]
        self._evaluated = evaluate(state, due, times, spheres, bounds)
        certificates.record(due, times, spheres, bounds, tick.time, tick.number, state)
        schedule.settle(times, tick.stop_time)
        if certificates.keeps_certificates:
            flagged = np.array(schedule.flagged(), dtype=np.int64)
            given = tick.time, tick.number, tick.stop_time
            certificates.extend(self._flagged, flagged, *given)
        # Of no use to schedules of pairs: every state is tested against their certificates.
        clear_changed_rows(self._obstacles.table.changed_rows)
        pair, expiry, overdue = certificates.earliest(tick.time, tick.number)
        rows = dict.fromkeys((broken // certificates.link_count).tolist()) if len(broken) else ()
        return TickResult(pair, expiry, overdue, self._evaluated, tuple(rows))

    def prepare(self, tick: Tick) -> None:
        """Place the arm and fill its bounds for a tick: its evaluations have done so."""
        self.arm.kinematics.place(tick.q)
        self.arm.state.now, self.arm.state.arm_age = tick.now, tick.arm_age
        self.arm.state.prepare_arm(tick.q, tick.v)

    def watched_pairs(self) -> NDArray[np.bool_]:
        """Which pairs are watched, by row × links + link."""
        return self.certificates.active

    def expect_evaluations(self) -> float:
        """How many evaluations a tick costs: as many as the last one."""
        return float(self._evaluated)

    def recall_stops(
        self,
        tick: Tick,
        stop_time: float,
        later: float = 0.0,
        kept_since: float | None = None,
        *,
        soon: float = 0.0,
    ) -> int:
        """Whether the arm was proved to rest in time: that is asked in every tick."""
        return IN_VAIN

    def find_unsafe(
        self,
        tick: Tick,
        stop_time: float,
        *,
        within: float | None = None,
        remembers: bool = True,
        lasting: float = -1.0,
        until: float = 0.0,
        pause: float = 0.0,
        kept_since: float | None = None,
    ) -> Unsafe:
        """A pair that might touch before the arm rests; all pairs that are near are evaluated."""
        pairs = self.certificates.pairs
        near = pairs[~(self.certificates.expiry[pairs] > tick.time + stop_time)]
        return Unsafe(*find_unsafe_pair(self.arm.state, near), left=0)

    def recall(self, pair: int) -> PairResult:
        """What is known of one pair."""
        certificates = self.certificates
        return PairResult(
            float(certificates.expiry[pair]),
            float(certificates.evaluated_at[pair]),
            int(certificates.sphere[pair]),
            int(certificates.bound[pair]),
        )

    def list_imminent(self, time: float, *, row_limit: int, pair_limit: int) -> Listing:
        """What is most imminent at `time`."""
        certificates = self.certificates
        # Obstacles may have been removed since, and others taken their rows.
        gone = np.isin(
            certificates.pairs // certificates.link_count, self._obstacles.membership_changes()
        )
        there = certificates.pairs[~gone]
        order = np.argsort(certificates.expiry[there], kind="stable")
        pairs = there[order]
        rows, first = np.unique(pairs // certificates.link_count, return_index=True)
        imminent = np.argsort(first, kind="stable")[:row_limit]
        sphere_expiry = self._sphere_expiry(time)
        chosen = pairs[:pair_limit]
        return Listing(
            rows=rows[imminent],
            row_expiry=certificates.expiry[pairs[first[imminent]]],
            pairs=chosen,
            expiry=certificates.expiry[chosen],
            evaluated_at=certificates.evaluated_at[chosen],
            sphere=certificates.sphere[chosen],
            bound=certificates.bound[chosen].astype(np.int64),
            sphere_expiry=sphere_expiry,
            all_expiry=certificates.expiry[there],
        )

    def _sphere_expiry(self, time: float) -> FloatArray:
        """Soonest contact of each finest sphere; what was not evaluated has its link's time."""
        certificates, state = self.certificates, self.arm.state
        tree = state.tree
        seen = state.sphere_time + time
        # Parents stand before their children: one that was not opened shares its parent's time.
        for node in np.flatnonzero((tree.parent >= 0) & np.isinf(seen)):
            seen[node] = seen[tree.parent[node]]
        waiting = certificates.pairs[
            (certificates.evaluated_at[certificates.pairs] < time)
            | (certificates.bound[certificates.pairs] <= REACH)
        ]
        link_expiry = np.full(certificates.link_count, np.inf)
        np.minimum.at(link_expiry, waiting % certificates.link_count, certificates.expiry[waiting])
        return np.minimum(seen, link_expiry[state.link_of])[tree.first_child < 0]

    def _prepare(self) -> None:
        """Lay out everything for the links that the robot has now."""
        self.arm, is_prepared = self._layouts.find(self._robot)
        arm = self.arm
        self.certificates = PairCertificates(
            len(arm.links),
            arm.watched_links,
            keeps_certificates=not self.schedule.every_tick,
        )
        hulls = lay_out_hulls(arm.hull_distance.vertices, arm.hull_distance.joints)
        self._flagged = FlaggedCheck(hulls, arm.motion.isotropic, arm.state)
        self._evaluated = 0
        self._make_room(0)
        if not is_prepared:
            self._compile()
        self._watcher = self._obstacles.start_watching()

    def _make_room(self, pairs: int) -> None:
        self._contact_times = np.zeros(pairs)
        self._spheres = np.zeros(pairs, dtype=np.int64)
        self._bounds = np.zeros(pairs, dtype=np.int8)

    def _compile(self) -> None:
        """Run every kernel once on nothing, so that none is compiled in a tick."""
        zeros, none = np.zeros(len(self._robot.joints)), np.zeros(0, dtype=np.int64)
        state = self.arm.state
        self.arm.kinematics.place(zeros)
        state.begin(0.0, 0.0, 0.0)
        state.prepare_arm(zeros, zeros)
        evaluate(state, none, self._contact_times, self._spheres, self._bounds)
        find_unsafe_pair(state, none)
        self.certificates.compile(state, self._obstacles.table.revision)
        if self.certificates.keeps_certificates:
            self.certificates.extend(self._flagged, none, 0.0, 0, 0.0)
