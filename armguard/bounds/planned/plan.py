"""Plans as controllers hand them over, and reading them: well formed, or refused with a reason.

A plan is a piece of trajectory that carries its own stop: it ends at rest.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.bounds.checks import read_only
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code
from armguard.jit.kernels import kernel
from armguard.robot.robot import Robot

MOST_SAMPLES = 20_000
"""Beyond this it is no next piece; bounds the time that a check takes."""


LONGEST = 1e6
"""Nor is what lasts longer, in [s]; times up to this are exact to a nanosecond."""


NUMBER = np.dtype(np.float64)
"""What arrays of plans hold in compiled code."""


OPTIONAL = 3
"""After this array of a plan those begin that need not be stated."""


class Plan(NamedTuple):
    """A piece of trajectory, cubic between samples, at whose end the arm rests, and stays."""

    stamp: float
    """When the arm is at the first sample, in [s] on the clock of the joint states."""
    times: ArrayLike
    """Of the samples, counted from `stamp`, in [s]; rising from 0. Shape (k,), k >= 2."""
    q: ArrayLike
    """Joint positions in the order of `robot.joints`, in [rad] or [m]; those of continuous joints
    may wrap. Shape (k, nv)."""
    v: ArrayLike
    """Joint velocities, in [rad]/[s] or [m]/[s]. Shape (k, nv)."""
    tracking_error: ArrayLike
    """How far each joint may be off the curve until it rests, in [rad] or [m], above 0;
    `robot.position_error` comes on top, so it may be what the controller sees. Shape (nv,)."""
    velocity_tracking_error: ArrayLike | None = None
    """How far each velocity may be off the curve's, in [rad]/[s] or [m]/[s], above 0;
    `robot.velocity_error` comes on top. None: what follows from `tracking_error` and the limits on
    accelerations, which is much. Shape (nv,)."""


class CheckedPlan(NamedTuple):
    """A plan that `check_plan` has found within limits and followed. It ends at rest.

    Arrays are its own, contiguous and of float64; those of its samples are read-only.
    """

    stamp: float
    """When the arm is at the first sample, in [s]."""
    times: FloatArray
    """Of the samples, counted from `stamp`, in [s]. Shape (k,)."""
    q: FloatArray
    """[rad] or [m]. Shape (k, nv)."""
    v: FloatArray
    """[rad]/[s] or [m]/[s]. Shape (k, nv)."""
    deviation: FloatArray
    """How far joints may truly be off the curve, all errors included, in [rad] or [m]. (nv,)."""
    acceleration: FloatArray
    """Greatest acceleration of the deviation of joints from the curve: the robot's limit and the
    curve's greatest together, in [rad]/[s²] or [m]/[s²]. Shape (nv,)."""
    velocity_deviation: FloatArray
    """How far velocities may truly be off the curve's as the controller states it, all errors
    included, in [rad]/[s] or [m]/[s]; inf where it does not. Shape (nv,)."""
    top_speed: FloatArray
    """The curve's greatest speed of each joint, in [rad]/[s] or [m]/[s]. Shape (nv,)."""
    now: float
    """When it was checked, in [s]."""
    measured_stamp: float
    """Stamp of the joint state that it was checked against, in [s]."""
    measured_q: FloatArray
    """Of that joint state, in [rad] or [m]. Shape (nv,)."""
    measured_v: FloatArray
    """Of that joint state, in [rad]/[s] or [m]/[s]. Shape (nv,)."""

    @property
    def end(self) -> float:
        """When the arm is at the last sample, in [s]."""
        return self.stamp + float(self.times[-1])


def make_example() -> CheckedPlan:
    """A plan of one joint, for the types that all plans have in compiled code."""
    times, q, v, one = np.zeros(2), np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(1)
    for samples in (times, q, v):
        samples.flags.writeable = False
    return CheckedPlan(0.0, times, q, v, one, one, one, one, 0.0, 0.0, one, one)


