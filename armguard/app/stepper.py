"""Steps a monitor in the rate loop: judges the joint state, answers requests."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from armguard.monitor.monitor import Monitor
from armguard.monitor.plan_verdict import refuse_plan
from armguard.streams.edge import Edge
from armguard.streams.joint_intake import JointState
from armguard.streams.requests import PlanRequest
from armguard.verdict import BRAKE, Level, PlanVerdict, Reason, ReasonKind, ResetVerdict, Verdict

if TYPE_CHECKING:
    from armguard.bounds.planned.plan import Plan
    from armguard.pairs.arm_obstacles import ArmObstacles
    from armguard.shield.command import Command
    from armguard.shield.shield import Shield


class Stepper:
    """Steps a monitor.

    Args:
        monitor: The monitor to step.
        edge: Holds the messages of the tick.
        answer: Called with the number of each plan and the answer to it; must never block.

    Attributes:
        monitor: As above.
        shield: The shield that moves the arm; None: the arm is only watched.
        command: Command of the shield in the last tick; None without a joint state.
    """

    def __init__(
        self,
        monitor: Monitor,
        edge: Edge,
        answer: Callable[[int, PlanVerdict | ResetVerdict], None],
    ) -> None:
        self.monitor = monitor
        self.shield: Shield | None = None
        self.command: Command | None = None
        self._edge = edge
        self._answer = answer

    def reset(self) -> None:
        """Obey a reset."""
        self.monitor.reset()

    def step(self, now: float) -> Verdict:
        """Judge the messages read last, at a time in [s]."""
        joints = self._edge.joints
        if joints.state is not None:
            return self.judge(joints.state, now)
        verdict = wait_for_joints(now, joints.dropped_age)
        if self.monitor.settings.permits_contact:
            verdict = verdict._replace(contact_speed=math.inf)
        return verdict

    def judge(self, state: JointState, now: float) -> Verdict:
        """The verdict on a joint state."""
        return self.monitor.step(state.stamp, state.q, state.v, now)

    def answer(self) -> None:
        """Answer requests, after the verdict is published."""
        plans = self._edge.requests.plans
        for request in plans:
            verdict = judge_request(self.monitor, request, is_newest=request is plans[-1])
            self._answer(request.number, verdict)
        for goal in self._edge.requests.goals:
            if not goal.problem:
                problem = "there is no shield here: `armguard shield` takes goals"
                self._edge.faults.add("goal refused", "goals", goal.number, problem)


def judge_request(monitor: Monitor, request: PlanRequest, *, is_newest: bool) -> PlanVerdict:
    """The answer to a plan from another process; never raises on its content.

    Args:
        monitor: After its step.
        request: The plan, and whether to commit it.
        is_newest: Whether no other plan came after it in the same tick. A plan takes a large part
            of a tick, so only one is judged.
    """
    if request.problem:
        return refuse_plan("message", request.problem)
    if not is_newest:
        return refuse_plan("plan", "was overtaken by a newer one in the same tick")
    if not monitor.settings.with_plans:
        return refuse_plan("monitor", 'takes no plans: it has no motion = "planned" in [monitor]')
    return monitor.commit(_make_plan(request))


def take_shared_plan(
    other: ArmObstacles, request: PlanRequest, until: float, clock_error: float
) -> None:
    """Give the plan of another arm to its obstacles; see `ArmObstacles.take_plan`.

    Raises:
        ArmguardError: The plan cannot be used.
    """
    other.take_plan(_make_plan(request), until, clock_error)


def _make_plan(request: PlanRequest) -> Plan:
    # Loaded long before by what judges plans, or takes them of another arm.
    from armguard.bounds.planned.plan import Plan

    return Plan(
        request.stamp,
        request.times,
        request.q,
        request.v,
        request.tracking_error,
        request.velocity_tracking_error,
    )


def wait_for_joints(now: float, dropped_age: float) -> Verdict:
    """The verdict while no fresh joint state has arrived: STOP, since nothing is known.

    Args:
        now: Time of the tick, in [s].
        dropped_age: Age of the last dropped joint state in [s]; nan: none was dropped.
    """
    detail = "no joint state has arrived yet"
    if not math.isnan(dropped_age):
        detail = f"no fresh joint state has arrived yet, the last one was {dropped_age:.3g} s old"
    return tell_unknown(now, Reason(ReasonKind.NOT_YET_COMPLETE, "joints", detail))


def tell_unknown(now: float, reason: Reason) -> Verdict:
    """The verdict without a usable joint state, at `now` [s]: STOP."""
    return Verdict(
        stamp=now,
        sequence=0,
        level=Level.STOP,
        contact_time=0.0,
        stop_time=math.inf,
        speed_scale=0.0,
        link=None,
        obstacle=None,
        complete=False,
        evaluated=0,
        reasons=(reason,),
        valid_until=now,
        stop=BRAKE,
    )
