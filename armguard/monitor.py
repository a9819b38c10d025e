"""The monitor: one joint state in, one verdict out, at every tick.

The only module that knows the whole chain: joint state, kinematics, bounds, obstacles, schedule,
evaluation, exact check, verdict. `step` never raises on what comes from outside; it says STOP and
why. It reads no clock, does no I/O and logs nothing, so that a replay of its inputs gives the same
verdicts to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from armguard.arm_motion import MOTIONS
from armguard.contact import Certificate
from armguard.exceptions import ArmguardError
from armguard.ignored_pairs import IgnoredPairs
from armguard.joint_states import DOUBTFUL, FAST, JointStates
from armguard.monitor_arguments import check_not_negative, read_budget, read_number
from armguard.obstacle_reasons import take_obstacle_reasons
from armguard.obstacle_watch import ObstacleWatch
from armguard.obstacles import Obstacles
from armguard.pair_reports import PairReport, report_pair
from armguard.pair_watch import PairWatch
from armguard.robot import Robot
from armguard.schedules import DEADLINE, Schedule, make_schedule
from armguard.schedules.wheel import NOBODY
from armguard.snapshot import Snapshot, take_snapshot
from armguard.stop_decision import StopDecision
from armguard.verdict import (
    Effect,
    Level,
    Reason,
    ReasonKind,
    Verdict,
    VerdictRule,
    compute_stop_time,
)
from armguard.watch import Look, Tick, Watch
from armguard.watched_arm import WatchedArm


class Monitor:
    """Supervises one arm among obstacles.

    Everything is compiled here, in the constructor, so that the first tick is like any other.

    Args:
        robot: The arm.
        obstacles: The table that perception writes to.
        rate: Ticks a second, [Hz].
        schedule: "deadline", "full", "distance", "daa", or a `Schedule` of your own.
        motion: How the arm's possible motion is bounded: "joint" (by its joints' limits, and a STOP
            only where braking after the next tick could be too late) or "isotropic" (points of the
            arm as free bodies; cheaper, and far more cautious).
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
        budget: Evaluations in a tick after which no further obstacle is begun; what misses its
            deadline is a STOP. For "deadline" only; default: no limit.
        base_placement: Of the robot's base in the world; default at the origin.
        certify: Attach to each verdict a certificate of the pair that decides it; takes a fraction
            of a millisecond a tick.

    Raises:
        ArmguardError: If an argument is out of range or names what does not exist.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        *,
        rate: float = 1000.0,
        schedule: str | Schedule = "deadline",
        motion: str = "joint",
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
        budget: int | None = None,
        base_placement: pinocchio.SE3 | None = None,
        certify: bool = False,
    ) -> None:
        if not 0.0 < read_number(rate) < math.inf:
            raise ArmguardError("rate", f"is {rate!r}", expected="a finite number of hertz above 0")
        self.period = 1.0 / rate
        joint_timeout = max(0.05, 5.0 * self.period) if joint_timeout is None else joint_timeout
        check_not_negative(
            reaction_time=reaction_time,
            latency=latency,
            slow_margin=slow_margin,
            aware_margin=aware_margin,
            hold=hold,
            source_timeout=source_timeout,
            joint_timeout=joint_timeout,
            margin=margin,
        )
        if not 0.0 <= read_number(freshness) < 1.0:
            raise ArmguardError("freshness", f"is {freshness!r}", expected="0 <= freshness < 1")
        if not isinstance(base_placement, pinocchio.SE3 | None):
            raise ArmguardError(
                "base_placement", f"is {base_placement!r}", expected="a pinocchio.SE3"
            )
        if motion not in MOTIONS:
            raise ArmguardError("motion", f"is {motion!r}", expected=f"one of {', '.join(MOTIONS)}")
        by_deadline = isinstance(schedule, str) and schedule == DEADLINE
        budget = read_budget(budget, by_deadline=by_deadline)
        self.robot = robot
        self.obstacles = obstacles
        self.base_placement = base_placement or pinocchio.SE3.Identity()
        self._horizon = self.period + latency
        self._reaction_time = reaction_time
        self._source_timeout = source_timeout
        self._freshness = freshness
        self._rule = VerdictRule(slow_margin, aware_margin, hold)
        self._states = JointStates(robot, joint_timeout)
        ignored = IgnoredPairs(ignore, robot)
        pairs_schedule = None if by_deadline else make_schedule(schedule, self.period)
        by_distance = pairs_schedule is not None and pairs_schedule.measure == "distance"
        with_joints = motion == "joint" and not by_distance

        def make_arm() -> WatchedArm:
            return WatchedArm(
                robot,
                obstacles,
                ignored,
                margin,
                reaction_time,
                base_placement,
                with_joints=with_joints,
                by_distance=by_distance,
            )

        self._watch: Watch
        if pairs_schedule is None:
            self._watch = ObstacleWatch(
                robot,
                obstacles,
                make_arm,
                self._horizon + reaction_time,
                freshness,
                self.period,
                budget,
            )
        else:
            self._watch = PairWatch(robot, obstacles, pairs_schedule, make_arm)
        self._stopping = None
        if with_joints:
            self._stopping = StopDecision(self._watch, self._horizon, slow_margin, hold)
        self._certify = certify
        self.certificate_inputs: dict[str, Any] | None = None
        """What the last verdict's certificate is about: arguments of `certificate.verify`."""
        self._epoch: float | None = None
        self._now = -math.inf
        self._activity = -1
        self._quiet_until = -math.inf
        self._homeless = self._no_sources = False
        self._sequence = 0
        self._evaluated = 0
        self._braking_scale = float(np.min(robot.braking_deceleration / robot.velocity_limit))
        self._disbelieved = 0
        self._faults_before = obstacles.fault_count
        self._compile()

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
                read_number(stamp),
                Reason(ReasonKind.INTERNAL_ERROR, type(error).__name__, str(error)),
            )

    def reset(self) -> None:
        """Forget latched faults and past joint states; every pair is looked at anew."""
        self._rule.reset()
        self._states.reset()
        self._watch.restart()
        if self._stopping is not None:
            self._stopping.reset()
        self._now = -math.inf
        self._epoch = None

    def pairs(self, limit: int = 64) -> list[PairReport]:
        """The most imminent pairs as of the last tick, soonest first, at most `limit`."""
        if self._epoch is None:
            return []
        time, arm = self._now - self._epoch, self._watch.arm
        # A tick with nothing near leaves the arm where it was.
        arm.kinematics.place(self._states.q)
        listing = self._watch.list_imminent(time, row_limit=0, pair_limit=max(limit, 0))
        return [
            report_pair(
                listing, index, time, self.period, arm.names(int(pair)), arm.state, arm.exact
            )
            for index, pair in enumerate(listing.pairs)
        ]

    def snapshot(self, *, pair_limit: int, row_limit: int) -> Snapshot:
        """What there is to see of the last tick, for observers; cheap, and their own to keep.

        Args:
            pair_limit: At most so many pairs, the most imminent ones.
            row_limit: At most so many obstacles, likewise.
        """
        time = 0.0 if self._epoch is None else self._now - self._epoch
        arm, states = self._watch.arm, self._states
        # A tick with nothing to look at leaves the spheres where they were.
        arm.kinematics.compute(states.q, states.v)
        listing = self._watch.list_imminent(time, row_limit=row_limit, pair_limit=pair_limit)
        return take_snapshot(listing, arm.state, states.q, time)

    def _step(self, stamp: float, q: ArrayLike, v: ArrayLike, now: float) -> Verdict:
        if not (type(stamp) is float and type(now) is float):
            stamp, now = read_number(stamp), read_number(now)
        if not (math.isfinite(now) and math.isfinite(stamp)):
            return self._refuse(stamp, Reason(ReasonKind.TIME_INVALID, f"stamp {stamp}, now {now}"))
        if now < self._now:
            reason = Reason(ReasonKind.TIME_BACKWARDS, "clock", f"{now!r} after {self._now!r}")
            self._now = now
            return self._refuse(stamp, reason)
        self._now = now
        if self._epoch is None:
            self._epoch = now
        watch, states, obstacles = self._watch, self._states, self.obstacles
        is_quiet = obstacles.activity == self._activity and now < self._quiet_until
        if not is_quiet or self.robot.revision != watch.arm.revision:
            watch.follow()
        found, stop_time = states.glance(stamp, q, v, now, self._horizon, self._reaction_time)
        if found & DOUBTFUL:
            disbelief = states.receive(stamp, q, v, now)
            if disbelief is not None:
                return self._refuse(stamp, disbelief)
            stop_time = self._stop_time(now - stamp)
            found = FAST
        reasons = []
        if found:
            stopping = states.stopping()
            if stopping is not None:
                reasons.append(stopping)
        if (found or watch.arm.motion.isotropic.is_widened) and watch.arm.follow_limits(states.v):
            watch.doubt()
        if not is_quiet:
            reasons += self._read_obstacles(now)
        tick = Tick(
            self._sequence,
            now,
            now - self._epoch,
            states.q,
            states.v,
            now - stamp,
            stop_time,
            # Children are opened only where a closer look could still matter to the level.
            (stop_time + self._rule.aware_margin) / (1.0 - self._freshness),
        )
        look = watch.look(tick)
        self._evaluated = look.evaluated
        for row in look.broken:
            reasons.append(Reason(ReasonKind.BOUND_BROKEN, obstacles.ids[row]))
        return self._judge(stamp, tick, look, reasons)

    def _read_obstacles(self, now: float) -> list[Reason]:
        """What is wrong with the obstacle table; if nothing is, until when that surely stays so."""
        obstacles = self.obstacles
        reasons = take_obstacle_reasons(obstacles, now, self._source_timeout)
        self._homeless = bool(obstacles.homeless())
        self._no_sources = not obstacles.has_sources
        self._activity = obstacles.activity
        # As long as nobody calls, only silence can become too long; rounding is allowed for.
        self._quiet_until = -math.inf
        if not reasons:
            self._quiet_until = obstacles.quiet_until(self._source_timeout) - self.period
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

    def _judge(self, stamp: float, tick: Tick, look: Look, reasons: list[Reason]) -> Verdict:
        """The verdict of a tick whose arm state is believed."""
        pair, contact_time = look.pair, max(0.0, look.expiry - tick.time)
        if self._homeless:
            # They were reported, so they are there, and could be anywhere.
            pair, contact_time = NOBODY, 0.0
        if look.overdue:
            reasons.append(Reason(ReasonKind.OVERDUE, detail=f"{look.overdue} pairs"))
        if self._no_sources:
            reasons.append(Reason(ReasonKind.NO_SOURCES))
        standing = bool(reasons) and any(
            reason.kind.effect is Effect.STANDING for reason in reasons
        )
        complete = not look.overdue
        rests = (
            self._stopping is not None
            and complete
            and not (standing or self._homeless or contact_time > tick.stop_time)
            and self._stopping.rests(tick)
        )
        level, held = self._rule.decide(
            tick.now,
            contact_time,
            tick.stop_time,
            complete=complete,
            standing=standing,
            rests=rests,
        )
        link, obstacle = (None, None) if pair == NOBODY else self._watch.arm.names(pair)
        grade = self._rule.grade(contact_time, tick.stop_time, rests=rests)
        if pair != NOBODY and grade is not Level.CLEAR:
            reasons.append(
                Reason(ReasonKind.CONTACT, f"{link} and {obstacle}", f"in {contact_time:.4g} s")
            )
        if held:
            reasons.append(Reason(ReasonKind.HOLD))
        return Verdict(
            stamp=stamp,
            sequence=self._sequence,
            level=level,
            contact_time=contact_time,
            stop_time=tick.stop_time,
            speed_scale=self._scale(tick, level, grade, contact_time),
            link=link,
            obstacle=obstacle,
            complete=complete,
            evaluated=self._evaluated,
            reasons=(*self._rule.latched.values(), *reasons),
            valid_until=math.nextafter(tick.now + self._horizon, -math.inf),
            certificate=self._prove(pair),
        )

    def _scale(self, tick: Tick, level: Level, grade: Level, contact_time: float) -> float:
        """The speed scale of a tick: 0 in STOP, and what is proved for whatever else is near."""
        if self._stopping is None:
            scale = (contact_time - self._horizon - self._reaction_time) * self._braking_scale
            return 0.0 if level is Level.STOP else min(max(scale, 0.0), 1.0)
        if level is Level.STOP:
            scale = 0.0
        elif grade is Level.CLEAR:
            scale = 1.0
        else:
            scale = self._stopping.speed_scale(tick)
        return self._stopping.hold_scale(tick.now, scale)

    def _prove(self, pair: int) -> Certificate | None:
        """Certificate of the deciding pair, where asked for and there is anything to prove."""
        self.certificate_inputs = None
        if not self._certify or pair == NOBODY:
            return None
        self._watch.arm.kinematics.compute(self._states.q, self._states.v)
        proof = self._watch.arm.prove(pair, self._watch.deciding_sphere(pair))
        if proof is None:
            return None
        certificate, self.certificate_inputs = proof
        return certificate

    def _compile(self) -> None:
        """Run once what only some ticks need, so that nothing is compiled in a tick."""
        self._stop_time(0.0)
        if self._stopping is not None:
            rest = np.zeros(len(self.robot.joints))
            place = np.clip(rest, self.robot.lower_position_limit, self.robot.upper_position_limit)
            self._stopping.speed_scale(Tick(0, 0.0, 0.0, place, rest, 0.0, 0.0, 0.0))

    def _refuse(self, stamp: float, reason: Reason) -> Verdict:
        """The verdict of a tick whose arm state is not believed: the worst of everything."""
        self._disbelieved += 1
        self._watch.doubt()
        self.certificate_inputs = None
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
