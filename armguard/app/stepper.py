"""What judges the joint state of each tick of a loop, and answers what was asked of it."""

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
        monitor: What is stepped.
        edge: What the messages of a tick have gone through.
        answer: Takes the number of each plan that came, and the answer to it; must never block.

    Attributes:
        monitor: As above.
        shield: What moves the arm; None: it is only watched.
        command: Of the shield in the last tick; None where it had no joint state.
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
        """The verdict on what was drained last, at a time in [s]."""
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
        """Answer what was asked, once the verdict is published."""
        plans = self._edge.requests.plans
        for request in plans:
            verdict = judge_request(self.monitor, request, is_newest=request is plans[-1])
            self._answer(request.number, verdict)
        for goal in self._edge.requests.goals:
            if not goal.problem:
                problem = "there is no shield here: `armguard shield` takes goals"
                self._edge.faults.add("goal refused", "goals", goal.number, problem)


def judge_request(monitor: Monitor, request: PlanRequest, *, is_newest: bool) -> PlanVerdict:
    """The answer to a plan that came from outside; nothing in it makes this raise.

    Args:
        monitor: After its step.
        request: The plan, and what is asked of it.
        is_newest: Whether no other plan came after it in the same tick. Each costs a good part of
            a tick, so one is judged.
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
    """Tell the obstacles of another arm what it promises; see `ArmObstacles.take_plan`.

    Raises:
        ArmguardError: It is no such promise.
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
    """The verdict while no fresh joint state has come: nothing is known, so STOP.

    Args:
        now: Time of the tick, in [s].
        dropped_age: How old the last one was that was dropped, in [s]; nan: none was.
    """
    detail = "no joint state has arrived yet"
    if not math.isnan(dropped_age):
        detail = f"no fresh joint state has arrived yet, the last one was {dropped_age:.3g} s old"
    return tell_unknown(now, Reason(ReasonKind.NOT_YET_COMPLETE, "joints", detail))


def tell_unknown(now: float, reason: Reason) -> Verdict:
    """The verdict where no joint state can be judged, at `now` [s]: STOP."""
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
