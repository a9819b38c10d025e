"""The scheduler: keeps the certificates of each obstacle, and chooses a tick's evaluations.

Each obstacle is due when the answer about it would look stale, or where no stop decision is made,
when it could matter to a stop. What is known is in `certificates`, and a tick is one compiled call;
here arrays are made, grown and handed over. A schedule of pairs makes more of them due, see
`pair_scheduler`.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.operating_history import OperatingHistory, make_empty_record
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import machine_code, pack
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.partners import NO_PARTNER
from armguard.obstacles.regions import ContactLimit, strictest_limit
from armguard.obstacles.table import States
from armguard.pairs.arm import WatchedArm
from armguard.pairs.evaluate import evaluate
from armguard.pairs.forbidden import Forbidden, find_forbidden
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.certificates import (
    ACTIVE,
    BROKEN,
    EVALUATED_ROWS,
    MOVED,
    PREPARED,
    SPENT,
    UNPLACED,
    UNSEEN,
    Certificates,
    end_uses,
    find_most_imminent,
    grow_certificates,
    insert,
    invalidate_all,
    make_certificates,
    remove,
)
from armguard.scheduling.deadline_kernels import (
    CROWD,
    Moment,
    StopQuestion,
    TickData,
    advance,
    evaluate_due,
    find_first_harm,
    find_permitted_contact,
    find_touch,
    find_unsafe,
    recall_stops,
)
from armguard.scheduling.layouts import Layouts
from armguard.scheduling.tether_uses import CERTIFICATE, USES
from armguard.scheduling.timing_wheel import NOBODY, SLOTS, WAITING
from armguard.scheduling.tournament import entries_of
from armguard.settings.settings import MOST_EVALUATIONS, Settings


class Tick(NamedTuple):
    """One tick, as a scheduler is told of it; times in [s]."""

    number: int
    now: float
    """On the obstacles' clock."""
    time: float
    """The same since the monitor's epoch."""
    q: FloatArray
    """Joint positions, [rad] or [m]. Shape (nv,)."""
    v: FloatArray
    """Joint velocities, [rad/s] or [m/s]. Shape (nv,)."""
    arm_age: float
    """Age of the joint state; negative where it is newer than now."""
    stop_time: float
    """In which the arm surely rests."""
    refinement_threshold: float
    """What could be touched before this is refined."""
    late_stop_time: float = math.inf
    """In which the arm surely rests that brakes only when a speed scale has run out."""


class TickResult(NamedTuple):
    """What a tick's evaluations of pairs found."""

    pair: int
    """Whose certificate ends first, row × links + link; NOBODY without pairs."""
    expiry: float
    """When that is, in [s] since the monitor's epoch; inf without pairs."""
    overdue: int
    """How many have neither a certificate in force nor an evaluation in this tick, whatever the
    stop decision says; beside those that have `ended`."""
    evaluated: int
    """Evaluations spent."""
    broken: tuple[int, ...] = ()
    """Rows of obstacles that broke the bounds behind their certificates."""
    disturbed: bool = True
    """Whether there may be changes that proofs of earlier ticks do not allow for."""
    ended: int = 0
    """How many obstacles have certificates that ended and were not evaluated in this tick: overdue
    unless the stop decision is made about all of them."""


NOTHING_FOUND = TickResult(NOBODY, math.inf, 0, 0)
"""Result of a tick in which nothing was evaluated."""

AdvanceResult = tuple[int, int, float, float, TickResult | None]
"""What was found of a joint state, below 0 where it is refused, and the joint that it is refused
for, both stop times in [s], and what the tick's evaluations found; None: they are still to come."""


class Listing(NamedTuple):
    """What is most imminent, soonest first; times in [s] since the monitor's epoch."""

    rows: IntArray
    """Of obstacles. Shape (o,)."""
    row_expiry: FloatArray
    """When the first certificate of each ends. Shape (o,)."""
    pairs: IntArray
    """Row × links + link. Shape (m,)."""
    expiry: FloatArray
    """When each pair's certificate ends. Shape (m,)."""
    evaluated_at: FloatArray
    """When each was evaluated last. Shape (m,)."""
    sphere: IntArray
    """Sphere that decided each. Shape (m,)."""
    bound: IntArray
    """What each certificate rests on, an index of `BOUND_NAMES`. Shape (m,)."""
    sphere_expiry: FloatArray
    """Soonest contact of each finest sphere of the arm. Shape (s,)."""
    all_expiry: FloatArray
    """When the certificates of all pairs of the rows looked at end, in no order. Shape (n,)."""


