"""What the controller has told of the arm's way: committed pieces, or a trajectory to follow."""

from __future__ import annotations

import numpy as np

from armguard.bounds.planned.curve import find_top_speeds
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal, read_plan
from armguard.bounds.planned.stop import append_stop
from armguard.exceptions import ArmguardError
from armguard.monitor.committed_pieces import CommittedPieces
from armguard.monitor.followed_trajectory import FollowedTrajectory
from armguard.monitor.plan_verdict import refuse_plan
from armguard.monitor.settings import MonitorSettings
from armguard.robot.brakes import find_gentlest_stop
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.verdict import PlanVerdict, Reason, ReasonKind


class KnownPath:
    """Takes plans of both kinds, one kind at a time.

    Args:
        robot: The arm.
        scheduler: Knows the pairs.
        settings: Of the monitor.
    """

    def __init__(self, robot: Robot, scheduler: Scheduler, settings: MonitorSettings) -> None:
        self._robot = robot
        self._scheduler = scheduler
        self._on_path = settings.stop == "path"
        margin, latency = settings.margin, settings.latency
        self._pieces = CommittedPieces(
            robot, scheduler, latency, margin, may_leave=settings.leave == "any"
        )
        self._trajectory = FollowedTrajectory(
            robot,
            scheduler,
            settings.response_time,
            latency,
            settings.reaction_time,
            margin,
            on_path=self._on_path,
            path_deceleration=settings.path_deceleration,
        )

    @property
    def is_proved(self) -> bool:
        """Whether the arm is on a piece on which nothing can touch it until it rests."""
        return self._pieces.is_proved

    @property
    def is_followed(self) -> bool:
        """Whether the arm follows a trajectory."""
        return self._trajectory.is_followed

    @property
    def is_on_time(self) -> bool:
        """Whether the clock of a trajectory that is followed is time itself."""
        return self._trajectory.is_on_time

    @property
    def stop_lasting(self) -> float | None:
        """How long a stop on the path lasts once brakes bite, in [s]; None: joints stop."""
        return self._trajectory.stop_lasting

    @property
    def plans(self) -> list[CheckedPlan]:
        """What the arm may be on, pieces or trajectories."""
        return [*self._pieces.plans, *self._trajectory.plans]

    @property
    def evaluated(self) -> int:
        """Evaluations since the last joint state was taken."""
        return self._pieces.evaluated + self._trajectory.evaluated

    def reset(self) -> None:
        """Forget what was told: from now on the arm may do what its joints can."""
        self._pieces.reset()
        self._trajectory.reset()

    def drop(self, subject: str, detail: str) -> Reason | None:
        """Forget what was told where its ground is gone; None if nothing was."""
        if not (self.is_proved or self.is_followed):
            return None
        self.reset()
        return Reason(ReasonKind.PLAN_VOID, subject, detail)

    def with_stop(self, plan: Plan) -> Plan:
        """A plan with a stop at its end; see `Monitor.with_stop`."""
        read = read_plan(plan, len(self._robot.joints))
        if isinstance(read, Refusal):
            raise ArmguardError(read.subject, read.detail, expected="a plan to stop from")
        motion = self._scheduler.arm.motion.planned
        assert motion is not None, "a monitor has a known path only where it takes plans"
        times, q, v = (np.asarray(part) for part in (read.times, read.q, read.v))
        braking = find_gentlest_stop(motion.brakes, find_top_speeds(times, q, v))
        stopped = append_stop(plan, braking, on_path=self._on_path)
        if isinstance(stopped, Refusal):
            raise ArmguardError(stopped.subject, stopped.detail, expected="a plan to stop from")
        return stopped

    def commit(self, plan: Plan, tick: Tick) -> PlanVerdict:
        """Judge a piece at the last tick."""
        if self.is_followed and not self._trajectory.is_over():
            return refuse_plan(
                "plan", "is a piece, and the arm follows a trajectory: end that first"
            )
        found = self._pieces.commit(plan, tick)
        if found.safe:
            self._trajectory.reset()
        return found

    def follow(self, plan: Plan, tick: Tick) -> PlanVerdict:
        """Take a trajectory at the last tick."""
        if self.is_proved and not self._pieces.is_over(tick.now - tick.arm_age):
            return refuse_plan("plan", "is a trajectory, and the arm is on a piece: end that first")
        found = self._trajectory.follow(plan, tick)
        if found.safe:
            self._pieces.reset()
        return found

    def update(
        self, tick: Tick, stamp: float, path_time: object, *, disturbed: bool, unplaced: bool
    ) -> Reason | None:
        """Take a tick's joint state; what there is to say of the arm's way, if anything.

        Args:
            tick: The tick.
            stamp: Of its joint state, in [s].
            path_time: As it was told; None: nothing was.
            disturbed: Whether obstacles have changed by more than was allowed for.
            unplaced: Whether there are obstacles that found no room, and could be anywhere.
        """
        if unplaced and self.is_proved:
            # They are in no pair, so no piece is judged by them.
            self.reset()
            detail = "some found no room, and could be anywhere"
            return Reason(ReasonKind.PIECE_UNSAFE, "obstacles", detail)
        self._pieces.evaluated = self._trajectory.evaluated = 0
        found = self._pieces.update(tick, stamp, disturbed=disturbed)
        return self._trajectory.update(tick, stamp, path_time) or found

    def rests(self, tick: Tick) -> bool:
        """Whether the arm, on its trajectory, surely rests if it is told to stop a tick later."""
        return self._trajectory.rests(tick)

    def is_braked(self, tick: Tick) -> bool:
        """Whether the arm is on a way on which brakes are stated for every speed."""
        return self.is_proved or self._trajectory.is_braked(tick)

    def is_free(self, tick: Tick, told_after: float, pace: float) -> bool:
        """Whether the arm surely rests if its clock keeps to a pace; see `FollowedTrajectory`."""
        return self._trajectory.is_free(tick, told_after, pace)

    def find_excess(self) -> Refusal | None:
        """Why a trajectory that is followed breaks the operating limits in force; None if not."""
        return self._trajectory.find_excess()

    def find_gain(self) -> float:
        """How much sooner an arm on a trajectory rests if its clock stands still, in [s]."""
        return self._trajectory.find_gain()

    def compile(self, tick: Tick) -> None:
        """Run once what only some ticks need, so that nothing is compiled in a tick.

        Args:
            tick: One of an arm at rest, for nothing is there to touch it yet.
        """
        q = np.tile(tick.q, (2, 1))
        rest = Plan(0.0, np.array([0.0, 1.0]), q, np.zeros_like(q), np.ones(q.shape[1]))
        for _ in range(2):
            self._pieces.commit(rest, tick)
        self._pieces.update(tick, 0.0, disturbed=False)
        self._trajectory.follow(rest, tick)
        self._trajectory.update(tick, 0.0, None)
        self._trajectory.update(tick, 0.0, 0.0)
        self._trajectory.rests(tick)
        self.reset()
