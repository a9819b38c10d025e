"""The watch that looks at each obstacle in time, in one compiled call a tick.

The schedule is `deadline`: each obstacle is due when it could matter to a stop, or when the answer
about it would look stale. What it knows is in `certificates`; here arrays are made, grown and
handed over.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import machine_code, pack
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.arm import WatchedArm
from armguard.pairs.evaluate import evaluate
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.certificates import (
    ACTIVE,
    BROKEN,
    LOOKS,
    PREPARED,
    SPENT,
    STALE,
    UNPLACED,
    UNSEEN,
    admit,
    dismiss,
    doubt_all,
    find_soonest,
    grow_book,
    make_book,
)
from armguard.scheduling.deadline_candidates import find_near, find_unsafe
from armguard.scheduling.deadline_evaluations import Watching, look
from armguard.scheduling.deadline_tick import advance
from armguard.scheduling.scheduler import (
    NOTHING_SEEN,
    Listing,
    Look,
    Recollection,
    Seen,
    Tick,
    Unsafe,
)
from armguard.scheduling.timing_wheel import NOBODY, SLOTS

UNLIMITED = 2**62
"""A budget that nothing exceeds."""


class ObstacleWatch:
    """Looks at obstacles by their deadlines; see `Watch`.

    Args:
        robot: The arm.
        obstacles: The table; this watch is the one that follows its rows from now on.
        make_arm: Lays out the arm as it is now.
        states: Where joint positions and velocities of each tick stand.
        horizon: Period plus latency plus reaction time, in [s].
        max_staleness: How stale an answer may look, as a fraction of itself.
        aware_margin: Beyond the stopping time, in [s]: what could be touched within is looked at
            closer.
        period: Of ticks, in [s].
        budget: Evaluations in a tick after which nothing further is begun, and those of a question
            by the stop decision; None: no limit.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        make_arm: Callable[[], WatchedArm],
        states: JointStates,
        horizon: float,
        max_staleness: float,
        aware_margin: float,
        period: float,
        budget: int | None,
    ) -> None:
        self._robot = robot
        self._obstacles = obstacles
        self._make_arm = make_arm
        self._states = states
        self._max_staleness, self._period = max_staleness, period
        self._budget = UNLIMITED if budget is None else budget
        self._pace = horizon, max_staleness, aware_margin, period, self._budget
        self._suspects = np.zeros(0, dtype=np.int64)
        self._placed = -2
        self._changes = -1
        self._doubted = False
        self._culprit = NOBODY
        self._prepare()

    @property
    def stale_looks(self) -> int:
        """How many looks so far came later than max_staleness asked for."""
        return int(self.book.numbers[STALE])

    def follow(self) -> None:
        """Take in what was attached to the robot, and obstacles that came or went."""
        changes, revision = self._obstacles.table.changes, self._robot.revision
        if changes == self._changes and revision == self.arm.revision:
            return
        if self._obstacles.watcher != self._watcher:
            raise ArmguardError(
                "obstacles",
                "are watched by another monitor, which came later",
                remedy="give each monitor obstacles of its own",
            )
        if self._robot.revision != self.arm.revision:
            self._prepare()
            self._doubted = True
        if self.arm.state.view_table():
            self._fit()
        added, removed = self._obstacles.drain_membership()
        if len(removed):
            dismiss(self._handle, removed)
        if len(added):
            masks = np.array([self.arm.watched_links(int(row)) for row in added])
            admit(self._handle, added, masks)
        self._changes = changes

    def restart(self) -> None:
        """Start again with all obstacles that are there, whatever happened before."""
        self._watcher = self._obstacles.start_watching()
        self._make_book()

    def doubt(self) -> None:
        """Let no certificate hold, from the next look on."""
        self._doubted = True

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
        """Take a joint state that there is nothing to be said against, and look if that is all."""
        may_look = may_look and not (self._doubted or self._isotropic.is_widened)
        seen: Seen = self._advance(self._watching, stamp, q, v, now, epoch, number, may_look)
        return seen

    def look(self, tick: Tick, seen: Seen = NOTHING_SEEN) -> Look:
        """Look at the obstacles that are due; the arm is placed only if one of them needs it."""
        doubted, self._doubted = self._doubted, False
        if doubted:
            doubt_all(self._handle)
        row, link, expiry, overdue, evaluated, disturbed = seen[5:]
        if row == UNSEEN:
            row, link, expiry, overdue, evaluated, disturbed = self._go_on(tick, 0)
        broken: tuple[int, ...] = ()
        if disturbed:
            # Read before the look goes on: by then there is no news any more.
            broken = tuple(self.book.broken[: self.book.numbers[BROKEN]].tolist())
        if row == UNPLACED:
            self._place(tick)
            row, link, expiry, overdue, evaluated, _ = self._go_on(tick, evaluated)
        pair = NOBODY if row == NOBODY else row * self._links + link
        return Look(pair, expiry, overdue, evaluated, broken, doubted or disturbed > 0)

    def _go_on(self, tick: Tick, spent: int) -> tuple[int, int, float, int, int, int]:
        found: tuple[int, int, float, int, int, int] = self._look(
            self._watching,
            self._placed == tick.number,
            spent,
            tick.now,
            tick.time,
            tick.number,
            tick.arm_age,
            tick.refinement_threshold,
        )
        return found

    def _place(self, tick: Tick) -> None:
        if self._placed != tick.number:
            self.arm.kinematics.place(tick.q)
            self._placed = tick.number

    def prepare(self, tick: Tick) -> None:
        """Place the arm and fill its bounds for a tick, whether its look needed that or not."""
        state, numbers = self.arm.state, self.book.numbers
        state.now, state.arm_age = tick.now, tick.arm_age
        self._place(tick)
        if numbers[PREPARED] != tick.number:
            state.prepare_arm(tick.q, tick.v)
            numbers[PREPARED] = tick.number

    def near_pairs(self, tick: Tick, duration: float) -> IntArray:
        """Pairs that could touch within `duration`, in [s]."""
        latest = tick.time + duration
        count = find_near(self._watching, latest, self._suspects)
        rows = self._suspects[:count]
        near = self.book.watched[rows] & ~(self.book.pair_expiry[rows] > latest)
        pairs: IntArray = (rows[:, None] * self._links + np.arange(self._links))[near]
        return pairs

    def watched_pairs(self) -> NDArray[np.bool_]:
        """Which pairs are watched, by row × links + link."""
        return self.book.watched.reshape(-1)

    def expect_evaluations(self) -> float:
        """How many evaluations a tick costs as imminent as all obstacles are now."""
        book, max_staleness, period = self.book, self._max_staleness, self._period
        rows = np.flatnonzero(book.watched.any(axis=1))
        looked_at = book.evaluated_at[rows]
        rows, looked_at = rows[np.isfinite(looked_at)], looked_at[np.isfinite(looked_at)]
        contact_time = book.soonest[len(book.soonest) // 2 + rows] - looked_at
        spare = book.wheel.deadline[rows] - looked_at
        if max_staleness > 0.0:
            spare = np.minimum(spare, max_staleness * contact_time)
        else:
            spare = np.zeros_like(spare)
        wait = np.maximum(spare, period)
        looks = float(np.sum(period / np.minimum(wait, SLOTS * period)))
        price = book.numbers[SPENT] / max(book.numbers[LOOKS], 1)
        return looks * float(price)

    def find_unsafe(self, tick: Tick, stop_time: float) -> Unsafe:
        """A pair that might touch before the arm rests, if there is one."""
        self._place(tick)
        row, link, spent, left = self._find_unsafe(
            self._watching,
            tick.now,
            tick.time,
            tick.number,
            tick.arm_age,
            stop_time,
            self._culprit,
            self._budget,
            self._suspects,
        )
        if row == NOBODY:
            return Unsafe(NOBODY, spent, 0)
        self._culprit = row
        return Unsafe(row * self._links + link, spent, left)

    def recall(self, pair: int) -> Recollection:
        """What is known of one pair."""
        book, place = self.book, divmod(pair, self._links)
        return Recollection(
            float(book.pair_expiry[place]),
            float(book.evaluated_at[place[0]]),
            int(book.pair_sphere[place]),
            int(book.pair_bound[place]),
        )

    def list_imminent(self, time: float, *, row_limit: int, pair_limit: int) -> Listing:
        """What is most imminent at `time`."""
        book, links = self.book, len(self.arm.links)
        wanted = min(max(row_limit, pair_limit), int(book.numbers[ACTIVE]))
        rows = np.zeros(wanted, dtype=np.int64)
        rows = rows[: find_soonest(self._handle, rows)]
        # Obstacles may have been removed since, and others taken their rows.
        rows = rows[~np.isin(rows, self._obstacles.membership_changes())]
        row_expiry = book.soonest[len(book.soonest) // 2 + rows]
        pairs = (rows[:, None] * links + np.arange(links))[book.watched[rows]]
        expiry = book.pair_expiry[pairs // links, pairs % links]
        order = np.argsort(expiry, kind="stable")[:pair_limit]
        pairs = pairs[order]
        places = pairs // links, pairs % links
        return Listing(
            rows=rows[:row_limit],
            row_expiry=row_expiry[:row_limit],
            pairs=pairs,
            expiry=expiry[order],
            evaluated_at=book.evaluated_at[places[0]],
            sphere=book.pair_sphere[places].astype(np.int64),
            bound=book.pair_bound[places].astype(np.int64),
            sphere_expiry=self._sphere_expiry(time, rows),
        )

    def _sphere_expiry(self, time: float, rows: IntArray) -> FloatArray:
        """Soonest contact of each finest sphere; what was not looked at has its link's time."""
        state, book = self.arm.state, self.book
        tree = state.tree
        seen = np.isfinite(state.sphere_time)
        self._seen_expiry[seen] = time + state.sphere_time[seen]
        state.sphere_time.fill(np.inf)
        expiry = np.where(book.watched[rows], book.pair_expiry[rows], np.inf)
        # Obstacles that are not listed are later than the last one that is.
        beyond = expiry.min(axis=1)[-1] if len(rows) else np.inf
        of_link = np.minimum(expiry.min(axis=0, initial=np.inf), beyond)[state.link_of]
        # A sphere that was seen lately is known better than its link, until that has come true.
        known = np.where(self._seen_expiry > time, self._seen_expiry, of_link)
        return np.maximum(known, of_link)[tree.first_child < 0]

    def _prepare(self) -> None:
        """Lay out everything for the links that the robot has now."""
        self.arm = self._make_arm()
        self._isotropic = self.arm.motion.isotropic
        self._links = len(self.arm.links)
        self._placed = -2
        self._watcher = self._obstacles.start_watching()
        self._seen_expiry = np.full(len(self.arm.state.tree.radius), -np.inf)
        self._make_book()
        self._compile()

    def _make_book(self) -> None:
        self.book = make_book(len(self.arm.links))
        # What somebody else's certificates rested on is of no use here.
        self._obstacles.table.reference_states.point_count.fill(0)
        self._fit()

    def _fit(self) -> None:
        """Follow the obstacle table's size."""
        table = self._obstacles.table
        self.book = grow_book(self.book, table.changed_rows, table.reference_states)
        self._suspects = np.zeros(len(self.book.watched), dtype=np.int64)
        self._handle = pack(self.book)
        scene = self.arm.state.scene
        self._watching = pack(Watching(scene, self.book, self._states.guard, *self._pace))
        self._bind()

    def _bind(self) -> None:
        """Have compiled what a tick runs, for the arrays that there are now."""
        handle, some = self._watching, np.zeros((len(self._states.q), 2))[:, 0]
        self._advance = machine_code(advance, handle, 0.0, some, some, 0.0, 0.0, 0, True)
        self._look = machine_code(look, handle, True, 0, 0.0, 0.0, 0, 0.0, 0.0)
        self._find_unsafe = machine_code(
            find_unsafe, handle, 0.0, 0.0, 0, 0.0, 0.0, 0, 0, self._suspects
        )

    def _compile(self) -> None:
        """Run every kernel once on nothing, so that none is compiled in a tick."""
        zeros, none = np.zeros(len(self._robot.joints)), np.zeros(0, dtype=np.int64)
        admit(self._handle, none, np.zeros((0, len(self.arm.links)), dtype=np.bool_))
        dismiss(self._handle, none)
        doubt_all(self._handle)
        # Numbers of ticks begin at 1.
        tick = Tick(-1, 0.0, 0.0, zeros, zeros, 0.0, 0.0, 0.0)
        self.look(tick)
        self.find_unsafe(tick, 0.0)
        self.near_pairs(tick, 0.0)
        evaluate(self.arm.state, none, np.zeros(0), none, np.zeros(0, dtype=np.int8))
        self.arm.state.prepare_arm(zeros, zeros)
        find_soonest(self._handle, none)
