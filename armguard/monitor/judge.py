"""From what a tick's look found to its verdict: level, speed scale, proof and margin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armguard.contact.earliest import Certificate
from armguard.jit.numerics import SUM_ROUNDING
from armguard.monitor.committed_plan import CommittedPlan
from armguard.monitor.levels import VerdictRule
from armguard.monitor.settings import MonitorSettings
from armguard.monitor.stop_decision import StopDecision
from armguard.pairs.proof import compile_proof
from armguard.pairs.scene import BOUND_NAMES
from armguard.pairs.separation_margin import SeparationMargin, SeparationRule
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Look, Tick, Watch
from armguard.scheduling.timing_wheel import NOBODY
from armguard.verdict import Effect, Level, Reason, ReasonKind, Verdict


class Judge:
    """Makes verdicts of ticks whose arm state is believed.

    Args:
        robot: The arm.
        watch: Knows the pairs.
        states: Knows the joint states.
        rule: Makes levels.
        settings: Of the monitor.
        separation: Rule of the separation distance whose margin each verdict is to carry, if any.
        certify: Whether each verdict is to carry a certificate.

    Attributes:
        plan: The plan that the arm follows; None where plans are not judged.
        certificate_inputs: What the last verdict's certificate is about.
    """

    def __init__(
        self,
        robot: Robot,
        watch: Watch,
        states: JointStates,
        rule: VerdictRule,
        settings: MonitorSettings,
        separation: SeparationRule | None,
        *,
        certify: bool,
    ) -> None:
        self._watch = watch
        self._rule = rule
        self._certify = certify
        self._budget = settings.budget
        self._horizon = settings.horizon
        self._until_braking = settings.horizon + settings.reaction_time
        self._braking_scale = float(np.min(robot.braking_deceleration / robot.velocity_limit))
        self._stopping = None
        if settings.with_joints:
            self._stopping = StopDecision(
                watch, settings.period, settings.horizon, settings.slow_margin, settings.rise_delay
            )
            states.delay_braking(self._stopping.looks_ahead - self._horizon)
        self._far = (self._until_braking + 1.0 / self._braking_scale) * (1.0 + SUM_ROUNDING)
        """What is later lets any arm brake in time, in [s]."""
        self.plan = None
        if watch.arm.motion.planned is not None:
            self.plan = CommittedPlan(robot, watch, settings.horizon, settings.margin)
        self._separation = None
        if separation is not None:
            self._separation = SeparationMargin(separation, self._until_braking)
        self.certificate_inputs: dict[str, Any] | None = None
        self._is_plain = not certify and separation is None and self.plan is None
        """Whether verdicts are about levels and speed scales alone."""
        self._compile(robot)

    @property
    def _spent(self) -> int:
        """Evaluations by the table of braking so far."""
        return 0 if self._stopping is None else self._stopping.evaluated

    def reset(self) -> None:
        """Forget speed scales and the plan."""
        for memory in (self._stopping, self.plan):
            if memory is not None:
                memory.reset()

    def forget_proofs(self) -> None:
        """Let no earlier tick's proof count: what it rests on has changed."""
        if self._stopping is not None:
            self._stopping.restart_search()

    def judge_clear(
        self,
        stamp: float,
        number: int,
        now: float,
        contact_time: float,
        stop_time: float,
        late_stop_time: float,
        row: int,
        link: int,
        evaluated: int,
    ) -> Verdict | None:
        """The verdict of a tick that is as most are: nothing near, nothing wrong, none waited for.

        None where there is anything else to be said, or to be done: `judge` would then, and says
        the same otherwise, in five times the time.

        Args:
            stamp: Of the joint state, in [s].
            number: Of the tick.
            now: Its time, in [s].
            contact_time: Earliest possible contact, in [s] from now.
            stop_time: In which the arm surely rests, in [s].
            late_stop_time: The same for one that goes on as a speed scale lets it.
            row: Of the obstacle that could be touched first.
            link: That could touch it first.
            evaluated: Evaluations in this tick.
        """
        rule, stopping = self._rule, self._stopping
        if not (
            contact_time > (self._far if stopping is None else late_stop_time)
            and contact_time > stop_time + rule.aware_margin
            and self._is_plain
            and rule.is_clear(now)
            and (stopping is None or not stopping.held)
        ):
            return None
        arm = self._watch.arm
        # A named tuple's own constructor takes twice as long.
        return tuple.__new__(
            Verdict,
            (
                stamp,
                number,
                Level.CLEAR,
                contact_time,
                stop_time,
                1.0,
                arm.links[link],
                arm.obstacles.ids[row],
                True,
                evaluated,
                (),
                math.nextafter(now + self._horizon, -math.inf),
                None,
                None,
            ),
        )

    def judge(
        self, stamp: float, tick: Tick, look: Look, reasons: list[Reason], *, unplaced: bool
    ) -> Verdict:
        """The verdict of a tick.

        Args:
            stamp: Of the joint state, in [s].
            tick: The tick.
            look: What its look found.
            reasons: What there is to say already; more is added.
            unplaced: Whether there are obstacles that found no room, and could be anywhere.
        """
        pair, contact_time = look.pair, max(0.0, look.expiry - tick.time)
        if self._stopping is not None:
            self._stopping.left = 0
        spent_before = self._spent
        if unplaced:
            pair, contact_time = NOBODY, 0.0
        if look.overdue:
            reasons.append(Reason(ReasonKind.OVERDUE, detail=f"{look.overdue} pairs"))
        standing = bool(reasons) and any(
            reason.kind.effect is Effect.STANDING for reason in reasons
        )
        complete = not look.overdue
        rests = (
            self._stopping is not None
            and complete
            and not (standing or unplaced or contact_time > tick.stop_time)
            and (self._stopping.rests(tick) or (self.plan is not None and self.plan.rests(tick)))
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
            bound = BOUND_NAMES[self._watch.recall(pair).bound]
            detail = f"in {contact_time:.4g} s by the {bound} bound"
            reasons.append(Reason(ReasonKind.CONTACT, f"{link} and {obstacle}", detail))
        if held:
            reasons.append(Reason(ReasonKind.HOLD))
        scale = self._scale(tick, level, contact_time)
        if self._stopping is not None and self._stopping.left:
            reasons.append(self._tell_spent(self._stopping))
        # By position: names would cost as much as the whole tuple.
        return Verdict(
            stamp,
            tick.number,
            level,
            contact_time,
            tick.stop_time,
            scale,
            link,
            obstacle,
            complete,
            look.evaluated + self._spent - spent_before,
            (*self._rule.latched.values(), *reasons),
            math.nextafter(tick.now + self._horizon, -math.inf),
            None if self._separation is None else self._measure_separation(tick, unplaced=unplaced),
            self._prove(tick, pair) if self._certify else None,
        )

    def _tell_spent(self, stopping: StopDecision) -> Reason:
        """That the user's budget did not suffice to find out whether the arm rests in time."""
        some = "1 obstacle" if stopping.left == 1 else f"{stopping.left} obstacles"
        detail = f"{some} not decided about after {self._budget} evaluations"
        return Reason(ReasonKind.BUDGET_SPENT, f"budget={self._budget}", detail)

    def _scale(self, tick: Tick, level: Level, contact_time: float) -> float:
        """The speed scale of a tick: 0 in STOP, and else what is proved."""
        if level is Level.STOP:
            return 0.0
        stopping = self._stopping
        if stopping is None:
            # An arm that is no faster can brake before contact, whatever it does in this tick.
            scale = (contact_time - self._until_braking) * self._braking_scale
            return min(max(scale, 0.0), 1.0)
        # Far off in time, nothing could touch an arm that goes on at any speed and brakes then.
        scale = 1.0 if contact_time > tick.late_stop_time else stopping.find_scale(tick)
        return stopping.hold_scale(tick.now, scale)

    def _measure_separation(self, tick: Tick, *, unplaced: bool) -> float:
        """Margin of the separation distance in [m]; what found no room could be anywhere."""
        assert self._separation is not None, "called only where there is a rule"
        if unplaced:
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

    def _compile(self, robot: Robot) -> None:
        """Run once what only some ticks need, so that nothing is compiled in a tick."""
        still = np.zeros(len(robot.joints))
        lower, upper = robot.lower_position_limit, robot.upper_position_limit
        tick = Tick(-1, 0.0, 0.0, np.clip(still, lower, upper), still, 0.0, 0.0, 0.0)
        if self._stopping is not None:
            self._stopping.find_scale(tick)
            self._stopping.reset()
        if self._separation is not None:
            self._separation.compile(self._watch.arm.state)
        if self._certify:
            compile_proof()
