"""Tests whether an arm keeps its operating limits: each joint state against all earlier ones.

What all states so far allow together is one interval for each joint's true velocity and one for its
position. From one state to the next the velocity's upper end grows with the acceleration limit
while it is negative, then with the operating acceleration, and never beyond the operating velocity;
its lower end mirrors that; the position's ends move by what such velocities allow for. Each new
state cuts the intervals to its values within its errors. If an interval becomes empty, the
operating limits were broken, or the errors were larger than stated.

Motion within limits and errors never fails: rounding goes towards acceptance, as `jit.numerics` has
it. A violation is detected with a delay: a joint with twice the stated acceleration is detected
when its velocity exceeds the possible one by twice the velocity error. This takes 2 dv / A, or
twice as long if the error changes from one extreme to the other meanwhile.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.displacement import operating_displacement, operating_velocity
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import ACCEPTANCE_SLACK
from armguard.robot.joints import is_prismatic
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot

KEPT, TOO_FAST, TOO_HARD, TOO_FAR = range(4)
"""What a joint did: it kept its operating limits, or was faster than the operating velocity, or
sped up harder than the operating acceleration, or got further than both allow."""

UNKEPT = 4
"""Added to what was found of a joint state that is believed, where it is outside the operating
limits; see `joint_acceptance` for the rest."""


class OperatingRecord(NamedTuple):
    """What the test needs and remembers, for compiled code; of no joints where there is none."""

    velocity: FloatArray
    """Operating velocities, [rad/s] or [m/s]. Shape (nv,)."""
    acceleration: FloatArray
    """Operating accelerations, [rad/s²] or [m/s²]. Shape (nv,)."""
    acceleration_limit: FloatArray
    """With which joints slow down at most, alike. Shape (nv,)."""
    position_error: FloatArray
    """[rad] or [m]. Shape (nv,)."""
    velocity_error: FloatArray
    """[rad/s] or [m/s]. Shape (nv,)."""
    reachable: FloatArray
    """Greatest and least positions, greatest and least velocities that all states allow for;
    written. Shape (4, nv)."""
    stamp: FloatArray
    """Of the last state, in [s]; -inf before the first; written. Shape (1,)."""
    finding: FloatArray
    """Joint, code and amount of the last break; written. Shape (3,)."""


@kernel
def keeps_operating_limits(
    record: OperatingRecord, stamp: float, q: FloatArray, v: FloatArray
) -> bool:
    """Whether a state is one that all before it and the operating limits allow for.

    It becomes part of the record. Of a joint that is outside, all that came before is forgotten,
    and the first such joint is the record's finding.

    Args:
        record: What came before.
        stamp: Of the state, in [s], not less than the last one's.
        q: Joint positions, finite, in [rad] or [m]. Shape (nv,).
        v: Joint velocities, finite, in [rad]/[s] or [m]/[s]. Shape (nv,).
    """
    joints = record.velocity.shape[0]
    if joints == 0:
        return True
    kept = True
    reachable, last = record.reachable, record.stamp[0]
    begun = last > -math.inf
    # Rounded stamps add up exactly, so the slack for them belongs to the test alone.
    elapsed = max(stamp - last, 0.0) if begun else 0.0
    clock_slack = ACCEPTANCE_SLACK * (abs(stamp) + abs(last)) if begun else 0.0
    for j in range(joints):
        top, speeding = record.velocity[j], record.acceleration[j]
        accel = record.acceleration_limit[j]
        position_error, velocity_error = record.position_error[j], record.velocity_error[j]
        highest, lowest, fastest, slowest = math.inf, -math.inf, top, -top
        if begun:
            up, down = reachable[2, j], -reachable[3, j]
            rounding = ACCEPTANCE_SLACK * (abs(q[j]) + position_error + top * elapsed)
            highest = reachable[0, j] + rounding
            highest += operating_displacement(up, accel, speeding, top, elapsed)
            lowest = reachable[1, j] - rounding
            lowest -= operating_displacement(down, accel, speeding, top, elapsed)
            rounding = ACCEPTANCE_SLACK * (top + velocity_error + accel * elapsed)
            fastest = min(operating_velocity(up, accel, speeding, top, elapsed) + rounding, top)
            slowest = -operating_velocity(down, accel, speeding, top, elapsed) - rounding
            slowest = max(slowest, -top)
        least, most = v[j] - velocity_error, v[j] + velocity_error
        allowance = ACCEPTANCE_SLACK * (abs(v[j]) + velocity_error) + accel * clock_slack
        finite = abs(q[j]) < math.inf and abs(v[j]) < math.inf
        too_fast = max(least, -most) - top
        too_hard = max(least - fastest, slowest - most)
        too_far = max(q[j] - position_error - highest, lowest - q[j] - position_error)
        room = ACCEPTANCE_SLACK * (abs(q[j]) + position_error) + 4.0 * top * clock_slack
        code, amount = KEPT, 0.0
        if not (finite and too_fast <= ACCEPTANCE_SLACK * (abs(v[j]) + velocity_error)):
            code, amount = TOO_FAST, too_fast
        elif not too_hard <= allowance:
            code, amount = TOO_HARD, too_hard
        elif not too_far <= room:
            code, amount = TOO_FAR, too_far
        if code != KEPT:
            if kept:
                record.finding[0], record.finding[1], record.finding[2] = j, code, amount
            kept = False
            highest, lowest, fastest, slowest = math.inf, -math.inf, top, -top
        reachable[0, j] = min(highest, q[j] + position_error)
        reachable[1, j] = max(lowest, q[j] - position_error)
        # Within the limits even where the measurement is not: what comes next is tested, too.
        reachable[2, j] = max(min(fastest, most), -top)
        reachable[3, j] = min(max(slowest, least), top)
    record.stamp[0] = stamp
    return kept


class OperatingHistory:
    """Tests joint states against operating limits, and puts the hardware's in force after a break.

    Args:
        robot: The arm.
        in_force: The limits that all bounds on the arm's motion share.
        rise_delay: How long the operating limits must have been kept again to be in force, in [s].

    Attributes:
        in_force: The limits that all bounds on the arm's motion share.
        record: What compiled code tests by.
    """

    def __init__(self, robot: Robot, in_force: LimitsInForce, rise_delay: float) -> None:
        joints = len(robot.joints)
        self._robot = robot
        self.in_force = in_force
        self.record = OperatingRecord(
            in_force.operating_velocity.copy(),
            in_force.operating_acceleration.copy(),
            np.array(robot.acceleration_limit, dtype=np.float64),
            np.array(robot.position_error, dtype=np.float64),
            np.array(robot.velocity_error, dtype=np.float64),
            np.zeros((4, joints)),
            np.array([-math.inf]),
            np.zeros(3),
        )
        self._rise_delay = rise_delay
        self._broken_at = -math.inf
        keeps_operating_limits(self.record, 0.0, np.zeros(joints), np.zeros(joints))  # compiles
        self.reset()

    def reset(self) -> None:
        """Forget all states. Limits that are suspended must first be kept again, as after a break.

        That counts from the next tick on, whose time may be earlier than that of the ticks before.
        """
        self.record.stamp[0] = -math.inf
        self._broken_at = math.inf

    def accept(self, stamp: float, q: FloatArray, v: FloatArray) -> bool:
        """Whether a state keeps the operating limits; it becomes part of the history.

        Args:
            stamp: Of the state, in [s].
            q: Joint positions, in [rad] or [m]. Shape (nv,), float64.
            v: Joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,), float64.
        """
        return bool(keeps_operating_limits(self.record, stamp, q, v))

    def describe_break(self, v: FloatArray) -> tuple[str, str]:
        """Joint of the last break, and in words what it did.

        Args:
            v: Joint velocities of the state that broke the limits, in [rad]/[s] or [m]/[s].
                Shape (nv,).
        """
        record = self.record
        joint, code, amount = int(record.finding[0]), int(record.finding[1]), record.finding[2]
        unit = "m" if is_prismatic(self._robot.model, 1 + joint) else "rad"
        velocity = f"{record.velocity[joint]:.4g} {unit}/s"
        acceleration = f"{record.acceleration[joint]:.4g} {unit}/s²"
        measured = f"{v[joint]:.4g} {unit}/s"
        detail = {
            TOO_FAST: f"at {measured}, operating velocity is {velocity}: "
            f"{amount:.3g} {unit}/s more than errors explain",
            TOO_HARD: f"at {measured} sooner than the operating acceleration, "
            f"{acceleration}, allows: {amount:.3g} {unit}/s more than errors explain",
            TOO_FAR: f"further than operating velocity and acceleration, {velocity} "
            f"and {acceleration}, allow: {amount:.3g} {unit} more than errors explain",
        }[code]
        return self._robot.joints[joint], detail

    def suspend(self, now: float) -> None:
        """Put the hardware's limits in force after a break.

        Args:
            now: Time of the tick, in [s].
        """
        self._broken_at = now
        if not self.in_force.is_suspended:
            self.in_force.suspend()

    def resumes(self, now: float) -> bool:
        """Put the operating limits in force again if they have been kept for long enough.

        Args:
            now: Time of the tick, in [s].

        Returns:
            Whether that is so since now.
        """
        if not self.in_force.is_suspended:
            return False
        if self._broken_at == math.inf:
            # The first tick after a reset: no state of before counts, so nothing was kept yet.
            self._broken_at = now
            return False
        # By the same sum as the rule that holds a level, so that both end in the same tick.
        if now - self._broken_at < self._rise_delay:
            return False
        self.in_force.resume()
        return True


def make_empty_record() -> OperatingRecord:
    """The record of an arm without operating limits: everything keeps them."""
    none = np.zeros(0)
    return OperatingRecord(none, none, none, none, none, np.zeros((4, 0)), np.zeros(1), np.zeros(3))
