"""The monitor: one joint state in, one verdict out, at every tick.

The only module that knows the whole chain: joint state, kinematics, bounds, obstacles, schedule,
evaluation, exact check, verdict. `step` never raises on what comes from outside; it says STOP and
why. It reads no clock, does no I/O and logs nothing, so that a replay of its inputs gives the same
verdicts to the bit.
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
"""Time of the last tick before the first one, in [s]."""


class Monitor:
    """Supervises one arm among obstacles.

    Everything is compiled here, in the constructor, so that the first tick is like any other.

    Args:
        robot: The arm.
        obstacles: The table that perception writes to.
        settings: A `Settings` record; without it, its fields as keywords.

    Attributes:
        settings: What it was made with; nothing that the robot decides is left open.
        journal: Is told all that reaches the monitor, and its answers; None: nothing is.
        choice: What `auto` chose of the settings, and why; None: nothing was chosen.

    Raises:
        ArmguardError: If an argument is out of range or names what does not exist, or an entrance
            is around a link that cannot leave it.
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
        """A monitor with the settings that a scene requires, chosen by a trial.

        Each candidate is led through the trial with a table of its own. Chosen is the cheapest
        whose verdicts cannot be told from those of the finest, which evaluates every pair in every
        tick: the same level in 99 % of the ticks, and speed scales that differ by 0.01 at most on
        average. What is chosen is how stale answers may look, the level of the cover, the motion
        model, and a budget with room to spare. The price is counted in evaluations, so the choice
        does not depend on the machine. Safety does not rest on it: each setting errs to the safe
        side, and watches every link, obstacle and source; a scene that is not like the trial is
        judged more cautiously than by the finest, never less safely.

        A trial in which the finest says one level alone, nothing but STOP or nothing but CLEAR,
        shows nothing: what is usual stays, and the choice says so.

        The trial takes as long as some twelve monitors and the finest take for its ticks; nothing
        of it is left in the monitor or its table.

        Args:
            robot: The arm. Its cover is cut to the level that is chosen; after an error it is as
                it was.
            obstacles: The table, in which nothing was told yet but obstacles that stand still.
            trial: Joint states, and what is told of obstacles between them; some seconds of the
                motions and the people that are to be expected, nearest moments included. Or the
                path of a recording; None: a simulated person comes up to the arm at work.
            keeps_cover: Whether the robot's cover stays as it is.
            **settings: As in `Monitor`; what is given here stands and is not chosen.

        Returns:
            The monitor; its `choice` says what was chosen and why.

        Raises:
            ArmguardError: A setting is unusable, the table was told already, the trial is empty or
                has something else than `TrialTick`, or a schedule other than "deadline" is given,
                of which there is nothing to choose.
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
        """What the last verdict's certificate is about: arguments of `certificate.verify`."""
        return self._judge.certificate_inputs

    @property
    def payload(self) -> float:
        """What the arm carries at most, in [kg]: which of its brakes' entries count.

        It may be set at any time between steps, to None for the heaviest that the brakes are stated
        for. It counts from the next step on, in which all pairs are evaluated and what was proved
        before is forgotten. Say more before the arm lifts it, and less after it has put it down.

        Raises:
            RobotError: It is no number, negative, or above what the robot's brakes are stated for;
                the one before stays.
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
        """Of the last joint state that was believed, in [rad]/[s] or [m]/[s]. Shape (nv,)."""
        return self._states.v.copy()

    @property
    def ticks(self) -> int:
        """How many steps there were so far."""
        return self._sequence

    @property
    def faults(self) -> int:
        """Faults since construction: refused rows and calls, and states not believed."""
        return self._disbelieved + self.obstacles.fault_count - self._faults_before

    def step(
        self,
        stamp: float,
        q: ArrayLike,
        v: ArrayLike,
        now: float | None = None,
    ) -> Verdict:
        """Judge one joint state.

        Never raises on bad data: whatever cannot be believed is a STOP with its reason.

        Args:
            stamp: When the joint state was measured, in [s] on the clock of the obstacles' stamps.
            q: Joint positions in the order of `robot.joints`, [rad] or [m]. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
            now: Time of this tick, in [s]; the stamp unless given.
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
            source: Arguments of `step`, one tuple a tick: stamp, q, v and, where it is not the
                stamp, now. What makes them may update the obstacles in between.
            sink: Is called with each verdict.
        """
        for state in source:
            sink(self.step(*state))

    def reset(self) -> None:
        """Forget latched faults and past joint states; every pair is evaluated anew.

        Operating limits that are suspended stay so until they have been kept for `rise_delay`. What
        of the obstacles no message may ever end is forgotten as well, and named by notes of the
        next verdict: an obstacle of which no state was ever believable; and where the sources were
        named, another one that is silent and has no obstacle.

        Committed pieces are forgotten: the arm must rest, and the controller must drop its pieces.

        Levels rise only after `rise_delay` seconds of evidence, counted from the next tick on; its
        time may be earlier than that of the ticks before.
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
        """Lay out the arm as it will be with some bodies attached, so that no step waits for it.

        For each sequence of bodies that may be attached at the same time, before the loop or where
        a late step does no harm, for it takes some 100 ms. Then `robot.attach_prepared` and
        `robot.detach` between two steps are taken in by the next one in about half a millisecond,
        in which all obstacles are evaluated anew. Nothing changes until then. The order counts,
        since links are numbered in it: bodies that are attached in another order than they were
        prepared in are laid out in that step, as if nothing had been prepared.

        Args:
            bodies: What `Robot.prepare` made, to be attached beside what is attached now, in the
                order in which they will be attached.

        Raises:
            RobotError: A name is taken, or there is no such link.
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
        """Let a contact be wanted for the time being: not watched until a time, or in a zone.

        From the next step on, a pair is not watched in steps in which nothing but wanted contact is
        possible before the arm rests, should it be told to stop then. So a pair with a time is
        watched again before it, by as long as the arm takes to rest; and one with a zone is not
        watched only while the obstacle, whatever it does within its bounds, stays in the zone for
        that long (the proofs are in `armguard.pairs.exemptions`). From the first step in which a
        pair is watched again it is evaluated as though it always had been.

        Verdicts tell in notes what is not watched, and why what is exempt is watched all the same;
        recordings have a line about each beginning and end. While a plan is known the arm may run
        it to its end, whatever verdicts say: then nothing is exempt, and no plan is judged by less
        than all pairs. `reset` ends exemptions that have a time, for the clock may be another one.

        Args:
            link: Name of a link; "*" is any.
            ids: Pattern of obstacle ids; one that has fitted no obstacle yet is a STOP that names
                it, as in the argument `ignore`.
            source: Name of a source whose obstacles alone are meant, and may come later; None:
                those of all sources, and what stands still.
            until: Contact is not wanted from this time on, in [s] of the monitor's clock; None: the
                zone decides.
            zone: Corners of a convex region in the world in which contact is wanted, in [m]; None:
                anywhere. Shape (k, 3), 4 <= k <= 8.

        Returns:
            The number of the exemption, for `watch`.

        Raises:
            ArmguardError: Neither a time nor a zone is given, the time is none, not finite or over,
                the zone encloses no room, the link or the source is unknown, or nothing would be
                left to watch; then nothing has changed.
        """
        exemption = self._exemptions.add(link, ids, source, until=until, zone=zone, now=self._now)
        self._note(exemption.to_message())
        return exemption.number

    def watch(self, number: int) -> None:
        """End what `ignore` began, from the next step on; harmless where it has ended already.

        Args:
            number: What `ignore` returned.

        Raises:
            ArmguardError: It returned no such number.
        """
        self._exemptions.end(number)
        self._note(WatchMessage(int(number)))

    @property
    def exemptions(self) -> tuple[Exemption, ...]:
        """What `ignore` began and has not ended."""
        return self._exemptions.listed

    @property
    def exemption_count(self) -> int:
        """How often `ignore` began something so far."""
        return self._exemptions.count

    def with_stop(self, plan: Plan) -> Plan:
        """A plan with a stop at its end, as hard as brakes guarantee, to be committed.

        Each joint decelerates as its own brake can; `armguard.stop_on_path` slows all of them down
        together. A plan that ends at rest stays as it is.

        Raises:
            ArmguardError: The plan is malformed, or the monitor was not made with motion="planned".
        """
        return self._find_pieces("with_stop").with_stop(plan)

    def commit(self, plan: Plan) -> PlanVerdict:
        """Judge the next piece of the controller's trajectory, which ends at rest: is it safe?

        A piece is safe if nothing can touch the arm on it until it rests. Then it is what the arm
        may be on from now on, until joint states tell that it is on another one or on none. It must
        agree with the one before until the answer has arrived, `latency` from now; the first one is
        for an arm that rests until then. While a piece is
        followed, and nothing new is seen, it stays safe without a further look; what it may not
        allow for judges it anew, in that tick, and a STOP says by `stop` whether to finish it or to
        leave it. An arm that brakes joint by joint on the way, at an emergency stop or without
        power, is not on its piece any more: that is covered with `leave="any"` only.

        Judged on what the last step saw, so commit after a step: where something is not as it was
        then, or was not as it should be, the piece is refused and the reason told. Nothing in a
        plan makes this raise.

        Args:
            plan: The piece, on the clock of the joint states' stamps.

        Raises:
            ArmguardError: The monitor was not made with motion="planned".
        """
        return self.fastest([plan]).verdicts[-1]

    def fastest(self, candidates: Iterable[Plan]) -> PlanChoice:
        """Commit the first piece of several that is safe, and no other; see `commit`.

        So a controller offers what it would like best first, and what is slower after that. A
        candidate is taken from the iterable only once all before it were refused, so that slower
        ones need not be made in vain.

        Args:
            candidates: Pieces, each ending at rest, on the clock of the joint states' stamps.

        Returns:
            Which one was committed, if any, and the answers to those that were judged.

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
        """The committed pieces that the arm may be on; for observers."""
        pieces = self._judge.pieces
        return [] if pieces is None else pieces.plans

    def pairs(self, limit: int = 64) -> list[PairReport]:
        """The most imminent pairs as of the last tick, soonest first, at most `limit`.

        Raises:
            ArmguardError: The limit is no whole number.
        """
        return self._queries.pairs(self._last[0], limit)

    def explain(self) -> Explanation | None:
        """Why the last verdict is as it is, what would have made it better, or avoided a STOP.

        None where no pair decided it: there are none, or its reasons alone did. None as well where
        the obstacle was removed since, so that nothing is known of it any more.
        """
        tick, result = self._last
        if tick is None or result.pair == NOBODY or self._unplaced:
            return None
        return self._queries.explain(tick, result.pair, by_braking=self._stopped_by_braking)

    def prepare_proofs(self) -> None:
        """Compile what `prove` runs, so that the first proof takes no longer than others."""
        self._queries.prepare_proofs()

    def prove(self, verdict: Verdict) -> Proof | None:
        """What was proved of the pair that decided the last verdict, for `armguard_check`.

        It is made when it is asked for, in the time of some evaluations: ask before the next
        update, for nothing is kept of what the tick knew. docs/proofs.md says what it claims.

        Args:
            verdict: What the last step returned.

        Returns:
            The proof; None where there is nothing to prove: no pair decided, the obstacle was
            updated or removed since or could be anywhere, the payload was changed since, the joint
            state is newer than its tick or was not believed, or another verdict has followed.
        """
        tick, result = self._last
        is_last = tick is not None and tick.number == verdict.sequence == self._sequence
        if tick is None or not is_last or result.pair == NOBODY or self._unplaced:
            return None
        if self._reloaded or self._scheduler.revision(result.pair) != self._decided_by:
            return None
        return self._queries.prove(tick, result.pair, verdict)

    def headroom(self) -> Headroom:
        """What evaluations cost now, and which number or rate would break the budget."""
        return self._queries.headroom(self._last[0])

    def attention(self, limit: int = 8) -> list[Attention]:
        """The obstacles whose fresh states would raise the verdict's contact time most.

        Args:
            limit: At most so many, first things first.

        Raises:
            ArmguardError: The limit is no whole number.
        """
        return self._queries.attention(self._last[0], limit)

    def snapshot(self, *, pair_limit: int, row_limit: int) -> Snapshot:
        """What there is to see of the last tick, for observers; cheap, and their own to keep.

        Args:
            pair_limit: At most so many pairs, the most imminent ones.
            row_limit: At most so many obstacles, likewise.

        Raises:
            ArmguardError: A limit is no whole number.
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
        """Give a message to the journal, if there is one."""
        if self.journal is not None:
            self.journal.note_message(message)

    def _find_pieces(self, method: str) -> CommittedPieces:
        if self._judge.pieces is None:
            raise ArmguardError(method, "needs plans", remedy='Monitor(..., motion="planned")')
        return self._judge.pieces

    def _find_tick_to_plan(self) -> Tick | PlanVerdict:
        """The last tick, if a plan can be judged by it; else why not."""
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
        """Let nothing count that was proved with brakes under another payload."""
        self._reloaded = False
        self._scheduler.invalidate_all()
        void = None
        if self._judge.pieces is not None:
            void = self._judge.pieces.drop("payload", f"is {self.payload:g} kg now")
        return [] if void is None else [void]

    def _suspend(self, operating: OperatingHistory, now: float) -> list[Reason]:
        """Put the hardware's limits in force: nothing that was proved with others holds.

        What is proved of committed pieces rests on the hardware's alone.
        """
        operating.suspend(now)
        self._scheduler.invalidate_all()
        found = operating.describe_break(self._states.v)
        return [Reason(ReasonKind.OPERATING_LIMITS_BROKEN, *found)]

    def _follow_exemptions(
        self, now: float, horizon: float, unbraked: Reason | None
    ) -> list[Reason]:
        """Take in which pairs are exempt in this tick, and tell of it.

        Args:
            now: Time of the tick, in [s].
            horizon: In which the arm surely rests that is told to stop by the next verdict, or at
                the end of a speed scale, in [s].
            unbraked: Why that is not known; None: it is.
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
        """Reasons about patterns to ignore that have fitted no obstacle."""
        detail = self._ignored.describe_unmatched(self.obstacles.ids)
        unmatched = [*self._ignored.unmatched, *self._exemptions.unmatched]
        return [Reason(ReasonKind.IGNORE_UNMATCHED, repr(ids), detail) for ids in unmatched]

    def _read_obstacles(self, now: float) -> list[Reason]:
        """What is wrong with the obstacle table, and until when silence is no reason."""
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
        """The verdict of a tick at a time that is none, or before the one before it."""
        if not (math.isfinite(now) and math.isfinite(stamp)):
            return self._refuse(stamp, Reason(ReasonKind.TIME_INVALID, f"stamp {stamp}, now {now}"))
        reason = Reason(ReasonKind.TIME_BACKWARDS, "clock", f"{now!r} after {self._now!r}")
        self._now = now
        return self._refuse(stamp, reason)

    def _blame_contact(self, reason: Reason, kind: ReasonKind) -> Reason:
        """The reason itself, or where it is of this kind and contact explains it, that."""
        contact = self._contact
        if contact is None or reason.kind is not kind or not contact.explains_jump(self._now):
            return reason
        return reason._replace(kind=ReasonKind.MOVED_BY_CONTACT)

    def _refuse_state(self, stamp: float, reason: Reason) -> Verdict:
        """The verdict of a tick whose joint state is impossible.

        It latches, unless a permitted contact may have moved the joint: then states are believed
        anew from the next one on.
        """
        blamed = self._blame_contact(reason, ReasonKind.JOINT_STATE_JUMPED)
        if blamed is not reason:
            self._states.reset()
        return self._refuse(stamp, blamed)

    def _refuse(self, stamp: float, reason: Reason) -> Verdict:
        """The verdict of a tick whose arm state is not believed: the worst of everything."""
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
