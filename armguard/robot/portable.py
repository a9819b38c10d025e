"""Converts a robot to plain data and back, so that a recording needs no other file.

Everything that a monitor counts with is there to the bit: joints and their placements, limits and
errors as they were when the data were taken, brakes, links and covers. Surfaces are not, except for
the corners of each link's hull, which exact distances are measured to; so no cover can be proved
anew from the data. Numbers that JSON has no word for stand as "Infinity", "-Infinity" and "NaN".
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from armguard.cover.cover import Cover, CoverTree
from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.robot.brakes import BrakeEntry, Brakes
from armguard.robot.joints import find_axis
from armguard.robot.robot import PublishedLimits, Robot, _Bodies, _Link

LIMITS = (
    "lower_position_limit",
    "upper_position_limit",
    "velocity_limit",
    "acceleration_limit",
    "position_error",
    "velocity_error",
)
"""Attributes of a robot that are one number a joint."""

_NO_SURFACE: FloatArray = np.zeros((0, 3, 3))


def describe_robot(robot: Robot) -> dict[str, Any]:
    """A robot as plain data, for `RestoredRobot`."""
    model, published = robot.model, robot.published_operating_limits
    return {
        "name": robot.name,
        "joints": [_describe_joint(model, joint) for joint in range(1, model.njoints)],
        **{name: write_numbers(getattr(robot, name)) for name in LIMITS},
        "brakes": {
            joint: [[*write_numbers(entry[:5]), entry.source] for entry in entries]
            for joint, entries in robot.brakes.entries.items()
        },
        "published_operating_limits": published
        and {
            "velocity": write_numbers(published.velocity),
            "acceleration": write_numbers(published.acceleration),
            "source": published.source,
        },
        **describe_bodies(robot),
    }


def describe_contents(robot: Robot) -> dict[str, Any]:
    """A robot as plain data, without the name of its folder and the count of its changes."""
    described = describe_robot(robot)
    return {name: one for name, one in described.items() if name not in ("name", "revision")}


def describe_bodies(robot: Robot, known: Iterable[str] = ()) -> dict[str, Any]:
    """The links of a robot as plain data, for `RestoredRobot.replace_bodies`.

    Args:
        robot: Whose links.
        known: Links of which the name alone is enough.
    """
    bodies, names = robot._bodies, set(known)
    return {
        "revision": bodies.revision,
        "links": [
            {"name": name} if name in names else _describe_link(robot, name, body)
            for name, body in bodies.links.items()
        ],
    }


class RestoredRobot(Robot):
    """A robot made from the data of `describe_robot`.

    Its links have covers and hulls and no surfaces. Bodies can be attached to it and taken off.

    Args:
        data: Such data.

    Raises:
        RobotError: Something of them is missing or malformed.
    """

    def __init__(self, data: Mapping[str, Any]) -> None:
        with _refusing("cannot be made from its data"):
            self._restore(data)

    def _restore(self, data: Mapping[str, Any]) -> None:
        self.name = str(data["name"])
        self.model = _make_model(self.name, data["joints"])
        self.collision_model = pinocchio.GeometryModel()
        self.joints = tuple(str(joint) for joint in self.model.names)[1:]
        count = len(self.joints)
        for name in LIMITS:
            setattr(self, name, _read(data[name], (count,)))
        self.rest_velocity_error = self.velocity_error
        self.model.lowerPositionLimit = self.lower_position_limit
        self.model.upperPositionLimit = self.upper_position_limit
        self.model.velocityLimit = self.velocity_limit
        self.brakes = Brakes(
            self.joints,
            {
                joint: [BrakeEntry._make([*map(float, row[:5]), str(row[5])]) for row in rows]
                for joint, rows in data["brakes"].items()
            },
        )
        published = data["published_operating_limits"]
        self.published_operating_limits = published and PublishedLimits(
            _read(published["velocity"], (count,)),
            _read(published["acceleration"], (count,)),
            str(published["source"]),
        )
        self._sources = {joint: {} for joint in self.joints}
        self._hulls: dict[str, FloatArray] = {}
        self._bodies = _Bodies({}, 0)
        self.cover = Cover({}, {})
        self.replace_bodies(data)

    def replace_bodies(self, data: Mapping[str, Any]) -> None:
        """Take the links that `describe_bodies` told.

        Raises:
            RobotError: Something of them is missing or malformed, or a link is not known.
        """
        links: dict[str, _Link] = {}
        trees: dict[str, CoverTree] = {}
        digests: dict[str, str] = {}
        hulls = dict(self._hulls)
        with _refusing("its links cannot be made from their data"):
            for entry in data["links"]:
                name = str(entry["name"])
                if "joint" not in entry:
                    links[name] = self._bodies.links[name]
                    trees[name], digests[name] = self.cover.tree(name), self.cover.digest(name)
                    continue
                joint = int(self.model.getJointId(entry["joint"]))
                if not 0 < joint < self.model.njoints:
                    raise ValueError(f"no joint {entry['joint']!r}")
                links[name] = _Link(joint, _NO_SURFACE, _NO_SURFACE, bool(entry["is_attached"]))
                hulls[name] = _read(entry["hull"], (-1, 3))
                tree = entry["cover"]
                trees[name] = CoverTree(
                    _read(tree["spheres"], (-1, 4)),
                    np.array(tree["first_child"], dtype=np.int64),
                    np.array(tree["child_count"], dtype=np.int64),
                )
                digests[name] = str(tree["geometry"])
            revision = int(data["revision"])
        self._hulls = {name: hulls[name] for name in links if name in hulls}
        self.cover = Cover(trees, digests)
        self._bodies = _Bodies(links, revision)

    def hull(self, link: str) -> FloatArray:
        """As `Robot.hull`: points whose convex hull contains a link. Shape (n, 3)."""
        self._find_link(link)
        # A body that was attached since has a surface of its own.
        return self._hulls[link] if link in self._hulls else super().hull(link)


@contextlib.contextmanager
def _refusing(problem: str) -> Iterator[None]:
    """Make an error of data that are malformed."""
    try:
        yield
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise RobotError("robot", f"{problem} ({type(error).__name__}: {error})") from None


def write_number(value: float) -> float | str:
    """A number as JSON can hold it."""
    if math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else ("Infinity" if value > 0.0 else "-Infinity")


def write_numbers(values: ArrayLike) -> Any:
    """Numbers as nested lists that JSON can hold."""
    array = np.asarray(values, dtype=np.float64)
    listed = array.tolist()
    return listed if np.isfinite(array).all() else _spell(listed)


def read_numbers(values: Any) -> NDArray[np.float64]:
    """Numbers from what `write_numbers` made.

    Raises:
        ValueError: It is something else.
    """
    return np.array(values, dtype=np.float64)


def _spell(values: Any) -> Any:
    if isinstance(values, list):
        return [_spell(value) for value in values]
    return write_number(values)


def _read(values: Any, shape: tuple[int, ...]) -> FloatArray:
    """A read-only array of numbers of this shape, -1 being any length."""
    array = read_numbers(values)
    if array.size == 0 and shape[0] == -1:
        array = array.reshape(0, *shape[1:])
    first = 1 if shape[0] == -1 else 0
    if len(shape) != array.ndim or shape[first:] != array.shape[first:]:
        raise ValueError(f"numbers of shape {array.shape}, expected {shape}")
    array.flags.writeable = False
    return array


def _describe_joint(model: Any, joint: int) -> dict[str, Any]:
    kind, placement = model.joints[joint].shortname(), model.jointPlacements[joint]
    return {
        "name": str(model.names[joint]),
        "parent": str(model.names[model.parents[joint]]),
        "kind": str(kind),
        "axis": write_numbers(find_axis(model, joint)),
        "rotation": write_numbers(placement.rotation),
        "translation": write_numbers(placement.translation),
    }


def _make_model(name: str, joints: Iterable[Mapping[str, Any]]) -> Any:
    model = pinocchio.Model()
    model.name = name
    for entry in joints:
        kind = str(entry["kind"])
        turns, slides = kind.startswith("JointModelR"), kind.startswith("JointModelP")
        if not (turns or slides) or not hasattr(pinocchio, kind):
            raise ValueError(f"joint {entry['name']!r} is a {kind!r}")
        make = getattr(pinocchio, kind)
        joint = make(_read(entry["axis"], (3,))) if kind.endswith("Unaligned") else make()
        parent = int(model.getJointId(str(entry["parent"])))
        if not parent < model.njoints:
            raise ValueError(f"joint {entry['name']!r} has no parent {entry['parent']!r}")
        placement = pinocchio.SE3(
            _read(entry["rotation"], (3, 3)), _read(entry["translation"], (3,))
        )
        model.addJoint(parent, joint, placement, str(entry["name"]))
    return model


def _describe_link(robot: Robot, name: str, body: _Link) -> dict[str, Any]:
    tree = robot.cover.tree(name)
    return {
        "name": name,
        "joint": str(robot.model.names[body.joint]),
        "is_attached": body.is_attached,
        "hull": write_numbers(robot.hull(name)),
        "cover": {
            "geometry": robot.cover.digest(name),
            "spheres": write_numbers(tree.spheres),
            "first_child": tree.first_child.tolist(),
            "child_count": tree.child_count.tolist(),
        },
    }
