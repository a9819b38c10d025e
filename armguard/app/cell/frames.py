"""Places the frames of a cell file, and the statics in them, in the world."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from armguard.app.cell.schema import CellTables, Quaternion, StaticTable, make_error
from armguard.obstacles.frames import Frame

_UNIT_TOLERANCE = 1e-3


class Placement(NamedTuple):
    """A frame in the world, and the greatest error of points given in it."""

    rotation: NDArray[np.float64]
    """World from frame. Shape (3, 3)."""
    translation: NDArray[np.float64]
    """Origin of the frame in the world, in [m]. Shape (3,)."""
    calibration_error: float
    """In [m]; errors along a chain of frames add up."""

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points of the frame in the world, in [m]. Shape (..., 3)."""
        moved: NDArray[np.float64] = np.asarray(points, float) @ self.rotation.T + self.translation
        return moved

    @property
    def transform(self) -> pinocchio.SE3:
        """World from frame."""
        return pinocchio.SE3(self.rotation, self.translation)

    def as_frame(self) -> Frame:
        """The same for a table of obstacles."""
        return Frame(*self)


def resolve_frames(tables: CellTables, file: str) -> dict[str, Placement]:
    """Place "world", "base" (the robot's) and all frames of the file in the world, by name.

    In a cell with several arms, the base of each arm is a frame with the arm's name. The file
    cannot name "base" then, which is the base of the watched arm.

    Args:
        tables: What the file says.
        file: What to call it in errors.

    Raises:
        CellError: A frame has no known parent, is its own ancestor, has a name in use, or has a
            quaternion that is not a rotation.
    """
    base = tables.robot.base
    rotation = read_rotation("robot.base.quaternion", base.quaternion, file)
    resolved = {"world": Placement(np.eye(3), np.zeros(3), 0.0)}
    own_base = Placement(rotation, np.array(base.xyz), 0.0)
    if not tables.robots:
        resolved["base"] = own_base
    for number, arm in enumerate(tables.robots):
        key = f"robots[{number}]"
        if arm.name in ("world", "base"):
            raise make_error(file, f"{key}.name", f"is {arm.name!r}", "another name")
        rotation = read_rotation(f"{key}.base.quaternion", arm.base.quaternion, file)
        resolved[arm.name] = Placement(rotation, np.array(arm.base.xyz), arm.calibration_error)
    for name in tables.frames:
        if name in resolved or name == "base":
            raise make_error(file, f"frames.{name}", "is a frame of its own", "another name")
    for name in tables.frames:
        _resolve(name, tables, resolved, [], file)
    return {**resolved, "base": own_base}


def _resolve(
    name: str, tables: CellTables, resolved: dict[str, Placement], below: list[str], file: str
) -> Placement:
    if name in resolved:
        return resolved[name]
    key = f"frames.{below[-1] if below else name}.parent"
    if name not in tables.frames:
        known = ", ".join(dict.fromkeys([*resolved, *tables.frames]))
        raise make_error(file, key, f"is {name!r}", f"one of {known}")
    if name in below:
        chain = " in ".join([*below[below.index(name) :], name])
        raise make_error(file, key, f"makes a circle ({chain})", "a tree")
    table = tables.frames[name]
    parent = _resolve(table.parent, tables, resolved, [*below, name], file)
    rotation = read_rotation(f"frames.{name}.quaternion", table.quaternion, file)
    resolved[name] = Placement(
        parent.rotation @ rotation,
        parent.apply(table.xyz),
        parent.calibration_error + table.calibration_error,
    )
    return resolved[name]


def read_rotation(key: str, quaternion: Quaternion, file: str) -> NDArray[np.float64]:
    """Rotation matrix of a quaternion (x, y, z, w), which is normalised. Shape (3, 3).

    Args:
        key: Key of the quaternion in the file.
        quaternion: Value in the file.
        file: What to call the file in errors.

    Raises:
        CellError: Its length is not nearly 1.
    """
    norm = math.hypot(*quaternion)
    if not abs(norm - 1.0) <= _UNIT_TOLERANCE:
        problem = f"is {list(quaternion)}, of length {norm:.6g}"
        raise make_error(file, key, problem, "x, y, z, w of length 1")
    x, y, z, w = (value / norm for value in quaternion)
    rotation: NDArray[np.float64] = pinocchio.Quaternion(w, x, y, z).toRotationMatrix()
    return rotation


def place_bodies(
    tables: Mapping[str, StaticTable], key: str, frames: dict[str, Placement], file: str
) -> dict[str, tuple[NDArray[np.float64], float]]:
    """Place bodies of a frame: points in the world, and radius with the frame's error, in [m].

    Args:
        tables: Tables of the bodies by name: `[statics]` or `[entrances]`.
        key: "statics" or "entrances".
        frames: All frames by name, as resolved.
        file: What to call the file in errors.

    Raises:
        CellError: Something has not exactly one of position and points, or no known frame.
    """
    placed = {}
    for name, table in tables.items():
        if (table.position is None) == (table.points is None):
            problem = "has not exactly one of position and points"
            raise make_error(file, f"{key}.{name}", problem, "one of them")
        if table.frame not in frames:
            known = f"one of {', '.join(frames)}"
            raise make_error(file, f"{key}.{name}.frame", f"is {table.frame!r}", known)
        frame = frames[table.frame]
        points = table.points if table.position is None else table.position
        placed[name] = (frame.apply(np.array(points)), table.radius + frame.calibration_error)
    return placed
