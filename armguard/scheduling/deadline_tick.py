"""A tick in one compiled call: the joint state taken, and a look at the obstacles that are due."""

from __future__ import annotations

from typing import Any

from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.robot.joint_acceptance import BELIEVED, accept
from armguard.scheduling.certificates import UNSEEN
from armguard.scheduling.deadline_evaluations import look


@kernel
def advance(
    handle: Any,
    stamp: float,
    q: FloatArray,
    v: FloatArray,
    now: float,
    epoch: float,
    number: int,
    may_look: bool,
) -> tuple[int, int, float, float, float, int, int, float, int, int, int]:
    """Take a joint state if there is nothing to be said against it, and then look.

    Args:
        handle: On a `Watching`.
        stamp: When the state was measured, in [s].
        q: Joint positions, [rad] or [m]; any strides. Shape (nv,).
        v: Joint velocities, [rad/s] or [m/s]; any strides. Shape (nv,).
        now: Time of the tick, in [s].
        epoch: Since when the monitor counts time, in [s].
        number: Of the tick.
        may_look: Whether there is nothing to be seen to between state and look.

    Returns:
        See `scheduler.Seen`.
    """
    found, joint, stop_time, late_stop_time = accept(handle.content.guard, stamp, q, v, now)
    if found != BELIEVED or not may_look:
        return found, joint, stop_time, late_stop_time, 0.0, UNSEEN, 0, 0.0, 0, 0, 0
    refinement_threshold = (stop_time + handle.content.aware_margin) / (
        1.0 - handle.content.max_staleness
    )
    row, link, expiry, overdue, evaluated, overtaken = look(
        handle, False, 0, now, now - epoch, number, now - stamp, refinement_threshold
    )
    return (
        found,
        joint,
        stop_time,
        late_stop_time,
        refinement_threshold,
        row,
        link,
        expiry,
        overdue,
        evaluated,
        overtaken,
    )
