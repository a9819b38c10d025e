"""The memory into which a table reads messages; reallocated only for a larger message.

Each array argument of compiled code costs some 60 ns, and reference counting costs compiled code
more than most work on a row. So the samples of all messages are in memory that compiled code
already knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import pack
from armguard.messages.batch import FIELDS
from armguard.obstacles.frames import Frame
from armguard.obstacles.table import States, make_states

HAS_REGIONS = 1 << len(FIELDS)
"""In `MessageHead.each`: each sample has a set of regions; without it none is stated."""

LEAST_ROOM = 64
"""Samples of balls that there is room for at the least."""


class Frames(NamedTuple):
    """The frames F that messages may refer to, by number: p_W = R_WF p_F + p_WF."""

    rotation: FloatArray
    """R_WF. Shape (frames, 3, 3)."""
    translation: FloatArray
    """p_WF, in [m]. Shape (frames, 3)."""
    position_error: FloatArray
    """What each may be off by, in [m]. Shape (frames,)."""


class MessageHead(NamedTuple):
    """What is said of all samples of a message."""

    points_each: int
    """Points of each sample."""
    stamp: float
    """Of all of them, in [s]."""
    extent: float
    """How far from the world's origin a coordinate may be, in [m]."""
    frame: int
    """Number of the samples' frame; 0 is the world."""
    is_velocity_known: bool
    """Whether velocities were measured; else they are 0, with errors as large as the bounds on
    speed, so that an error of inf is no flaw."""
    each: int
    """Sum of 2**i over those of `FIELDS` of which there is one number for each sample; of these the
    numbers here do not count. With `HAS_REGIONS`, sets of regions are stated as well."""
    radius: float
    """[m]."""
    accel: float
    """[m/s²]."""
    speed: float
    """[m/s]."""
    position_error: float
    """[m]."""
    velocity_error: float
    """[m/s]."""


class MessageData(NamedTuple):
    """All of a message that compiled code reads and writes; of each array the beginning is used."""

    points: FloatArray
    """[m]. Shape (rows, width, 3)."""
    velocities: FloatArray
    """[m/s]. Shape (rows, width, 3)."""
    radius: FloatArray
    """[m]. Shape (rows,)."""
    accel: FloatArray
    """[m/s²]. Shape (rows,)."""
    speed: FloatArray
    """[m/s]. Shape (rows,)."""
    position_error: FloatArray
    """[m]. Shape (rows,)."""
    velocity_error: FloatArray
    """[m/s]. Shape (rows,)."""
    regions: IntArray
    """Sets of regions that are stated; 0: none is. Shape (rows,)."""
    codes: IntArray
    """What became of each sample. Shape (rows,)."""
    values: FloatArray
    """What a fault would show of it. Shape (rows,)."""
    sample: States
    """Room for one sample while it is judged, in the first place of two."""
    frames: Frames


class MessageMemory:
    """Room for the samples of one message.

    Args:
        frames: Those that messages may refer to, by number; the first is the world.

    Attributes:
        data: The arrays.
        handle: On all of them, for compiled code; replaced with them.
        points_each: Points of each sample of the message that is read.
        fields: Where the fields go of which there is one number for each sample; as `FIELDS`.
    """

    data: MessageData
    handle: Any

    def __init__(self, frames: Sequence[Frame]) -> None:
        self._frames = Frames(
            np.array([frame.rotation for frame in frames]),
            np.array([frame.translation for frame in frames]),
            np.array([frame.position_error for frame in frames]),
        )
        self._make(LEAST_ROOM, 1)
        self._lay_out((0, 3))

    def take_points(self, points: FloatArray, velocities: FloatArray | None) -> None:
        """Take in the points of a message, and their velocities if known; make room if need be.

        Args:
            points: In [m]. Shape (n, 3) or (n, k, 3).
            velocities: In [m/s]. Alike, or None.
        """
        shape = points.shape
        if shape != self._shape:
            count, points_each = shape[0], 1 if len(shape) == 2 else shape[1]
            rows, width = self.data.points.shape[:2]
            if count > rows or points_each > width:
                rows = rows if count <= rows else max(count, 2 * rows)
                self._make(rows, max(width, points_each))
            self._lay_out(shape)
        # A slice in place of the dots takes twice as long.
        self._points[...] = points
        if velocities is not None:
            self._velocities[...] = velocities

    def _make(self, rows: int, width: int) -> None:
        radius, accel, speed, position_error, velocity_error = (np.zeros(rows) for _ in FIELDS)
        self.fields = radius, accel, speed, position_error, velocity_error
        self.data = MessageData(
            points=np.zeros((rows, width, 3)),
            velocities=np.zeros((rows, width, 3)),
            radius=radius,
            accel=accel,
            speed=speed,
            position_error=position_error,
            velocity_error=velocity_error,
            regions=np.zeros(rows, dtype=np.int64),
            codes=np.zeros(rows, dtype=np.int64),
            values=np.zeros(rows),
            sample=make_states(2, width),
            frames=self._frames,
        )
        self.handle = pack(self.data)

    def _lay_out(self, shape: tuple[int, ...]) -> None:
        """Let the places for points be those of a message with points of this shape."""
        self._shape, is_ball = shape, len(shape) == 2
        count, self.points_each = shape[0], 1 if is_ball else shape[1]
        places = slice(count), 0 if is_ball else slice(self.points_each)
        self._points, self._velocities = self.data.points[places], self.data.velocities[places]

    def __getstate__(self) -> dict[str, Any]:
        # Arrays of a copy would be others than those that its handle is on.
        return {"_frames": self._frames}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._frames = state["_frames"]
        self._make(LEAST_ROOM, 1)
        self._lay_out((0, 3))
