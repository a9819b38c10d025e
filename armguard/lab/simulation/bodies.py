"""A person as obstacles: nine tracked points, and the balls and capsules that cover the body.

Motion capture and pose estimators give points: the middles of joints and parts. Balls around them
would leave the forearm between elbow and hand uncovered, so five of the nine bodies are capsules,
each named after the point nearer the trunk. Radii are those of a large adult in work clothes,
rounded up: the cover shall hold the person, not the average.

| body | between | radius | covers |
|---|---|---|---|
| head | head | 0.16 m | skull with a cap: half of the 0.24 m from chin to crown, and hair |
| collar | collar | 0.20 m | upper chest and the base of the neck, out to the shoulder joints |
| hip | hip, collar | 0.20 m | the trunk: half of a hip's 0.38 m; deeper than a chest |
| left_shoulder, right_shoulder | shoulder, elbow | 0.10 m | upper arm: half of 0.14 m, and cloth |
| left_elbow, right_elbow | elbow, hand | 0.08 m | forearm: half of 0.11 m, and a sleeve |
| left_hand, right_hand | hand | 0.13 m | from the back of the hand to the stretched fingertips |

Legs below the hip have no tracked point and are not covered: a table stands between them and the
arm. Neither is anything that the person holds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.lab.simulation.sources import ObstacleSink

Array = NDArray[np.float64]


class Body(NamedTuple):
    """One part of a person: the hull of one or two tracked points, rounded by a radius."""

    name: str
    points: tuple[str, ...]
    radius: float
    """In [m]."""


BODIES = (
    Body("head", ("head",), 0.16),
    Body("collar", ("collar",), 0.20),
    Body("hip", ("hip", "collar"), 0.20),
    Body("left_shoulder", ("left_shoulder", "left_elbow"), 0.10),
    Body("right_shoulder", ("right_shoulder", "right_elbow"), 0.10),
    Body("left_elbow", ("left_elbow", "left_hand"), 0.08),
    Body("right_elbow", ("right_elbow", "right_hand"), 0.08),
    Body("left_hand", ("left_hand",), 0.13),
    Body("right_hand", ("right_hand",), 0.13),
)

POINTS = tuple(body.name for body in BODIES)
"""The tracked points, in the order of every array of points in this package."""


def publish_person(
    sink: ObstacleSink,
    source: str,
    stamp: float,
    position: Array,
    velocity: Array,
    velocity_error: Array,
    *,
    position_error: float = 0.0,
    accel: float | None = None,
    speed: float | None = None,
    person: str = "",
) -> None:
    """Hand one frame of a person to a sink: balls and capsules in a call each.

    A body of which a point was not seen is left out; where no body was seen at all, an empty
    update says that the source is alive.

    Args:
        sink: Where it goes.
        source: Name of the source.
        stamp: Time of the frame, in [s].
        position: Of the tracked points in the world, NaN where one was not seen, in [m].
            Shape (9, 3).
        velocity: Of these points, in [m]/[s]. Shape (9, 3).
        velocity_error: What each may be off by, in [m]/[s]. Shape (9,).
        position_error: What each point may be off by, in [m].
        accel: Bound on accelerations, in [m]/[s²]; None: the sink's.
        speed: Bound on speeds, in [m]/[s]; None: the sink's.
        person: Whose bodies they are, as ids then say; contact limits need that.
    """
    seen_any = False
    for names, points, radii in _GROUPS:
        seen: NDArray[np.bool_] = np.all(np.isfinite(position[points]), axis=(1, 2))
        if not seen.any():
            continue
        seen_any = True
        rows = points[seen]
        sink.update(
            [f"{person}/{name}" if person else name for name in names[seen].tolist()],
            stamp,
            position[rows],
            velocity[rows],
            radius=radii[seen],
            accel=accel,
            speed=speed,
            position_error=position_error,
            velocity_error=velocity_error[rows].max(axis=1),
            source=source,
        )
    if not seen_any:
        sink.update([], stamp, np.empty((0, 3)), radius=np.empty(0), source=source)


def _group(count: int) -> tuple[NDArray[np.str_], NDArray[np.int64], Array]:
    """Names (n,), points (n, count) and radii (n,) of the bodies with so many points."""
    bodies = [body for body in BODIES if len(body.points) == count]
    return (
        np.array([body.name for body in bodies]),
        np.array([[POINTS.index(point) for point in body.points] for body in bodies]),
        np.array([body.radius for body in bodies]),
    )


_GROUPS = (_group(1), _group(2))
