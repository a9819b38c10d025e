"""Steps a shield in the rate loop: reads goals, publishes commands."""

from __future__ import annotations

import numpy as np

from armguard.app.stepper import Stepper
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.messages.command import CommandMessage, pack
from armguard.messages.reasons import write_reasons
from armguard.monitor.monitor import Monitor
from armguard.monitor.plan_verdict import refuse_plan
from armguard.shield.command import Command
from armguard.shield.path import Path
from armguard.shield.shield import Shield
from armguard.streams.edge import Edge
from armguard.streams.goal_intake import GoalRequest
from armguard.streams.joint_intake import JointState
from armguard.streams.nodes import VerdictPublisher
from armguard.verdict import Verdict


class ShieldStepper(Stepper):
    """Steps a shield, which steps its monitor.

    Args:
        shield: The shield to step.
        monitor: The shield's.
        edge: Holds the messages of the tick.
        publisher: Publishes commands, and answers to plans.
    """

    def __init__(
        self, shield: Shield, monitor: Monitor, edge: Edge, publisher: VerdictPublisher
    ) -> None:
        super().__init__(monitor, edge, publisher.answer)
        self.shield = self._shield = shield
        self._publish = publisher.command
        self._goal: GoalRequest | None = None
        self._chunk: FloatArray | None = None
        self._refused: int | None = None
        self._problem = ""

    def reset(self) -> None:
        """Obey a reset and drop the goal, so that no motion resumes by itself."""
        self._shield.reset()
        self._shield.set_path(None)
        self._goal = self._chunk = None

    def step(self, now: float) -> Verdict:
        """Judge the messages read last, at a time in [s]; the command is kept for `answer`."""
        self.command = None
        return super().step(now)

    def judge(self, state: JointState, now: float) -> Verdict:
        """The verdict on a joint state."""
        goal, velocity = self._goal, None
        if goal is not None and goal.velocity is not None and now <= goal.until:
            velocity = goal.velocity
        chunk, self._chunk = self._chunk, None
        self.command = self._shield.step(
            now, state.q, state.v, state.stamp, velocity=velocity, chunk=chunk
        )
        return self.command.verdict

    def answer(self) -> None:
        """Publish the command after the verdict, then read the next goal.

        This order matters: timing a path takes some milliseconds, and no command may wait for it.
        """
        if self.command is not None:
            self._publish(self._describe(self.command))
        requests = self._edge.requests
        for plan in requests.plans:
            problem = plan.problem or "is refused: a shield makes the plans; send goals instead"
            self._answer(plan.number, refuse_plan("plan", problem))
        usable = [goal for goal in requests.goals if not goal.problem]
        for goal in requests.goals:
            if goal.problem:
                self._refused, self._problem = goal.number, goal.problem
            elif goal is usable[-1]:
                self._take(goal)

    def _take(self, goal: GoalRequest) -> None:
        """Replace the goal; if the new goal is refused, the old one goes on."""
        try:
            if self.command is None:
                raise ArmguardError("goal", "came before the first joint state")
            paths = [self._make_path(q, times) for q, times in goal.paths]
            self._shield.set_path(paths or None)
        except ArmguardError as error:
            self._refused, self._problem = goal.number, str(error)
            self._edge.faults.add("goal refused", "goals", goal.number, str(error))
            return
        self._goal, self._chunk = goal, goal.chunk

    def _make_path(self, q: FloatArray, times: FloatArray | None) -> Path:
        """The path of a goal; raises ArmguardError if it leaves the position limits."""
        robot = self.monitor.robot
        error = robot.position_error
        lower, upper = robot.lower_position_limit - error, robot.upper_position_limit + error
        beyond = np.argwhere(~((lower <= q) & (q <= upper)))
        if len(beyond):
            k, j = beyond[0]
            raise ArmguardError(
                "path",
                f"has {robot.joints[j]} at {q[k, j]:.6g}",
                expected=f"{lower[j]:.6g} to {upper[j]:.6g}",
            )
        return Path(q, times)

    def _describe(self, command: Command) -> CommandMessage:
        # Without samples the end is the present.
        begin = float(command.times[0]) if len(command.times) else command.valid_until
        reason = command.reason
        return CommandMessage(
            sequence=command.verdict.sequence,
            stamp=begin,
            take_up_by=begin + self.monitor.settings.latency,
            valid_until=command.valid_until,
            names=list(self.monitor.robot.joints),
            times=pack(command.times - begin),
            q=pack(command.q),
            v=pack(command.v),
            a=pack(command.a),
            moving=command.moving,
            scale=command.scale,
            progress=self._shield.progress,
            executed=command.executed,
            stop=command.stop,
            reason=None if reason is None else write_reasons((reason,))[0],
            contact_speed=command.contact_speed,
            goal=None if self._goal is None else self._goal.number,
            refused=self._refused,
            problem=self._problem,
        )