class Unsafe(NamedTuple):
    """Answer to the question whether the arm surely rests before contact."""

    pair: int
    """A pair that might touch before, row × links + link; NOBODY if there is none."""
    evaluated: int
    """Evaluations spent."""
    left: int
    """Obstacles that were not decided about when the budget was spent; 0 if it was not."""


class PermittedContact(NamedTuple):
    """A contact that is permitted, and possible."""

    pair: int
    """Which pair, row × links + link; NOBODY if there is none."""
    speed: float
    """How fast the link's surface is then at most, in [m/s]."""
    limit: float
    """How fast it may be, in [m/s]."""
    greatest: float
    """How fast any link is at most that may touch something, in [m/s]."""


NO_CONTACT = PermittedContact(NOBODY, 0.0, math.inf, 0.0)
"""That there is no such contact."""


class PairResult(NamedTuple):
    """What is known of one pair; times in [s] since the monitor's epoch."""

    expiry: float
    """When its certificate ends."""
    evaluated_at: float
    """When it was evaluated."""
    sphere: int
    """Sphere that decided it."""
    bound: int
    """What the certificate rests on, an index of `BOUND_NAMES`."""


class _Desk(NamedTuple):
    """What ticks work on and run for one arm; to make it takes a millisecond."""

    bodies: States
    """The accepted states of the obstacle table that it was made for."""
    certificates: Certificates
    fresh: list[NDArray[Any]]
    """What was in the certificates' arrays at first; empty where that is not known any more."""
    candidates: IntArray
    handle: Any
    """On the certificates."""
    tick_data: Any
    codes: tuple[Any, Any, Any, Any]
    """Machine code of `advance`, `evaluate_due`, `find_unsafe` and `recall_stops`."""
    limit_codes: tuple[Any, ...]
    """That of `find_first_harm`, `find_permitted_contact`, `find_touch` and `find_forbidden`; none
    where no contact is permitted."""


def _list_own(certificates: Certificates) -> list[NDArray[Any]]:
    """The arrays of certificates that are not the obstacle table's."""
    own = certificates._asdict()
    del own["reference_states"], own["news"], own["permits_contact"]
    *proofs, _, _ = own.pop("proofs")  # without these no state that they rest on is read
    partner = own.pop("uses").partner
    return [*own.pop("wheel"), *proofs, partner, *own.values()]


