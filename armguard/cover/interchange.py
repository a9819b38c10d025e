"""Spheres of other tools: reads and writes their files.

cuRobo keeps its spheres in YAML (`collision_spheres`), VAMP and foam in a URDF whose collision
geometry is spheres. Both place them in the frames of links; a cover has them in the frame of the
joint that moves the link. None of the published sets covers its robot, so what is read here is no
cover before `armguard.cover.inflation` has made and proved one of it.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np
import pinocchio

from armguard.cover.cover import FARTHEST, Cover, Surfaces
from armguard.exceptions import CoverError
from armguard.jit.arrays import FloatArray

Spheres = Mapping[str, FloatArray]
"""Centre and radius in [m], by link, each of shape (n, 4)."""

YAML_ENDINGS = (".yml", ".yaml")


class Links(Surfaces, Protocol):
    """What has links with surfaces and places: a `Robot`, or `UrdfLinks`."""

    @property
    def model(self) -> Any:
        """`pinocchio.Model` with a frame for each link."""


def read_spheres(path: str | Path) -> dict[str, FloatArray]:
    """Read cuRobo's YAML (.yml, .yaml) or a spherized URDF.

    Args:
        path: The file. Of cuRobo, a list of spheres or a robot's configuration, which may name
            such a list; its `collision_sphere_buffer` is added to the radii.

    Returns:
        By link, in the frame of the link. Each of shape (n, 4).

    Raises:
        CoverError: The file is unreadable, malformed or without spheres.
    """
    path = Path(path)
    if path.suffix in YAML_ENDINGS:
        spheres = _read_curobo(path)
    elif path.suffix == ".urdf":
        spheres = _read_urdf(path)
    else:
        raise CoverError(str(path), "is of no known kind", expected=".yml, .yaml or .urdf")
    spheres = {link: rows for link, rows in spheres.items() if len(rows)}
    for link, rows in spheres.items():
        if not (np.abs(rows) <= FARTHEST).all():
            raise CoverError(
                f"{path}: link {link!r}",
                f"has a sphere that is not finite, or beyond {FARTHEST:g} m",
                expected="metres",
            )
    if not spheres:
        raise CoverError(str(path), "has no spheres")
    return spheres


def place_spheres(robot: Links, spheres: Spheres) -> dict[str, FloatArray]:
    """Move spheres from the frames of links to those of the joints that move them.

    Args:
        robot: Whose links they are on.
        spheres: As `read_spheres` gives them; links that the robot does not watch are left out.

    Returns:
        For each link of the robot that has any. Each of shape (n, 4).
    """
    placed = {}
    for link in robot.links:
        if link in spheres:
            placement = _find_placement(robot, link)
            rows = spheres[link]
            centers = rows[:, :3] @ placement.rotation.T + placement.translation
            placed[link] = np.column_stack([centers, rows[:, 3]])
    return placed


def write_curobo(path: str | Path, robot: Links, cover: Cover) -> None:
    """Write the leaves of a cover as cuRobo's `collision_spheres`, in the frames of links."""
    links = {
        link: [
            _CuroboSphere(center=(x, y, z), radius=radius)
            for x, y, z, radius in _express_in_link(robot, link, cover).tolist()
        ]
        for link in cover.links
    }
    _write(path, msgspec.yaml.encode(_CuroboFile(collision_spheres=links)))


