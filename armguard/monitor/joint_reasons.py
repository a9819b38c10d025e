"""Describes refused joint states as reasons of a verdict.

`armguard.robot` decides which states are believed, and answers with a code, a joint and numbers;
here they become words. This module also converts arguments to arrays before that decision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import (
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
)
from armguard.robot import joint_acceptance as acceptance
from armguard.robot.joint_acceptance import NO_JOINT
from armguard.robot.joint_states import JointStates
from armguard.robot.joints import is_prismatic
from armguard.robot.stop_time import ALL_COVERED, speed_at_bite
from armguard.verdict import Reason, ReasonKind

UNIX_LEAD = 1e9
"""A stamp so far ahead, in [s], is Unix time on a clock that began with the machine."""


def read_joint_vectors(
    q: ArrayLike | Reason, v: ArrayLike, joints: int
) -> tuple[FloatArray, FloatArray] | Reason:
    """Convert positions and velocities to plain arrays; a reason replaces an unusable one.

    Args:
        q: Joint positions, [rad] or [m]; expected of shape (nv,). A reason replaces a refused
            array.
        v: Joint velocities, [rad/s] or [m/s]; expected of shape (nv,).
        joints: Number of joints, nv.
    """
    if isinstance(q, Reason):
        return q
    read_q = _read_vector("q", q, joints)
    if isinstance(read_q, Reason):
        return read_q
    read_v = _read_vector("v", v, joints)
    return read_v if isinstance(read_v, Reason) else (read_q, read_v)


def describe_refusal(
    states: JointStates, found: int, joint: int, stamp: float, q: FloatArray, v: FloatArray
) -> Reason:
    """The reason why the last joint state was refused.

    Args:
        states: The joint states, which refused it.
        found: Result of `JointStates.accept`, below 0.
        joint: The joint for which it was refused.
        stamp: Of the state, in [s].
        q: Its positions, [rad] or [m].
        v: Its velocities, [rad/s] or [m/s].
    """
    code, guard = -found, states.guard
    value, allowed, duration = guard.numbers.tolist()
    if code == acceptance.WRONG_LENGTH:
        name, array = ("q", q) if q.shape != states.q.shape else ("v", v)
        detail = f"shape {array.shape}, expected {states.q.shape}"
        return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
    lasting, most = _spell(value, guard.timeout, digits=3)
    at_most = f"expected at most {most} s"
    age = f"{lasting} s old, {at_most}"
    if value < 0.0:
        age = describe_lead(-value, guard.timeout)
    about_time = {
        acceptance.STAMP_BACKWARDS: (
            ReasonKind.TIME_BACKWARDS,
            f"{stamp!r} after {float(guard.heard[0])!r}",
        ),
        acceptance.TOO_OLD: (ReasonKind.JOINT_STATE_GAP, age),
        acceptance.GAP: (
            ReasonKind.JOINT_STATE_GAP,
            f"{lasting} s between two, {at_most}",
        ),
        acceptance.STAMP_STANDS: (
            ReasonKind.JOINT_STATE_GAP,
            f"stamp {stamp!r} has not changed for {lasting} s, {at_most}",
        ),
    }
    if code in about_time:
        kind, detail = about_time[code]
        return Reason(kind, "joint states", detail)
    subject = states.robot.joints[joint]
    if code in (acceptance.POSITION_NOT_FINITE, acceptance.VELOCITY_NOT_FINITE):
        name = "q" if code == acceptance.POSITION_NOT_FINITE else "v"
        return Reason(ReasonKind.JOINT_STATE_MALFORMED, subject, f"{name} is {value}")
    unit = "m" if is_prismatic(states.robot.model, 1 + joint) else "rad"
    if code in (acceptance.POSITION_BEYOND_LIMITS, acceptance.VELOCITY_BEYOND_LIMITS):
        name, lower, upper, rate = "v", -allowed, allowed, "/s"
        if code == acceptance.POSITION_BEYOND_LIMITS:
            name, lower, upper = "q", float(guard.lower[joint]), float(guard.upper[joint])
            rate = ""
        found_text, lower_text, upper_text = _spell(value, lower, upper, digits=6)
        detail = f"{name} is {found_text} {unit}{rate}, limits with errors are "
        detail += f"{lower_text} to {upper_text} {unit}{rate}"
        return Reason(ReasonKind.JOINT_STATE_BEYOND_LIMITS, subject, detail)
    text, rate = {
        POSITION_BY_ACCEL: ("deviated from its motion by", ""),
        POSITION_BY_SPEED: ("moved by", ""),
        VELOCITY_BY_ACCEL: ("changed its velocity by", "/s"),
        VELOCITY_BY_SPEED: ("moved at", "/s"),
    }[code]
    found_text, limit_text = _spell(value, allowed, digits=3)
    detail = (
        f"{text} {found_text} {unit}{rate} in {_spell_time(duration)}, "
        f"limit {limit_text} {unit}{rate}"
    )
    return Reason(ReasonKind.JOINT_STATE_JUMPED, subject, detail)


def describe_lead(lead: float, most: float) -> str:
    """Describe how far a stamp is ahead, and which clock it may come from.

    Args:
        lead: Stamp minus the monitor's time, in [s].
        most: The greatest permitted lead, in [s].
    """
    found, allowed = _spell(lead, most, digits=3)
    told = f"stamp {found} s ahead of the monitor's clock, expected at most {allowed} s"
    if lead > UNIX_LEAD:
        told += '; it looks like Unix time: if it is, set clock = "unix" in the cell file'
    return told


def describe_unbraked(states: JointStates, age: float) -> Reason | None:
    """The reason that a joint may be too fast for its brakes when they engage; else None.

    Args:
        states: The joint states, of which the last is meant.
        age: Of that one, in [s].
    """
    joint = states.find_unbraked(age)
    if joint == ALL_COVERED:
        return None
    guard, name = states.guard, states.robot.joints[joint]
    unit = "m/s" if is_prismatic(states.robot.model, 1 + joint) else "rad/s"
    delay = max(age, 0.0) + guard.horizon + guard.reaction_time
    # As Python has it: to compile it here would hold up the tick.
    speed = speed_at_bite.py_func(
        guard.v[joint],
        guard.velocity_error[joint],
        guard.operating_velocity[joint],
        guard.acceleration_limit[joint],
        guard.operating_acceleration[joint],
        delay,
        -age,
    )
    found, limit = _spell(float(speed), float(guard.brakes.speed[joint, -1]), digits=3)
    return Reason(
        ReasonKind.BRAKES_NOT_COVERED,
        name,
        f"moves at {guard.v[joint]:.3g} {unit}, and may reach {found} {unit} in the "
        f"{_spell_time(delay)} until its brakes engage, which are stated up to {limit} {unit}",
    )


def describe_runaway(states: JointStates) -> Reason | None:
    """The reason that a joint cannot stop before its position limit; None if all can."""
    joint, robot = states.find_runaway(), states.robot
    if joint == NO_JOINT:
        return None
    limits = robot.lower_position_limit[joint], robot.upper_position_limit[joint]
    return Reason(
        ReasonKind.JOINT_STOP_AHEAD,
        robot.joints[joint],
        f"at {states.q[joint]:.6g} with velocity {states.v[joint]:.3g}, "
        f"between stops at {limits[0]:.6g} and {limits[1]:.6g}",
    )


def _read_vector(name: str, values: ArrayLike, joints: int) -> FloatArray | Reason:
    try:
        if isinstance(values, np.ma.MaskedArray):
            # What was masked out was not measured.
            values = np.ma.filled(values.astype(np.float64), np.nan)
        array = np.asarray(values)
        # NumPy would read strings of digits as numbers, and drop imaginary parts.
        if array.dtype.kind not in "fiu":
            detail = f"array of {array.dtype}, expected numbers"
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
        if array.shape != (joints,):
            detail = f"shape {array.shape}, expected {(joints,)}"
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
        with np.errstate(all="ignore"):
            # What is too large for a float becomes infinite, and is refused as that.
            return np.array(array, dtype=np.float64)
    except Exception:
        # Whatever a foreign object raises here, it is no array.
        return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, "not an array of numbers")


def _spell(value: float, *limits: float, digits: int) -> list[str]:
    """A value and its limits, with enough digits to distinguish the value from them."""
    while digits < 17:
        texts = [f"{number:.{digits}g}" for number in (value, *limits)]
        if texts[0] not in texts[1:]:
            break
        digits += 3
    return texts


def _spell_time(duration: float) -> str:
    """A duration in [s], in words."""
    return f"{1e3 * duration:.3g} ms" if duration < 1.0 else f"{duration:.3g} s"