class Scheduler:
    """Evaluates obstacles by their deadlines, and knows for each pair until when it is safe.

    Args:
        robot: The arm.
        obstacles: The table; this scheduler is the one that follows its rows from now on.
        make_arm: Lays out an arm as it is.
        states: Where joint positions and velocities of each tick stand.
        settings: How stale answers may look, what is refined, and the budget.
        operating: What tests joint states against operating limits; None: there are none.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        make_arm: Callable[[Robot], WatchedArm],
        states: JointStates,
        settings: Settings,
        operating: OperatingHistory | None = None,
    ) -> None:
        self._robot = robot
        self._obstacles = obstacles
        self._layouts = Layouts(make_arm)
        self._desks: weakref.WeakKeyDictionary[WatchedArm, _Desk] = weakref.WeakKeyDictionary()
        """Of arms that are laid out ahead."""
        self._states = states
        self._record = make_empty_record() if operating is None else operating.record
        self._settings = settings
        self._budget = MOST_EVALUATIONS if settings.budget is None else settings.budget
        self._max_staleness, self._crowd = self._find_limits(settings)
        self._candidates = np.zeros(0, dtype=np.int64)
        self._placed = -2
        self._changes = -1
        self._all_invalid = False
        self._last_offender = NOBODY
        self._prepare()

    def _find_limits(self, settings: Settings) -> tuple[float, int]:
        """How stale answers may look, and evaluations beyond which a tick of a STOP ends."""
        return settings.max_staleness, CROWD

    @property
    def waiting(self) -> int:
        """Obstacles that were due in the last tick and still wait."""
        return int(self.certificates.wheel.numbers[WAITING])

    def follow(self) -> None:
        """Take in what was attached to the robot, and obstacles that came or went.

        Raises:
            ArmguardError: Another scheduler follows the table, so that news of it is lost.
        """
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
            self._layouts.keep(self.arm)
            if self._desk.fresh:
                self._desks[self.arm] = self._desk
            self._prepare()
            self._all_invalid = True
        ties = self._obstacles.has_new_tethers
        if ties:
            self._obstacles.tie_rows()
        if self.arm.state.view_table():
            self._fit()
        if ties:
            used = np.flatnonzero(self.certificates.uses.partner != NO_PARTNER) // USES
            end_uses(self._handle, np.unique(used))
        added, removed = self._obstacles.drain_membership()
        if len(removed):
            self._remove(removed)
        if len(added):
            self._insert(added)
        self._changes = changes

    def prepare_arm(self, robot: Robot) -> None:
        """Lay out an arm ahead, for a later tick in which the robot has become like this one.

        Args:
            robot: The arm with other bodies attached.
        """
        arm = self._layouts.prepare(robot)
        arm.state.view_table()
        desk = self._desks.get(arm)
        if desk is None or desk.bodies is not self._obstacles.table.accepted:
            certificates = self._make_empty(arm)
            self._desks[arm] = self._lay_desk(arm, certificates, is_fresh=True)

    def watch_anew(self, rows: IntArray) -> None:
        """Take in which links are watched against some obstacles now, after `follow`.

        All their pairs are evaluated in this tick, as those of obstacles that have just come.

        Args:
            rows: Of obstacles that are there. Shape (r,).
        """
        self._remove(rows)
        self._insert(rows)

    def _remove(self, rows: IntArray) -> None:
        remove(self._handle, rows)

    def _insert(self, rows: IntArray) -> None:
        masks = np.array([self.arm.watched_links(int(row)) for row in rows])
        insert(self._handle, rows, masks)

    def restart(self) -> None:
        """Start again with all obstacles that are there, whatever happened before."""
        self._watcher = self._obstacles.start_watching()
        self._make_certificates()

    def invalidate_all(self) -> None:
        """Invalidate all certificates when the next tick evaluates."""
        self._all_invalid = True

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
        """Accept a joint state, and evaluate what is due if nothing else needs to be done.

        Args:
            stamp: When the state was measured, in [s].
            q: Joint positions, [rad] or [m]; plain, see `JointStates.is_plain`. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]; plain. Shape (nv,).
            now: Time of the tick, in [s].
            epoch: Since when the monitor counts time, in [s].
            number: Of the tick.
            may_evaluate: Whether nothing needs to be done between state and evaluations.
        """
        may_evaluate = may_evaluate and not (self._all_invalid or self._isotropic.is_widened)
        (
            found, joint, stop_time, late_stop_time, threshold,
            row, link, expiry, overdue, evaluated, disturbed, ended,
        ) = seen = self._advance(
            self._tick_data, stamp, q, v, now, epoch, number, may_evaluate
        )  # fmt: skip
        if row >= 0 and not disturbed:
            # The usual tick is over already; a named tuple's own constructor takes twice as long.
            result = tuple.__new__(
                TickResult, (row * self._links + link, expiry, overdue, evaluated, (), False, ended)
            )
        elif row == UNSEEN:
            result = None
        else:
            moment = Moment(now, now - epoch, number, now - stamp, threshold)
            result = self._finish(seen[5:], moment, self._states.q, all_invalid=False)
        return found, joint, stop_time, late_stop_time, result

    def evaluate_due(self, tick: Tick) -> TickResult:
        """Evaluate the obstacles that are due; the arm is placed only if one of them needs it."""
        all_invalid, self._all_invalid = self._all_invalid, False
        if all_invalid:
            invalidate_all(self._handle)
        moment = _moment_of(tick)
        seen = self._evaluate_due(self._tick_data, self._placed == tick.number, 0, moment)
        return self._finish(seen, moment, tick.q, all_invalid=all_invalid)

    def _finish(
        self, seen: Sequence[Any], moment: Moment, q: FloatArray, *, all_invalid: bool
    ) -> TickResult:
        """What a tick's evaluations found, and the rest of them where the arm has to be placed.

        Args:
            seen: What compiled code returned, see `deadline_kernels.evaluate_due`.
            moment: The tick.
            q: Joint positions, [rad] or [m]. Shape (nv,).
            all_invalid: Whether all certificates were invalidated in this tick.
        """
        row, link, expiry, overdue, evaluated, disturbed, ended = seen
        broken: tuple[int, ...] = ()
        if disturbed:
            # Read before the evaluations go on: by then no change is marked any more.
            broken = tuple(self.certificates.broken[: self.certificates.numbers[BROKEN]].tolist())
        if row == UNPLACED:
            self._place(moment.number, q)
            row, link, expiry, overdue, evaluated, _, ended = self._evaluate_due(
                self._tick_data, True, evaluated, moment
            )
        pair = NOBODY if row == NOBODY else row * self._links + link
        disturbs = all_invalid or disturbed > 0
        return TickResult(pair, expiry, overdue, evaluated, broken, disturbs, ended)

    def _place(self, number: int, q: FloatArray) -> None:
        """Place the arm in the tick of this number, unless that was done."""
        if self._placed != number:
            self.arm.kinematics.place(q)
            self._placed = number

    def prepare(self, tick: Tick) -> None:
        """Place the arm and fill its bounds for a tick, needed by its evaluations or not."""
        state, numbers = self.arm.state, self.certificates.numbers
        state.now, state.arm_age = tick.now, tick.arm_age
        self._place(tick.number, tick.q)
        if numbers[PREPARED] != tick.number:
            state.prepare_arm(tick.q, tick.v)
            numbers[MOVED] = numbers[PREPARED] = tick.number

    def revision(self, pair: int) -> int:
        """How often what is known of a pair's obstacle has changed; of no pair, any number."""
        return self._obstacles.table.revision.item(pair // self._links)

    def watched_pairs(self) -> NDArray[np.bool_]:
        """Which pairs are watched, by row × links + link; none beyond its end. Shape (n,)."""
        return self.certificates.watched.reshape(-1)

    def expect_evaluations(self) -> float:
        """How many evaluations a tick costs as imminent as all obstacles are now."""
        certificates, settings = self.certificates, self._settings
        max_staleness, period = self._max_staleness, settings.period
        rows = np.flatnonzero(certificates.watched.any(axis=1))
        evaluated_at = certificates.evaluated_at[rows]
        known = np.isfinite(evaluated_at)
        rows, evaluated_at = rows[known], evaluated_at[known]
        contact_time = entries_of(certificates.expiry_tree)[rows] - evaluated_at
        spare = certificates.wheel.deadline[rows] - evaluated_at
        if max_staleness > 0.0:
            spare = np.minimum(spare, max_staleness * contact_time)
        else:
            spare = np.zeros_like(spare)
        wait = np.maximum(spare, period)
        rows_per_tick = float(np.sum(period / np.minimum(wait, SLOTS * period)))
        price = certificates.numbers[SPENT] / max(certificates.numbers[EVALUATED_ROWS], 1)
        return rows_per_tick * float(price)

    def recall_stops(
        self,
        tick: Tick,
        stop_time: float,
        later: float = 0.0,
        kept_since: float | None = None,
        *,
        soon: float = 0.0,
    ) -> int:
        """Whether earlier ticks have proved already that the arm rests in time, told to stop.

        For what has no certificate that outlasts the stop, by `find_unsafe` for a time that has not
        passed.

        Args:
            tick: The tick.
            stop_time: When the arm surely rests, in [s] from the tick.
            later: When it is told to stop at the latest, in [s] from the tick.
            kept_since: As for `find_unsafe`.
            soon: What is proved for no longer than that and so much more, in [s], ends soon.

        Returns:
            PROVED; ENDING where some proof ends soon, and this tick has had nothing else to do, so
            that it may well be renewed; IN_VAIN where all that is not proved was asked a moment ago
            already; or ASKABLE, which says nothing.
        """
        is_paced, since = _read_kept(kept_since)
        answer: int = self._recall_stops(
            self._tick_data,
            tick.number,
            tick.time,
            tick.time + later,
            tick.time + stop_time,
            soon,
            is_paced,
            since,
            self._candidates,
        )
        return answer

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
        """A pair that might touch before the arm rests, if there is one.

        Judged by the arm's table of braking, which ends at `stop_time`, for all obstacles that
        could be touched by then, or `within` a shorter time, in [s]: it is not about others. Where
        the user's budget does not suffice, a pair counts as unsafe. What is found may be asked for
        first the next time, unless `remembers` is false: then nothing changes.

        A `lasting` of 0 or more, in [s], says that the table is that of an arm that is told to stop
        at any time from this tick until so much later. Then what was proved of earlier tables for
        all that comes `until` so much later, in [s], need not be asked again; what ends soon may be
        renewed along with the rest. Obstacles that might be touched are not asked again by
        questions with a `pause` until that is over, in [s], or something newer is known of them:
        they count as unsafe.

        Where `kept_since` is given, the table is that of an arm whose joints keep to some speeds,
        as they surely have since then, in [s] since the epoch. Proofs of such tables stand by
        themselves; older ones count for nothing, and the others are of the same speeds or higher.
        """
        self._place(tick.number, tick.q)
        is_paced, since = _read_kept(kept_since)
        question = StopQuestion(
            stop_time,
            stop_time if within is None else min(within, stop_time),
            lasting,
            until,
            pause,
            is_paced,
            since,
            self._last_offender,
            self._budget,
        )
        row, link, spent, left = self._find_unsafe(
            self._tick_data, _moment_of(tick), question, self._candidates
        )
        if row == NOBODY:
            return Unsafe(NOBODY, spent, 0)
        pair = row * self._links + link
        if remembers:
            self._last_offender = pair
        return Unsafe(pair, spent, left)

    def find_harm(self) -> tuple[int, float]:
        """The pair of which a contact that is not permitted could come first, and when.

        To be asked in a tick whose evaluations found a pair.

        Returns:
            Row × links + link; and the time in [s] since the epoch.
        """
        row, link, expiry = self._find_harm(self._handle)
        return row * self._links + link, expiry

    def find_harm_expiry(self, pair: int) -> float:
        """Until when no contact of a pair can do harm, in [s] since the epoch."""
        return self.certificates.pair_harm.item(divmod(pair, self._links))

    def find_touch(self, tick: Tick) -> int:
        """A pair that touches, as is permitted; NOBODY if there is none.

        To be asked after the tick's evaluations, where contact limits are stated.
        """
        self._place(tick.number, tick.q)
        row, link = self._find_touch(self._tick_data, _moment_of(tick), self._candidates)
        return NOBODY if row == NOBODY else row * self._links + link

    def find_limit(self, regions: int) -> ContactLimit:
        """What contact with an obstacle of a set of regions is permitted."""
        return ContactLimit(*strictest_limit(self.arm.state.scene.contact_limits, regions))

    def list_touchable(self, tick: Tick) -> IntArray:
        """Rows of obstacles whose certificates do not say that nothing touches them. Shape (r,)."""
        expiry = entries_of(self.certificates.expiry_tree)[: len(self.certificates.watched)]
        rows: IntArray = np.flatnonzero(expiry <= tick.time)
        return rows

    def find_speed_limit(self, pair: int) -> float:
        """How fast a surface may be that touches the obstacle of a pair, in [m/s]."""
        regions = int(self.arm.state.scene.marks.regions[pair // self._links])
        return float(self.find_limit(regions).max_speed)

    def find_forbidden(self, pair: int, tick: Tick) -> Forbidden:
        """Why a contact of a pair's obstacle is forbidden, by the arm's table of braking.

        Where that of the pair itself is not, another one of the same obstacle may be.
        """
        self.prepare(tick)
        row, link = divmod(pair, self._links)
        watched = self.certificates.watched[row]
        return Forbidden(*self._find_forbidden(self.arm.state.handle, link, row, watched, tick.now))

    def find_permitted_contact(self, tick: Tick, within: float) -> PermittedContact:
        """The contact that is permitted and possible within a time, in [s], nearest its limit.

        For a tick whose stop decision was made.
        """
        row, link, speed, limit, greatest = self._find_permitted(
            self._tick_data, tick.time, tick.time + within, self._candidates
        )
        if row == NOBODY:
            return NO_CONTACT
        pair = row * self._links + link
        # A named tuple's own constructor takes twice as long.
        return tuple.__new__(PermittedContact, (pair, speed, limit, greatest))

    def recall(self, pair: int) -> PairResult:
        """What is known of one pair."""
        certificates, place = self.certificates, divmod(pair, self._links)
        return PairResult(
            certificates.pair_expiry.item(place),
            certificates.evaluated_at.item(place[0]),
            certificates.pair_sphere.item(place),
            certificates.pair_bound.item(place),
        )

    def find_bound(self, pair: int) -> int:
        """What a pair's certificate rests on, an index of `BOUND_NAMES`."""
        return self.certificates.pair_bound.item(divmod(pair, self._links))

    def find_partner(self, pair: int) -> int:
        """Row of the obstacle by whose state a pair was evaluated as well; or NO_PARTNER."""
        row = pair // self._links
        return self.certificates.uses.partner.item(row * USES + CERTIFICATE)

    def list_imminent(self, time: float, *, row_limit: int, pair_limit: int) -> Listing:
        """What is most imminent at `time`, in [s] since the epoch; cheap, and the caller's own."""
        certificates, links = self.certificates, len(self.arm.links)
        wanted = min(max(row_limit, pair_limit), int(certificates.numbers[ACTIVE]))
        rows = np.zeros(wanted, dtype=np.int64)
        rows = rows[: find_most_imminent(self._handle, rows)]
        # Obstacles may have been removed since, and others taken their rows.
        rows = rows[~np.isin(rows, self._obstacles.membership_changes())]
        row_expiry = entries_of(certificates.expiry_tree)[rows]
        pairs = self._pairs_of(rows)
        expiry = certificates.pair_expiry[pairs // links, pairs % links]
        order = _find_first(expiry, pair_limit)
        pairs = pairs[order]
        places = pairs // links, pairs % links
        return Listing(
            rows=rows[:row_limit],
            row_expiry=row_expiry[:row_limit],
            pairs=pairs,
            expiry=expiry[order],
            evaluated_at=certificates.evaluated_at[places[0]],
            sphere=certificates.pair_sphere[places].astype(np.int64),
            bound=certificates.pair_bound[places].astype(np.int64),
            sphere_expiry=self._sphere_expiry(time, rows),
            all_expiry=expiry,
        )

    def _sphere_expiry(self, time: float, rows: IntArray) -> FloatArray:
        """Soonest contact of each finest sphere; what was not evaluated has its link's time."""
        state, certificates = self.arm.state, self.certificates
        tree = state.tree
        seen = np.isfinite(state.sphere_time)
        self._seen_expiry[seen] = time + state.sphere_time[seen]
        state.sphere_time.fill(np.inf)
        expiry = np.where(certificates.watched[rows], certificates.pair_expiry[rows], np.inf)
        # Obstacles that are not listed are later than the last one that is.
        beyond = expiry.min(axis=1)[-1] if len(rows) else np.inf
        of_link = np.minimum(expiry.min(axis=0, initial=np.inf), beyond)[state.link_of]
        # A sphere that was seen lately is known better than its link, until that has come true.
        known = np.where(self._seen_expiry > time, self._seen_expiry, of_link)
        return np.maximum(known, of_link)[tree.first_child < 0]

    def _pairs_of(self, rows: IntArray) -> IntArray:
        """The pairs that are watched of some rows, row by row. Shape (m,)."""
        pairs = rows[:, None] * self._links + np.arange(self._links)
        return pairs[self.certificates.watched[rows]]

    def _prepare(self) -> None:
        """Lay out everything for the links that the robot has now."""
        self.arm, is_prepared = self._layouts.find(self._robot)
        self._isotropic = self.arm.motion.isotropic
        self._links = len(self.arm.links)
        self._placed = -2
        self._watcher = self._obstacles.start_watching()
        self._seen_expiry = np.full(len(self.arm.state.tree.radius), -np.inf)
        desk = self._desks.pop(self.arm, None)
        table = self._obstacles.table
        if desk is not None and desk.bodies is table.accepted:
            for array, fresh in zip(_list_own(desk.certificates), desk.fresh, strict=True):
                array[...] = fresh
            table.reference_states.point_count.fill(0)
            self._use(desk)
        else:
            self._make_certificates()
        if not is_prepared:
            self._compile()

    def _make_certificates(self) -> None:
        # What the certificates of another scheduler rested on is of no use here.
        self._obstacles.table.reference_states.point_count.fill(0)
        self._use(self._lay_desk(self.arm, self._make_empty(self.arm), is_fresh=True))

    def _make_empty(self, arm: WatchedArm) -> Certificates:
        permits_contact = self._settings.permits_contact
        return make_certificates(len(arm.links), permits_contact=permits_contact)

    def _fit(self) -> None:
        """Follow the obstacle table's size."""
        self._use(self._lay_desk(self.arm, self.certificates, is_fresh=False))

    def _use(self, desk: _Desk) -> None:
        self._desk = desk
        self.certificates, self._candidates = desk.certificates, desk.candidates
        self._handle, self._tick_data = desk.handle, desk.tick_data
        self._advance, self._evaluate_due, self._find_unsafe, self._recall_stops = desk.codes
        if desk.limit_codes:
            (
                self._find_harm, self._find_permitted, self._find_touch, self._find_forbidden
            ) = desk.limit_codes  # fmt: skip

    def _lay_desk(self, arm: WatchedArm, certificates: Certificates, *, is_fresh: bool) -> _Desk:
        """Certificates that have the obstacle table's size, and what ticks run on them."""
        table = self._obstacles.table
        certificates = grow_certificates(certificates, table.changed_rows, table.reference_states)
        candidates = np.zeros(len(certificates.watched), dtype=np.int64)
        scene = arm.state.scene
        settings = self._settings
        tick_data = pack(
            TickData(
                scene, certificates, self._states.guard, self._record,
                settings.braking_delay, self._max_staleness, settings.aware_margin,
                settings.period, self._budget, self._crowd, settings.rise_delay,
                scene.settings.with_joints,
            )
        )  # fmt: skip
        handle = pack(certificates)
        limit_codes: tuple[Any, ...] = ()
        if certificates.permits_contact:
            limit_codes = (
                machine_code(find_first_harm, handle),
                machine_code(find_permitted_contact, tick_data, 0.0, 0.0, candidates),
                machine_code(find_touch, tick_data, Moment(0.0, 0.0, 0, 0.0, 0.0), candidates),
                machine_code(find_forbidden, arm.state.handle, 0, 0, certificates.watched[0], 0.0),
            )
        return _Desk(
            table.accepted,
            certificates,
            [array.copy() for array in _list_own(certificates)] if is_fresh else [],
            candidates,
            handle,
            tick_data,
            self._bind(tick_data, candidates),
            limit_codes,
        )

    def _bind(self, handle: Any, candidates: IntArray) -> tuple[Any, Any, Any, Any]:
        """Have compiled what a tick runs, for the arrays that there are now."""
        moment, question = (
            Moment(0.0, 0.0, 0, 0.0, 0.0),
            StopQuestion(0.0, 0.0, 0.0, 0.0, 0.0, True, 0.0, 0, 0),
        )
        some = np.zeros((2, 2))[:, 0]  # a single joint's would be of another type
        return (
            machine_code(advance, handle, 0.0, some, some, 0.0, 0.0, 0, True),
            machine_code(evaluate_due, handle, True, 0, moment),
            machine_code(find_unsafe, handle, moment, question, candidates),
            machine_code(recall_stops, handle, 0, 0.0, 0.0, 0.0, 0.0, True, 0.0, candidates),
        )

    def _compile(self) -> None:
        """Run every kernel once on nothing, so that none is compiled in a tick."""
        zeros, none = np.zeros(len(self._robot.joints)), np.zeros(0, dtype=np.int64)
        insert(self._handle, none, np.zeros((0, len(self.arm.links)), dtype=np.bool_))
        remove(self._handle, none)
        end_uses(self._handle, none)
        invalidate_all(self._handle)
        # Numbers of ticks begin at 1.
        tick = Tick(-1, 0.0, 0.0, zeros, zeros, 0.0, 0.0, 0.0)
        Scheduler.evaluate_due(self, tick)
        self.find_unsafe(tick, 0.0)
        evaluate(self.arm.state, none, np.zeros(0), none, np.zeros(0, dtype=np.int8))
        self.arm.state.prepare_arm(zeros, zeros)
        find_most_imminent(self._handle, none)


def _read_kept(kept_since: float | None) -> tuple[bool, float]:
    """Whether an arm is meant that keeps to a speed scale, and since when proofs of it count."""
    return kept_since is not None, -np.inf if kept_since is None else kept_since


def _moment_of(tick: Tick) -> Moment:
    """A tick, as compiled code is told of it."""
    return Moment(tick.now, tick.time, tick.number, tick.arm_age, tick.refinement_threshold)


def _find_first(values: FloatArray, count: int) -> IntArray:
    """Indices of the `count` least values, the least first, equal ones in their order."""
    if len(values) > 4 * count > 0:
        # Among so many, only those that can be among the first are put in order.
        last = np.partition(values, count - 1)[count - 1]
        few = np.flatnonzero(values <= last)
        return few[np.argsort(values[few], kind="stable")][:count]
    return np.argsort(values, kind="stable")[:count]
