"""The monitor: one joint state in, one verdict out, at every tick.

The only module that knows the whole chain: joint state, kinematics, bounds, obstacles, schedule,
evaluation, exact check, verdict. `step` never raises on what comes from outside; it says STOP and
why. It reads no clock, does no I/O and logs nothing, so that a replay of its inputs gives the same
verdicts to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from armguard.bounds import IsotropicMotion
from armguard.exact import ExactGeometry
from armguard.exceptions import ArmguardError
from armguard.joint_states import JointStates
from armguard.kinematics import Kinematics
from armguard.ledger import PairLedger
from armguard.obstacle_faults import Fault
from armguard.obstacles import Obstacles
from armguard.pairs import TickState, evaluate
from armguard.robot import Robot
from armguard.schedules import Schedule, make_schedule
from armguard.snapshot import Snapshot, take_snapshot
from armguard.verdict import (
    Effect,
    Level,
    Reason,
    ReasonKind,
    Verdict,
    VerdictRule,
    compute_stop_time,
)

ADVANCES = 8
"""Tangent advances per evaluation; nearly every pair has converged by then."""

BUCKETS = 16
"""Grades of imminence: bucket k holds contact times of 2^k to 2^(k+1) periods."""


class PairReport(NamedTuple):
    """One pair as `Monitor.pairs` shows it."""

    link: str
    obstacle: str
    contact_time: float
    """[s] from the last tick."""
    bucket: int
    """Imminence, 0 (next tick) to 15 (far)."""
    age: float
    """Since the pair was last evaluated, in [s]."""
    bound: str
    """Motion model that decided."""
    point_on_link: NDArray[np.float64]
    """Closest point of the link, [m], world. Shape (3,)."""
    point_on_obstacle: NDArray[np.float64]
    """Closest point of the obstacle as last measured, [m], world. Shape (3,)."""


class Monitor:
    """Supervises one arm among obstacles.

    Everything is compiled here, in the constructor, so that the first tick is like any other.

    Args:
        robot: The arm.
        obstacles: The table that perception writes to.
        rate: Ticks a second, [Hz].
        schedule: "full", "distance", "daa", or a `Schedule` of your own.
        motion: How the arm's possible motion is bounded: "isotropic".
        ignore: Pairs not to be watched, as (link, pattern of obstacle ids); "*" is any.
        reaction_time: From a STOP to braking torque, [s].
        latency: Of computing and transporting a verdict, lateness of a tick included, [s].
        slow_margin: Beyond the stopping time, [s]: SLOW below.
        aware_margin: Beyond the stopping time, [s]: AWARE below.
        hold: Evidence needed before a level rises, [s].
        source_timeout: Silence that a source may keep, and lead of its stamps, [s].
        joint_timeout: Longest step between joint states, [s]; default max(0.05, 5 periods).
        margin: Distance that counts as contact already, [m].
        freshness: How stale an answer may look, as a fraction of itself, in [0, 1).
        base_placement: Of the robot's base in the world; default at the origin.

    Raises:
        ArmguardError: If an argument is out of range or names what does not exist.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        *,
        rate: float = 1000.0,
        schedule: str | Schedule = "full",
        motion: str = "isotropic",
        ignore: Iterable[tuple[str, str]] = (),
        reaction_time: float = 0.02,
        latency: float = 0.002,
        slow_margin: float = 0.1,
        aware_margin: float = 0.3,
        hold: float = 0.3,
        source_timeout: float = 0.2,
        joint_timeout: float | None = None,
        margin: float = 0.0,
        freshness: float = 0.25,
        base_placement: pinocchio.SE3 | None = None,
    ) -> None:
        if not 0.0 < rate < math.inf:
            raise ArmguardError("rate", f"is {rate}", expected="a finite number of hertz above 0")
        self.period = 1.0 / rate
        joint_timeout = max(0.05, 5.0 * self.period) if joint_timeout is None else joint_timeout
        _check_not_negative(
            reaction_time=reaction_time,
            latency=latency,
            slow_margin=slow_margin,
            aware_margin=aware_margin,
            hold=hold,
            source_timeout=source_timeout,
            joint_timeout=joint_timeout,
            margin=margin,
        )
        if not 0.0 <= freshness < 1.0:
            raise ArmguardError("freshness", f"is {freshness}", expected="0 <= freshness < 1")
        if motion != "isotropic":
            raise ArmguardError("motion", f"is {motion!r}", expected='"isotropic"')
        self.robot = robot
        self.obstacles = obstacles
        self.base_placement = base_placement or pinocchio.SE3.Identity()
        self._ignore = _check_ignore(ignore, robot)
        self._horizon = self.period + latency
        self._reaction_time = reaction_time
        self._source_timeout = source_timeout
        self._freshness = freshness
        self._margin = margin
        self._schedule = (
            make_schedule(schedule, self.period) if isinstance(schedule, str) else schedule
        )
        self._rule = VerdictRule(slow_margin, aware_margin, hold)
        self._states = JointStates(robot, joint_timeout)
        self._kinematics = Kinematics(robot, base_placement)
        self._motion = IsotropicMotion(robot, base_placement)
        self._exact = ExactGeometry(robot, self._kinematics)
        self._state = TickState(
            self._kinematics,
            self._motion,
            obstacles,
            margin=margin,
            advances=ADVANCES,
            by_distance=self._schedule.measure == "distance",
        )
        self._ledger = PairLedger(
            len(robot.links), self._watched, keeps_certificates=not self._schedule.every_tick
        )
        self._epoch: float | None = None
        self._now = -math.inf
        self._sequence = 0
        self._evaluated = 0
        self._contact_times = np.zeros(0)
        self._spheres = np.zeros(0, dtype=np.int64)
        self._braking_scale = float(np.min(robot.braking_deceleration / robot.velocity_limit))
        self.faults = 0
        """Faults met since construction: refused rows and calls, and states not believed."""
        self._compile()

    def step(self, stamp: float, q: ArrayLike, v: ArrayLike, now: float | None = None) -> Verdict:
        """Judge one joint state.

        Never raises on bad data: whatever cannot be believed is a STOP with its reason.

        Args:
            stamp: When the joint state was measured, in [s] on the clock of the obstacles' stamps.
            q: Joint positions in the order of `robot.joints`, [rad] or [m]. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
            now: Time of this tick, in [s]; the stamp unless given.
        """
        self._sequence += 1
        self._evaluated = 0
        try:
            return self._step(stamp, q, v, stamp if now is None else now)
        except Exception as error:
            # Whatever went wrong inside, the arm must stop.
            return self._refuse(
                stamp, Reason(ReasonKind.INTERNAL_ERROR, type(error).__name__, str(error))
            )

    def reset(self) -> None:
        """Forget latched faults and past joint states; every pair is looked at anew."""
        self._rule.reset()
        self._states.reset()
        self._ledger.void(self._ledger.pairs)
        self._schedule.touch(self._ledger.pairs)
        self._now = -math.inf
        self._epoch = None

    def pairs(self, limit: int = 64) -> list[PairReport]:
        """The most imminent pairs as of the last tick, soonest first, at most `limit`."""
        if self._epoch is None:
            return []
        ledger = self._ledger
        now = self._now - self._epoch
        order = np.argsort(ledger.expiry[ledger.pairs], kind="stable")[:limit]
        return [self._report(int(pair), now) for pair in ledger.pairs[order]]

    def snapshot(self, *, pair_limit: int, row_limit: int) -> Snapshot:
        """What there is to see of the last tick, for observers; cheap, and their own to keep.

        Args:
            pair_limit: At most so many pairs, the most imminent ones.
            row_limit: At most so many obstacles, likewise.
        """
        time = 0.0 if self._epoch is None else self._now - self._epoch
        return take_snapshot(
            self._ledger,
            self._state,
            self._states.q,
            time,
            self._sequence,
            pair_limit=pair_limit,
            row_limit=row_limit,
        )

    def _step(self, stamp: float, q: ArrayLike, v: ArrayLike, now: float) -> Verdict:
        stamp, now = _as_time(stamp), _as_time(now)
        if not (math.isfinite(now) and math.isfinite(stamp)):
            return self._refuse(stamp, Reason(ReasonKind.TIME_INVALID, f"stamp {stamp}, now {now}"))
        if now < self._now:
            reason = Reason(ReasonKind.TIME_BACKWARDS, "clock", f"{now!r} after {self._now!r}")
            self._now = now
            return self._refuse(stamp, reason)
        self._now = now
        if self._epoch is None:
            self._epoch = now
        self._follow_membership()
        disbelief = self._states.receive(stamp, q, v, now)
        if disbelief is not None:
            return self._refuse(stamp, disbelief)
        reasons = self._standing_faults(now)
        self._kinematics.compute(self._states.q, self._states.v)
        self._motion.update(self._states.v)
        stop_time = self._stop_time(now - stamp)
        self._look(now, now - stamp, stop_time, reasons)
        return self._judge(stamp, now, stop_time, reasons)

    def _follow_membership(self) -> None:
        added, removed = self.obstacles.drain_membership()
        if not len(added) and not len(removed):
            return
        fresh, gone = self._ledger.change(added, removed, len(self.obstacles.table.alive))
        self._schedule.remove(gone)
        self._schedule.insert(fresh)
        if len(self._contact_times) < len(self._ledger.active):
            self._contact_times = np.zeros(len(self._ledger.active))
            self._spheres = np.zeros(len(self._ledger.active), dtype=np.int64)

    def _standing_faults(self, now: float) -> list[Reason]:
        """What forces STOP for as long as it lasts."""
        obstacles = self.obstacles
        reasons: list[Reason] = []
        stopping = self._states.stopping()
        if stopping is not None:
            reasons.append(stopping)
        for name in obstacles.silent_sources(now, self._source_timeout):
            reasons.append(Reason(ReasonKind.SOURCE_SILENT, name))
        for name in obstacles.ahead_sources(now, self._source_timeout):
            reasons.append(Reason(ReasonKind.STAMP_AHEAD, name))
        for row in obstacles.rows_ahead(now, self._source_timeout):
            reasons.append(Reason(ReasonKind.STAMP_AHEAD, obstacles.ids[row]))
            obstacles.distrust(row)
        named = set()
        for fault in obstacles.take_faults():
            self.faults += 1
            named.add(fault.id)
            reasons.append(_as_reason(fault))
        for row in obstacles.refused_rows():
            if obstacles.ids[row] not in named:
                reasons.append(Reason(ReasonKind.OBSTACLE_REFUSED, obstacles.ids[row]))
        return reasons

    def _stop_time(self, age: float) -> float:
        robot = self.robot
        stop_time: float = compute_stop_time(
            self._states.v,
            robot.velocity_error,
            robot.velocity_limit,
            robot.acceleration_limit,
            robot.braking_deceleration,
            age,
            self._horizon,
            self._reaction_time,
        )
        return stop_time

    def _look(self, now: float, arm_age: float, stop_time: float, reasons: list[Reason]) -> None:
        """Evaluate the pairs that are due and check the flagged ones exactly."""
        ledger, state, schedule = self._ledger, self._state, self._schedule
        time = now - (self._epoch or 0.0)
        # Children are opened only where a closer look could still matter to the level.
        opening_time = (stop_time + self._rule.aware_margin) / (1.0 - self._freshness)
        state.begin(now, arm_age, opening_time)
        grown, broken = ledger.disturbed(state, self.obstacles.table.revision)
        for disturbed in (grown, broken):
            if len(disturbed):
                ledger.void(disturbed)
                schedule.touch(disturbed)
        for row in dict.fromkeys((broken // ledger.link_count).tolist()):
            reasons.append(Reason(ReasonKind.BOUND_BROKEN, self.obstacles.ids[row]))
        due = schedule.due()
        times = self._contact_times[: len(due)]
        spheres = self._spheres[: len(due)]
        self._evaluated = evaluate(state, due, times, spheres)
        ledger.record(due, times, spheres, time, self._sequence, state)
        schedule.settle(times, stop_time)
        for pair in schedule.flagged():
            contact_time = self._exact_contact_time(int(pair), arm_age)
            ledger.extend(int(pair), contact_time, time, self._sequence, state)

    def _exact_contact_time(self, pair: int, arm_age: float) -> float:
        """True distance over the fastest closing speed, in [s]: for pairs between two looks."""
        row, link = divmod(pair, self._ledger.link_count)
        marks, state, motion = self._state.marks, self._state, self._motion
        if not marks.has_state[row] or marks.refused[row]:
            return 0.0
        body = state.bodies
        count = int(body.point_count[row])
        distance, _, _ = self._exact.distance(
            link, body.points[row, :count], float(body.radius[row])
        )
        velocity = np.linalg.norm(body.velocities[row, :count], axis=1).max()
        speed = float(max(body.speed[row], velocity + body.velocity_error[row]))
        age = 0.0 if marks.static[row] else abs(self._now - float(body.stamp[row]))
        arm_speed = float(motion.surface_speed[link])
        gap = distance - self._margin - float(body.position_error[row])
        gap -= float(motion.surface_position_error[link]) + speed * age + arm_speed * abs(arm_age)
        if not gap > 0.0:
            return 0.0
        return gap / (speed + arm_speed) if speed + arm_speed > 0.0 else math.inf

    def _judge(self, stamp: float, now: float, stop_time: float, reasons: list[Reason]) -> Verdict:
        """The verdict of a tick whose arm state is believed."""
        time = now - (self._epoch or 0.0)
        pair, contact_time, overdue = self._ledger.earliest(time, self._sequence)
        if overdue:
            reasons.append(Reason(ReasonKind.OVERDUE, detail=f"{overdue} pairs"))
        if not self.obstacles.has_sources:
            reasons.append(Reason(ReasonKind.NO_SOURCES))
        standing = any(reason.kind.effect is Effect.STANDING for reason in reasons)
        level, held = self._rule.decide(
            now, contact_time, stop_time, complete=not overdue, standing=standing
        )
        link, obstacle = self._names(pair)
        if self._rule.grade(contact_time, stop_time) is not Level.CLEAR:
            reasons.append(
                Reason(ReasonKind.CONTACT, f"{link} and {obstacle}", f"in {contact_time:.4g} s")
            )
        if held:
            reasons.append(Reason(ReasonKind.HOLD))
        scale = (contact_time - self._horizon - self._reaction_time) * self._braking_scale
        return Verdict(
            stamp=stamp,
            sequence=self._sequence,
            level=level,
            contact_time=contact_time,
            stop_time=stop_time,
            speed_scale=0.0 if level is Level.STOP else min(max(scale, 0.0), 1.0),
            link=link,
            obstacle=obstacle,
            complete=not overdue,
            evaluated=self._evaluated,
            reasons=(*self._rule.latched.values(), *reasons),
            valid_until=math.nextafter(now + self._horizon, -math.inf),
        )

    def _refuse(self, stamp: float, reason: Reason) -> Verdict:
        """The verdict of a tick whose arm state is not believed: the worst of everything."""
        self.faults += 1
        self._rule.latch(reason)
        now = self._now if math.isfinite(self._now) else 0.0
        self._rule.decide(now, 0.0, math.inf, complete=False, standing=True)
        return Verdict(
            stamp=stamp,
            sequence=self._sequence,
            level=Level.STOP,
            contact_time=0.0,
            stop_time=math.inf,
            speed_scale=0.0,
            link=None,
            obstacle=None,
            complete=False,
            evaluated=self._evaluated,
            reasons=tuple(self._rule.latched.values()),
            valid_until=now + self._horizon,
        )

    def _names(self, pair: int) -> tuple[str | None, str | None]:
        if pair < 0:
            return None, None
        row, link = divmod(pair, self._ledger.link_count)
        return self.robot.links[link], self.obstacles.ids[row]

    def _report(self, pair: int, now: float) -> PairReport:
        row, link = divmod(pair, self._ledger.link_count)
        bodies = self._state.bodies
        contact_time = max(0.0, float(self._ledger.expiry[pair]) - now)
        _, on_link, on_obstacle = self._exact.distance(
            link, bodies.points[row, : int(bodies.point_count[row])], float(bodies.radius[row])
        )
        return PairReport(
            link=self.robot.links[link],
            obstacle=self.obstacles.ids[row],
            contact_time=contact_time,
            bucket=bucket_of(contact_time, self.period),
            age=now - float(self._ledger.evaluated_at[pair]),
            bound="distance" if self._state.by_distance else "isotropic",
            point_on_link=on_link,
            point_on_obstacle=on_obstacle,
        )

    def _watched(self, row: int) -> NDArray[np.bool_]:
        """Which links are watched against the obstacle in `row`. Shape (links,)."""
        name = self.obstacles.ids[row]
        return np.array(
            [
                not any(
                    pattern in (link, "*") and fnmatchcase(name, ids)
                    for pattern, ids in self._ignore
                )
                for link in self.robot.links
            ]
        )

    def _compile(self) -> None:
        """Run every kernel once on nothing, so that none is compiled in a tick."""
        zeros = np.zeros(len(self.robot.joints))
        self._kinematics.compute(zeros, zeros)
        self._motion.update(zeros)
        self._stop_time(0.0)
        self._state.begin(0.0, 0.0, 0.0)
        none = np.zeros(0, dtype=np.int64)
        evaluate(self._state, none, self._contact_times, self._spheres)
        self._ledger.compile(self._state, self.obstacles.table.revision)


def bucket_of(contact_time: float, period: float) -> int:
    """Imminence of a contact time: floor(log2(contact_time / period)), clipped to 0 … 15."""
    if not contact_time > period:
        return 0
    if contact_time == math.inf:
        return BUCKETS - 1
    return min(int(math.log2(contact_time / period)), BUCKETS - 1)


def _as_time(value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def _as_reason(fault: Fault) -> Reason:
    kind = ReasonKind.OBSTACLE_REFUSED if fault.id else ReasonKind.CALL_REFUSED
    return Reason(kind, fault.id or fault.source, f"{fault.field} is {fault.value}: {fault.kind}")


def _check_not_negative(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 <= value < math.inf:
            raise ArmguardError(name, f"is {value}", expected="a finite number, at least 0")


def _check_ignore(ignore: Iterable[tuple[str, str]], robot: Robot) -> list[tuple[str, str]]:
    pairs = [(link, ids) for link, ids in ignore]
    for link, _ in pairs:
        if link != "*" and link not in robot.links:
            raise ArmguardError(
                f"ignore: link {link!r}",
                "is not watched",
                expected=f'one of {", ".join(robot.links)} or "*"',
            )
    return pairs
