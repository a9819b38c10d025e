"""Reads a URDF into Pinocchio's model and its collision geometry, without losing any element.

Pinocchio reads most of it, but drops mimic relations, gives continuous joints a configuration of
two numbers, and resolves relative mesh names by the current folder. So the XML is corrected first,
and afterwards every collision element and every axis is checked.
"""

from __future__ import annotations

import contextlib
import math
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from armguard.exceptions import RobotError

UNIT = 1e-6  # an axis is off from unit length by rounding at most
XACRO = "ros.org/wiki/xacro"  # in the name of its elements' namespace, with and without "www."
PACKAGES = ("package://", "model://")  # before the name of the package, or Gazebo model, of a mesh
FREE_RANGE = 1e9  # stands in for "none" where the URDF format wants a number, in [rad]


class Mimic(NamedTuple):
    """How a joint follows another: multiplier · position of the leader + offset."""

    leader: str
    multiplier: float
    offset: float
    """In [rad] or [m]."""

    def map_range(self, lower: float, upper: float) -> tuple[float, float]:
        """Where the joint may be while its leader is in a range, in [rad] or [m]."""
        ends = [self.multiplier * end + self.offset for end in (lower, upper)]
        return min(ends), max(ends)


class UrdfModel(NamedTuple):
    """What a URDF says, in Pinocchio's terms: one degree of freedom a joint, so nq = nv."""

    model: Any
    """`pinocchio.Model` of every joint; continuous ones are revolute, their range ±inf."""
    collision_model: Any
    """`pinocchio.GeometryModel` of the collision geometry as read."""
    mimics: dict[str, Mimic]
    """Which joint each mimic joint follows, and how."""
    continuous: frozenset[str]
    """Names of the continuous joints."""
    bare: tuple[str, ...]
    """Links that are drawn, but have no collision geometry."""

    def read_range(self, joint: str) -> tuple[float, float] | None:
        """Position limits of a joint, in [rad] or [m]; None where the URDF has none of use."""
        index = self.model.joints[self.model.getJointId(joint)].idx_q
        lower = float(self.model.lowerPositionLimit[index])
        upper = float(self.model.upperPositionLimit[index])
        return (lower, upper) if -math.inf < lower < upper < math.inf else None


def read_urdf(
    path: str | Path,
    package_dirs: Sequence[str | Path] = (),
    freed: Collection[str] = (),
    drawn: Collection[str] = (),
) -> UrdfModel:
    """Read the model and the collision geometry of a URDF; other visual meshes are not opened.

    Args:
        path: The URDF file. Mesh names without a scheme are relative to its folder.
        package_dirs: Folders in which `package://` and `model://` names are looked up, before those
            of the environment variable `ROS_PACKAGE_PATH`.
        freed: Joints that are drawn fixed but do turn, about the axis that the file gives them.
        drawn: Links without collision geometry whose visual geometry is taken for it.

    Raises:
        RobotError: The file is missing or malformed, a mesh cannot be read, a joint has more
            than one degree of freedom or no axis, or geometry was lost.
    """
    path = Path(path)
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except OSError as error:
        raise RobotError(str(path), f"cannot be read: {error.strerror}") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(str(path), f"is not XML: {error}") from error
    _refuse_xacro(path, root)
    if root.find("link") is None:
        raise RobotError(
            str(path),
            f"has no links below its root <{root.tag}>",
            expected="a URDF: <robot> of links",
        )
    if not root.get("name"):
        root.set("name", path.stem)  # the reader wants one, and nothing depends on it
    _collide_as_drawn(root, drawn)
    continuous, mimics = _prepare_joints(root, freed)
    _prepare_meshes(root, path.resolve().parent, package_dirs)
    text = ElementTree.tostring(root, encoding="unicode")
    collision = pinocchio.GeometryType.COLLISION
    try:
        model = pinocchio.buildModelFromXML(text)
        collision_model = pinocchio.buildGeomFromUrdfString(model, text, collision)
    except (ValueError, RuntimeError) as error:
        raise RobotError(str(path), f"is not a usable URDF: {describe_error(error)}") from error
    for joint in list(model.joints)[1:]:
        if joint.nv != 1:
            raise RobotError(
                f"joint {model.names[joint.id]!r}",
                f"has {joint.nv} degrees of freedom",
                expected="one (no free-flyer or moving base)",
                remedy="describe the arm on its fixed base",
            )
        # Pinocchio takes an axis of zero length as it is, and then no motion is rigid.
        length = float(np.linalg.norm(joint.createData().S))
        if not abs(length - 1.0) <= UNIT:
            raise RobotError(
                f"joint {model.names[joint.id]!r}",
                f"has an axis of length {length:g}",
                expected="a direction",
            )
    _check_collisions(path, root, model, collision_model)
    for name in continuous:
        index = model.joints[model.getJointId(name)].idx_q
        model.lowerPositionLimit[index] = -float("inf")
        model.upperPositionLimit[index] = float("inf")
    links = root.findall("link")
    visible = [link for link in links if link.find("visual") is not None]
    bare = tuple(link.get("name", "") for link in visible if link.find("collision") is None)
    return UrdfModel(model, collision_model, mimics, frozenset(continuous), bare)


