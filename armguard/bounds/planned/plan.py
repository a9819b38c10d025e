"""Plans of controllers, and the check that they are well formed.

A plan is a piece of trajectory that contains its own stop: it ends at rest.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code
from armguard.jit.kernels import kernel

MOST_SAMPLES = 20_000
"""Greatest number of samples of a plan; bounds the time of a check."""


LONGEST = 1e6
"""Longest duration of a plan, in [s]; times up to this are exact to 1 ns."""


NUMBER = np.dtype(np.float64)
"""Type of plans' arrays in compiled code."""


class Plan(NamedTuple):
    """A piece of trajectory, cubic between samples, at whose end the arm is and stays at rest."""

    stamp: float
    """Time of the first sample, in [s] on the clock of the joint states."""
    times: ArrayLike
    """Times of the samples, counted from `stamp`, in [s]; increasing from 0. Shape (k,), k >= 2."""
    q: ArrayLike
    """Joint positions in the order of `robot.joints`, in [rad] or [m]; those of continuous joints
    may wrap. Shape (k, nv)."""
    v: ArrayLike
    """Joint velocities, in [rad]/[s] or [m]/[s]. Shape (k, nv)."""
    tracking_error: ArrayLike
    """Greatest distance of each joint from the curve until it is at rest, in [rad] or [m], above 0.
    `robot.position_error` is added, so this can be the error that the controller measures. Shape
    (nv,)."""
    velocity_tracking_error: ArrayLike | None = None
    """Greatest difference of each velocity from the curve's, in [rad]/[s] or [m]/[s], above 0.
    `robot.velocity_error` is added. None: the bound that follows from `tracking_error` and the
    acceleration limits, which is large. Shape (nv,)."""


class CheckedPlan(NamedTuple):
    """A plan that `check_plan` has accepted: within limits, followed by the arm, ending at rest.

    Arrays are its own, contiguous and of float64; those of its samples are read-only.
    """

    stamp: float
    """Time of the first sample, in [s]."""
    times: FloatArray
    """Times of the samples, counted from `stamp`, in [s]. Shape (k,)."""
    q: FloatArray
    """[rad] or [m]. Shape (k, nv)."""
    v: FloatArray
    """[rad]/[s] or [m]/[s]. Shape (k, nv)."""
    deviation: FloatArray
    """Greatest true distance of joints from the curve, all errors included, in [rad] or [m].
    (nv,)."""
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


class Refusal(NamedTuple):
    """Why a plan was refused."""

    subject: str
    """The offender: the plan, one of its fields, or a joint."""
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
    stamp = plan.stamp if type(plan.stamp) is float else _read_array("stamp", plan.stamp, ())
    if isinstance(stamp, Refusal):
        return stamp
    if isinstance(plan.times, np.ndarray) and plan.times.size > MOST_SAMPLES:
        # It is refused before anything is copied, for it may be of any size.
        return _refuse_count(plan.times.size)
    times = _read_array("times", plan.times, (-1,))
    if isinstance(times, Refusal):
        return times
    count = len(times)
    if not 2 <= count <= MOST_SAMPLES:
        return _refuse_count(count)
    arrays = {"times": times}
    shapes = {"q": (count, joints), "v": (count, joints), "tracking_error": (joints,)}
    if plan.velocity_tracking_error is not None:
        shapes["velocity_tracking_error"] = (joints,)
    for name, shape in shapes.items():
        array = _read_array(name, getattr(plan, name), shape)
        if isinstance(array, Refusal):
            return array
        arrays[name] = array
    # A velocity error that is not stated is as good as the one that is.
    *_, last = arrays.values()
    samples = times, arrays["q"], arrays["v"]
    is_sound = math.isfinite(stamp) and _find_sound_code()(*samples, arrays["tracking_error"], last)
    if not is_sound:
        return _describe_numbers({"stamp": np.asarray(stamp), **arrays})
    return Plan(float(stamp), **arrays)


def _refuse_count(count: int) -> Refusal:
    return Refusal("times", f"has {count} samples, expected 2 to {MOST_SAMPLES}")


def _describe_numbers(arrays: dict[str, FloatArray]) -> Refusal:
    """What is wrong with the numbers of a plan that is not sound, by field."""
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            return Refusal(name, "is not finite everywhere")
        if name.endswith("tracking_error") and not (array > 0.0).all():
            return Refusal(name, f"is {array.min():.4g} for a joint, expected above 0")
    times = arrays["times"]
    if times[0] != 0.0:
        return Refusal("times", f"begins at {times[0]:.6g} s, expected 0")
    steps = np.diff(times)
    if not (steps > 0.0).all():
        k = int(np.argmin(steps))
        step = f"{times[k + 1]:.6g} s after {times[k]:.6g} s"
        return Refusal("times", f"{step}, expected rising numbers")
    return Refusal("times", f"ends at {times[-1]:.6g} s, expected {LONGEST:g} s at most")


def _read_array(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray | Refusal:
    """A float64 copy, which nothing else writes to; -1 in `shape` is any length."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            # What was masked out was not planned.
            values = np.ma.filled(values.astype(np.float64), np.nan)
        given = np.asarray(values)
        # NumPy would read strings of digits as numbers, and drop imaginary parts.
        if given.dtype.kind not in "fiu":
            return Refusal(name, f"is an array of {given.dtype}, expected numbers")
        if given.shape != shape and not (shape == (-1,) and given.ndim == 1):
            return Refusal(name, f"has shape {given.shape}, expected {shape}")
        if given.dtype == NUMBER:
            array: FloatArray = given.copy()
        else:
            with np.errstate(all="ignore"):
                array = given.astype(np.float64, order="C")
    except Exception:
        # Whatever a foreign object raises here, it is no array.
        return Refusal(name, "is no array of numbers")
    array.setflags(write=False)
    return array


@functools.cache
def _find_sound_code() -> Any:
    """What `_is_sound` runs for copies of arrays."""
    times, q, v = make_example()[1:4]
    return machine_code(_is_sound, times, q, v, times, times)


@kernel
def _is_sound(
    times: FloatArray, q: FloatArray, v: FloatArray, error: FloatArray, speed_error: FloatArray
) -> bool:
    """Whether all numbers are finite, times rise from 0 to LONGEST, and errors are above 0."""
    count = times.shape[0]
    if not (times[0] == 0.0 and times[count - 1] <= LONGEST):
        return False
    for k in range(count - 1):
        if not times[k + 1] > times[k]:
            return False
    # Differences of what is not finite are no numbers, and no such sum is 0.
    total = 0.0
    for k in range(count):
        for j in range(q.shape[1]):
            total += (q[k, j] - q[k, j]) + (v[k, j] - v[k, j])
    for j in range(error.shape[0]):
        for array in (error, speed_error):
            total += array[j] - array[j]
            if not array[j] > 0.0:
                return False
    return total == 0.0
