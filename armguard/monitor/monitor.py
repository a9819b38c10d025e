"""The monitor: computes one verdict from one joint state, at every tick.

This module alone connects the whole chain: joint state, kinematics, bounds, obstacles, schedule,
evaluation, exact check, verdict. `step` never raises on outside data; it returns a STOP with its
reason. It reads no clock, does no I/O and logs nothing, so a replay of its inputs gives
bit-identical verdicts.
"""

from __future__ import annotations

import copy
import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import pinocchio
from numpy.typing import ArrayLike

from armguard.bounds.operating_history import UNKEPT, OperatingHistory
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.messages.events import Payload
from armguard.messages.incoming import Message, ResetMessage, WatchMessage
from armguard.messages.journal import Journal
from armguard.monitor.joint_reasons import (
    describe_refusal,
    describe_runaway,
    describe_unbraked,
    read_joint_vectors,
)
from armguard.monitor.judge import Judge
from armguard.monitor.levels import STOP, VerdictRule
from armguard.monitor.obstacle_reasons import (
    describe_broken_tethers,
    describe_no_sources,
    describe_spreads,
    take_obstacle_reasons,
)
from armguard.monitor.plan_verdict import refuse_plan
from armguard.monitor.queries import Queries
from armguard.monitor.reports import PairReport, Snapshot
from armguard.monitor.settings import (
    make_scheduler,
    read_settings,
    resolve_settings,
    take_keywords,
)
from armguard.monitor.trial import Choice, TrialTick
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.exemptions import Exemption, Exemptions
from armguard.pairs.ignored import IgnoredPairs
from armguard.robot.joint_acceptance import BELIEVED
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import NOTHING_FOUND, Tick, TickResult
from armguard.scheduling.timing_wheel import NOBODY
from armguard.settings.declarations import read_number
from armguard.settings.settings import Settings
from armguard.verdict import Effect, PlanChoice, PlanVerdict, Reason, ReasonKind, Verdict

if TYPE_CHECKING:
    from armguard.bounds.planned.plan import CheckedPlan, Plan
    from armguard.messages.proof import Proof
    from armguard.monitor.committed_pieces import CommittedPieces
    from armguard.monitor.contact_watch import ContactWatch
    from armguard.monitor.explain import Explanation
    from armguard.monitor.headroom import Attention, Headroom
    from armguard.robot.attachments import PreparedBody

NEVER = -sys.float_info.max
"""Value for the time of the last tick, before the first tick, in [s]."""