def write_spherized_urdf(path: str | Path, robot: Links, cover: Cover, urdf: str | Path) -> None:
    """Write a URDF whose collision geometry is the leaves of a cover, as VAMP and foam read it.

    Args:
        path: What to write.
        robot: Whose cover it is.
        cover: Its links lose the collision geometry that they have; other links keep theirs.
        urdf: The robot's own URDF.
    """
    root = _read_xml(urdf)
    elements = {element.get("name", ""): element for element in root.findall("link")}
    for link in cover.links:
        if link not in elements:
            raise CoverError(f"link {link!r}", f"is not in {urdf}")
        for collision in elements[link].findall("collision"):
            elements[link].remove(collision)
        for x, y, z, radius in _express_in_link(robot, link, cover).tolist():
            collision = ElementTree.SubElement(elements[link], "collision")
            ElementTree.SubElement(collision, "origin", xyz=f"{x!r} {y!r} {z!r}", rpy="0 0 0")
            geometry = ElementTree.SubElement(collision, "geometry")
            ElementTree.SubElement(geometry, "sphere", radius=repr(radius))
    ElementTree.indent(root)
    _write(path, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")


class _CuroboSphere(msgspec.Struct):
    center: tuple[float, float, float]
    radius: float


class _CuroboKinematics(msgspec.Struct):
    collision_spheres: dict[str, list[_CuroboSphere]] | str
    collision_sphere_buffer: float | dict[str, float] = 0.0


class _CuroboRobot(msgspec.Struct):
    kinematics: _CuroboKinematics


class _CuroboFile(msgspec.Struct, omit_defaults=True):
    collision_spheres: dict[str, list[_CuroboSphere]] | None = None
    robot_cfg: _CuroboRobot | None = None


def _read_curobo(path: Path) -> dict[str, FloatArray]:
    file = _decode(path)
    links: dict[str, list[_CuroboSphere]] | str | None = file.collision_spheres
    buffer: float | dict[str, float] = 0.0
    if file.robot_cfg is not None:
        links = file.robot_cfg.kinematics.collision_spheres
        buffer = file.robot_cfg.kinematics.collision_sphere_buffer
    if isinstance(links, str):  # a file beside the configuration
        links = _decode(path.parent / links).collision_spheres or {}
    if links is None:
        raise CoverError(str(path), "has neither collision_spheres nor robot_cfg")
    bare = {link: _as_rows(rows) for link, rows in links.items()}
    for link, rows in bare.items():
        rows[:, 3] += buffer.get(link, 0.0) if isinstance(buffer, dict) else buffer
    return {link: rows[~(rows[:, 3] <= 0.0)] for link, rows in bare.items()}


def _decode(path: Path) -> _CuroboFile:
    try:
        # Not strict: YAML takes 1e-3, without a point, for text.
        return msgspec.yaml.decode(path.read_bytes(), type=_CuroboFile, strict=False)
    except OSError as error:
        raise CoverError(str(path), f"cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        place = str(path).replace("\0", "\\0")
        raise CoverError(place, " ".join(str(error).split())) from error


def _as_rows(spheres: list[_CuroboSphere]) -> FloatArray:
    """Spheres with a radius; cuRobo keeps places for held parts as spheres without."""
    rows = [(*sphere.center, sphere.radius) for sphere in spheres if not sphere.radius <= 0.0]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _read_xml(path: str | Path) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(Path(path).read_bytes())
    except (OSError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise CoverError(str(path), f"cannot be read: {error}") from error


def _read_urdf(path: Path) -> dict[str, FloatArray]:
    """Spheres among the collision geometry; links without are measured as uncovered later."""
    links: dict[str, FloatArray] = {}
    for element in _read_xml(path).findall("link"):
        link, rows = element.get("name", ""), []
        for collision in element.findall("collision"):
            sphere, origin = collision.find("geometry/sphere"), collision.find("origin")
            if sphere is None:
                continue
            xyz = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
            try:
                x, y, z = map(float, xyz.split())
                radius = float(sphere.get("radius", ""))
            except ValueError:
                x = y = z = radius = math.nan
            if not (radius > 0.0 and math.isfinite(x + y + z)):
                raise CoverError(
                    f"{path}: link {link!r}",
                    f"has a sphere of radius {sphere.get('radius')!r} at {xyz!r}",
                    expected="numbers, and a radius above 0",
                )
            rows.append((x, y, z, radius))
        links[link] = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return links


def _write(path: str | Path, content: bytes) -> None:
    try:
        Path(path).write_bytes(content)
    except OSError as error:
        raise CoverError(str(path), f"cannot be written: {error.strerror}") from error


def _find_placement(robot: Links, link: str) -> Any:
    """Where the frame of a link stands in that of the joint that moves it."""
    number = robot.model.getFrameId(link, pinocchio.FrameType.BODY)
    return robot.model.frames[number].placement


def _express_in_link(robot: Links, link: str, cover: Cover) -> FloatArray:
    placement, rows = _find_placement(robot, link), cover.spheres(link)
    centers = (rows[:, :3] - placement.translation) @ placement.rotation
    return np.column_stack([np.round(centers, 9), rows[:, 3]])
