"""Committed pieces: parts of a path with their own stop, on which nothing can touch the arm.

A controller that moves only on safe pieces needs no STOP for obstacles that keep their bounds. If
the next piece is refused, or no answer arrives, it follows its present piece to the end, where the
arm is at rest. So no verdict has to arrive, and no reaction time enters.

The monitor does not know whether an answer arrived: it may be lost or still in transit. So the arm
can be on any piece that was answered safe, whatever was answered later. Such a piece is kept, and
judged again when obstacles change, until one of these rules it out:

- A joint state that no arm on it can have, measured after its answer must have arrived.
- A later piece that covers it: an arm on the older one is always also on the later one. The mere
  beginning of a later piece rules out nothing, nor does one that does not continue this one. If the
  later answer was lost, the arm is still on the older piece, or will take it up.
- Its end. An arm at rest there touches nothing.

An arm that is at rest until its first piece, and then follows only pieces that were answered safe,
is on a kept piece at every time. So a proof about all kept pieces is a proof about this arm.

The arm counts as free if joint states show that it is on no kept piece, if a new payload ends a
premise of the proofs, or if an obstacle makes a piece unsafe. The stop decision bounds a free arm.
Pieces that it could still be on, or take up, stay on a list of *open* pieces. No piece is committed
while one is open: if the answer or the STOP is late or lost, the arm might follow the open piece.

A controller that commits often leaves many similar pieces. From `MANY_PIECES` on, two of them are
merged into one, see `_join_two`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.planned.check import PlanCheck
from armguard.bounds.planned.contact import NONE, Permissions
from armguard.bounds.planned.course import PlannedCourse
from armguard.bounds.planned.curve import find_top_speeds
from armguard.bounds.planned.following import Following
from armguard.bounds.planned.motion import PlannedMotion
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal, read_plan
from armguard.bounds.planned.stop import append_stop
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.monitor.plan_verdict import refuse_plan
from armguard.obstacles.tethers import TIED
from armguard.pairs.course_clamps import NOTHING, find_obstacle_speeds
from armguard.pairs.receding import PieceMotion, find_pressing_link, sum_up_motion
from armguard.pairs.touching import NO_LINK
from armguard.robot.brakes import find_gentlest_stop
from armguard.robot.robot import Robot
from armguard.scheduling.certificates import agrees, keep_known_state, make_known_states
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.scheduling.tether_uses import find_excess
from armguard.settings.settings import Settings
from armguard.verdict import PlanVerdict, Reason, ReasonKind

MOST_PIECES = 64
"""Greatest number of pieces that the arm can be on at a time."""
MANY_PIECES = 16
"""From this number of pieces on, two of them are merged if that is safe."""
USUAL_PIECES = 16
"""Number of pieces with memory allocated at the start, so that few commits must allocate."""
MOST_TRIED = 3
"""Number of pairs of pieces for which a commit tries to merge."""


class KnownObstacles:
    """The obstacle states with which pieces were proved safe, and whether they still hold.

    Pieces are identified by the number of their place, from 0.

    Args:
        scheduler: Provides the obstacles.
    """

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler
        self._kinds: tuple[Any, Any] | None = None
        self._forget()
        for _ in range(USUAL_PIECES):
            self._make_room()

    def keep(self, place: int) -> None:
        """Store the present obstacle states for a piece; replaces the stored ones."""
        arm = self._scheduler.arm
        if self._find_shape() != self._shape:
            # What was kept of obstacles in other rows is not known any more.
            self._forget()
        while place >= len(self._rooms):
            self._make_room()
        self._changes[place] = arm.obstacles.table.changes
        self._keep_all(arm.state.handle, self._rooms[place])

    def has_changed(self, place: int) -> bool:
        """Whether an obstacle is new, or has a state that the stored one does not allow."""
        arm = self._scheduler.arm
        kept = self._changes.get(place)
        if kept != arm.obstacles.table.changes or self._find_shape() != self._shape:
            return True
        changed: bool = self._find_change(arm.state.handle, self._rooms[place])
        return changed

    def _find_shape(self) -> tuple[Any, int, int]:
        """Shape of the stored arrays: rows of obstacles, and points per row."""
        state = self._scheduler.arm.state
        rows, width, _ = state.bodies.points.shape
        return state.handle.kind, rows, width

    def _forget(self) -> None:
        """Drop all stored states, because obstacles have changed rows."""
        self._shape = self._find_shape()
        self._changes: dict[int, int] = {}
        self._rooms: list[Any] = []

    def _make_room(self) -> None:
        """Allocate memory for one more piece, and for the table's number of obstacles."""
        _, rows, width = self._shape
        room = pack(make_known_states(rows, width))
        self._rooms.append(room)
        handles = self._scheduler.arm.state.handle, room
        kinds = handles[0].kind, handles[1].kind
        if kinds != self._kinds:
            self._kinds = kinds
            self._keep_all = machine_code(_keep_all, *handles)
            self._find_change = machine_code(_find_change, *handles)


