"""The watch that lets a schedule of pair numbers decide whom to look at.

It follows the obstacle table, asks the schedule, evaluates those pairs, checks flagged ones
exactly, and keeps the certificates of all. This is what the schedules of the paper run on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.table import clear_news
from armguard.pairs.arm import WatchedArm
from armguard.pairs.evaluate import evaluate, find_unsafe_pair
from armguard.pairs.scene import REACH
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.flagged_pairs import FlaggedCheck
from armguard.scheduling.pair_certificates import PairLedger
from armguard.scheduling.schedule import Schedule
from armguard.scheduling.scheduler import (
    NOTHING_SEEN,
    Listing,
    Look,
    Recollection,
    Seen,
    Tick,
    Unsafe,
)


class PairWatch:
    """Looks at pairs as a schedule demands, and knows for each until when it is safe.

    Args:
        robot: The arm.
        obstacles: The table; this watch is the one that follows its rows from now on.
        schedule: Says which pairs to look at.
        make_arm: Lays out the arm as it is now.
        states: Where joint positions and velocities of each tick stand.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        schedule: Schedule,
        make_arm: Callable[[], WatchedArm],
        states: JointStates,
    ) -> None:
        self._robot = robot
        self._obstacles = obstacles
        self.schedule = schedule
        self._make_arm = make_arm
        self._states = states
        self._prepare()

    def follow(self) -> None:
        """Take in what was attached to the robot, and obstacles that came or went.

        Raises:
            ArmguardError: Another watch follows the table, so that news of it is lost.
        """
        if self._obstacles.watcher != self._watcher:
            raise ArmguardError(
                "obstacles",
                "are watched by another monitor, which came later",
                remedy="give each monitor obstacles of its own",
            )
        if self._robot.revision != self.arm.revision:
            self.schedule.remove(self.schedule.ranking())
            self._prepare()
        if not self._obstacles.has_membership_news:
            return
        added, removed = self._obstacles.drain_membership()
        fresh, gone = self.ledger.change(added, removed, len(self._obstacles.table.alive))
        self.schedule.remove(gone)
        self.schedule.insert(fresh)
        if len(self._contact_times) < len(self.ledger.active):
            self._make_room(len(self.ledger.active))

    def restart(self) -> None:
        """Start again with all obstacles that are there, whatever happened before.

        An error may have struck anywhere, so nothing that is known of pairs is kept.
        """
        self.schedule.remove(self.schedule.ranking())
        self.ledger.clear()
        self._watcher = self._obstacles.start_watching()

    def doubt(self) -> None:
        """Let no certificate hold: what they rest on beside their obstacles is gone."""
        self.ledger.doubt()

    def advance(
        self,
        stamp: float,
        q: FloatArray,
        v: FloatArray,
        now: float,
        epoch: float,
        number: int,
        may_look: bool,
    ) -> Seen:
        """Take a joint state that there is nothing to be said against; the look comes later."""
        return (*self._states.accept(stamp, q, v, now), *NOTHING_SEEN[4:])

    def look(self, tick: Tick, seen: Seen = NOTHING_SEEN) -> Look:
        """Evaluate the pairs that are due and check the flagged ones exactly."""
        ledger, state, schedule = self.ledger, self.arm.state, self.schedule
        self.arm.kinematics.place(tick.q)
        state.begin(tick.now, tick.arm_age, tick.refinement_threshold)
        state.prepare_arm(tick.q, tick.v)
        grown, broken = ledger.disturbed(state, self._obstacles.table.revision)
        for disturbed in (grown, broken):
            if len(disturbed):
                ledger.void(disturbed)
                schedule.touch(disturbed)
        due = np.array(schedule.due())
        times = self._contact_times[: len(due)]
        spheres = self._spheres[: len(due)]
        bounds = self._bounds[: len(due)]
        self._evaluated = evaluate(state, due, times, spheres, bounds)
        ledger.record(due, times, spheres, bounds, tick.time, tick.number, state)
        schedule.settle(times, tick.stop_time)
        for pair in schedule.flagged().tolist():
            contact_time = self._flagged.contact_time(*divmod(pair, ledger.link_count))
            ledger.extend(pair, contact_time, tick.time, tick.number, state)
        # Of no use to schedules of pairs, whose ledger tests every state.
        clear_news(self._obstacles.table.news)
        pair, expiry, overdue = ledger.earliest(tick.time, tick.number)
        rows = dict.fromkeys((broken // ledger.link_count).tolist()) if len(broken) else ()
        return Look(pair, expiry, overdue, self._evaluated, tuple(rows))

    def prepare(self, tick: Tick) -> None:
        """Place the arm and fill its bounds for a tick: its look has done so."""
        self.arm.kinematics.place(tick.q)
        self.arm.state.now, self.arm.state.arm_age = tick.now, tick.arm_age
        self.arm.state.prepare_arm(tick.q, tick.v)

    def near_pairs(self, tick: Tick, duration: float) -> IntArray:
        """Pairs that could touch within `duration`, in [s]."""
        pairs = self.ledger.pairs
        return pairs[~(self.ledger.expiry[pairs] > tick.time + duration)]

    def watched_pairs(self) -> NDArray[np.bool_]:
        """Which pairs are watched, by row × links + link."""
        return self.ledger.active

    def expect_evaluations(self) -> float:
        """How many evaluations a tick costs: as many as the last one."""
        return float(self._evaluated)

    def find_unsafe(self, tick: Tick, stop_time: float) -> Unsafe:
        """A pair that might touch before the arm rests; all pairs that are near are looked at."""
        near = self.near_pairs(tick, stop_time)
        return Unsafe(*find_unsafe_pair(self.arm.state, near), left=0)

    def recall(self, pair: int) -> Recollection:
        """What is known of one pair."""
        ledger = self.ledger
        return Recollection(
            float(ledger.expiry[pair]),
            float(ledger.evaluated_at[pair]),
            int(ledger.sphere[pair]),
            int(ledger.bound[pair]),
        )

    def list_imminent(self, time: float, *, row_limit: int, pair_limit: int) -> Listing:
        """What is most imminent at `time`."""
        ledger = self.ledger
        # Obstacles may have been removed since, and others taken their rows.
        gone = np.isin(ledger.pairs // ledger.link_count, self._obstacles.changed_rows())
        there = ledger.pairs[~gone]
        order = np.argsort(ledger.expiry[there], kind="stable")
        pairs = there[order]
        rows, first = np.unique(pairs // ledger.link_count, return_index=True)
        imminent = np.argsort(first, kind="stable")[:row_limit]
        sphere_expiry = self._sphere_expiry(time)
        chosen = pairs[:pair_limit]
        return Listing(
            rows=rows[imminent],
            row_expiry=ledger.expiry[pairs[first[imminent]]],
            pairs=chosen,
            expiry=ledger.expiry[chosen],
            evaluated_at=ledger.evaluated_at[chosen],
            sphere=ledger.sphere[chosen],
            bound=ledger.bound[chosen].astype(np.int64),
            sphere_expiry=sphere_expiry,
        )

    def _sphere_expiry(self, time: float) -> FloatArray:
        """Soonest contact of each finest sphere; what was not looked at has its link's time."""
        ledger, state = self.ledger, self.arm.state
        tree = state.tree
        seen = state.sphere_time + time
        # Parents stand before their children: one that was not opened shares its parent's time.
        for node in np.flatnonzero((tree.parent >= 0) & np.isinf(seen)):
            seen[node] = seen[tree.parent[node]]
        waiting = ledger.pairs[
            (ledger.evaluated_at[ledger.pairs] < time) | (ledger.bound[ledger.pairs] <= REACH)
        ]
        link_expiry = np.full(ledger.link_count, np.inf)
        np.minimum.at(link_expiry, waiting % ledger.link_count, ledger.expiry[waiting])
        return np.minimum(seen, link_expiry[state.link_of])[tree.first_child < 0]

    def _prepare(self) -> None:
        """Lay out everything for the links that the robot has now."""
        self.arm = arm = self._make_arm()
        self.ledger = PairLedger(
            len(arm.links),
            arm.watched_links,
            keeps_certificates=not self.schedule.every_tick,
        )
        self._flagged = FlaggedCheck(arm.hull_distance, arm.motion.isotropic, arm.state)
        self._evaluated = 0
        self._make_room(0)
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
        self.ledger.compile(state, self._obstacles.table.revision)
