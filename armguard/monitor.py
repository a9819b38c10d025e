"""The monitor: one joint state in, one verdict out, at every tick.

The only module that knows the whole chain: joint state, kinematics, bounds, obstacles, schedule,
evaluation, exact check, verdict. `step` never raises on what comes from outside; it says STOP and
why. It reads no clock, does no I/O and logs nothing, so that a replay of its inputs gives the same
verdicts to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from armguard.bounds import IsotropicMotion
from armguard.exact import ExactGeometry
from armguard.exceptions import ArmguardError
from armguard.flagged import FlaggedCheck
from armguard.ignored_pairs import IgnoredPairs
from armguard.joint_states import JointStates
from armguard.kinematics import Kinematics
from armguard.ledger import NOBODY, PairLedger
from armguard.obstacle_reasons import take_obstacle_reasons
from armguard.obstacles import Obstacles
from armguard.pair_reports import PairReport, report_pair
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
        self._ignored = IgnoredPairs(ignore, robot)
        self._horizon = self.period + latency
        self._reaction_time = reaction_time
        self._source_timeout = source_timeout
        self._freshness = freshness
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
        self._flagged = FlaggedCheck(self._exact, self._motion, self._state)
        self._ledger = PairLedger(
            len(robot.links), self._watched_links, keeps_certificates=not self._schedule.every_tick
        )
        self._epoch: float | None = None
        self._now = -math.inf
        self._sequence = 0
        self._evaluated = 0
        self._contact_times = np.zeros(0)
        self._spheres = np.zeros(0, dtype=np.int64)
        self._braking_scale = float(np.min(robot.braking_deceleration / robot.velocity_limit))
        self._disbelieved = 0
        self._faults_before = obstacles.fault_count
        self._compile()
        self._watcher = obstacles.start_watching()

    @property
    def faults(self) -> int:
        """Faults since construction: refused rows and calls, and states not believed."""
        return self._disbelieved + self.obstacles.fault_count - self._faults_before

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
                _as_time(stamp),
                Reason(ReasonKind.INTERNAL_ERROR, type(error).__name__, str(error)),
            )

    def reset(self) -> None:
        """Forget latched faults and past joint states; every pair is looked at anew."""
        self._rule.reset()
        self._states.reset()
        # An error may have struck anywhere, so nothing that is known of pairs is kept.
        self._schedule.remove(self._schedule.ranking())
        self._ledger.clear()
        self._watcher = self.obstacles.start_watching()
        self._now = -math.inf
        self._epoch = None

    def pairs(self, limit: int = 64) -> list[PairReport]:
        """The most imminent pairs as of the last tick, soonest first, at most `limit`."""
        if self._epoch is None:
            return []
        ledger, state = self._ledger, self._state
        now = self._now - self._epoch
        # Obstacles may have been removed since.
        there = ledger.pairs[state.marks.alive[ledger.pairs // ledger.link_count]]
        order = np.argsort(ledger.expiry[there], kind="stable")[:limit]
        return [
            report_pair(pair, now, self.period, self._names(pair), ledger, state, self._exact)
            for pair in there[order].tolist()
        ]

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
        stopping = self._states.stopping()
        reasons = [] if stopping is None else [stopping]
        reasons += take_obstacle_reasons(self.obstacles, now, self._source_timeout)
        self._kinematics.compute(self._states.q, self._states.v)
        self._motion.update(self._states.v)
        stop_time = self._stop_time(now - stamp)
        self._look(now, now - stamp, stop_time, reasons)
        return self._judge(stamp, now, stop_time, reasons)

    def _follow_membership(self) -> None:
        if self.obstacles.watcher != self._watcher:
            raise ArmguardError(
                "obstacles",
                "are watched by another monitor, which came later",
                remedy="give each monitor obstacles of its own",
            )
        added, removed = self.obstacles.drain_membership()
        if not len(added) and not len(removed):
            return
        fresh, gone = self._ledger.change(added, removed, len(self.obstacles.table.alive))
        self._schedule.remove(gone)
        self._schedule.insert(fresh)
        if len(self._contact_times) < len(self._ledger.active):
            self._contact_times = np.zeros(len(self._ledger.active))
            self._spheres = np.zeros(len(self._ledger.active), dtype=np.int64)

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
        due = np.array(schedule.due())
        times = self._contact_times[: len(due)]
        spheres = self._spheres[: len(due)]
        self._evaluated = evaluate(state, due, times, spheres)
        ledger.record(due, times, spheres, time, self._sequence, state)
        schedule.settle(times, stop_time)
        for pair in schedule.flagged().tolist():
            contact_time = self._flagged.contact_time(*divmod(pair, ledger.link_count))
            ledger.extend(pair, contact_time, time, self._sequence, state)

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
        link, obstacle = (None, None) if pair == NOBODY else self._names(pair)
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
        self._disbelieved += 1
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
            valid_until=math.nextafter(now + self._horizon, -math.inf),
        )

    def _names(self, pair: int) -> tuple[str, str]:
        row, link = divmod(pair, self._ledger.link_count)
        return self.robot.links[link], self.obstacles.ids[row]

    def _watched_links(self, row: int) -> NDArray[np.bool_]:
        """Which links are watched against the obstacle in `row`. Shape (links,)."""
        return self._ignored.watched_links(self.obstacles.ids[row])

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


def _as_time(value: object) -> float:
    """A time in [s]; NaN for whatever is not one number."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _check_not_negative(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 <= value < math.inf:
            raise ArmguardError(name, f"is {value}", expected="a finite number, at least 0")