class Piece(NamedTuple):
    """A piece that the arm may be on."""

    plan: CheckedPlan
    course: PlannedCourse
    before: tuple[CheckedPlan, ...]
    """Pieces that the arm may follow until this piece begins."""
    place: int
    """Place of the stored obstacle states that its proof rests on, see `KnownObstacles`."""


class CommittedPieces:
    """Judges pieces, and keeps those that the arm can be on.

    Args:
        robot: The arm.
        scheduler: Provides the pairs.
        settings: Of the monitor.

    Attributes:
        is_proved: Whether the arm is on a piece, and nothing can touch it until it is at rest.
        evaluated: Number of evaluations since the last joint state.
    """

    def __init__(self, robot: Robot, scheduler: Scheduler, settings: Settings) -> None:
        self.evaluated = 0
        self._judged: tuple[int, float] = NONE, 0.0
        self._permitted: dict[int, tuple[int, float]] = {}
        self._joints = robot.joints
        self._scheduler = scheduler
        self._check = PlanCheck(robot, self._planned_motion().brakes)
        self._following = Following(robot)
        self._latency = settings.latency
        self._margin = settings.margin
        self._limits = settings.contact_limits
        self._with_velocities = settings.permits_contact
        # Whether joints may leave a piece at any moment, to brake by themselves.
        self._may_leave = settings.leave == "any"
        self._known = KnownObstacles(scheduler)
        self._clamps: tuple[Any, Any] | None = None
        self._pressing: tuple[Any, Any] | None = None
        self.reset()

    def reset(self) -> None:
        """Drop all pieces: the arm takes up none of them, and counts as free."""
        self._count_as_free([])

    @property
    def plans(self) -> list[CheckedPlan]:
        """The pieces that the arm may be on, or may still take up."""
        return [*(piece.plan for piece in self._pieces), *self._open]

    @property
    def proved_until(self) -> float | None:
        """Latest time at which an arm on a proved piece is at rest, in [s]; None: on none."""
        if not self.is_proved:
            return None
        return max(_find_end(piece.course) for piece in self._pieces)

    @property
    def permitted(self) -> tuple[int, float]:
        """The fastest permitted contact that is possible on a kept piece.

        Returns its pair, negative without one, and the greatest speed of its link, in [m]/[s].
        """
        known = (self._permitted[piece.place] for piece in self._pieces)
        return max(known, key=lambda one: one[1], default=(NONE, 0.0))

    def drop(self, subject: str, detail: str) -> Reason | None:
        """Count no piece as proved, after a premise has ended; None if none was proved."""
        if not self.is_proved:
            return None
        self._count_as_free(self._pieces)
        return Reason(ReasonKind.PLAN_VOID, subject, detail)

    def _count_as_free(self, still_open: list[Piece]) -> None:
        """Count the arm as free; keep the pieces that it may still be on, or take up, as open."""
        self._open = [piece.plan for piece in still_open]
        self._pieces: list[Piece] = []
        self.is_proved = False
        self._motion = self._scheduler.arm.motion.planned

    def with_stop(self, plan: Plan) -> Plan:
        """A plan with a stop at its end; see `Monitor.with_stop`."""
        read = read_plan(plan, len(self._joints))
        if isinstance(read, Refusal):
            raise ArmguardError(read.subject, read.detail, expected="a plan to stop from")
        times, q, v = (np.asarray(part) for part in (read.times, read.q, read.v))
        brakes = self._planned_motion().brakes
        stopped = append_stop(plan, find_gentlest_stop(brakes, find_top_speeds(times, q, v)))
        if isinstance(stopped, Refusal):
            raise ArmguardError(stopped.subject, stopped.detail, expected="a plan to stop from")
        return stopped

    def commit(self, plan: Plan, tick: Tick) -> PlanVerdict:
        """Judge a piece at the last tick; if it is safe, the arm may be on it from now on."""
        now, pieces = tick.now, self._pieces
        if self._open:
            latest = max(plan.end for plan in self._open)
            return refuse_plan(
                "plan",
                "the arm may still follow a piece that was answered safe before: wait until joint "
                f"states rule that out, for {latest - now:.3g} s at most",
            )
        checked = self._check.check(plan, now, tick.q, tick.v, now - tick.arm_age)
        if isinstance(checked, Refusal):
            return refuse_plan(*checked)
        first = max(now, checked.stamp)
        last = max(first, now + self._latency)
        # Covered ones need not be kept. But the new piece covers nothing of what the arm may do
        # before that begins, nor of what an arm does that leaves another one first.
        may_leave_first = self._may_leave and checked.stamp > now
        going_on: list[Piece] = []
        kept: list[Piece] = []
        for piece in pieces:
            refusal, is_covered = self._following.compare(piece.plan, checked, first, last)
            if refusal is None:
                going_on.append(piece)
            if may_leave_first or piece.plan.stamp > now or not is_covered:
                kept.append(piece)
        if pieces and not going_on:
            assert refusal is not None, "the last one disagreed"
            return refuse_plan(*refusal)
        before = tuple(piece.plan for piece in going_on)
        course = self._lay_out(checked, before)
        if isinstance(course, Refusal):
            return refuse_plan(*course)
        contact = self._find_contact(course, tick)
        if contact is not None:
            return contact
        if self._with_velocities:
            pressed = self._find_pressed(checked, course, tick)
            if pressed is not None:
                return pressed
        permitted = self._judged
        kept = self._make_room(self._drop_covered(kept, now), tick)
        if len(kept) >= MOST_PIECES:
            detail = f"is the {MOST_PIECES + 1}th that the arm may be on: commit less often"
            return refuse_plan("plan", detail)
        self._pieces = kept
        place = self._remember()
        # That of the newest one, whatever was judged since.
        self._permitted[place] = permitted
        self._pieces = [*kept, Piece(checked, course, before, place)]
        self._motion = self._planned_motion()
        self.is_proved = True
        return PlanVerdict(True, math.inf, None, None, ())

    def update(self, tick: Tick, stamp: float, *, disturbed: bool, unplaced: bool) -> Reason | None:
        """Process a tick's joint state, and judge the rest of the pieces if obstacles have changed.

        Args:
            tick: The tick.
            stamp: Stamp of its joint state, in [s].
            disturbed: Whether obstacles have changed by more than their stored states allow.
            unplaced: Whether obstacles that found no room in the table could be anywhere.

        Returns:
            Reason why the arm is no longer on a piece, or no longer on a safe one; else None.
        """
        self.evaluated = 0
        self._open = [
            plan
            for plan in self._open
            if tick.now < plan.end and self._can_follow(plan, tick, stamp)
        ]
        if not self._pieces:
            return None
        if unplaced:
            # They are in no pair, so no piece is judged by them.
            self._count_as_free(self._pieces)
            detail = "some found no room, and could be anywhere"
            return Reason(ReasonKind.PIECE_UNSAFE, "obstacles", detail)
        check = self._following.check
        strayed: Refusal | None = None
        kept, is_on_one = [], False
        for piece in self._pieces:
            found = check(piece.plan, tick.q, tick.v, stamp)
            if found is None or self._may_be_on_its_way(piece.plan, stamp):
                # One that the arm can still get to is kept, wherever the arm is until it begins.
                kept.append(piece)
            if found is None:
                found = self._find_waiting_elsewhere(piece, tick, stamp)
            is_on_one |= found is None
            strayed = found or strayed
        if not is_on_one:
            assert strayed is not None, "the last one was not followed"
            self._count_as_free(kept)
            return Reason(ReasonKind.PLAN_VOID, *strayed)
        self._pieces = kept
        motion = self._planned_motion()
        if motion is not self._motion:
            # Another tool: the same way, swept by other spheres.
            self._motion, disturbed = motion, True
            for k, piece in enumerate(kept):
                course = self._lay_out(piece.plan, piece.before)
                if isinstance(course, Refusal):
                    self._count_as_free(kept)
                    return Reason(ReasonKind.PIECE_UNSAFE, *course)
                self._pieces[k] = piece._replace(course=course)
        for piece in self._pieces:
            if not disturbed and not self._known.has_changed(piece.place):
                continue
            contact = self._find_contact(piece.course, tick)
            if contact is not None:
                self._count_as_free(kept)
                (reason,) = contact.reasons
                return Reason(ReasonKind.PIECE_UNSAFE, reason.subject, reason.detail)
            self._known.keep(piece.place)
            self._permitted[piece.place] = self._judged
        return None

    def compile(self, tick: Tick) -> None:
        """Run once what only some ticks need, so that nothing is compiled in a tick.

        Args:
            tick: One of an arm at rest, for nothing is there to touch it yet.
        """
        q = np.tile(tick.q, (2, 1))
        rest = Plan(0.0, np.array([0.0, 1.0]), q, np.zeros_like(q), np.ones(q.shape[1]))
        for _ in range(2):
            self.commit(self.with_stop(rest), tick)
        self.update(tick, 0.0, disturbed=False, unplaced=False)
        if self._with_velocities:
            joints = q.shape[1]
            still = PieceMotion(*np.zeros((2, 1, joints)), *np.zeros((2, joints)))
            self._compile_pressing(still)
        self.reset()

    def _drop_covered(self, pieces: list[Piece], now: float) -> list[Piece]:
        """The pieces that the newest begun piece does not cover from now on."""
        begun = [piece for piece in pieces if piece.plan.stamp <= now]
        if len(begun) < 2:
            return pieces
        *older, newest = begun
        covers = self._following.covers
        covered = {id(piece) for piece in older if covers(piece.plan, newest.plan, now)}
        return [piece for piece in pieces if id(piece) not in covered]

    def _make_room(self, pieces: list[Piece], tick: Tick) -> list[Piece]:
        """Reduce the number of pieces if there are many."""
        if len(pieces) >= MANY_PIECES:
            pieces = self._join_two(pieces, tick)
        if len(pieces) >= MOST_PIECES:
            # On one that has come to its end the arm rests, and a resting arm touches nothing: to
            # forget that it may be there can only cost a STOP.
            pieces = [piece for piece in pieces if not _is_at_rest(piece.course, tick.now)]
        return pieces

    def _join_two(self, pieces: list[Piece], tick: Tick) -> list[Piece]:
        """Merge two of the pieces into one, if an arm on either one is still safe.

        The newer piece gets deviations so wide that an arm on the older one is also on it, and is
        proved again. Neighbours whose positions of rest are nearest to each other are tried first.
        """
        ends = np.array([piece.plan.q[-1] for piece in pieces])
        widths = np.array([piece.plan.deviation for piece in pieces])
        apart = (np.abs(np.diff(ends, axis=0)) + widths[:-1]).max(axis=1)
        for k in np.argsort(apart, kind="stable")[:MOST_TRIED]:
            older, newer = pieces[k : k + 2]
            one = self._join(older, newer, tick)
            if one is not None:
                self._known.keep(one.place)
                return [*pieces[:k], one, *pieces[k + 2 :]]
        return pieces

    def _join(self, older: Piece, newer: Piece, tick: Tick) -> Piece | None:
        """Both pieces merged into one; None if that is not proved safe."""
        waits = newer.plan.stamp > tick.now
        if older.plan.stamp > newer.plan.stamp or (waits and self._may_leave):
            # What the arm does on the older one before the newer one begins, or when it leaves it
            # then, is not on the course of the newer one.
            return None
        wide = self._following.widen(older.plan, newer.plan, max(tick.now, newer.plan.stamp))
        # What is known of the joints now is known of an arm on either.
        plan = wide._replace(
            now=tick.now,
            measured_stamp=tick.now - tick.arm_age,
            measured_q=tick.q.copy(),
            measured_v=tick.v.copy(),
        )
        before = (*older.before, older.plan, *newer.before) if waits else ()
        course = self._lay_out(plan, before)
        if isinstance(course, Refusal) or self._find_contact(course, tick) is not None:
            return None
        self._permitted[newer.place] = self._judged
        return Piece(plan, course, before, newer.place)

    def _can_follow(self, plan: CheckedPlan, tick: Tick, stamp: float) -> bool:
        """Whether the joint state allows the arm to be on a piece, or to take it up."""
        is_on = self._following.check(plan, tick.q, tick.v, stamp) is None
        return is_on or self._may_be_on_its_way(plan, stamp)

    def _may_be_on_its_way(self, plan: CheckedPlan, stamp: float) -> bool:
        """Whether the answer may still be in transit at a stamp; the arm may take it up later."""
        return stamp < plan.now + self._latency

    def _find_waiting_elsewhere(self, piece: Piece, tick: Tick, stamp: float) -> Refusal | None:
        """Why the arm is not where a piece's proof assumes it until the piece begins; else None."""
        if stamp >= piece.plan.stamp:
            return None
        found = None
        for one in piece.before:
            found = self._following.check(one, tick.q, tick.v, stamp)
            if found is None:
                return None
        return found

    def _planned_motion(self) -> PlannedMotion:
        motion = self._scheduler.arm.motion.planned
        assert motion is not None, "a monitor commits to plans only where it bounds them"
        return motion

    def _lay_out(
        self, plan: CheckedPlan, before: tuple[CheckedPlan, ...]
    ) -> PlannedCourse | Refusal:
        """The region of the arm from the check of a piece until rest."""
        motion, with_velocities = self._planned_motion(), self._with_velocities
        if not self._may_leave:
            return motion.lay_out(plan, before, with_velocities=with_velocities)
        course = motion.lay_out_left(plan, before, self._latency, with_velocities=with_velocities)
        if course is not None:
            return course
        if plan.stamp > plan.now and not before:
            detail = f"begins in {plan.stamp - plan.now:.4g} s: its brakes are not known until then"
            return Refusal("plan", detail)
        return Refusal("plan", "allows speeds that the brakes are not stated for")

    def _find_contact(self, course: PlannedCourse, tick: Tick) -> PlanVerdict | None:
        """The first possible contact on the rest of a piece; None if nothing can touch the arm.

        Permitted contact does not count.

        Every pair is evaluated: a certificate may rest on older states than those stored here, and
        changes are judged by the stored ones.
        """
        scheduler = self._scheduler
        self._judged = NONE, 0.0
        if _is_at_rest(course, tick.now):
            # It rests, and a resting arm touches nothing.
            return None
        (pairs,) = scheduler.watched_pairs().nonzero()
        state = scheduler.arm.state
        speeds: float | FloatArray = NOTHING
        if self._with_velocities:
            speeds = self._find_obstacle_speeds(course, pairs, tick.now)
        found = self._planned_motion().contact_time(
            course, pairs, tick.now, self._margin, state.bodies, state.refused_bodies, state.marks,
            Permissions(state.scene.contact_limits, speeds), state.scene.tethers,
        )  # fmt: skip
        self._judged = found.permitted_pair, found.permitted_speed
        self.evaluated += found.evaluated
        if found.time == math.inf:
            return None
        link, obstacle = (None, None) if found.pair < 0 else scheduler.arm.names(found.pair)
        detail = f"contact time {found.time:.4g} s"
        if self._limits is not None and found.pair >= 0:
            row = found.pair // len(scheduler.arm.links)
            regions = int(scheduler.arm.obstacles.table.regions[row])
            detail += f"; {self._limits.describe_permitted(regions)}"
        reason = Reason(ReasonKind.PLAN_UNSAFE, f"{link} and {obstacle}", detail)
        return PlanVerdict(False, found.time, link, obstacle, (reason,))

    def _find_obstacle_speeds(
        self, course: PlannedCourse, pairs: IntArray, now: float
    ) -> FloatArray:
        """Greatest speed of whatever each pair's obstacle could be pressed against, in [m]/[s]."""
        handle = self._scheduler.arm.state.handle
        if self._clamps is None or self._clamps[0] is not handle.kind:
            code = machine_code(find_obstacle_speeds, handle, course, pairs, now)
            self._clamps = handle.kind, code
        speeds: FloatArray = self._clamps[1](handle, course, pairs, now)
        return speeds

    def _find_pressed(
        self, plan: CheckedPlan, course: PlannedCourse, tick: Tick
    ) -> PlanVerdict | None:
        """A touching obstacle from which the piece does not provably recede; else None."""
        scheduler = self._scheduler
        rows = scheduler.list_touchable(tick)
        if not len(rows):
            return None
        scheduler.prepare(tick)
        left = course if self._may_leave else None
        motion = sum_up_motion(plan, tick.now, tick.q, left)
        handle, watched = scheduler.arm.state.handle, scheduler.certificates.watched
        find = self._compile_pressing(motion)
        for row in rows.tolist():
            link = find(handle, row, watched[row], motion, tick.now)
            if link != NO_LINK:
                names = scheduler.arm.names(row * watched.shape[1] + link)
                return refuse_plan(
                    f"{names[0]} and {names[1]}",
                    f"{names[1]} touches the arm: the arm must be at rest, or recede on the "
                    "whole piece",
                )
        return None

    def _compile_pressing(self, motion: PieceMotion) -> Any:
        """Compile `find_pressing_link` for the present arrays."""
        handle, watched = self._scheduler.arm.state.handle, self._scheduler.certificates.watched
        if self._pressing is None or self._pressing[0] is not handle.kind:
            code = machine_code(find_pressing_link, handle, 0, watched[0], motion, 0.0)
            self._pressing = handle.kind, code
        return self._pressing[1]

    def _remember(self) -> int:
        """Store the present obstacle states in a place that no other piece uses."""
        used = {piece.place for piece in self._pieces}
        place = next(place for place in range(MOST_PIECES) if place not in used)
        self._known.keep(place)
        return place


