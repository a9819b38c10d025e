"""Locates the model file of a new robot, and its name in robot.toml."""

from __future__ import annotations

import importlib.metadata
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from armguard.exceptions import RobotError
from armguard.robot.description import find_example_urdf
from armguard.robot.ros_parameters import read_robot_description

URDF = "robot.urdf"
"""File name, beside robot.toml, of a URDF that was extracted from a parameter file."""

PARAMETER_ENDINGS = (".yaml", ".yml")


class UrdfSource(NamedTuple):
    """A URDF and its entries in robot.toml."""

    path: Path
    """Where it can be read now."""
    folders: list[Path]
    """Folders in which `package://` names are looked up."""
    text: str | None
    """Text to write beside robot.toml; None if the file stays at its place."""
    key: str
    """`urdf` of robot.toml."""
    package_keys: tuple[str, ...]
    """`package_dirs` of robot.toml."""
    origin: str
    """Its name in the source texts of limits."""


def find_urdf(name: Path, out: Path, package_dirs: Sequence[Path], scratch: Path) -> UrdfSource:
    """Find a URDF: a file, one below `robots/` of example-robot-data, or in a parameter file.

    Args:
        name: The name that the user gives.
        out: The folder of the robot.toml to be.
        package_dirs: Folders in which `package://` names are looked up, beside those around it.
        scratch: A folder for the URDF of a parameter file.

    Raises:
        RobotError: There is no such file, or it has no URDF.
    """
    for folder in package_dirs:
        if not folder.is_dir():
            raise RobotError(f"--package-dirs {folder}", "is not a folder")
    if name.suffix in PARAMETER_ENDINGS:
        text = read_robot_description(name)
        path = scratch / URDF
        path.write_text(text, encoding="utf-8")
        _refuse_loose_meshes(name, text)
        folders = [*package_dirs, name.resolve().parent]
        keys = tuple(_spell(folder, out) for folder in folders)
        return UrdfSource(path, folders, text, URDF, keys, f"robot_description of {name.name}")
    if not name.is_file() and not name.is_absolute():
        try:
            name, _ = find_example_urdf(str(name))
        except RobotError as error:
            raise RobotError(
                str(name),
                "cannot be read: no such file",
                expected="a URDF, an MJCF, one below robots/ of example-robot-data, or a YAML file "
                "with robot_description",
            ) from error
    folders = [*package_dirs, *name.resolve().parents]
    example = _find_in_examples(name)
    key = example or _spell(name, out)
    origin = name.name
    if example:
        version = importlib.metadata.version("example-robot-data")
        origin += f" of example-robot-data {version.partition('.')[0]}"
    keys = () if example else tuple(_spell(folder, out) for folder in package_dirs)
    return UrdfSource(name, folders, None, key, keys, origin)


def _find_in_examples(path: Path) -> str | None:
    """The path of a URDF below `robots/` of example-robot-data; None where it lies elsewhere."""
    parts = path.resolve().parts
    for number in range(len(parts) - 2, 0, -1):
        if parts[number - 1 : number + 1] == ("example-robot-data", "robots"):
            key = "/".join(parts[number + 1 :])
            try:
                urdf, _ = find_example_urdf(key)
            except RobotError:
                return None
            return key if urdf == path.resolve() else None
    return None


def _refuse_loose_meshes(name: Path, text: str) -> None:
    """Refuse mesh names that are relative to a URDF without a file."""
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise RobotError(f"{name}: robot_description", f"is not XML: {error}") from error
    for mesh in root.iterfind("link/collision/geometry/mesh"):
        file = mesh.get("filename", "")
        if "://" not in file and not Path(file).is_absolute():
            raise RobotError(
                f"{name}: mesh {file!r}",
                "is relative, but the URDF is not a separate file",
                expected="package://… or file://…",
            )


def _spell(path: Path, out: Path) -> str:
    """A path as robot.toml names it: relative where both may be moved together, else absolute."""
    path, home = path.resolve(), out.resolve()
    if path.is_relative_to(home):
        return str(path.relative_to(home))
    if path.is_relative_to(home.parent):
        return str(Path("..") / path.relative_to(home.parent))
    return str(path)
