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

from armguard.committed_plan import CommittedPlan, PlanVerdict
from armguard.contact import Certificate
from armguard.exceptions import ArmguardError
from armguard.explain import Explanation, explain_pair
from armguard.foresight import Attention, Headroom, predict_headroom, rank_attention
from armguard.ignored_pairs import IgnoredPairs
from armguard.joint_states import DOUBTFUL, FAST, JointStates
from armguard.monitor_arguments import read_number, read_settings
from armguard.obstacle_reasons import take_obstacle_reasons
from armguard.obstacles import Obstacles
from armguard.pair_reports import PairReport, report_pair
from armguard.plans import Plan
from armguard.robot import Robot
from armguard.schedules import Schedule
from armguard.schedules.wheel import NOBODY
from armguard.separation_margin import SeparationMargin, SeparationRule
from armguard.snapshot import Snapshot, take_snapshot
from armguard.stop_decision import StopDecision
from armguard.verdict import (
    Effect,
    Level,
    Reason,
    ReasonKind,
    Verdict,
    VerdictRule,
)
from armguard.watch import Look, Tick
from armguard.watches import make_watch


class Monitor:
    """Supervises one arm among obstacles.

    Everything is compiled here, in the constructor, so that the first tick is like any other.

    Args:
        robot: The arm.
        obstacles: The table that perception writes to.
        rate: Ticks a second, [Hz].
        schedule: "deadline", "full", "distance", "daa", or a `Schedule` of your own.
        motion: How the arm's possible motion is bounded: "joint" (by its joints' limits, and a STOP
            only where braking after the next tick could be too late), "planned" (the same, and the
            controller tells what it is about to do by `commit`), or "isotropic" (points of the arm
            as free bodies; cheaper, and far more cautious).
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
        certify: Attach to each verdict a certificate of the pair that decides it, by free bodies;
            takes a fraction of a millisecond a tick.
        separation: Attach to each verdict the margin of the speed-and-separation distance by this
            rule; takes a look at every pair in every tick.

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
        separation: SeparationRule | None = None,
    ) -> None:
        self.settings = settings = read_settings(
            rate=rate,
            schedule=schedule,
            motion=motion,
            joint_timeout=joint_timeout,
            freshness=freshness,
            budget=budget,
            base_placement=base_placement,
            reaction_time=reaction_time,
            latency=latency,
            slow_margin=slow_margin,
            aware_margin=aware_margin,
            hold=hold,
            source_timeout=source_timeout,
            margin=margin,
        )
        self.period = settings.period
        self.robot = robot
        self.obstacles = obstacles
        self.base_placement = settings.base_placement
        self._horizon = settings.horizon
        self._rule = VerdictRule(slow_margin, aware_margin, hold)
        self._states = JointStates(
            robot, settings.joint_timeout, settings.horizon, settings.reaction_time
        )
        self._watch = make_watch(
            robot, obstacles, settings, IgnoredPairs(ignore, robot), self._states
        )
        self._stopping = None
        if settings.with_joints:
            self._stopping = StopDecision(
                self._watch, settings.period, settings.horizon, slow_margin, hold
            )
        self._plan = None
        if self._watch.arm.motion.planned is not None:
            self._plan = CommittedPlan(robot, self._watch, margin)
        self._separation = None
        if separation is not None:
            response_time = settings.horizon + settings.reaction_time
            self._separation = SeparationMargin(separation, response_time)
        self._tick: Tick | None = None
        self._look = Look(NOBODY, math.inf, 0, 0)
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
        self._slowest_stop = settings.reaction_time + 1.0 / self._braking_scale
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
        for memory in (self._stopping, self._plan):
            if memory is not None:
                memory.reset()
        self._tick = None
        self._now = -math.inf
        self._epoch = None

    def commit(self, plan: Plan) -> PlanVerdict:
        """Judge the next piece of the controller's trajectory: is it safe to commit?

        A safe piece is what the arm is taken to follow from now on, until another one is safe, it
        strays from it by more than its tracking error, or it rests. Nothing in a plan makes this
        raise.

        Args:
            plan: The piece, on the clock of the joint states' stamps.

        Raises:
            ArmguardError: The monitor was not made with motion="planned".
        """
        if self._plan is None:
            raise ArmguardError("commit", "needs plans", remedy='Monitor(..., motion="planned")')
        if self._tick is None or self._rule.latched:
            reason = Reason(ReasonKind.PLAN_REFUSED, "arm", "its state is not believed")
            return PlanVerdict(False, 0.0, None, None, (reason,))
        return self._plan.commit(plan, self._tick)

    def pairs(self, limit: int = 64) -> list[PairReport]:
        """The most imminent pairs as of the last tick, soonest first, at most `limit`."""
        if self._tick is None:
            return []
        self._watch.prepare(self._tick)
        time, arm = self._tick.time, self._watch.arm
        listing = self._watch.list_imminent(time, row_limit=0, pair_limit=max(limit, 0))
        return [
            report_pair(
                listing, index, time, self.period, arm.names(int(pair)), arm.state, arm.exact
            )
            for index, pair in enumerate(listing.pairs)
        ]

    def explain(self) -> Explanation | None:
        """Why the last verdict is as it is, and what would have made it better.

        None where no pair decided it: there are none, or its reasons alone did.
        """
        if self._tick is None or self._look.pair == NOBODY or self._homeless:
            return None
        self._watch.prepare(self._tick)
        return explain_pair(
            self._watch, self.robot, self._tick, self._look.pair, self.settings.reaction_time
        )

    def headroom(self) -> Headroom:
        """What looks cost now, and at how many obstacles or which rate the budget would break."""
        watched = len(self.obstacles) if self._tick is not None else 0
        expected = self._watch.expect_evaluations()
        return predict_headroom(watched, expected, self.period, self.settings.budget)

    def attention(self, limit: int = 8) -> list[Attention]:
        """The obstacles whose fresh states would raise the verdict's contact time most.

        Args:
            limit: At most so many, first things first.
        """
        if self._tick is None:
            return []
        self._watch.prepare(self._tick)
        time = self._tick.time
        listing = self._watch.list_imminent(time, row_limit=max(limit, 0) + 1, pair_limit=0)
        ids = self.obstacles.ids
        return rank_attention(listing, self._watch.arm.state, time, ids, max(limit, 0))

    def snapshot(self, *, pair_limit: int, row_limit: int) -> Snapshot:
        """What there is to see of the last tick, for observers; cheap, and their own to keep.

        Args:
            pair_limit: At most so many pairs, the most imminent ones.
            row_limit: At most so many obstacles, likewise.
        """
        watch, q, v = self._watch, self._states.q, self._states.v
        tick = self._tick or Tick(-1, 0.0, 0.0, q, v, 0.0, 0.0, 0.0)
        watch.prepare(tick)
        listing = watch.list_imminent(tick.time, row_limit=row_limit, pair_limit=pair_limit)
        return take_snapshot(listing, watch.arm.state, q, tick.time)

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
        arm_changed = self.robot.revision != watch.arm.revision
        if not is_quiet or arm_changed:
            watch.follow()
        found, stop_time = states.glance(stamp, q, v, now)
        if found & DOUBTFUL:
            disbelief = states.receive(stamp, q, v, now)
            if disbelief is not None:
                return self._refuse(stamp, disbelief)
            stop_time = states.stop_time(now - stamp)
            found = FAST
        reasons: list[Reason] = []
        if found:
            stopping = states.stopping()
            if stopping is not None:
                reasons.append(stopping)
        if (found or watch.arm.motion.isotropic.is_widened) and watch.arm.follow_limits(states.v):
            watch.doubt()
        if not is_quiet:
            reasons += self._read_obstacles(now)
        self._tick = tick = Tick(
            self._sequence,
            now,
            now - self._epoch,
            states.q,
            states.v,
            now - stamp,
            stop_time,
            # Children are opened only where a closer look could still matter to the level.
            (stop_time + self._rule.aware_margin) / (1.0 - self.settings.freshness),
        )
        self._look = look = watch.look(tick)
        self._evaluated = look.evaluated
        if look.disturbed and self._stopping is not None:
            self._stopping.restart_search()
        if self._plan is not None:
            void = self._plan.void(tick, stamp)
            if void is not None:
                reasons.append(void)
        for row in look.broken:
            reasons.append(Reason(ReasonKind.BOUND_BROKEN, obstacles.ids[row]))
        return self._judge(stamp, tick, look, reasons)

    def _read_obstacles(self, now: float) -> list[Reason]:
        """What is wrong with the obstacle table; if nothing is, until when that surely stays so."""
        obstacles = self.obstacles
        reasons = take_obstacle_reasons(obstacles, now, self.settings.source_timeout)
        self._homeless = bool(obstacles.homeless())
        self._no_sources = not obstacles.has_sources
        self._activity = obstacles.activity
        # As long as nobody calls, only silence can become too long; rounding is allowed for.
        self._quiet_until = -math.inf
        if not reasons:
            self._quiet_until = obstacles.quiet_until(self.settings.source_timeout) - self.period
        return reasons

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
            and (self._stopping.rests(tick) or (self._plan is not None and self._plan.rests(tick)))
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
        # By position: names would cost as much as the whole tuple.
        return Verdict(
            stamp,
            self._sequence,
            level,
            contact_time,
            tick.stop_time,
            self._scale(tick, level, contact_time),
            link,
            obstacle,
            complete,
            self._evaluated,
            (*self._rule.latched.values(), *reasons),
            math.nextafter(tick.now + self._horizon, -math.inf),
            None if self._separation is None else self._measure_separation(tick),
            self._prove(tick, pair) if self._certify else None,
        )

    def _scale(self, tick: Tick, level: Level, contact_time: float) -> float:
        """The speed scale of a tick: 0 in STOP, and else what is proved."""
        if level is Level.STOP:
            return 0.0
        stopping = self._stopping
        if stopping is None:
            # An arm that is no faster can brake before contact, whatever it does in this tick.
            until_braking = self._horizon + self.settings.reaction_time
            scale = (contact_time - until_braking) * self._braking_scale
            return min(max(scale, 0.0), 1.0)
        scale = 1.0
        # Far off in time, nothing could touch an arm that goes on at any speed and brakes then.
        if not contact_time > stopping.looks_ahead + self._slowest_stop:
            age = tick.arm_age + stopping.looks_ahead - self._horizon
            rest = self._states.stop_time(age) + stopping.looks_ahead - self._horizon
            if not contact_time > rest:
                scale = stopping.find_scale(tick)
        return stopping.hold_scale(tick.now, scale)

    def _measure_separation(self, tick: Tick) -> float:
        """Margin of the separation distance in [m]; what found no room could be anywhere."""
        assert self._separation is not None, "called only where there is a rule"
        if self._homeless:
            return -math.inf
        self._watch.prepare(tick)
        state, watched = self._watch.arm.state, self._watch.watched_pairs()
        return self._separation.margin(state, tick.stop_time, watched)

    def _prove(self, tick: Tick, pair: int) -> Certificate | None:
        """Certificate of the deciding pair, where there is anything to prove."""
        self.certificate_inputs = None
        if pair == NOBODY:
            return None
        self._watch.prepare(tick)
        proof = self._watch.arm.prove(pair, self._watch.recall(pair).sphere)
        if proof is None:
            return None
        certificate, self.certificate_inputs = proof
        return certificate

    def _compile(self) -> None:
        """Run once what only some ticks need, so that nothing is compiled in a tick."""
        still = np.zeros(len(self.robot.joints))
        lower, upper = self.robot.lower_position_limit, self.robot.upper_position_limit
        tick = Tick(-1, 0.0, 0.0, np.clip(still, lower, upper), still, 0.0, 0.0, 0.0)
        if self._stopping is not None:
            self._stopping.find_scale(tick)
            self._stopping.reset()
        if self._separation is not None:
            self._separation.compile(self._watch.arm.state)

    def _refuse(self, stamp: float, reason: Reason) -> Verdict:
        """The verdict of a tick whose arm state is not believed: the worst of everything."""
        self._disbelieved += 1
        self._watch.doubt()
        if self._plan is not None:
            self._plan.reset()
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