def is_plain(plan: CheckedPlan, joints: int) -> bool:
    """Whether a plan has the types that all plans have in compiled code, and so many joints."""
    for array in (*plan[1:8], *plan[10:]):
        if not (type(array) is np.ndarray and array.dtype == NUMBER and array.flags.c_contiguous):
            return False
    return plan.q.shape[1:] == (joints,)


class PlanLimits(NamedTuple):
    """A robot's limits and errors, by which its plans are judged. Shape (nv,) each."""

    lower: FloatArray
    """Position limits, in [rad] or [m]; infinite where the joint is continuous."""
    upper: FloatArray
    """As `lower`."""
    velocity: FloatArray
    """Limits, in [rad]/[s] or [m]/[s]."""
    acceleration: FloatArray
    """Limits, in [rad]/[s²] or [m]/[s²]."""
    position_error: FloatArray
    """What measured positions may be off by, in [rad] or [m]."""
    velocity_error: FloatArray
    """What measured velocities may be off by, in [rad]/[s] or [m]/[s]."""


def read_plan_limits(robot: Robot) -> PlanLimits:
    """The limits and errors by which plans for a robot are judged; read-only copies."""
    given = (
        robot.lower_position_limit,
        robot.upper_position_limit,
        robot.velocity_limit,
        robot.acceleration_limit,
        robot.position_error,
        robot.velocity_error,
    )
    # Of one type, or all that reads them is compiled anew for limits of less precision.
    return PlanLimits(*(read_only(np.array(limit, dtype=NUMBER)) for limit in given))


class Refusal(NamedTuple):
    """Why a plan cannot be relied on."""

    subject: str
    """What is at fault: the plan, one of its fields, a joint."""
    detail: str
    """Value found and value expected, in plain words."""

    def __str__(self) -> str:
        return f"{self.subject}: {self.detail}"


def read_plan(plan: object, joints: int) -> Plan | Refusal:
    """The plan with float64 copies for arrays, or what is malformed about it.

    Args:
        plan: Anything at all; a refusal stands for a plan that was refused so.
        joints: How many joints the robot has.
    """
    if isinstance(plan, Refusal):
        return plan
    if not isinstance(plan, Plan):
        return Refusal("plan", f"is a {type(plan).__name__}, expected an armguard.Plan")
    return _copy_arrays(plan, joints) or _read_fields(plan, joints)


def _copy_arrays(plan: Plan, joints: int) -> Plan | None:
    """The plan with copies for arrays, where these are float64 already; None: to be looked into.

    What `_read_fields` finds field by field, a controller's loop has mostly seen to.
    """
    stamp, *given = plan
    if not isinstance(stamp, float) or type(plan.times) is not np.ndarray:
        return None
    count = plan.times.shape[0] if plan.times.ndim else 0
    if count > MOST_SAMPLES:
        # It is refused before anything is copied, for it may be of any size.
        return None
    shapes = (count,), (count, joints), (count, joints), (joints,), (joints,)
    copies: list[FloatArray | None] = []
    for array, shape in zip(given, shapes, strict=True):
        if array is None and len(copies) > OPTIONAL:
            copies.append(None)
        elif type(array) is np.ndarray and array.dtype == NUMBER and array.shape == shape:
            copy = array.copy()
            copy.setflags(write=False)
            copies.append(copy)
        else:
            return None
    times, q, v, error, speed_error = copies
    # One that is not stated is as good as the one that is.
    if not _find_sound_code()(
        float(stamp),
        times,
        q,
        v,
        error,
        error if speed_error is None else speed_error,
    ):
        return None
    return Plan(float(stamp), *copies)  # type: ignore[arg-type]  # it has no None but where one may be


