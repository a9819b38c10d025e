"""Reads goals of a shield, and refuses late or unusable ones by name."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import (
    GoalMessage,
    MessageError,
    Rows,
    count_rows,
    to_rows,
    to_values,
)
from armguard.streams.intake import Intake
from armguard.streams.joint_intake import JointOrder
from armguard.streams.stamp_clocks import StampClock

MOST_SAMPLES = 5000
"""Of all paths of a goal, where they have times; laying these out takes some milliseconds."""

MOST_WAYPOINTS = 20
"""Of all paths of a goal without times: the fastest timing takes about 2 ms for each."""

MOST_PATHS = 8
"""Of a goal; an arm at rest looks at each of them in each step."""

MOST_POINTS = 100
"""Of a chunk; they are laid out in the step that takes them."""

LONGEST_VELOCITY = 1.0
"""From now on, in [s]: for so long at most an arm goes on whose caller has fallen silent."""

PathRows = tuple[NDArray[np.float64], NDArray[np.float64] | None]
"""Positions of a path, in [rad] or [m], and their times, in [s]; None: the fastest."""


class GoalRequest(NamedTuple):
    """What a shield is asked to do, in the order of the watched joints."""

    number: int
    """Of the goal, as its sender counts."""
    problem: str
    """What makes it unusable, in words; empty: nothing, and one of the others below is there."""
    until: float = math.nan
    """When it is over, in [s] of the monitor's time, never too late."""
    paths: tuple[PathRows, ...] = ()
    """To be followed, the first ones preferred. Shapes (k, nv), and (k,)."""
    velocity: NDArray[np.float64] | None = None
    """To be kept, in [rad/s] or [m/s]. Shape (nv,)."""
    chunk: NDArray[np.float64] | None = None
    """The next positions of a policy, in [rad] or [m]. Shape (k, nv)."""


class GoalReader:
    """Reads goals.

    Args:
        intake: Where faults are counted, and times.
        clock: How joint states are stamped, and so ends of goals.
    """

    def __init__(self, intake: Intake, clock: StampClock) -> None:
        self._intake = intake
        # Joint states may be measured before their stamps; a goal says what is to come.
        self._clock = clock._replace(latency=0.0)

    def read(self, message: GoalMessage, joints: JointOrder) -> GoalRequest:
        """A goal in the order of an arm's joints; what makes it unusable is said, and counted."""
        intake, number = self._intake, message.number
        try:
            intake.check_arm(message)
            return self._read(message, joints)
        except MessageError as error:
            intake.faults.add("goal refused", "goals", number, str(error))
            return GoalRequest(number, str(error))

    def _read(self, message: GoalMessage, joints: JointOrder) -> GoalRequest:
        asked = {name: getattr(message, name) for name in ("paths", "velocity", "chunk")}
        given = [name for name, value in asked.items() if value is not None]
        if len(given) != 1:
            found = " and ".join(given) or "empty"
            raise MessageError("goal", found, "one of paths, velocity and chunk")
        times, now = self._intake.times, self._intake.times.now()
        until = times.translate(message.until, self._clock)[0] - self._clock.error
        if not now <= until < math.inf:
            late = f"{now - until:.3g} s ago" if until <= now else repr(message.until)
            raise MessageError("until", late, "a time to come")
        count, order = len(message.names), joints.find(message.names)
        if message.velocity is not None:
            if until - now > LONGEST_VELOCITY:
                expected = f"{LONGEST_VELOCITY:g} s at most for a velocity"
                raise MessageError("until", f"{until - now:.3g} s ahead", expected)
            velocity = to_values("velocity", message.velocity, count)[order]
            _check_finite("velocity", velocity)
            return GoalRequest(message.number, "", until, velocity=velocity)
        if message.chunk is not None:
            chunk = _read_rows("chunk", message.chunk, count, MOST_POINTS, order)
            return GoalRequest(message.number, "", until, chunk=chunk)
        paths = message.paths or []
        if not 0 < len(paths) <= MOST_PATHS:
            raise MessageError("paths", f"{len(paths)} of them", f"1 to {MOST_PATHS}")
        lengths = [(one.times is not None, count_rows(one.q, count)) for one in paths]
        for timed, most in ((True, MOST_SAMPLES), (False, MOST_WAYPOINTS)):
            total = sum(length for is_timed, length in lengths if is_timed is timed)
            if total > most:
                words = "samples with times" if timed else "waypoints without times"
                raise MessageError("paths", f"{total} {words}", f"{most} at most")
        read: list[PathRows] = []
        for k, path in enumerate(paths):
            q = _read_rows(f"paths[{k}].q", path.q, count, MOST_SAMPLES, order)
            at = path.times
            read.append((q, None if at is None else to_values(f"paths[{k}].times", at, len(q))))
        return GoalRequest(message.number, "", until, tuple(read))


def _read_rows(
    field: str, rows: Rows, width: int, most: int, order: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Rows in the order of the watched joints, 1 to `most` of them."""
    count = count_rows(rows, width)
    if not 0 < count <= most:
        raise MessageError(field, f"{count} rows", f"1 to {most}")
    values = to_rows(field, rows, width)[:, order]
    _check_finite(field, values)
    return values


def _check_finite(field: str, values: NDArray[np.float64]) -> None:
    if not np.isfinite(values).all():
        raise MessageError(field, "not finite", "finite numbers")