def _refuse_xacro(path: Path, root: ElementTree.Element) -> None:
    """Refuse a file whose macros are yet to be expanded: what they stand for would be missing."""
    for element in root.iter():
        # A comment's tag is a function.
        if isinstance(element.tag, str) and XACRO in element.tag.partition("}")[0]:
            raise RobotError(
                str(path),
                f"is a xacro: it has <xacro:{element.tag.partition('}')[2]}>",
                expected="a URDF",
                remedy=f"expand it: `xacro {path.name} > arm.urdf`",
            )


def _collide_as_drawn(root: ElementTree.Element, drawn: Collection[str]) -> None:
    """Give links the geometry that they are drawn with as their collision geometry."""
    links = {link.get("name", ""): link for link in root.findall("link")}
    for name in drawn:
        link = links.get(name, ElementTree.Element("link"))
        visuals, has_own = link.findall("visual"), link.find("collision") is not None
        check_drawn(name, links, has_own=has_own, is_drawn=bool(visuals))
        for visual in visuals:
            collision = ElementTree.SubElement(link, "collision")
            collision.extend([part for part in visual if part.tag in ("origin", "geometry")])


def check_drawn(name: str, links: Collection[str], *, has_own: bool, is_drawn: bool) -> None:
    """Refuse a link of which no drawing can be taken as its collision geometry.

    Raises:
        RobotError: It is none of the links, has collision geometry of its own, or is not drawn.
    """
    if name in links and is_drawn and not has_own:
        return
    problem = "has collision geometry of its own" if has_own else "is not drawn"
    raise RobotError(
        f"link {name!r}",
        problem if name in links else "is not in the model file",
        expected="" if name in links else f"one of {', '.join(links)}",
        remedy="leave it out of collision_from_visual",
    )


def _prepare_joints(
    root: ElementTree.Element, freed: Collection[str]
) -> tuple[list[str], dict[str, Mimic]]:
    """Make continuous joints revolute; tell which they were, and which joint follows which."""
    continuous: list[str] = []
    mimics: dict[str, Mimic] = {}
    links = {link.get("name", "") for link in root.findall("link")}
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        mimic = joint.find("mimic")
        if mimic is not None:
            mimics[name] = _read_mimic(name, mimic)
        if joint.get("type") == "fixed" and name in freed:
            joint.set("type", "revolute")
        if joint.get("type") == "fixed" and name in links:
            # Pinocchio finds neither frame by a name that is both a link's and a fixed joint's.
            joint.set("name", f"{name} (fixed joint)")
        if joint.get("type") not in ("continuous", "revolute", "prismatic"):
            continue
        # The format wants limits that many files lack; 0 stands for none, and none is believed.
        limit = joint.find("limit")
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit")
        for key in ("effort", "velocity"):
            limit.set(key, limit.get(key, "0"))
        for key in limit.attrib:
            _read_number(
                name, limit, key, least=0.0 if key in ("effort", "velocity") else -math.inf
            )
        if joint.get("type") == "continuous":
            continuous.append(name)
            joint.set("type", "revolute")
            limit.set("lower", str(-FREE_RANGE))
            limit.set("upper", str(FREE_RANGE))
    return continuous, mimics


