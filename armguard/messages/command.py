"""What a shield answers in each step: the motion that the arm is to follow to its rest."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.messages.incoming import PACKED, Rows, to_rows, to_values
from armguard.messages.reasons import ReasonMessage

SAME_PLACE = 1e-4
"""Motions that are no farther apart than this join, in [rad] or [m]."""

SAME_VELOCITY = 1e-3
"""Alike, in [rad/s] or [m/s]."""


class Samples(NamedTuple):
    """Of a motion; cubic between them."""

    times: NDArray[np.float64]
    """In [s] from the stamp of the motion, rising from 0. Shape (k,)."""
    q: NDArray[np.float64]
    """In [rad] or [m]. Shape (k, nv)."""
    v: NDArray[np.float64]
    """In [rad/s] or [m/s]. Shape (k, nv)."""
    a: NDArray[np.float64]
    """In [rad/s²] or [m/s²]. Shape (k, nv)."""


class CommandMessage(msgspec.Struct, tag_field="type", tag="command", kw_only=True):
    """A `Command` on the wire: times on the machine's monotonic clock."""

    sequence: int
    """tick; 0: no joint state, or end"""
    stamp: float
    """start of the motion, [s]"""
    take_up_by: float
    """latest time at which to change to this motion, [s]"""
    valid_until: float
    """end of the motion, at rest, [s]"""
    names: list[str]
    """joints"""
    times: bytes | list[float]
    """sample times after `stamp`, [s], rising from 0"""
    q: Rows
    """positions, a row per time, [rad] or [m]"""
    v: Rows
    """velocities, [rad/s] or [m/s]; motion is cubic between samples"""
    a: Rows
    """accelerations, [rad/s²] or [m/s²]"""
    moving: bool
    """whether the arm moves from now on"""
    scale: float
    """share of requested pace or velocities, 0 to 1"""
    progress: float
    """progress on the path, 0 to 1"""
    executed: int
    """number of chunk points before the stop begins"""
    stop: Literal["finish", "brake"] | None
    """`"brake"`: the motion is not proved any more"""
    reason: ReasonMessage | None
    """why it is slower than requested"""
    contact_speed: float | None
    """bound on the speed of contacts, [m/s]; only with contact limits"""
    goal: int | None
    """number of the newest accepted goal"""
    refused: int | None
    """number of the newest refused goal"""
    problem: str
    """why it was refused, or empty"""
    run: str = ""
    """random text, another one after each start of the monitor"""
    arm: str = ""
    """name of the arm"""

    def read(self) -> Samples:
        """The samples of the motion.

        Raises:
            MessageError: Their numbers do not fit each other.
        """
        times, width = self.times, len(self.names)
        count = len(times) // 8 if isinstance(times, bytes) else len(times)
        rows = ((name, getattr(self, name)) for name in ("q", "v", "a"))
        return Samples(
            to_values("times", times, count),
            *(to_rows(name, values, width, count) for name, values in rows),
        )

    def at(self, time: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """Where the arm is to be at a time; before its beginning and after its end it rests there.

        Args:
            time: In [s] of the machine's monotonic clock; there must be samples. Shape (...).

        Returns:
            Positions, velocities and accelerations, in [rad] or [m], and by [s] and [s²]. Shape
            (..., nv) each.
        """
        times, q, v, a = self.read()
        since = np.asarray(time, float)[..., None] - self.stamp
        k = np.clip(np.searchsorted(times, since[..., 0]), 1, len(times) - 1)
        h = (times[k] - times[k - 1])[..., None]
        u = np.clip((since - times[k - 1][..., None]) / h, 0.0, 1.0)
        # Cubic Hermite, as the motion was proved.
        way, first, last = q[k] - q[k - 1], h * v[k - 1], h * v[k]
        square, cube = 3.0 * way - 2.0 * first - last, first + last - 2.0 * way
        return (
            q[k - 1] + u * (first + u * (square + u * cube)),
            (first + u * (2.0 * square + 3.0 * u * cube)) / h,
            (1.0 - u) * a[k - 1] + u * a[k],
        )

    def joins(self, q: ArrayLike, v: ArrayLike, now: float) -> bool:
        """Whether an arm that follows another motion may take this one up.

        Args:
            q: Where that motion has the arm at `now`, in [rad] or [m]. Shape (nv,).
            v: And how fast, in [rad/s] or [m/s]. Shape (nv,).
            now: In [s] of the machine's monotonic clock.
        """
        if not (len(self.times) and now <= self.take_up_by):
            return False
        place, speeds, _ = self.at(now)
        apart = np.abs(place - np.asarray(q, float)), np.abs(speeds - np.asarray(v, float))
        return bool((apart[0] <= SAME_PLACE).all() and (apart[1] <= SAME_VELOCITY).all())


def pack(values: NDArray[np.float64]) -> bytes:
    """Numbers as they go over the wire."""
    return np.ascontiguousarray(values, PACKED).tobytes()


def move_clock(message: CommandMessage, offset: float, run: str, arm: str) -> CommandMessage:
    """The same on another clock, as sent; never to be taken up or followed for too long.

    Args:
        message: In the monitor's own time.
        offset: Machine's monotonic clock minus the monitor's, in [s].
        run: Text that each start of the monitor makes anew.
        arm: Name of the arm; empty in a cell with one.
    """
    return msgspec.structs.replace(
        message,
        stamp=message.stamp + offset,
        take_up_by=math.nextafter(message.take_up_by + offset, -math.inf),
        valid_until=math.nextafter(message.valid_until + offset, -math.inf),
        run=run,
        arm=arm,
    )


def unpack(message: CommandMessage) -> CommandMessage:
    """The same with lists of numbers, for JSON."""
    samples = message.read()
    lists = {name: rows.tolist() for name, rows in samples._asdict().items()}
    return msgspec.structs.replace(message, **lists)