def _find_end(course: PlannedCourse) -> float:
    """Time at which an arm on this course is at rest, in [s]."""
    return course.epoch + float(course.end[-1])


def _is_at_rest(course: PlannedCourse, now: float) -> bool:
    """Whether an arm on this course is at rest by a time, in [s]."""
    return _find_end(course) <= now


@kernel
def _keep_all(handle: Any, kept: Any) -> None:
    """Store the states of all rows for a piece."""
    for row in range(handle.content.marks.alive.shape[0]):
        keep_known_state(handle.content.bodies, handle.content.marks, kept.content, row, row)


@kernel
def _find_change(handle: Any, kept: Any) -> bool:
    """Whether a state is refused, lost, or outside what a piece's stored states allow."""
    bodies, marks, known = handle.content.bodies, handle.content.marks, kept.content
    tethers = handle.content.tethers
    for row in range(marks.alive.shape[0]):
        if not marks.alive[row]:
            continue
        if marks.refused[row] or marks.has_state[row] != (known.states.point_count[row] > 0):
            return True
        if marks.revision[row] == known.revision[row]:
            continue
        if not agrees(bodies, marks, known.states, row, row):
            return True
        if tethers.numbers[TIED] > 0:
            # It is among what its partners' states say of it, too.
            for k in range(tethers.row_count[row]):
                number = tethers.of_row[row, k]
                partner = tethers.rows[number, 0] + tethers.rows[number, 1] - row
                length = tethers.length[number]
                # Of what is broken already, nothing is proved by the tether.
                excess = find_excess(known.states, partner, bodies, row, length)
                if excess > 0.0 and not tethers.is_broken[number]:
                    return True
        known.revision[row] = marks.revision[row]
    return False
