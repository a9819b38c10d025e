"""A batch of obstacle states as arrays: what one source saw at one time.

Its fields are the parameters of `Obstacles.update`, in their order; a table takes one by
`Obstacles.take`. On the wire and in recordings it is an `ObstaclesMessage`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import ObstaclesMessage, to_points, to_values

Field = float | NDArray[np.float64]
"""One number for all obstacles, or one for each: shape (n,)."""


FIELDS = ("radius", "accel", "speed", "position_error", "velocity_error")
"""What is said of an obstacle with one number, in the order of a batch."""


class ObstacleBatch(NamedTuple):
    """States of n obstacles, k points each; units as in `Obstacles.update`."""

    ids: list[str]
    stamp: float
    """[s]."""
    position: NDArray[np.float64]
    """[m]. Shape (n, 3) or (n, k, 3)."""
    velocity: NDArray[np.float64] | None
    """[m/s]; None: not measured. Shape as of `position`."""
    radius: Field | None
    """[m]."""
    accel: Field | None
    """[m/s²]; None: the table's for each id."""
    speed: Field | None
    """[m/s]; None: the table's for each id."""
    position_error: Field
    """[m]."""
    velocity_error: Field
    """[m/s]."""
    source: str
    frame: str
    snapshot: bool
    region: str | Sequence[str] | None = None
    """Of a body; None: the table's for each id."""


def pack_batch(batch: ObstacleBatch) -> ObstaclesMessage:
    """The message that holds a batch; its arrays are copied."""
    ids, stamp, position, velocity, *fields, source, frame, snapshot, region = batch
    packed: list[Any] = [
        field.tobytes() if isinstance(field, np.ndarray) else field for field in fields
    ]
    radius, accel, speed, position_error, velocity_error = packed
    return ObstaclesMessage(
        ids,
        stamp,
        source,
        None,
        frame,
        snapshot,
        position.tobytes(),
        None if velocity is None else velocity.tobytes(),
        radius,
        accel,
        speed,
        position_error,
        velocity_error,
        region if region is None or isinstance(region, str) else [str(one) for one in region],
    )


def read_batch(message: ObstaclesMessage, stamp: float | None = None) -> ObstacleBatch:
    """The batch that a message holds.

    Args:
        message: The message.
        stamp: In place of its stamp, in [s]; None: as it is.

    Raises:
        MessageError: A field has more or fewer numbers than its ids ask for.
    """
    count, velocity = len(message.ids), message.velocity
    numbers: list[Any] = []
    for name in FIELDS:
        value = getattr(message, name)
        if value is not None and type(value) is not float:
            value = to_values(name, value, count)
        numbers.append(value)
    points = (
        to_points("position", message.position, count),
        None if velocity is None else to_points("velocity", velocity, count),
    )
    stamp = message.stamp if stamp is None else stamp
    of_all = message.source, message.frame, message.snapshot, message.region
    return ObstacleBatch._make((message.ids, stamp, *points, *numbers, *of_all))
