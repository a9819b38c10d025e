"""What a robot.toml says: the watched joints, every limit with its source, the locked joints.

URDF files carry neither accelerations nor guaranteed decelerations, and often infinite or missing
limits, so every limit is named here, with where it comes from. Parsing is strict: an unknown key,
a missing limit or one that is not finite is refused by name.
"""

from __future__ import annotations

import functools
import importlib.metadata
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from armguard.exceptions import RobotError
from armguard.robot.brakes import RANGE_REMEDY, BrakeEntry, BrakeRow, read_rows

LIMITS = ("position", "velocity", "acceleration", "braking")


class LimitSources(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where each kind of limit comes from; the robot's, or one joint's own where it differs."""

    position: str = ""
    velocity: str = ""
    acceleration: str = ""
    braking: str = ""


class JointDescription(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of one watched joint, in [rad] or [m], [s]; `position` is absent if continuous."""

    velocity: float
    acceleration: float
    braking: float | None = None
    """Refused by name: a deceleration without the load and speed up to which it holds."""
    position: tuple[float, float] | None = None
    position_error: float = 1e-3
    velocity_error: float = 0.02
    sources: LimitSources = LimitSources()


class LockedJoint(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An unwatched joint beyond or before a watched one.

    Either it rests at `position`, or it may be anywhere in `travel`, in [rad] or [m], and its links
    are taken as all that they can reach. A joint with travel may be one that the URDF draws fixed.
    """

    position: float | None = None
    travel: tuple[float, float] | None = None


class OperatingSources(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where published operating limits come from."""

    velocity: str
    acceleration: str


class OperatingDescription(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What those who make or drive a robot publish of what its controller keeps to at work.

    By joint, in [rad]/[s] and [rad]/[s²], or [m]/[s] and [m]/[s²]. No limits of the hardware: an
    emergency may exceed them, and so may a controller that is configured otherwise.
    """

    sources: OperatingSources
    velocity: dict[str, float]
    acceleration: dict[str, float]


class OperatingTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[operating]`: what is known of a robot at work."""

    published: OperatingDescription | None = None


class RobotDescription(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A parsed and checked robot.toml.

    Attributes:
        title: The robot's name for people.
        urdf: Path below `robots/` of example-robot-data; empty where the caller brings the URDF.
        sources: Where the limits come from.
        joints: The watched joints by name.
        brakes: What is known of their brakes, by load and speed.
        locked: Unwatched joints that move links beyond, or carry, a watched one.
        bare_links: Links that are drawn but have no collision geometry, and may go uncovered.
        operating: What its controller keeps to at work, as far as that is published.
    """

    sources: LimitSources
    joints: dict[str, JointDescription]
    brakes: tuple[BrakeRow, ...] = ()
    title: str = ""
    urdf: str = ""
    locked: dict[str, LockedJoint] = {}
    bare_links: tuple[str, ...] = ()
    operating: OperatingTable = OperatingTable()

    @property
    def travelling(self) -> list[str]:
        """The locked joints that may be anywhere in their travel."""
        return [name for name, entry in self.locked.items() if entry.travel is not None]

    def source(self, joint: str, limit: str) -> str:
        """Where one limit of one joint comes from."""
        own: str = getattr(self.joints[joint].sources, limit)
        general: str = getattr(self.sources, limit)
        return own or general

    def brake_entries(self, place: str = "limits") -> dict[str, list[BrakeEntry]]:
        """What is known of each joint's brakes, checked.

        Args:
            place: What to call the file in errors.

        Raises:
            RobotError: An entry is missing or unusable, or the table of a joint falls or has holes.
        """
        sources = {name: self.source(name, "braking") for name in self.joints}
        accelerations = np.array([joint.acceleration for joint in self.joints.values()])
        return read_rows(place, self.brakes, sources, accelerations)


def read_description(source: str | Path | Mapping[str, Any]) -> RobotDescription:
    """Parse and check a robot.toml or a mapping of the same form.

    Raises:
        RobotError: It cannot be read, has an unknown or missing key, or a limit is unusable.
    """
    try:
        if isinstance(source, Mapping):
            place = "limits"
            description = msgspec.convert(
                msgspec.to_builtins(source, enc_hook=_to_builtin), RobotDescription
            )
        else:
            place = str(source)
            content = Path(source).read_bytes()
            description = msgspec.toml.decode(content, type=RobotDescription)
    except OSError as error:
        raise RobotError(place, f"cannot be read: {error.strerror}") from error
    except (msgspec.ValidationError, msgspec.DecodeError, UnicodeDecodeError, TypeError) as error:
        raise RobotError(place, str(error)) from error
    _check(place, description)
    return description


def _to_builtin(value: object) -> object:
    """Let limits be NumPy's numbers and arrays as well."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r} is neither number, text, list nor mapping")


def robots_directory() -> Path:
    """The folder of known robots: inside the package in a wheel, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for directory in (package / "robots", package.parent / "robots"):
        if directory.is_dir():
            return directory
    raise RobotError("robots", f"no such folder in {package} or beside it", remedy="reinstall")


def list_robots() -> list[str]:
    """Names of the robots that `Robot.load` knows."""
    return sorted(path.parent.name for path in robots_directory().glob("*/robot.toml"))


def find_robot(name: str) -> Path:
    """The folder of one known robot.

    Raises:
        RobotError: There is none of that name; the message lists those that exist.
    """
    known = list_robots()
    if name not in known:
        raise RobotError(f"robot {name!r}", "is not known", expected=f"one of {', '.join(known)}")
    return robots_directory() / name


@functools.cache
def find_example_urdf(path: str) -> tuple[Path, Path]:
    """A URDF of the example-robot-data distribution, and the folder that its packages lie in.

    The distribution ships data only, and its loader has wrong entries, so the file is looked up
    in the list of installed files, which takes long: once in a process.

    Args:
        path: Path below the distribution's `robots/` folder.

    Raises:
        RobotError: The distribution is not installed or has no such file.
    """
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError as error:
        raise RobotError(
            "example-robot-data", "is not installed", remedy="pip install example-robot-data"
        ) from error
    ending = ("example-robot-data", "robots", *Path(path).parts)
    for file in distribution.files or ():
        if file.parts[-len(ending) :] == ending:
            urdf = Path(str(distribution.locate_file(file))).resolve()
            return urdf, urdf.parents[len(ending) - 1]
    raise RobotError(path, f"is not in example-robot-data {distribution.version}")


def _check(place: str, description: RobotDescription) -> None:
    if not description.joints:
        raise RobotError(place, "watches no joint", expected="at least one under [joints]")
    for name, joint in description.joints.items():
        where = f"{place}: joint {name}"
        for limit in ("position", "velocity", "acceleration"):
            if limit == "position" and joint.position is None:
                continue
            if not description.source(name, limit).strip():
                raise RobotError(where, f"its {limit} limit has no source")
        for key in ("velocity", "acceleration"):
            value = getattr(joint, key)
            if not (0.0 < value < math.inf):
                raise RobotError(where, f"{key} = {value}", expected="positive and finite")
        for key in ("position_error", "velocity_error"):
            value = getattr(joint, key)
            if not (0.0 <= value < math.inf):
                raise RobotError(where, f"{key} = {value}", expected="non-negative and finite")
        if joint.position is not None:
            _check_range(where, "position", joint.position)
        if joint.braking is not None:
            raise RobotError(
                where, f"braking = {joint.braking} has no stated range", remedy=RANGE_REMEDY
            )
    description.brake_entries(place)
    if description.operating.published is not None:
        _check_operating(place, description, description.operating.published)
    for name, locked in description.locked.items():
        where = f"{place}: locked joint {name}"
        if name in description.joints:
            raise RobotError(where, "is watched as well", remedy="name it in one place only")
        if (locked.position is None) == (locked.travel is None):
            raise RobotError(where, "names both or neither", expected="position or travel")
        if locked.travel is not None:
            _check_range(where, "travel", locked.travel)
        elif not math.isfinite(locked.position or 0.0):
            raise RobotError(where, f"position = {locked.position}", expected="a finite number")


def _check_operating(
    place: str, description: RobotDescription, published: OperatingDescription
) -> None:
    """Refuse operating limits that lack a joint or a source, or are beyond the hardware's."""
    for key in ("velocity", "acceleration"):
        where = f"{place}: operating.published.{key}"
        limits: dict[str, float] = getattr(published, key)
        if not getattr(published.sources, key).strip():
            raise RobotError(where, "has no source")
        for name in limits:
            if name not in description.joints:
                raise RobotError(
                    where, f"names joint {name}", expected=f"one of {', '.join(description.joints)}"
                )
        for name, joint in description.joints.items():
            if name not in limits:
                raise RobotError(where, f"lacks joint {name}", expected="every joint of [joints]")
            hardware = getattr(joint, key)
            # Neither is NaN let through, nor a limit that the hardware could not keep.
            if not (0.0 < limits[name] <= hardware):
                raise RobotError(
                    f"{where}: joint {name}",
                    f"is {limits[name]}",
                    expected=f"above 0 and at most {hardware}, the {key} limit of the joint",
                )


def _check_range(where: str, key: str, limits: tuple[float, float]) -> None:
    lower, upper = limits
    if not (-math.inf < lower < upper < math.inf):
        raise RobotError(where, f"{key} = [{lower}, {upper}]", expected="finite, lower < upper")