def _read_mimic(joint: str, mimic: ElementTree.Element) -> Mimic:
    """Read how a joint follows another; where nothing else is said, they move alike."""
    found = {
        key: _read_number(joint, mimic, key, default)
        for key, default in (("multiplier", "1"), ("offset", "0"))
    }
    return Mimic(mimic.get("joint", ""), **found)


def _read_number(
    joint: str, element: ElementTree.Element, key: str, default: str = "", least: float = -math.inf
) -> float:
    """A finite number; one that is none is refused by name, which the format's reader does not."""
    text, value = element.get(key, default), math.nan
    with contextlib.suppress(ValueError):
        value = float(text)
    if not (math.isfinite(value) and value >= least):
        raise RobotError(
            f"joint {joint!r}",
            f"has {key}={text!r} in its {element.tag} element",
            expected="a finite number" + (f", at least {least:g}" if least == 0.0 else ""),
            remedy="correct the URDF",
        )
    return value


def _check_collisions(
    path: Path, root: ElementTree.Element, model: Any, collision_model: Any
) -> None:
    """Refuse a model that has fewer collision geometries than its file."""
    found = [str(model.frames[one.parentFrame].name) for one in collision_model.geometryObjects]
    for link in root.findall("link"):
        name, expected = link.get("name", ""), len(link.findall("collision"))
        if found.count(name) != expected:
            raise RobotError(
                f"{path}: link {name!r}",
                f"only {found.count(name)} of its {expected} collision elements could be read",
                remedy="check their numbers and shapes",
            )


def _prepare_meshes(
    root: ElementTree.Element, directory: Path, package_dirs: Sequence[str | Path]
) -> None:
    """Give every mesh a path of its own, whatever the present folder and its package are."""
    for link in root.iterfind("link"):
        for mesh in link.iterfind("collision/geometry/mesh"):
            name = mesh.get("filename", "")
            if name.startswith(PACKAGES):
                found = _find_packaged(name, link.get("name", ""), package_dirs)
                mesh.set("filename", str(found))
            elif "://" not in name and not Path(name).is_absolute():
                mesh.set("filename", str(directory / name))


def _find_packaged(name: str, link: str, package_dirs: Sequence[str | Path]) -> Path:
    """The file of a mesh that is named by its package.

    A package lies in a folder of its name, or in one whose package.xml says so. After
    `package_dirs` the folders of the environment variable `ROS_PACKAGE_PATH` are searched.

    Raises:
        RobotError: No package of this name, or no such file in it, is in any of the folders.
    """
    package, _, rest = name.partition("://")[2].partition("/")
    listed_by_ros = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    searched = [Path(directory) for directory in (*package_dirs, *filter(None, listed_by_ros))]
    homes = []
    for directory in searched:
        manifests = [directory / "package.xml", *sorted(directory.glob("*/package.xml"))]
        homes.append(directory / package)
        homes += [one.parent for one in manifests if _read_package_name(one) == package]
    for home in homes:
        if (home / rest).is_file():
            return home / rest
    is_there = any(home.is_dir() for home in homes)
    listed = ", ".join(map(str, searched)) or "no folder"
    raise RobotError(
        f"link {link!r}",
        f"its mesh {name} was not found: searched {listed}",
        expected=f"{rest} in package {package!r}" if is_there else f"a package {package!r} there",
        remedy="name the folder that holds the package: --package-dirs on the command line, "
        "package_dirs in Robot.from_urdf and in the cell file",
    )


def _read_package_name(manifest: Path) -> str:
    """What a package.xml says that its package is called; empty where it does not."""
    try:
        return (ElementTree.parse(manifest).getroot().findtext("name") or "").strip()
    except (OSError, ElementTree.ParseError, ValueError):
        return ""


def describe_error(error: Exception) -> str:
    """What an error of Pinocchio says, in one line.

    Coal's errors have their message in a later line of three.
    """
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    for i, line in enumerate(lines):
        if line.startswith("message:"):
            return " ".join([line.removeprefix("message:").strip(), *lines[i + 1 : i + 2]])
    return lines[0] if lines else type(error).__name__
