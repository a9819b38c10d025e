"""Reads ROS parameter files: a robot's description, and MoveIt's joint limits.

Both are YAML. A key is looked for at any depth, since launch files and nodes wrap parameters in
namespaces. MoveIt's limits are what plans keep to: operating limits, not what the hardware can do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from armguard.exceptions import RobotError

DESCRIPTION_KEY = "robot_description"
LIMITS_KEY = "joint_limits"
SCALING_KEYS = ("default_velocity_scaling_factor", "default_acceleration_scaling_factor")


class PlanningLimits(NamedTuple):
    """What a `joint_limits.yaml` of MoveIt says."""

    joints: tuple[str, ...]
    """All that it names."""
    velocity: dict[str, float]
    """By joint, where it has such a limit, in [rad/s] or [m/s]."""
    acceleration: dict[str, float]
    """By joint, where it has such a limit, in [rad/s²] or [m/s²]."""
    unused: tuple[str, ...]
    """What it states beside these: limits as "joint.key", and default scaling factors, since a
    motion may ask for others."""


def read_planning_limits(path: Path) -> PlanningLimits:
    """Read MoveIt's `joint_limits.yaml`.

    A limit counts where its `has_…_limits` is true, or is left out beside a value, as MoveIt has
    it.

    Raises:
        RobotError: It cannot be read, has no `joint_limits`, or a value is unusable.
    """
    root = _read_yaml(path)
    table = _find(root, LIMITS_KEY)
    if not isinstance(table, Mapping) or not table:
        raise RobotError(
            str(path), f"has no {LIMITS_KEY}", expected="a joint_limits.yaml as MoveIt has it"
        )
    limits: dict[str, dict[str, float]] = {"velocity": {}, "acceleration": {}}
    read = {key for kind in limits for key in (f"has_{kind}_limits", f"max_{kind}")}
    unused = []
    for joint, entry in table.items():
        where = f"{path}: joint {joint}"
        if not isinstance(entry, Mapping):
            raise RobotError(where, f"is {entry!r}", expected="its limits by name")
        for kind, found in limits.items():
            has, value = entry.get(f"has_{kind}_limits"), entry.get(f"max_{kind}")
            if not isinstance(has, bool | None):
                raise RobotError(where, f"has_{kind}_limits is {has!r}", expected="true or false")
            if has or (has is None and value is not None):
                found[str(joint)] = _read_positive(where, f"max_{kind}", value)
        others = [key for key in map(str, entry) if key not in read]
        unused += [f"{joint}.{key}" for key in others if not key.startswith("has_")]
    unused += [key for key in SCALING_KEYS if _find(root, key) is not None]
    return PlanningLimits(
        joints=tuple(map(str, table)),
        velocity=limits["velocity"],
        acceleration=limits["acceleration"],
        unused=tuple(unused),
    )


def read_robot_description(path: Path) -> str:
    """The URDF that a parameter file has as `robot_description`.

    Raises:
        RobotError: The file cannot be read, or has none, or one that is not the text of a URDF.
    """
    found = _find(_read_yaml(path), DESCRIPTION_KEY)
    where = f"{path}: {DESCRIPTION_KEY}"
    if isinstance(found, Mapping) and "value" in found:
        found = found["value"]
    if found is None:
        raise RobotError(
            str(path), f"has no {DESCRIPTION_KEY}", expected="the text of a URDF under that name"
        )
    if not isinstance(found, str) or not found.lstrip().startswith("<"):
        raise RobotError(
            where,
            f"is {str(found)[:60]!r}",
            expected="the text of a URDF",
            remedy="expand what makes it: `xacro FILE.xacro > arm.urdf`",
        )
    return found


def _read_yaml(path: Path) -> Any:
    try:
        return msgspec.yaml.decode(path.read_bytes())
    except OSError as error:
        raise RobotError(str(path), f"cannot be read: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, ValueError) as error:
        raise RobotError(str(path), f"is not YAML: {' '.join(str(error).split())}") from error


def _find(node: Any, key: str) -> Any:
    """What stands under a key, nearest to the root; None where it is nowhere."""
    level = [node]
    while level:
        tables = [one for one in level if isinstance(one, Mapping)]
        for table in tables:
            if key in table:
                return table[key]
        level = [value for table in tables for value in table.values()]
    return None


def _read_positive(where: str, key: str, value: object) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and 0.0 < float(str(value)) < math.inf):
        raise RobotError(where, f"{key} is {value!r}", expected="a finite number above 0")
    return float(str(value))
