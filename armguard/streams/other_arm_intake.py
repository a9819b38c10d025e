"""Processes joint states and plans of another arm, which is an obstacle of the watched arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.messages.incoming import JointsMessage, MessageError, PlanMessage
from armguard.streams.intake import Intake, SequenceWatch
from armguard.streams.joint_intake import JointOrder
from armguard.streams.requests import PlanReader, PlanRequest
from armguard.streams.stamp_clocks import HELD_UP, StampClock


class OtherArm(NamedTuple):
    """Another arm of the cell, which is an obstacle of the watched one."""

    joints: Sequence[str]
    """Names of its joints, in the order that `publish` takes."""
    publish: Callable[[float, NDArray[np.float64], NDArray[np.float64]], None]
    """Tells the table of obstacles a stamp, in [s], with positions and velocities, each (nv,)."""
    take_plan: Callable[[PlanRequest, float, float], None]
    """Takes a plan that it promises to keep to, until when, in [s] of the monitor's time, and what
    its clock may be off by, in [s]."""


class OtherArmIntake:
    """Takes joint states and plans of another arm; the drain's bounds bound this work, too.

    Args:
        intake: The table, where faults are counted, and times.
        name: Of the arm.
        arm: Takes its states and plans.
        clock: How joint states are stamped.
        plans: Reads plans.
    """

    def __init__(
        self, intake: Intake, name: str, arm: OtherArm, clock: StampClock, plans: PlanReader
    ) -> None:
        self._intake = intake
        self._name = name
        self._arm = arm
        self._clock = clock
        self._clock_difference = clock.error + HELD_UP
        self._plans = plans
        self._order = JointOrder(arm.joints)
        self._numbers = SequenceWatch(intake.faults, name)

    def take_joints(self, message: JointsMessage) -> None:
        """Tell the table a joint state; what cannot be used is counted."""
        intake, name, sequence = self._intake, self._name, message.seq
        self._numbers.follow(sequence)
        try:
            q, v = self._order.read(message)
        except MessageError as error:
            now = intake.times.drain_start
            intake.faults.add("malformed", name, sequence, str(error))
            intake.obstacles.leave_malformed(name, "joint state", str(error), now)
            return
        intake.check_finite(name, sequence, {"stamp": message.stamp, "q": q, "v": v})
        stamp, gap = intake.times.translate(message.stamp, self._clock)
        now = intake.times.now()
        if stamp > now:
            # A state bounds what follows it, not what was before: none is of the future. What the
            # clocks are off by is in its errors; of more, nothing is known of when it was measured.
            problem, allowed = f"stamp is {stamp - now:.3g} s ahead", self._clock_difference
            if not stamp - now <= allowed:
                problem += f", expected at most the clock error, {allowed:.3g} s"
                intake.faults.add("stamp ahead", name, sequence, problem)
                intake.obstacles.leave_malformed(name, "joint state", problem, now)
                return
            problem += "; counted as measured now"
            intake.faults.add("stamp ahead", name, sequence, problem)
            stamp = now
        if not gap <= HELD_UP:
            intake.count_hold_up(gap, name, sequence)
            return
        # Each, not the newest alone: what one of them breaks, the next may hide.
        try:
            self._arm.publish(stamp, q, v)
        except ArmguardError as error:
            intake.count_refused(error, name, None)

    def take_shared_plan(self, message: PlanMessage) -> None:
        """Pass on a shared plan of the arm; an unusable plan has no effect, and is reported."""
        intake, clock = self._intake, self._clock
        request = self._plans.read(message, self._order)
        if request.problem:
            return
        if clock.clock == "arrival":
            problem = 'needs stamps: with clock = "arrival" nobody knows until when it is promised'
            intake.faults.add("plan refused", self._name, message.number, problem)
            return
        told = math.nan if message.until is None else message.until
        until, gap = self._plans.translate(told)
        # Joint states, which are tested against the plan, may be that much younger than they look.
        clock_error = clock.latency + self._clock_difference + gap
        try:
            self._arm.take_plan(request, until, clock_error)
        except ArmguardError as error:
            intake.faults.add("plan refused", self._name, message.number, str(error))
