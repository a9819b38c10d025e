"""Makes the verdict from a tick's evaluations: level, speed scale, certificate and margin."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from armguard.monitor.doubtful_states import DoubtfulStates
from armguard.monitor.late_data import LateData
from armguard.monitor.levels import AWARE, CLEAR, SLOW, STOP, VerdictRule
from armguard.monitor.rising_scale import RisingScale
from armguard.monitor.second_look import SecondLook
from armguard.monitor.stop_decision import STEP, StopDecision
from armguard.obstacles.partners import NO_PARTNER
from armguard.pairs.scene import BOUND_NAMES
from armguard.robot.brakes import scale_that_rests, scale_within_range
from armguard.robot.joint_states import JointStates
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot
from armguard.robot.stop_time import ALL_COVERED
from armguard.scheduling.scheduler import NO_CONTACT, PermittedContact, Scheduler, Tick, TickResult
from armguard.scheduling.timing_wheel import NOBODY
from armguard.settings.settings import Settings
from armguard.verdict import (
    BRAKE,
    FINISH,
    Effect,
    Held,
    Level,
    Reason,
    ReasonKind,
    Verdict,
    sort_reasons,
)

if TYPE_CHECKING:
    from armguard.contact.earliest import Certificate
    from armguard.monitor.committed_pieces import CommittedPieces
    from armguard.monitor.limit_reasons import LimitReasons
    from armguard.pairs.separation_margin import SeparationMargin

NO_NAMES = (None, None)
"""Names of link and obstacle if no pair decides."""


class Contact(NamedTuple):
    """The first possible contact of a verdict."""

    names: tuple[str | None, str | None]
    """Names of its link and obstacle."""
    time: float
    """Its contact time, in [s] from now."""
    harm_time: float
    """The harm time, in [s] from now."""
    speed: float | None
    """Bound on the contact speed, in [m/s]; None without contact limits."""


MOST_SLOW_SCALE = 1.0 - STEP
"""Greatest speed scale while the level is SLOW."""


class Judge:
    """Makes verdicts of ticks whose joint state is believed.

    Args:
        robot: The arm.
        scheduler: Knows the pairs.
        states: Provides the joint states.
        rule: Makes levels.
        settings: Of the monitor.
        in_force: The operating limits and brakes in force; shared.

    Attributes:
        pieces: Pieces that the arm may be on; None if plans are not judged.
        certificate_inputs: Inputs of the last verdict's certificate.
    """

    def __init__(
        self,
        robot: Robot,
        scheduler: Scheduler,
        states: JointStates,
        rule: VerdictRule,
        settings: Settings,
        in_force: LimitsInForce,
    ) -> None:
        self._scheduler = scheduler
        self._rule = rule
        self._certify = settings.certify
        self._joints = robot.joints
        self._budget = settings.budget
        self._response_time = settings.response_time
        self._braking_delay = settings.braking_delay
        self._in_force = in_force
        self._velocity_error = np.array(robot.velocity_error)
        self._most_scale, self._most_scale_of = 1.0, -1
        self._rising = RisingScale(settings.scale_rise)
        self._stopping = None
        if settings.with_joints:
            self._stopping = StopDecision(scheduler, settings)
            states.delay_braking(self._stopping.looks_ahead - self._response_time)
        # What only some monitors do is loaded for these.
        self.pieces: CommittedPieces | None = None
        if scheduler.arm.motion.planned is not None:
            from armguard.monitor.committed_pieces import CommittedPieces

            self.pieces = CommittedPieces(robot, scheduler, settings)
        self._separation: SeparationMargin | None = None
        if settings.separation is not None:
            from armguard.pairs.separation_margin import SeparationMargin

            self._separation = SeparationMargin(settings.separation, self._braking_delay)
        self.certificate_inputs: dict[str, Any] | None = None
        self._limits: LimitReasons | None = None
        if settings.contact_limits is not None:
            from armguard.monitor.limit_reasons import LimitReasons

            self._limits = LimitReasons(scheduler, settings.contact_limits)
        self._look_again = SecondLook(scheduler, states, rule, settings, self._stopping)
        obstacles = scheduler.arm.obstacles
        self._late_data = LateData(obstacles, self._look_again, settings)
        self._doubtful = DoubtfulStates(obstacles, scheduler, self._look_again, self._late_data)
        self._compile(robot)

    def reset(self) -> None:
        """Drop speed scales and committed pieces."""
        self._late_data.reset()
        self._doubtful.reset()
        self._rising.reset()
        for memory in (self._stopping, self.pieces, self._limits):
            if memory is not None:
                memory.reset()

    def judge(
        self, stamp: float, tick: Tick, result: TickResult, reasons: list[Reason], *, unplaced: bool
    ) -> Verdict:
        """The verdict of a tick.

        Args:
            stamp: Of the joint state, in [s].
            tick: The tick.
            result: Result of its evaluations.
            reasons: Reasons so far; further ones are added.
            unplaced: Whether there are obstacles that found no room, and could be anywhere.
        """
        rule, stopping, pieces = self._rule, self._stopping, self.pieces
        if tick.now >= self._late_data.sample_at:
            self._late_data.follow(tick)
        pair, expiry, overdue, evaluated, _, _, ended = result
        contact_time = expiry - tick.time
        if unplaced:
            pair, contact_time = NOBODY, 0.0
        elif not contact_time > 0.0:
            contact_time = 0.0
        # The soonest contact that is not permitted.
        harm_pair, harm_time = pair, contact_time
        if self._limits is not None and pair != NOBODY:
            harm_pair, harm_expiry = self._scheduler.find_harm()
            harm_time = max(harm_expiry - tick.time, contact_time)
        standing = bool(reasons) and any(
            reason.kind.effect is Effect.STANDING for reason in reasons
        )
        spent_before = 0
        if stopping is not None:
            stopping.left = 0
            spent_before = stopping.evaluated
        # On a piece that is proved safe to its end, the arm rests whatever verdicts say.
        is_proved = pieces is not None and pieces.is_proved
        stop_time = tick.stop_time
        matters = not (overdue or standing or unplaced or harm_time > stop_time)
        # What was decided about in this tick is not overdue, though its certificate has ended.
        is_asked = matters and (ended > 0 or not is_proved) and stopping is not None
        is_decided = is_asked and stopping is not None and stopping.rests(tick)
        offending = NOBODY
        if self._limits is not None and stopping is not None and is_asked and not is_decided:
            offending = stopping.offending
        if not is_decided:
            overdue += ended
        rests = is_decided or (matters and is_proved and not overdue)
        complete = not overdue
        if overdue:
            reasons.append(Reason(ReasonKind.OVERDUE, detail=f"{overdue} pairs"))
            standing = True
        proved = None
        earned = rule.grade(harm_time, stop_time, rests=rests, whole=is_proved)
        permitted = None
        if self._limits is not None and is_proved:
            permitted = self._find_permitted_on_piece()
        elif self._limits is not None and earned is not STOP:
            within = stop_time if earned is not SLOW else max(stop_time, tick.late_stop_time)
            permitted = NO_CONTACT
            if not contact_time > within:
                permitted = self._scheduler.find_permitted_contact(tick, within)
        if permitted is not None and permitted.pair != NOBODY and earned is CLEAR:
            earned = AWARE
        may_slow = earned is SLOW and not (standing or rule.latched or rule.holds_stop(tick.now))
        if may_slow:
            proved = self._find_proved_scale(tick, harm_time)
        decided, held = rule.decide(
            tick.now,
            # At the end of a scale of 1 an arm at any speed rests in time.
            AWARE if proved == 1.0 else earned,
            complete=complete,
            standing=standing,
        )
        level = decided
        if level is SLOW and is_proved:
            # Held since before it was on the piece, and nothing is gained by a slower one.
            level, held = AWARE, earned is CLEAR
        elif level is SLOW and proved is None:
            proved = self._find_proved_scale(tick, harm_time)
        scale = self._give_scale(tick, level, proved, is_proved=is_proved)
        names = NO_NAMES if pair == NOBODY else self._scheduler.arm.names(pair)
        if level is not CLEAR and pair != NOBODY and earned is not CLEAR:
            if not (standing or held or unplaced):
                # Last of all questions, so that it disturbs none of those that decide.
                reasons += self._late_data.explain(tick, level)
                reasons += self._doubtful.explain(tick, level)
                reasons += self._tell_forbidden(tick, level, offending)
            told_pair, told_time = harm_pair, harm_time
            if offending != NOBODY:
                # Not the one of which harm could come first, but the one for which the arm stops.
                told_pair = offending
                told_time = max(self._scheduler.find_harm_expiry(offending) - tick.time, 0.0)
            deciding = names if told_pair == pair else self._scheduler.arm.names(told_pair)
            told = self._tell_contact(told_pair, deciding, told_time)
            if is_asked and stopping is not None and stopping.thrown != ALL_COVERED:
                joint = self._joints[stopping.thrown]
                thrown = f"; the stop of {joint} may throw it back beyond its brakes' range"
                told = told._replace(detail=told.detail + thrown)
            reasons.append(told)
        if permitted is not None and permitted.pair != NOBODY and level is not STOP:
            assert self._limits is not None, "nothing is permitted without limits"
            reasons.append(self._limits.tell_permitted(permitted))
        if len(reasons) > 1:
            sort_reasons(reasons)
        if rule.begins:
            rule.keep_cause(tick.now, harm_time, stop_time, reasons)
        cause = None
        if held:
            cause = rule.find_cause(decided)
            reasons.insert(0, Reason(ReasonKind.HOLD, detail=cause.describe(level, tick.now)))
        waiting = self._scheduler.waiting if level is STOP and complete else 0
        if waiting:
            some = "1 obstacle waits" if waiting == 1 else f"{waiting} obstacles wait"
            reasons.append(Reason(ReasonKind.CROWD, detail=f"{some}: a STOP is certain anyway"))
        if pieces is not None:
            evaluated += pieces.evaluated
        if stopping is not None:
            evaluated += stopping.evaluated - spent_before
            if stopping.left:
                reasons.append(self._tell_spent(stopping))
        speed = self._find_contact_speed(permitted if level is not STOP or is_proved else None)
        verdict = self._make_verdict(
            stamp,
            tick,
            level,
            Contact(names, contact_time, harm_time, speed),
            scale,
            evaluated,
            reasons,
            complete=complete,
            cause=cause,
        )
        if self._separation is not None:
            separation = self._measure_separation(tick, unplaced=unplaced)
            verdict = verdict._replace(separation=separation)
        if self._certify:
            verdict = verdict._replace(certificate=self._prove(tick, pair))
        return verdict

    def refuse(self, stamp: float, tick: Tick, reason: Reason, since: str) -> Verdict:
        """The verdict of a tick whose joint state is not believed: the worst case of each field.

        Args:
            stamp: Stamp of the joint state, in [s]; can be NaN.
            tick: The tick, whose arm may never stop.
            reason: Why the joint state is not believed; it is latched if its kind latches.
            since: Time of the reason, in words.
        """
        if self.pieces is not None:
            self.pieces.reset()
        self.certificate_inputs = None
        latches = reason.kind.effect is Effect.LATCHED
        if latches:
            self._rule.latch(reason, since)
        level, _ = self._rule.decide(tick.now, STOP, complete=False, standing=True)
        self._rising.give(tick.now, 0.0)
        contact = Contact(NO_NAMES, 0.0, 0.0, self._find_contact_speed(None))
        told = [] if latches else [reason]
        return self._make_verdict(stamp, tick, level, contact, 0.0, 0, told, complete=False)

    def _make_verdict(
        self,
        stamp: float,
        tick: Tick,
        level: Level,
        contact: Contact,
        scale: float,
        evaluated: int,
        reasons: list[Reason],
        *,
        complete: bool,
        cause: Held | None = None,
    ) -> Verdict:
        """Make a verdict; all verdicts are made here. `reasons` excludes the latched ones."""
        latched = self._rule.latched
        proved_until = None if self.pieces is None else self.pieces.proved_until
        stop = None
        if level is STOP:
            # On a piece of trajectory that is proved, and ends at rest, the arm may run it.
            stop = BRAKE if proved_until is None else FINISH
        # A named tuple's own constructor takes twice as long.
        return tuple.__new__(
            Verdict,
            (
                stamp,
                tick.number,
                level,
                contact.time,
                tick.stop_time,
                scale,
                *contact.names,
                complete,
                evaluated,
                (*latched.values(), *reasons) if latched or reasons else (),
                math.nextafter(tick.now + self._response_time, -math.inf),
                None,
                None,
                stop,
                proved_until,
                cause,
                contact.harm_time,
                contact.speed,
                None,  # configuration, run and arm are told by who publishes
                "",
                "",
            ),
        )

    def _find_permitted_on_piece(self) -> PermittedContact:
        """The reason for permitted contact that is possible on pieces the arm may be on."""
        assert self.pieces is not None, "asked where there are pieces alone"
        pair, speed = self.pieces.permitted
        if pair < 0:
            return NO_CONTACT
        return PermittedContact(pair, speed, self._scheduler.find_speed_limit(pair), speed)

    def _find_contact_speed(self, permitted: PermittedContact | None) -> float | None:
        """The verdict's bound on the speed of a contact, in [m/s]."""
        if self._limits is None:
            return None
        return math.inf if permitted is None else permitted.greatest

    def _tell_forbidden(self, tick: Tick, level: Level, offending: int) -> list[Reason]:
        """Why limits forbid the contact that led to a STOP, or to the scale of a SLOW.

        Args:
            tick: The tick.
            level: Its level, which is not held from earlier ones.
            offending: The pair that made the decision a STOP; NOBODY if there was none.
        """
        limits, stopping = self._limits, self._stopping
        if limits is None or stopping is None:
            return []
        told = None
        if level is STOP:
            told = limits.tell_forbidden(tick, offending, self._response_time, "")
        elif level is SLOW:
            begin, horizon = "at full speed: ", stopping.looks_ahead
            told = limits.tell_forbidden(tick, stopping.limiting, horizon, begin)
        return [] if told is None else [told]

    def _tell_contact(self, pair: int, names: tuple[Any, Any], contact_time: float) -> Reason:
        """The reason that names the deciding pair and its bound."""
        arm = self._scheduler.arm
        link, obstacle = names
        bound = BOUND_NAMES[self._scheduler.find_bound(pair)]
        detail = f"in {contact_time:.4g} s by the {bound} bound"
        partner = self._scheduler.find_partner(pair) if arm.obstacles.is_tethered else NO_PARTNER
        if partner != NO_PARTNER:
            detail += f", as it is tethered to {arm.obstacles.ids[partner]}"
        if arm.obstacles.is_entrance(pair // len(arm.links)):
            detail += ", by a body that may come out of it unseen"
        return Reason(ReasonKind.CONTACT, f"{link} and {obstacle}", detail)

    def _tell_spent(self, stopping: StopDecision) -> Reason:
        """The reason that the budget did not suffice for the stop decision."""
        some = "1 obstacle" if stopping.left == 1 else f"{stopping.left} obstacles"
        detail = f"{some} not decided about after {self._budget} evaluations"
        return Reason(ReasonKind.BUDGET_SPENT, f"budget={self._budget}", detail)

    def _find_proved_scale(self, tick: Tick, contact_time: float) -> float:
        """The proved speed scale, limited to what may be given out; 1: any speed is proved.

        A scale below 1 never exceeds the speeds that brakes are stated for. Safety does not depend
        on it: the level says whether a faster arm must stop.
        """
        stopping = self._stopping
        if stopping is None:
            # An arm that is no faster can brake before contact, whatever it does in this tick.
            left = max(contact_time - self._braking_delay, 0.0)
            fastest = self._in_force.velocity
            return float(scale_that_rests(self._in_force.brakes, fastest, left))
        most = self._find_most_scale(stopping)
        # Far off in time, nothing could touch an arm that goes on at any speed and brakes then.
        if contact_time > tick.late_stop_time:
            return most
        allowed = self._rising.find_most(tick.now)
        if allowed < MOST_SLOW_SCALE:
            most = min(most, allowed)
        return stopping.find_scale(tick, self._rising.given, most)

    def _give_scale(
        self, tick: Tick, level: Level, proved: float | None, *, is_proved: bool
    ) -> float:
        """The speed scale of a tick: 0 in STOP; in SLOW below 1 and at most the proved scale.

        It rises at a bounded rate in every level. In AWARE and CLEAR nothing else limits it: at
        these levels the arm can stop before contact from any speed, so SLOW comes in time. A
        committed piece must be followed as it was proved, not slower.
        """
        limit = 1.0
        if level is SLOW:
            assert proved is not None, "found wherever the level is SLOW"
            limit = min(proved, MOST_SLOW_SCALE)
        elif level is STOP:
            limit = 0.0
        if is_proved:
            return self._rising.give(tick.now, limit)
        return self._rising.follow(tick.now, limit)

    def _find_most_scale(self, stopping: StopDecision) -> float:
        """The greatest scale that stated brakes allow; computed only when they change.

        A joint at this scale may still accelerate until its brakes engage.
        """
        in_force = self._in_force
        if in_force.revision != self._most_scale_of:
            self._most_scale_of = in_force.revision
            self._most_scale = scale_within_range(
                in_force.brakes,
                in_force.velocity,
                self._velocity_error,
                in_force.acceleration,
                stopping.braking_delay,
            )
        return self._most_scale

    def _measure_separation(self, tick: Tick, *, unplaced: bool) -> float:
        """Margin of the separation distance in [m].

        It is negative infinite if obstacles found no room, or if the arm is not known to stop.
        """
        assert self._separation is not None, "called only where there is a rule"
        if unplaced or tick.stop_time == math.inf:
            return -math.inf
        self._scheduler.prepare(tick)
        state, watched = self._scheduler.arm.state, self._scheduler.watched_pairs()
        return self._separation.margin(state, tick.stop_time, watched)

    def _prove(self, tick: Tick, pair: int) -> Certificate | None:
        """Certificate of the deciding pair; None if there is nothing to prove."""
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
        scale_that_rests(self._in_force.brakes, self._in_force.velocity, 0.0)
        # Compiles what it runs.
        self._look_again.grade(tick, np.zeros(0, dtype=np.int64))
        if self._stopping is not None:
            self._find_most_scale(self._stopping)
            # Where nothing is near, neither stops nor scales have to be asked for.
            self._scheduler.find_unsafe(tick, 0.0)
            for most in (1.0, 0.5):
                self._scheduler.arm.motion.braking.tabulate(tick.q, tick.v, 0.0, 0.0, pace=most)
                # A scale that is to rise, and one that was given out before.
                self._stopping.find_scale(tick, 0.0, most)
                self._stopping.find_scale(tick, most, most)
                self._stopping.reset()
        if self.pieces is not None:
            self.pieces.compile(tick)
        if self._separation is not None:
            self._separation.compile(self._scheduler.arm.state)
        if self._certify:
            from armguard.pairs.proof import compile_proof

            compile_proof(self._scheduler.arm.state)