def _read_fields(plan: Plan, joints: int) -> Plan | Refusal:
    """The same, whatever its fields are."""
    stamp = _read_array("stamp", plan.stamp, ())
    if isinstance(plan.times, np.ndarray) and plan.times.size > MOST_SAMPLES:
        return _refuse_count(plan.times.size)
    times = _read_array("times", plan.times, (-1,))
    if isinstance(stamp, Refusal):
        return stamp
    if isinstance(times, Refusal):
        return times
    if not 2 <= len(times) <= MOST_SAMPLES:
        return _refuse_count(len(times))
    arrays = {"q": (len(times), joints), "v": (len(times), joints), "tracking_error": (joints,)}
    if plan.velocity_tracking_error is not None:
        arrays["velocity_tracking_error"] = (joints,)
    fields: dict[str, FloatArray] = {}
    for name, shape in arrays.items():
        array = _read_array(name, getattr(plan, name), shape)
        if isinstance(array, Refusal):
            return array
        if name.endswith("tracking_error") and not (array > 0.0).all():
            return Refusal(name, f"is {array.min():.4g} for a joint, expected above 0")
        fields[name] = array
    if times[0] != 0.0:
        return Refusal("times", f"begins at {times[0]:.6g} s, expected 0")
    steps = np.diff(times)
    if not (steps > 0.0).all():
        k = int(np.argmin(steps))
        return Refusal(
            "times", f"{times[k + 1]:.6g} s after {times[k]:.6g} s, expected rising numbers"
        )
    if not times[-1] <= LONGEST:
        return Refusal("times", f"ends at {times[-1]:.6g} s, expected {LONGEST:g} s at most")
    return Plan(float(stamp), times, **fields)


def _refuse_count(count: int) -> Refusal:
    return Refusal("times", f"has {count} samples, expected 2 to {MOST_SAMPLES}")


def _read_array(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray | Refusal:
    """A finite float64 copy, which nothing else writes to; -1 in `shape` is any length."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            # What was masked out was not planned.
            values = np.ma.filled(values.astype(np.float64), np.nan)
        given = np.asarray(values)
        # NumPy would read strings of digits as numbers, and drop imaginary parts.
        if given.dtype.kind not in "fiu":
            return Refusal(name, f"is an array of {given.dtype}, expected numbers")
        fits = given.ndim == len(shape) and all(
            wanted in (-1, length) for wanted, length in zip(shape, given.shape, strict=True)
        )
        if not fits:
            return Refusal(name, f"has shape {given.shape}, expected {shape}")
        with np.errstate(all="ignore"):
            array: FloatArray = np.array(given, dtype=np.float64, order="C")
    except Exception:
        # Whatever a foreign object raises here, it is no array.
        return Refusal(name, "is no array of numbers")
    if not np.isfinite(array).all():
        return Refusal(name, "is not finite everywhere")
    array.flags.writeable = False
    return array


@functools.cache
def _find_sound_code() -> Any:
    """What `_is_sound` runs for copies of arrays."""
    times, q, v = make_example()[1:4]
    return machine_code(_is_sound, 0.0, times, q, v, times, times)


@kernel
def _is_sound(
    stamp: float,
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    error: FloatArray,
    speed_error: FloatArray,
) -> bool:
    """Whether all that `_read_fields` says of the numbers of a plan is in order."""
    count = times.shape[0]
    if not (abs(stamp) < math.inf and 2 <= count <= MOST_SAMPLES):
        return False
    if not (times[0] == 0.0 and times[count - 1] <= LONGEST):
        return False
    for k in range(count - 1):
        if not times[k + 1] > times[k]:
            return False
    # Differences of what is not finite are no numbers, and no such sum is 0.
    total = 0.0
    for k in range(count):
        total += times[k] - times[k]
        for j in range(q.shape[1]):
            total += (q[k, j] - q[k, j]) + (v[k, j] - v[k, j])
    for j in range(error.shape[0]):
        for array in (error, speed_error):
            total += array[j] - array[j]
            if not array[j] > 0.0:
                return False
    return total == 0.0
