"""Plans as controllers hand them over, and reading them: well formed, or refused with a reason."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.jit.arrays import FloatArray

MOST_SAMPLES = 20_000
"""Beyond this it is no next piece; bounds the time that a check takes."""


class Plan(NamedTuple):
    """A piece of trajectory, cubic between samples, at whose end the arm brakes."""

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
    """How far each joint may be off the curve, in [rad] or [m], above 0; `robot.position_error`
    comes on top, so it may be what the controller sees. Shape (nv,)."""
    velocity_tracking_error: ArrayLike | None = None
    """How far each velocity may be off the curve's, in [rad]/[s] or [m]/[s], above 0;
    `robot.velocity_error` comes on top. None: what follows from `tracking_error` and the limits on
    accelerations, which is much. Shape (nv,)."""


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
        plan: Anything at all.
        joints: How many joints the robot has.
    """
    if not isinstance(plan, Plan):
        return Refusal("plan", f"is a {type(plan).__name__}, expected an armguard.Plan")
    stamp = _read_array("stamp", plan.stamp, ())
    times = _read_array("times", plan.times, (-1,))
    if isinstance(stamp, Refusal):
        return stamp
    if isinstance(times, Refusal):
        return times
    if not 2 <= len(times) <= MOST_SAMPLES:
        return Refusal("times", f"has {len(times)} samples, expected 2 to {MOST_SAMPLES}")
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
    return Plan(float(stamp), times, **fields)


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