class Monitor:
    """Supervises one arm among obstacles.

    The constructor compiles all kernels, so that the first tick takes no longer than others.

    Args:
        robot: The arm.
        obstacles: The table of obstacles, which perception updates.
        settings: A `Settings` record. Instead, its fields can be given as keywords.

    Attributes:
        settings: Its settings, in which defaults that depend on the robot are resolved.
        journal: Receives all inputs and answers of the monitor, such as a `Recorder`; None: no
            journal.
        choice: The settings that `auto` chose, and why; None: nothing was chosen.

    Raises:
        ArmguardError: An argument is out of range or names something unknown, or an entrance
            contains a link that cannot leave it.
    """

    @overload
    def __init__(
        self, robot: Robot, obstacles: Obstacles, settings: Settings | None = None
    ) -> None: ...

    @overload
    @take_keywords(Settings)
    def __init__(self, robot: Robot, obstacles: Obstacles, /, **keywords: Any) -> None: ...

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        settings: Settings | None = None,
        **keywords: Any,
    ) -> None:
        if not isinstance(robot, Robot):
            remedy = 'armguard.Robot.load("panda") makes one'
            raise ArmguardError(
                "robot", f"is {robot!r}", expected="an armguard.Robot", remedy=remedy
            )
        if not isinstance(obstacles, Obstacles):
            raise ArmguardError(
                "obstacles",
                f"is {obstacles!r}",
                expected="an armguard.Obstacles",
                remedy="an empty table if there are none",
            )
        given = read_settings(settings, keywords)
        self._ignored = IgnoredPairs(given.ignore, robot, obstacles.source_names)
        self.settings = settings = resolve_settings(given, robot, self._ignored)
        self.journal: Journal | None = None
        self.choice: Choice | None = None
        self.period = settings.period
        self.robot = robot
        self.obstacles = obstacles
        self.base_placement: pinocchio.SE3 = settings.base_placement
        self._fresh_share = settings.fresh_share
        self._source_timeout = settings.source_timeout
        self._rule = rule = VerdictRule(settings)
        self._in_force = in_force = settings.put_in_force(robot)
        self._operating = None
        if settings.has_operating:
            self._operating = OperatingHistory(robot, in_force, rule.rise_delay)
        self._states = JointStates(
            robot,
            settings.longest_joint_step,
            settings.response_time,
            settings.reaction_time,
            settings.period,
            in_force,
        )
        self._exemptions = Exemptions(obstacles, self._ignored)
        self._scheduler = make_scheduler(
            robot,
            obstacles,
            settings,
            self._ignored,
            self._states,
            in_force,
            self._operating,
            self._exemptions,
        )
        if len(obstacles.entrance_rows):
            from armguard.monitor.entrances import check_entrances

            check_entrances(self._scheduler.arm)
        self._judge = Judge(robot, self._scheduler, self._states, rule, settings, in_force)
        self._queries = Queries(robot, obstacles, settings, self._scheduler, self._states, in_force)
        self._contact: ContactWatch | None = None
        if settings.permits_contact:
            from armguard.monitor.contact_watch import ContactWatch

            self._contact = ContactWatch(robot, self._scheduler)
        self._last: tuple[Tick | None, TickResult] = None, NOTHING_FOUND
        self._decided_by = 0
        """Revision of the obstacle that decided the last verdict, in its tick."""
        self._epoch = math.nan
        self._now = NEVER
        self._quiet_until = -math.inf
        self._unplaced = self._no_sources = self._reloaded = False
        self._reasons: list[Reason] = []
        self._stopped_by_braking = False
        self._sequence = 0
        self._disbelieved = 0
        self._faults_before = obstacles.fault_count

    @classmethod
    def auto(
        cls,
        robot: Robot,
        obstacles: Obstacles,
        trial: Iterable[TrialTick] | str | Path | None = None,
        *,
        keeps_cover: bool = False,
        **settings: Any,
    ) -> Monitor:
        """Make a monitor with settings that a trial chooses for a scene.

        Each candidate runs through the trial with its own table. The finest settings, which
        evaluate every pair in every tick, are the reference. The result is the cheapest candidate
        with practically the same verdicts: the same level in 99 % of the ticks, and speed scales
        that differ by at most 0.01 on average. The trial chooses the staleness of answers, the
        level of the cover, the motion model, and a budget with a reserve. Costs are counted in
        evaluations, so the choice does not depend on the machine. Safety does not depend on the
        choice: every candidate errs to the safe side and watches every link, obstacle and source.
        In a scene unlike the trial, verdicts are more cautious than the reference, never less safe.

        If the reference gives only one level in the trial, only STOP or only CLEAR, the trial shows
        nothing. The defaults are kept then, and the choice says so.

        The trial takes as long as about twelve monitors and the reference take for its ticks. It
        leaves nothing in the monitor or its table.

        Args:
            robot: The arm. Its cover is cut to the chosen level; after an error it is unchanged.
            obstacles: The table, which must have no obstacles yet except statics.
            trial: Joint states, and updates of obstacles between them: some seconds of the expected
                motions and people, including their nearest moments. Or the path of a recording.
                None: a simulated person approaches the working arm.
            keeps_cover: Whether to keep the robot's cover unchanged.
            **settings: As in `Monitor`; settings given here are not chosen.

        Returns:
            The monitor; its `choice` says which settings were chosen, and why.

        Raises:
            ArmguardError: A setting is unusable, the table has obstacles already, the trial is
                empty or has elements other than `TrialTick`, or a schedule other than "deadline" is
                given, whose settings cannot be chosen.
        """
        # What tries settings stands above this package, and is loaded for a trial alone.
        from armguard import choose_settings

        choice = choose_settings(robot, obstacles, trial, keeps_cover=keeps_cover, **settings)
        whole = robot.cover
        try:
            if choice.level is not None:
                robot.cover = whole.cut(choice.level)
            monitor = cls(robot, obstacles, **{**settings, **choice.settings})
        except BaseException:
            robot.cover = whole
            raise
        monitor.choice = choice
        return monitor

    def __repr__(self) -> str:
        settings = self.settings
        watched = f"{self.robot!r}, {self.obstacles!r}"
        return f"Monitor({watched}, {settings.rate:g} Hz, motion={settings.motion!r})"

    @property
    def certificate_inputs(self) -> dict[str, Any] | None:
        """The inputs of the last verdict's certificate: arguments of `certificate.verify`."""
        return self._judge.certificate_inputs

    @property
    def payload(self) -> float:
        """Greatest mass that the arm carries, tool included, in [kg]; selects the brakes' entries.

        It can be set at any time between steps; None is the heaviest payload of the brakes. It
        applies from the next step on, which drops all earlier proofs and evaluates all pairs. It
        must be increased before the arm lifts a load, and decreased only after the arm has put it
        down.

        Raises:
            RobotError: It is not a number, is negative, or exceeds the payloads of the robot's
                brakes. The payload is unchanged then.
        """
        return self._in_force.payload

    @payload.setter
    def payload(self, payload: float | None) -> None:
        before = self._in_force.payload
        self._in_force.load(payload)
        if self._in_force.payload != before:
            self._reloaded = True
        self._note(Payload(payload=self._in_force.payload))

    @property
    def joint_velocities(self) -> FloatArray:
        """Velocities of the last believed joint state, in [rad]/[s] or [m]/[s]. Shape (nv,)."""
        return self._states.v.copy()

    @property
    def ticks(self) -> int:
        """Number of steps so far."""
        return self._sequence

    @property
    def faults(self) -> int:
        """Number of faults since construction: refused rows and calls, and states not believed."""
        return self._disbelieved + self.obstacles.fault_count - self._faults_before

    def step(
        self,
        stamp: float,
        q: ArrayLike,
        v: ArrayLike,
        now: float | None = None,
    ) -> Verdict:
        """Judge one joint state.

        Never raises on bad data: data that cannot be believed give a STOP with its reason.

        Args:
            stamp: Time of measurement of the joint state, in [s] on the clock of the obstacles'
                stamps.
            q: Joint positions in the order of `robot.joints`, [rad] or [m]. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
            now: Time of this tick, in [s]; None: the stamp.
        """
        self._sequence += 1
        if now is None:
            now = stamp
        journal = self.journal
        if journal is not None:
            journal.note_state(stamp, q, v, now)
        try:
            verdict = self._step(stamp, q, v, now)
        except Exception as error:
            # Whatever went wrong inside, the arm must stop.
            verdict = self._refuse(
                read_number(stamp),
                Reason(ReasonKind.INTERNAL_ERROR, type(error).__name__, str(error)),
            )
        if journal is not None:
            journal.note_verdict(verdict)
        return verdict

    def run(self, source: Iterable[tuple[Any, ...]], sink: Callable[[Verdict], object]) -> None:
        """Step through all joint states of a source, until it ends.

        Args:
            source: Arguments of `step`, one tuple per tick: stamp, q, v and optionally now. The
                iterator can update the obstacles in between.
            sink: Called with each verdict.
        """
        for state in source:
            sink(self.step(*state))

    def reset(self) -> None:
        """Drop latched faults and past joint states; every pair is evaluated again.

        Suspended operating limits stay suspended until the arm has kept them for `rise_delay`. The
        reset also drops obstacles and sources that no message may ever end: an obstacle without any
        believable state, and, if sources are named, an unnamed silent source without obstacles.
        Notes of the next verdict name them.

        Committed pieces are dropped: the arm must be at rest, and the controller must drop its
        pieces.

        Levels rise only after `rise_delay` seconds of evidence from the next tick on. The time of
        the next tick can be earlier than that of the last one.
        """
        self._note(ResetMessage(""))
        self._rule.reset()
        self._states.reset()
        if self._operating is not None:
            self._operating.reset()
        self.obstacles.forget_unbelieved(self._now, self._source_timeout)
        self._exemptions.reset()
        self._scheduler.restart()
        self._judge.reset()
        if self._contact is not None:
            self._contact.reset()
        self._last = None, NOTHING_FOUND
        self._now = NEVER
        self._epoch = math.nan
        self._quiet_until = -math.inf
        self._reasons = []
        self._stopped_by_braking = False

    def prepare(self, *bodies: PreparedBody) -> None:
        """Prepare the arm with some bodies attached, so that no step has to wait for it.

        Call it once for each sequence of bodies that can be attached at the same time. It takes
        some 100 ms, so call it before the loop or when a late step does no harm. Later, after
        `robot.attach_prepared` or `robot.detach` between two steps, the next step needs about 0.5
        ms more, in which it evaluates all obstacles. Until then nothing changes. The order matters,
        since it numbers the links: bodies that are attached in another order are prepared in the
        step itself.

        Args:
            bodies: Results of `Robot.prepare`, to be attached in addition to the present ones, in
                the order in which they will be attached.

        Raises:
            RobotError: A name is in use, or there is no such link.
        """
        robot = copy.copy(self.robot)
        for body in bodies:
            robot.attach_prepared(body)
        self._scheduler.prepare_arm(robot)

    def ignore(
        self,
        link: str,
        ids: str,
        source: str | None = None,
        *,
        until: float | None = None,
        zone: ArrayLike | None = None,
    ) -> int:
        """Permit a wanted contact for a while: its pair is not watched until a time, or in a zone.

        From the next step on, a step skips the pair if only wanted contact is possible before the
        arm is at rest, in case that step gives a STOP. So a pair with a time is watched again
        earlier than that time, by the stop time of the arm. A pair with a zone is skipped only
        while the obstacle, within its bounds, cannot leave the zone during the stop time. The
        proofs are in `armguard.pairs.exemptions`. From the first step in which a pair is watched
        again, it is evaluated as if it had always been watched.

        Notes of verdicts name the pairs that are not watched, and say why an exempt pair is still
        watched. Recordings have a line about each beginning and end. While the arm is on a
        committed piece, it can follow the piece to its end whatever verdicts say. So nothing is
        exempt then, and plans are judged with all pairs. `reset` ends exemptions with a time, since
        the clock may start anew.

        Args:
            link: Name of a link; "*" is every link.
            ids: Pattern of obstacle ids. A pattern that has matched no obstacle yet is a STOP that
                names it, as in the setting `ignore`.
            source: Name of a source, to which the pattern is restricted; its obstacles can appear
                later. None: obstacles of all sources, and statics.
            until: Time at which wanted contact ends, in [s] of the monitor's clock; None: the zone
                decides.
            zone: Corners of a convex region in the world in which contact is wanted, in [m]; None:
                anywhere. Shape (k, 3), 4 <= k <= 8.

        Returns:
            The number of the exemption, for `watch`.

        Raises:
            ArmguardError: Neither a time nor a zone is given, the time is not finite or is past,
                the zone has no volume, the link or the source is unknown, or no pair would be left
                to watch. Nothing is changed then.
        """
        exemption = self._exemptions.add(link, ids, source, until=until, zone=zone, now=self._now)
        self._note(exemption.to_message())
        return exemption.number

    def watch(self, number: int) -> None:
        """End an exemption of `ignore` from the next step on; no effect if it has already ended.

        Args:
            number: Number that `ignore` returned.

        Raises:
            ArmguardError: `ignore` returned no such number.
        """
        self._exemptions.end(number)
        self._note(WatchMessage(int(number)))

    @property
    def exemptions(self) -> tuple[Exemption, ...]:
        """Exemptions that `ignore` began and that have not ended."""
        return self._exemptions.listed

    @property
    def exemption_count(self) -> int:
        """Number of exemptions that `ignore` has begun so far."""
        return self._exemptions.count

    def with_stop(self, plan: Plan) -> Plan:
        """A plan with a stop at its end, as hard as the brakes guarantee, ready to commit.

        Each joint decelerates as its own brake guarantees, so the arm leaves its path.
        `armguard.stop_on_path` decelerates all joints together, on the path. A plan that ends at
        rest is returned unchanged.

        Raises:
            ArmguardError: The plan is malformed, or the monitor was not made with motion="planned".
        """
        return self._find_pieces("with_stop").with_stop(plan)

    def commit(self, plan: Plan) -> PlanVerdict:
        """Judge whether the next piece of the controller's trajectory, which ends at rest, is safe.

        A piece is safe if nothing can touch the arm on it until the arm is at rest. A safe piece is
        committed: the arm can be on it from now on, until joint states show that it is on another
        piece or on none. The piece must agree with the one before until the answer has arrived,
        `latency` from now. For the first piece, the arm must be at rest until then.

        A committed piece stays safe without further evaluation while obstacles stay within the
        states that it allows. An obstacle outside them makes that tick judge the piece again. Then
        `stop` of a STOP says whether to finish the piece or to leave it. An arm that brakes joint
        by joint, in an emergency stop or without power, leaves its piece. Only `leave="any"` covers
        this.

        The piece is judged with the data of the last step, so call this after a step. If something
        has changed since, or was faulty in that step, the piece is refused with a reason. No
        content of a plan raises an error.

        Args:
            plan: The piece, on the clock of the joint states' stamps.

        Raises:
            ArmguardError: The monitor was not made with motion="planned".
        """
        return self.fastest([plan]).verdicts[-1]

    def fastest(self, candidates: Iterable[Plan]) -> PlanChoice:
        """Commit the first safe piece of several candidates; see `commit`.

        A controller offers its preferred piece first, and slower ones after it. A candidate is read
        from the iterable only after all earlier ones were refused, so no candidate is made in vain.

        Args:
            candidates: Pieces, each ending at rest, on the clock of the joint states' stamps.

        Returns:
            The committed candidate, if any, and the answers to all judged candidates.

        Raises:
            ArmguardError: The monitor was not made with motion="planned".
        """
        pieces = self._find_pieces("commit")
        # A plan is run to its end whatever verdicts say, so it is judged by all pairs.
        rows = self._exemptions.suspend()
        if len(rows):
            self._scheduler.watch_anew(rows)
        tick, journal = self._find_tick_to_plan(), self.journal
        answers: list[PlanVerdict] = []
        for number, plan in enumerate(candidates):
            if journal is not None:
                journal.note_plan(plan)
            answer = tick if isinstance(tick, PlanVerdict) else pieces.commit(plan, tick)
            if journal is not None:
                journal.note_plan_verdict(answer)
            answers.append(answer)
            if answer.safe:
                return PlanChoice(number, tuple(answers))
            if answer is tick:
                # So would be all others.
                break
        return PlanChoice(None, tuple(answers))

    @property
    def plans(self) -> list[CheckedPlan]:
        """The committed pieces that the arm can be on; for observers."""
        pieces = self._judge.pieces
        return [] if pieces is None else pieces.plans

    def pairs(self, limit: int = 64) -> list[PairReport]:
        """The most imminent pairs of the last tick, at most `limit`, by contact time.

        Raises:
            ArmguardError: The limit is not an integer.
        """
        return self._queries.pairs(self._last[0], limit)

    def explain(self) -> Explanation | None:
        """Explain the last verdict, and what would have improved it or avoided a STOP.

        Returns None if no pair decided the verdict, because there are no pairs or other reasons
        decided it. Also returns None if the obstacle was removed since.
        """
        tick, result = self._last
        if tick is None or result.pair == NOBODY or self._unplaced:
            return None
        return self._queries.explain(tick, result.pair, by_braking=self._stopped_by_braking)

    def prepare_proofs(self) -> None:
        """Compile the kernels of `prove`, so that the first proof takes no longer than others."""
        self._queries.prepare_proofs()

    def prove(self, verdict: Verdict) -> Proof | None:
        """Make the proof about the deciding pair of the last verdict, for `armguard_check`.

        The proof is computed on request, in the time of some evaluations. Call this before the
        next update of the obstacle. docs/proofs.md says what a proof claims.

        Args:
            verdict: The verdict that the last step returned.

        Returns:
            The proof; None if there is nothing to prove: no pair decided, the obstacle was updated
            or removed since or could be anywhere, the payload was changed since, the joint state is
            newer than its tick or was not believed, or a newer verdict exists.
        """
        tick, result = self._last
        is_last = tick is not None and tick.number == verdict.sequence == self._sequence
        if tick is None or not is_last or result.pair == NOBODY or self._unplaced:
            return None
        if self._reloaded or self._scheduler.revision(result.pair) != self._decided_by:
            return None
        return self._queries.prove(tick, result.pair, verdict)

    def headroom(self) -> Headroom:
        """Predict evaluations per tick, and the number or rate that would exceed the budget."""
        return self._queries.headroom(self._last[0])

    def attention(self, limit: int = 8) -> list[Attention]:
        """The obstacles whose fresh states would raise the verdict's contact time most.

        Args:
            limit: Greatest number of obstacles; the most useful come first.

        Raises:
            ArmguardError: The limit is not an integer.
        """
        return self._queries.attention(self._last[0], limit)

    def snapshot(self, *, pair_limit: int, row_limit: int) -> Snapshot:
        """Copy the data of the last tick for observers; cheap, and not changed by later ticks.

        Args:
            pair_limit: Greatest number of pairs; the most imminent ones are returned.
            row_limit: Greatest number of obstacles; the most imminent ones are returned.

        Raises:
            ArmguardError: A limit is not an integer.
        """
        return self._queries.snapshot(self._last[0], pair_limit, row_limit)

    def _step(self, stamp: float, q: Any, v: Any, now: float) -> Verdict:
        if not (type(stamp) is float and type(now) is float):
            stamp, now = read_number(stamp), read_number(now)
        if not self._now <= now < math.inf:
            return self._refuse_time(stamp, now)
        self._now = now
        if not -math.inf < stamp < math.inf:
            return self._refuse_time(stamp, now)
        scheduler, states = self._scheduler, self._states
        obstacles, number = self.obstacles, self._sequence
        scheduler.follow()
        if math.isnan(self._epoch):
            self._epoch = now
        epoch = self._epoch
        if not states.is_plain(q, v):
            read = read_joint_vectors(q, v, len(states.q))
            if isinstance(read, Reason):
                return self._refuse(stamp, read)
            q, v = read
        operating = self._operating
        # While a state is not believed, nobody sees whether limits are kept.
        resumes = operating is not None and not self._rule.latched and operating.resumes(now)
        if resumes:
            # What was proved with wider limits holds with these, too.
            scheduler.arm.follow_limits(states.v)
        quiet = now < self._quiet_until and obstacles.is_quiet(now, self._source_timeout)
        # Under another payload nothing may be decided before all certificates are invalid.
        exemptions = self._exemptions
        # What is exempt is decided by the stop time that this tick's joint state leaves.
        exempts = not exemptions.is_idle
        usual = quiet and not (self._reloaded or exempts)
        found, joint, stop_time, late, result = scheduler.advance(
            stamp, q, v, now, epoch, number, usual
        )
        if found < BELIEVED:
            return self._refuse_state(stamp, describe_refusal(states, found, joint, stamp, q, v))
        reasons: list[Reason] = []
        notes: list[Reason] = []
        unbraked = None
        if result is None:
            # Not the usual tick: there may be something to do before evaluations.
            if operating is not None and found & UNKEPT:
                reasons += self._suspend(operating, now)
                stop_time, late = states.stop_times(now - stamp)
            if self._reloaded:
                reasons += self._reload()
            if found:
                unbraked = describe_unbraked(states, now - stamp)
                runaway = describe_runaway(states)
                if runaway is not None:
                    reasons.append(runaway)
            if (found or scheduler.arm.motion.isotropic.is_widened) and scheduler.arm.follow_limits(
                states.v
            ):
                scheduler.invalidate_all()
            if not quiet:
                reasons += self._read_obstacles(now)
            if exempts:
                notes = self._follow_exemptions(now, max(stop_time, late), unbraked)
        tick: Tick = tuple.__new__(
            Tick,
            (
                number,
                now,
                now - epoch,
                states.q,
                states.v,
                now - stamp,
                stop_time,
                # Children are opened only where a refinement could still matter to the level.
                (stop_time + self._rule.aware_margin) / self._fresh_share,
                late,
            ),
        )
        if result is None:
            result = scheduler.evaluate_due(tick)
        pieces = self._judge.pieces
        if pieces is not None:
            disturbed = result.disturbed or bool(result.broken) or not quiet
            found_unsafe = pieces.update(tick, stamp, disturbed=disturbed, unplaced=self._unplaced)
            if found_unsafe is not None:
                reasons.append(self._blame_contact(found_unsafe, ReasonKind.PLAN_VOID))
        is_proved = pieces is not None and pieces.is_proved
        # On a piece brakes were found to be stated for all its speeds.
        if unbraked is not None and not is_proved:
            reasons.append(unbraked)
            # How far to look ahead needed a number; that the arm rests by then is not known.
            tick = tick._replace(stop_time=math.inf, late_stop_time=math.inf)
        self._last = tick, result
        self._decided_by = scheduler.revision(result.pair)
        contact = self._contact
        if contact is not None:
            reasons += contact.update(tick, result.expiry, is_on_piece=is_proved)
        for row in result.broken:
            if not obstacles.table.touched[row]:
                reasons.append(Reason(ReasonKind.BOUND_BROKEN, obstacles.ids[row]))
        if obstacles.has_wide_spreads:
            reasons += describe_spreads(obstacles)
        if obstacles.is_tethered and obstacles.has_broken_tethers:
            reasons += describe_broken_tethers(obstacles)
        if self._no_sources:
            reasons.append(describe_no_sources(obstacles))
        if self._ignored.unmatched or (exempts and exemptions.unmatched):
            reasons += self._tell_unmatched()
        verdict = self._judge.judge(stamp, tick, result, reasons, unplaced=self._unplaced)
        if notes:
            # Last, since nothing rests on them.
            verdict = verdict._replace(reasons=(*verdict.reasons, *notes))
        if contact is not None:
            contact.note_verdict(tick, verdict)
        self._reasons = reasons
        # Beside another reason to stop, or on a piece, more than the brakes would decide.
        self._stopped_by_braking = (
            verdict.level is STOP
            and verdict.complete
            and not (self._unplaced or is_proved)
            and all(
                one.kind.effect is Effect.NOTE or one.kind is ReasonKind.BRAKES_NOT_COVERED
                for one in verdict.reasons
            )
        )
        return verdict

    def _note(self, message: Message) -> None:
        """Send a message to the journal, if there is one."""
        if self.journal is not None:
            self.journal.note_message(message)

    def _find_pieces(self, method: str) -> CommittedPieces:
        if self._judge.pieces is None:
            raise ArmguardError(method, "needs plans", remedy='Monitor(..., motion="planned")')
        return self._judge.pieces

    def _find_tick_to_plan(self) -> Tick | PlanVerdict:
        """The last tick if it can judge a plan; else the reason why not."""
        tick, _ = self._last
        obstacles, latched = self.obstacles, self._rule.latched
        if tick is None:
            return refuse_plan("arm", "its state is not known: step first")
        if latched:
            return refuse_plan("arm", f"its state is not believed: {next(iter(latched.values()))}")
        if obstacles.unplaced():
            return refuse_plan("obstacles", "some found no room, and could be anywhere")
        for reason in self._reasons:
            # What is touched is looked at by itself: a piece may recede from it.
            is_standing = reason.kind.effect is Effect.STANDING
            if is_standing and reason.kind is not ReasonKind.IN_CONTACT:
                return refuse_plan("last step", f"was a STOP: {reason}")
        if self._reloaded:
            return refuse_plan("payload", "has changed since the last step: step first")
        if self.robot.revision != self._scheduler.arm.revision:
            return refuse_plan("tool", "was attached or detached since the last step: step first")
        if (
            obstacles.has_membership_changes
            or obstacles.has_new_tethers
            or obstacles.table.changed_count[0] > 0
        ):
            detail = "have changed since the last step by more than it allowed for: step first"
            return refuse_plan("obstacles", detail)
        if not obstacles.is_settled(self._now, self._source_timeout):
            return refuse_plan("obstacles", "were refused, or a source is new: step first")
        return tick

    def _reload(self) -> list[Reason]:
        """Drop all proofs that assumed brakes under another payload."""
        self._reloaded = False
        self._scheduler.invalidate_all()
        void = None
        if self._judge.pieces is not None:
            void = self._judge.pieces.drop("payload", f"is {self.payload:g} kg now")
        return [] if void is None else [void]

    def _suspend(self, operating: OperatingHistory, now: float) -> list[Reason]:
        """Put the hardware's limits in force; proofs with operating limits no longer hold.

        Proofs of committed pieces assume only the hardware's limits, and still hold.
        """
        operating.suspend(now)
        self._scheduler.invalidate_all()
        found = operating.describe_break(self._states.v)
        return [Reason(ReasonKind.OPERATING_LIMITS_BROKEN, *found)]

    def _follow_exemptions(
        self, now: float, horizon: float, unbraked: Reason | None
    ) -> list[Reason]:
        """Update the exempt pairs of this tick, and report them.

        Args:
            now: Time of the tick, in [s].
            horizon: Time by which the arm is at rest after a STOP by the next verdict, or at the
                end of a speed scale, in [s].
            unbraked: Why this time is unknown; None: it is known.
        """
        pieces = self._judge.pieces
        if unbraked is not None or (pieces is not None and pieces.is_proved):
            # A piece is run to its end, whatever verdicts say.
            horizon = math.inf
        exemptions = self._exemptions
        change = exemptions.update(now, horizon)
        if len(change.rows):
            self._scheduler.watch_anew(change.rows)
        if self.journal is not None:
            for line in change.lines:
                self.journal.note(line)
        watched = ReasonKind.PAIR_WATCHED
        told = [Reason(watched, str(one), "it has ended") for one in change.ended]
        for one in exemptions.states:
            kind = ReasonKind.PAIR_IGNORED if one.left_out else watched
            told.append(Reason(kind, str(one.exemption), one.detail))
        return told

    def _tell_unmatched(self) -> list[Reason]:
        """Reasons about patterns of `ignore` that have matched no obstacle."""
        detail = self._ignored.describe_unmatched(self.obstacles.ids)
        unmatched = [*self._ignored.unmatched, *self._exemptions.unmatched]
        return [Reason(ReasonKind.IGNORE_UNMATCHED, repr(ids), detail) for ids in unmatched]

    def _read_obstacles(self, now: float) -> list[Reason]:
        """Faults of the obstacle table, and the time until which no source can time out."""
        obstacles = self.obstacles
        reasons = take_obstacle_reasons(obstacles, now, self._source_timeout, self._rule.rise_delay)
        self._unplaced = bool(obstacles.unplaced())
        self._no_sources = not obstacles.has_sources
        self._quiet_until = -math.inf
        if not self._unplaced:
            # Until then no source can have been silent for too long; rounding is allowed for.
            self._quiet_until = obstacles.quiet_until(self._source_timeout) - self.period
        return reasons

    def _refuse_time(self, stamp: float, now: float) -> Verdict:
        """The verdict of a tick whose time is not finite, or is before the last tick."""
        if not (math.isfinite(now) and math.isfinite(stamp)):
            return self._refuse(stamp, Reason(ReasonKind.TIME_INVALID, f"stamp {stamp}, now {now}"))
        reason = Reason(ReasonKind.TIME_BACKWARDS, "clock", f"{now!r} after {self._now!r}")
        self._now = now
        return self._refuse(stamp, reason)

    def _blame_contact(self, reason: Reason, kind: ReasonKind) -> Reason:
        """The reason, or one about contact if the reason has this kind and contact explains it."""
        contact = self._contact
        if contact is None or reason.kind is not kind or not contact.explains_jump(self._now):
            return reason
        return reason._replace(kind=ReasonKind.MOVED_BY_CONTACT)

    def _refuse_state(self, stamp: float, reason: Reason) -> Verdict:
        """The verdict of a tick whose joint state is impossible.

        It latches, unless permitted contact may have moved the joint. Then states are believed
        again from the next one on.
        """
        blamed = self._blame_contact(reason, ReasonKind.JOINT_STATE_JUMPED)
        if blamed is not reason:
            self._states.reset()
        return self._refuse(stamp, blamed)

    def _refuse(self, stamp: float, reason: Reason) -> Verdict:
        """The verdict of a tick whose joint state is not believed: the worst case of each field."""
        # One cause that latches is one fault, however many ticks it lasts.
        self._disbelieved += reason.kind not in self._rule.latched
        self._last = self._last[0], NOTHING_FOUND
        self._scheduler.invalidate_all()
        is_known = self._now != NEVER
        now = self._now if is_known else 0.0
        since = f"{now:.3f} s" if is_known else "before the first tick"
        q, v = self._states.q, self._states.v
        tick = Tick(self._sequence, now, 0.0, q, v, 0.0, math.inf, 0.0)
        return self._judge.refuse(stamp, tick, reason, since)
