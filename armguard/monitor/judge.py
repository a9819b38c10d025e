"""From what a tick's evaluations found to its verdict: level, speed scale, proof and margin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armguard.contact.earliest import Certificate
from armguard.monitor.committed_plan import CommittedPlan
from armguard.monitor.levels import VerdictRule
from armguard.monitor.settings import MonitorSettings
from armguard.monitor.stop_decision import StopDecision
from armguard.pairs.proof import compile_proof
from armguard.pairs.scene import BOUND_NAMES
from armguard.pairs.separation_margin import SeparationMargin, SeparationRule
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick, TickResult
from armguard.scheduling.timing_wheel import NOBODY
from armguard.verdict import Effect, Level, Reason, ReasonKind, Verdict

NO_NAMES = (None, None)
"""Of link and obstacle, where no pair decides."""


class Judge:
    """Makes verdicts of ticks whose arm state is believed.

    Args:
        robot: The arm.
        scheduler: Knows the pairs.
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
        scheduler: Scheduler,
        states: JointStates,
        rule: VerdictRule,
        settings: MonitorSettings,
        separation: SeparationRule | None,
        *,
        certify: bool,
    ) -> None:
        self._scheduler = scheduler
        self._rule = rule
        self._certify = certify
        self._budget = settings.budget
        self._response_time = settings.response_time
        self._braking_delay = settings.response_time + settings.reaction_time
        fastest = scheduler.arm.state.scene.limits.operating_velocity
        self._braking_scale = float(np.min(robot.braking_deceleration / fastest))
        self._stopping = None
        if settings.with_joints:
            self._stopping = StopDecision(
                scheduler,
                settings.period,
                settings.response_time,
                settings.slow_margin,
                settings.rise_delay,
            )
            states.delay_braking(self._stopping.looks_ahead - self._response_time)
        self.plan = None
        if scheduler.arm.motion.planned is not None:
            self.plan = CommittedPlan(robot, scheduler, settings.response_time, settings.margin)
        self._separation = None
        if separation is not None:
            self._separation = SeparationMargin(separation, self._braking_delay)
        self.certificate_inputs: dict[str, Any] | None = None
        self._compile(robot)

    def reset(self) -> None:
        """Forget speed scales and the plan."""
        for memory in (self._stopping, self.plan):
            if memory is not None:
                memory.reset()

    def forget_proofs(self) -> None:
        """Let no earlier tick's proof count: what it rests on has changed."""
        if self._stopping is not None:
            self._stopping.restart_search()

    def judge(
        self, stamp: float, tick: Tick, result: TickResult, reasons: list[Reason], *, unplaced: bool
    ) -> Verdict:
        """The verdict of a tick.

        Args:
            stamp: Of the joint state, in [s].
            tick: The tick.
            result: What its evaluations found.
            reasons: What there is to say already; more is added.
            unplaced: Whether there are obstacles that found no room, and could be anywhere.
        """
        rule, stopping, plan = self._rule, self._stopping, self.plan
        pair, contact_time = result.pair, max(0.0, result.expiry - tick.time)
        if unplaced:
            pair, contact_time = NOBODY, 0.0
        if result.overdue:
            reasons.append(Reason(ReasonKind.OVERDUE, detail=f"{result.overdue} pairs"))
        standing = bool(reasons) and any(
            reason.kind.effect is Effect.STANDING for reason in reasons
        )
        complete = not result.overdue
        spent_before = 0
        if stopping is not None:
            stopping.left = 0
            spent_before = stopping.evaluated
        rests = (
            stopping is not None
            and complete
            and not (standing or unplaced or contact_time > tick.stop_time)
            and (stopping.rests(tick) or (plan is not None and plan.rests(tick)))
        )
        level, held = rule.decide(
            tick.now,
            contact_time,
            tick.stop_time,
            complete=complete,
            standing=standing,
            rests=rests,
        )
        names = NO_NAMES if pair == NOBODY else self._scheduler.arm.names(pair)
        if (
            level is not Level.CLEAR
            and pair != NOBODY
            and rule.grade(contact_time, tick.stop_time, rests=rests) is not Level.CLEAR
        ):
            bound = BOUND_NAMES[self._scheduler.recall(pair).bound]
            detail = f"in {contact_time:.4g} s by the {bound} bound"
            reasons.append(Reason(ReasonKind.CONTACT, f"{names[0]} and {names[1]}", detail))
        if held:
            reasons.append(Reason(ReasonKind.HOLD))
        scale = self._find_scale(tick, level, contact_time)
        evaluated = result.evaluated
        if stopping is not None:
            evaluated += stopping.evaluated - spent_before
            if stopping.left:
                reasons.append(self._tell_spent(stopping))
        separation = certificate = None
        if self._separation is not None:
            separation = self._measure_separation(tick, unplaced=unplaced)
        if self._certify:
            certificate = self._prove(tick, pair)
        return self._make_verdict(
            stamp,
            tick,
            level,
            contact_time,
            scale,
            names,
            complete,
            evaluated,
            reasons,
            separation,
            certificate,
        )

    def refuse(self, stamp: float, tick: Tick, reason: Reason, since: str) -> Verdict:
        """The verdict of a tick whose joint state is not believed: the worst of everything.

        Args:
            stamp: Of the joint state, in [s]; it may be no number.
            tick: The tick, whose arm may never stop.
            reason: What there is against the joint state; it is latched.
            since: When that was, in words.
        """
        if self.plan is not None:
            self.plan.reset()
        self.certificate_inputs = None
        self._rule.latch(reason, since)
        level, _ = self._rule.decide(tick.now, 0.0, tick.stop_time, complete=False, standing=True)
        return self._make_verdict(stamp, tick, level, 0.0, 0.0, NO_NAMES, False, 0, [])

    def _make_verdict(
        self,
        stamp: float,
        tick: Tick,
        level: Level,
        contact_time: float,
        speed_scale: float,
        names: tuple[str, str] | tuple[None, None],
        complete: bool,
        evaluated: int,
        reasons: list[Reason],
        separation: float | None = None,
        certificate: Certificate | None = None,
    ) -> Verdict:
        """The one place where a verdict is made; the arguments are named as its fields are."""
        latched = self._rule.latched
        # A named tuple's own constructor takes twice as long.
        return tuple.__new__(
            Verdict,
            (
                stamp,
                tick.number,
                level,
                contact_time,
                tick.stop_time,
                speed_scale,
                names[0],
                names[1],
                complete,
                evaluated,
                (*latched.values(), *reasons) if latched or reasons else (),
                math.nextafter(tick.now + self._response_time, -math.inf),
                separation,
                certificate,
            ),
        )

    def _tell_spent(self, stopping: StopDecision) -> Reason:
        """That the user's budget did not suffice to find out whether the arm rests in time."""
        some = "1 obstacle" if stopping.left == 1 else f"{stopping.left} obstacles"
        detail = f"{some} not decided about after {self._budget} evaluations"
        return Reason(ReasonKind.BUDGET_SPENT, f"budget={self._budget}", detail)

    def _find_scale(self, tick: Tick, level: Level, contact_time: float) -> float:
        """The speed scale of a tick: 0 in STOP, 1 in AWARE and CLEAR, and in SLOW what is proved.

        Where nothing is near there is nothing to slow down for: SLOW comes in time, for while a
        level is higher, the arm can stop before contact at whatever speed it has.
        """
        if level is Level.STOP:
            return 0.0
        if level is not Level.SLOW:
            return 1.0
        stopping = self._stopping
        if stopping is None:
            # An arm that is no faster can brake before contact, whatever it does in this tick.
            scale = (contact_time - self._braking_delay) * self._braking_scale
            return min(max(scale, 0.0), 1.0)
        # Far off in time, nothing could touch an arm that goes on at any speed and brakes then.
        scale = 1.0 if contact_time > tick.late_stop_time else stopping.find_scale(tick)
        return stopping.hold_scale(tick.now, scale)

    def _measure_separation(self, tick: Tick, *, unplaced: bool) -> float:
        """Margin of the separation distance in [m]; what found no room could be anywhere."""
        assert self._separation is not None, "called only where there is a rule"
        if unplaced:
            return -math.inf
        self._scheduler.prepare(tick)
        state, watched = self._scheduler.arm.state, self._scheduler.watched_pairs()
        return self._separation.margin(state, tick.stop_time, watched)

    def _prove(self, tick: Tick, pair: int) -> Certificate | None:
        """Certificate of the deciding pair, where there is anything to prove."""
        self.certificate_inputs = None
        if pair == NOBODY:
            return None
        self._scheduler.prepare(tick)
        proof = self._scheduler.arm.prove(pair, self._scheduler.recall(pair).sphere)
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
            self._separation.compile(self._scheduler.arm.state)
        if self._certify:
            compile_proof()
