"""The content of a robot.toml: watched joints, every limit with its source, locked joints.

URDF files have no accelerations and no guaranteed decelerations, and often infinite or missing
limits. So a robot.toml states every limit with its source. Parsing is strict: an unknown key, a
missing limit or an infinite one is refused by name.
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

DESCRIPTION = "robot.toml"
"""The file that describes a robot, in a folder of its own."""

COVER = "cover.json"
"""The file beside it with the cover that was proved for the robot."""

LIMITS = ("position", "velocity", "acceleration", "braking")


class LimitSources(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Source of each kind of limit: of the whole robot, or of one joint if it differs."""

    position: str = ""
    """Source of the position limits."""
    velocity: str = ""
    """Source of the velocity limits."""
    acceleration: str = ""
    """Source of the acceleration limits."""
    braking: str = ""
    """Source of the rows of `[[brakes]]` without their own source."""


class JointDescription(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of one watched joint, in [rad] or [m], [s]; `position` is absent if continuous."""

    velocity: float
    """Greatest velocity in every mode, in [rad/s] or [m/s]."""
    acceleration: float
    """Greatest acceleration and deceleration, also in emergency stops, in [rad/s²] or [m/s²]."""
    braking: float | None = None
    """Refused: state `[[brakes]]` instead."""
    position: tuple[float, float] | None = None
    """Lowest and highest position, in [rad] or [m]."""
    position_error: float = 1e-3
    """Greatest error of a measured position, in [rad] or [m]."""
    velocity_error: float = 0.02
    """Greatest error of a measured velocity, in [rad/s] or [m/s]."""
    sources: LimitSources = LimitSources()
    """Sources of its own limits."""


class LockedJoint(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A joint that is not watched, but carries a watched one or is carried by it.

    It either stays at `position`, or can be anywhere in `travel`, in [rad] or [m]; then its links
    count as everything that they can reach. A joint with travel can be fixed in the URDF.
    """

    position: float | None = None
    """Position at which it stays, in [rad] or [m]."""
    travel: tuple[float, float] | None = None
    """Range of its positions, in [rad] or [m], at most one turn; it must carry no watched joint.
    """


class OperatingSources(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sources of published operating limits."""

    velocity: str
    """Source of the operating velocities."""
    acceleration: str
    """Source of the operating accelerations."""


class OperatingDescription(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Operating limits of the controller, as manufacturers or driver authors publish them.

    By joint, in [rad]/[s] and [rad]/[s²], or [m]/[s] and [m]/[s²]. They are not limits of the
    hardware: an emergency stop can exceed them, and so can a controller with another configuration.
    """

    sources: OperatingSources
    """Their sources."""
    velocity: dict[str, float]
    """Operating velocity of each joint, in [rad/s] or [m/s]."""
    acceleration: dict[str, float]
    """Operating acceleration of each joint, in [rad/s²] or [m/s²]."""


class OperatingTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[operating]`: published operating limits of a robot."""

    published: OperatingDescription | None = None
    """The published limits."""


class RobotDescription(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A parsed and checked robot.toml."""

    sources: LimitSources
    """Sources of the limits of all joints."""
    joints: dict[str, JointDescription]
    """The watched joints, by their names in the URDF."""
    brakes: tuple[BrakeRow, ...] = ()
    """Braking of the joints; every joint needs a row."""
    title: str = ""
    """Display name of the robot."""
    urdf: str = ""
    """Path of the URDF or MJCF: relative to the folder of robot.toml, absolute, or below `robots/`
    of the package example-robot-data."""
    package_dirs: tuple[str, ...] = ()
    """Folders in which `package://` names are looked up."""
    locked: dict[str, LockedJoint] = {}
    """Joints that are not watched."""
    bare_links: tuple[str, ...] = ()
    """Moving links with visual but no collision geometry that may stay without a cover."""
    collision_from_visual: tuple[str, ...] = ()
    """Links without collision geometry whose visual geometry is used instead."""
    operating: OperatingTable = OperatingTable()
    """Operating limits of its controller."""

    @property
    def travelling(self) -> list[str]:
        """The locked joints that can be anywhere in their travel."""
        return [name for name, entry in self.locked.items() if entry.travel is not None]

    def source(self, joint: str, limit: str) -> str:
        """Source of one limit of one joint."""
        own: str = getattr(self.joints[joint].sources, limit)
        general: str = getattr(self.sources, limit)
        return own or general

    def brake_entries(self, place: str = "limits") -> dict[str, list[BrakeEntry]]:
        """The braking entries of each joint, checked.

        Args:
            place: What to call the file in errors.

        Raises:
            RobotError: An entry is missing or unusable, or the table of a joint falls.
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
        raise RobotError(place, _name_joint(source, str(error))) from error
    _check(place, description)
    return description


def _name_joint(source: str | Path | Mapping[str, Any], problem: str) -> str:
    """What is wrong with a description, with the joint's name where msgspec says `[...]`."""
    if "joints[...]" not in problem:
        return problem
    raw = source if isinstance(source, Mapping) else msgspec.toml.decode(Path(source).read_bytes())
    for name, joint in raw["joints"].items():
        try:
            msgspec.convert(msgspec.to_builtins(joint, enc_hook=_to_builtin), JointDescription)
        except msgspec.ValidationError:
            return problem.replace("$.joints[...]", f"joints.{name}")
    return problem


def _to_builtin(value: object) -> object:
    """Let limits be NumPy's numbers and arrays as well."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r} is neither number, text, list nor mapping")


def robots_directory() -> Path:
    """The folder of known robots: inside the package in a wheel, next to it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for directory in (package / "robots", package.parent / "robots"):
        if directory.is_dir():
            return directory
    raise RobotError("robots", f"no such folder in {package} or beside it", remedy="reinstall")


def list_robots() -> list[str]:
    """Names of the robots that `Robot.load` knows."""
    return sorted(path.parent.name for path in robots_directory().glob("*/robot.toml"))


def is_known(name: str | Path) -> bool:
    """Whether a name is that of a robot that armguard knows, and not the path of a folder."""
    return isinstance(name, str) and name in list_robots()


def find_robot(name: str | Path) -> Path:
    """The folder of a robot.

    Args:
        name: One of `list_robots`, or the path of a folder with a robot.toml, as `armguard robot
            new` writes it; a folder that has the name of a known robot is meant by "./name".

    Raises:
        RobotError: There is none of that name; the message lists those that exist.
    """
    if is_known(name):
        return robots_directory() / name
    try:
        if (Path(name) / DESCRIPTION).is_file():
            return Path(name)
        is_folder = Path(name).is_dir()
    except (OSError, ValueError):  # too long for a path, or with a zero byte
        is_folder = False
    if is_folder:
        raise RobotError(
            str(name),
            f"has no {DESCRIPTION}",
            remedy="`armguard robot new arm.urdf --out DIR` writes one",
        )
    known = ", ".join(list_robots())
    raise RobotError(
        f"robot {str(name)!r}",
        "is not known",
        expected=f"one of {known}, or a folder with a {DESCRIPTION}",
    )


def locate_urdf(directory: Path, description: RobotDescription) -> tuple[Path, list[Path]]:
    """The URDF of a robot, and the folders in which its packages are looked up.

    Args:
        directory: The folder of its robot.toml.
        description: What that says.

    Raises:
        RobotError: There is no such file.
    """
    place = directory / DESCRIPTION
    if not description.urdf:
        raise RobotError(f"{place}: urdf", "is missing", expected="the path of the robot's URDF")
    own = directory / description.urdf
    if own.is_file():
        folders = [directory / folder for folder in description.package_dirs]
        return own, [*folders, *own.resolve().parents]
    try:
        urdf, packages = find_example_urdf(description.urdf)
    except RobotError as error:
        if directory.parent == robots_directory():
            raise
        raise RobotError(
            f"{place}: urdf",
            f"is {description.urdf!r}, which is no file",
            expected=f"a path from {directory}, or one below robots/ of example-robot-data",
        ) from error
    return urdf, [packages]


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
        if set(limits) != set(description.joints):
            raise RobotError(
                where, f"is for {', '.join(limits)}", expected=", ".join(description.joints)
            )
        for name, joint in description.joints.items():
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
