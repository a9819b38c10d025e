"""`Robot`: the watched arm, with Pinocchio's model, limits with sources, links and cover.

Pink and mink use the model as it was loaded. Here it is reduced to the watched joints with one
number each, so that nq = nv and public arrays have one value per joint. All other joints are locked
by name; fingers that can be anywhere in their travel count as everything that they can reach. A
robot without a limit, a mesh or a link's geometry is refused: nothing vanishes quietly.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from armguard.cover.cover import Cover
from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.jit.progress import following
from armguard.robot.brakes import Brakes
from armguard.robot.description import (
    COVER,
    DESCRIPTION,
    LIMITS,
    OperatingDescription,
    RobotDescription,
    find_robot,
    locate_urdf,
    read_description,
)
from armguard.robot.joints import check_bare_links, check_joints, reduce_model
from armguard.robot.links import collect_fixed_points, collect_surfaces
from armguard.robot.model_file import read_model
from armguard.robot.urdf import UrdfModel

if TYPE_CHECKING:
    from armguard.robot.attachments import PreparedBody

SPHERES = 12
"""Greatest number of spheres of an attached body; few, so that fitting is quick."""


# Of all robots, since a lock of its own would keep a robot from being copied and pickled.
_CHANGE = threading.Lock()


class PublishedLimits(NamedTuple):
    """Published operating limits of a robot's controller.

    They hold only for controllers that are configured as the source says. No bound uses them unless
    the user states that the controller enforces them.
    """

    velocity: FloatArray
    """Operating velocities, at most the robot's limits, in [rad]/[s] or [m]/[s]. Shape (nv,)."""
    acceleration: FloatArray
    """Operating accelerations, at most the robot's limits, in [rad]/[s²] or [m]/[s²]. Shape
    (nv,)."""
    source: str
    """Sources of both; "CHOSEN" marks a figure that is not published."""


@dataclass(frozen=True, eq=False)
class _Link:
    joint: int
    """Index of the joint that moves it."""
    triangles: FloatArray
    """In the frame of that joint, in [m]. Shape (n, 3, 3)."""
    pieces: FloatArray
    """Of its surface, as `patches` has them."""
    is_attached: bool

    @functools.cached_property
    def hull(self) -> FloatArray:
        """Vertices of its triangles, each once; read-only, as every monitor shares them."""
        vertices = np.unique(self.triangles.reshape(-1, 3), axis=0)
        vertices.flags.writeable = False
        return vertices


class _Bodies(NamedTuple):
    """All links at one time; replaced as a whole, never changed, so that no half is ever seen."""

    links: dict[str, _Link]
    revision: int


class Robot:
    """An arm with its joints, limits, brakes, links and cover.

    Made by `Robot.load`, `Robot.from_urdf` or `Robot.from_mjcf`.

    All limits are read-only arrays of shape (nv,), in the order of `joints`.

    Attributes:
        name: Its name in `robots/`, or the name of its file.
        model: `pinocchio.Model` reduced to the watched joints: nq = nv.
        collision_model: `pinocchio.GeometryModel` of it, geometry as read.
        joints: Names of the watched joints, in model order.
        cover: A tree of spheres for each link, proved to contain it.
        velocity_limit: Velocity limits in [rad]/[s] or [m]/[s].
        acceleration_limit: Acceleration limits that hold in every mode, including emergency brakes,
            in [rad]/[s²] or [m]/[s²].
        brakes: Its brakes, by load and speed.
        lower_position_limit: Lower position limits in [rad] or [m]; -inf for a continuous joint.
        upper_position_limit: Upper position limits in [rad] or [m]; inf for a continuous joint.
        position_error: Greatest errors of measured positions, in [rad] or [m].
        velocity_error: Greatest errors of measured velocities, in [rad]/[s] or [m]/[s].
        rest_velocity_error: The same of joints at rest, for which it does not matter when they were
            measured: an error of the clock adds to `velocity_error` alone.
        published_operating_limits: Published operating limits of its controller; None if its
            robot.toml has none.
        drawn_links: Names of the links with visual but without collision geometry: they are not
            watched, and are not an obstacle for another arm.
    """

    cover: Cover
    drawn_links: tuple[str, ...] = ()
    _fixed_points: Mapping[str, FloatArray] = {}

    def __init__(
        self, name: str, urdf: UrdfModel, description: RobotDescription, joints: Sequence[str]
    ) -> None:
        self.name = name
        locked = check_joints(urdf, description, joints)
        check_bare_links(urdf, description, joints)
        self.drawn_links = urdf.bare
        self.model, self.collision_model = reduce_model(urdf, description, locked)
        self.joints = tuple(str(joint) for joint in self.model.names)[1:]
        entries = [description.joints[joint] for joint in self.joints]
        positions = [entry.position or (-np.inf, np.inf) for entry in entries]
        self.lower_position_limit = _read_only(lower for lower, _ in positions)
        self.upper_position_limit = _read_only(upper for _, upper in positions)
        self.velocity_limit = _read_only(entry.velocity for entry in entries)
        self.acceleration_limit = _read_only(entry.acceleration for entry in entries)
        self.brakes = Brakes(self.joints, description.brake_entries())
        self.position_error = _read_only(entry.position_error for entry in entries)
        self.velocity_error = _read_only(entry.velocity_error for entry in entries)
        self.rest_velocity_error = self.velocity_error
        self.published_operating_limits = _read_published(
            description.operating.published, self.joints
        )
        self.model.lowerPositionLimit = self.lower_position_limit
        self.model.upperPositionLimit = self.upper_position_limit
        self.model.velocityLimit = self.velocity_limit
        self._sources = {
            joint: {limit: description.source(joint, limit) for limit in LIMITS}
            | {"braking": self.brakes.sources(joint)}
            for joint in self.joints
        }
        surfaces = collect_surfaces(urdf, self.joints, description)
        if not surfaces:
            raise RobotError(name, "no watched joint moves a link with collision geometry")
        links = {
            link: _Link(self.model.getJointId(joint), triangles, pieces, is_attached=False)
            for link, (joint, triangles, pieces) in surfaces.items()
        }
        self._bodies = _Bodies(dict(sorted(links.items(), key=lambda item: item[1].joint)), 0)
        self._fixed_points = collect_fixed_points(urdf, self.joints, description)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}: {len(self.joints)} joints, {len(self.links)} links)"

    @classmethod
    def load(
        cls,
        name: str | Path,
        *,
        joints: Sequence[str] | None = None,
        cover: str | Path | None = None,
        level: int | None = None,
    ) -> Robot:
        """Load a known robot, or one of your own, with its proved cover.

        Args:
            name: A name that `armguard robots` lists, or a folder that `armguard robot new` wrote.
                Write "./name" for a folder with the name of a known robot.
            joints: Joints to watch, by name or by pattern as in `fnmatch`, such as `["left_*"]` for
                one arm of a robot with two arms. None: all.
            cover: A file that `Cover.save` or `armguard cover` wrote, which replaces the robot's
                own cover; it is proved again.
            level: Finest level of the cover's tree to use, from 0, one ball per link. Fewer spheres
                need less time, and give more cautious verdicts. None: all levels.

        Raises:
            RobotError: There is no such robot, its files are unusable, or it has no such joint.
            CoverError: Its cover is damaged, was made for other geometry, does not cover it, or has
                no such level.
        """
        directory = find_robot(name)
        description = read_description(directory / DESCRIPTION)
        path, packages = locate_urdf(directory, description)
        urdf = read_described(path, packages, description)
        watched = _choose_joints(description, joints)
        robot = cls(directory.resolve().name, urdf, description, watched)
        if cover is None:
            own = Cover.load(directory / COVER)
            if joints is not None:
                own = _restrict(own, [link for link in own.links if link in robot.links])
            own.verify(robot)
        else:
            own = Cover.load(cover)
            own.prove(robot, str(cover))
        robot.cover = own if level is None else own.cut(level)
        return robot

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        *,
        limits: str | Path | Mapping[str, Any],
        joints: Sequence[str] | None = None,
        package_dirs: Sequence[str | Path] = (),
        cover: str | Path | None = None,
        level: int | None = None,
    ) -> Robot:
        """Load a robot from its own files.

        Args:
            path: Its URDF, or an MJCF as for `from_mjcf`.
            limits: A robot.toml, or a mapping of the same form.
            joints: The joints to watch; None: all that `limits` names.
            package_dirs: Folders in which `package://` mesh names are looked up.
            cover: A file that `Cover.save` wrote, which is proved again. None: a cover is fitted,
                which takes seconds per link; a terminal shows the progress.
            level: Finest level of the cover's tree, as for `load`.

        Raises:
            RobotError: A joint, a limit or a mesh is missing or unusable; the message names it.
            CoverError: The cover is for other geometry, does not cover it, or has no such level.
        """
        description = read_description(limits)
        urdf = read_described(path, package_dirs, description)
        watched = list(description.joints) if joints is None else list(joints)
        robot = cls(Path(path).stem, urdf, description, watched)
        if cover is None:
            with following("fitting spheres to link", len(robot.links)) as begin:
                whole = Cover.fit(robot, on_link=begin)
        else:
            whole = Cover.load(cover)
            whole.prove(robot, str(cover))
        robot.cover = whole if level is None else whole.cut(level)
        return robot

    @classmethod
    def from_mjcf(
        cls,
        path: str | Path,
        *,
        limits: str | Path | Mapping[str, Any],
        joints: Sequence[str] | None = None,
        cover: str | Path | None = None,
        level: int | None = None,
    ) -> Robot:
        """Load a robot from an MJCF file, MuJoCo's format.

        Its links are the bodies of the file. Names of included files and meshes are relative to it.

        Args:
            path: The file; it must contain the arm alone, without moving base and floor.
            limits: A robot.toml, or a mapping of the same form. It must state velocity and position
                limits, since the format has no velocity limits.
            joints: As for `from_urdf`; the further arguments too.
            cover: A file that `Cover.save` wrote.
            level: Finest level of the cover's tree.

        Raises:
            RobotError: As for `from_urdf`; or something in the file is not supported.
            CoverError: As for `from_urdf`.
        """
        return cls.from_urdf(path, limits=limits, joints=joints, cover=cover, level=level)

    @property
    def braking_deceleration(self) -> FloatArray:
        """Deceleration guaranteed at each instant, by the heaviest load and the lowest speed.

        In [rad]/[s²] or [m]/[s²]; 0 for a joint whose brakes are stated by times and distances
        only. `brakes` has the dependence on speed and load. An assigned value holds for all loads
        and speeds. Shape (nv,).
        """
        return _read_only(self.brakes.make_curves().deceleration[:, 0])

    @braking_deceleration.setter
    def braking_deceleration(self, deceleration: ArrayLike) -> None:
        self.brakes = Brakes.constant(self.joints, np.asarray(deceleration, dtype=np.float64))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links with geometry that a watched joint moves; attached ones last."""
        return tuple(self._bodies.links)

    @property
    def revision(self) -> int:
        """Number of times that bodies were attached or detached so far."""
        return self._bodies.revision

    def attach(
        self,
        name: str,
        link: str,
        geometry: Any,
        placement: pinocchio.SE3 | ArrayLike | None = None,
    ) -> None:
        """Attach a tool or a held part as a new link with a proved cover.

        A running monitor includes it from its next step on, which evaluates all its pairs. This
        call fits the cover, which takes about 0.5 s for a sphere or a box and several seconds for a
        capsule or a fine mesh. The next step takes some 100 ms more. If steps must not wait, call
        `prepare` for the cover and `Monitor.prepare` for the step in advance.

        Args:
            name: Name of the new link.
            link: Link to which it is fixed, whose joint moves it from now on.
            geometry: A Coal shape (sphere, box, capsule, cylinder, convex) or mesh, or triangles
                in [m] of shape (n, 3, 3).
            placement: Placement of the geometry in the frame of that joint: `pinocchio.SE3` or a
                homogeneous matrix of shape (4, 4); None: they coincide.

        Raises:
            RobotError: The name is in use, there is no such link, or the geometry or its placement
                is unusable.
            CoverError: No cover of it could be proved.
        """
        self.attach_prepared(self.prepare(name, link, geometry, placement))

    def prepare(
        self,
        name: str,
        link: str,
        geometry: Any,
        placement: pinocchio.SE3 | ArrayLike | None = None,
    ) -> PreparedBody:
        """Fit and prove the cover of a body, to be attached later by `attach_prepared`.

        The result can be pickled, so this can run in another process. Another thread would delay
        the monitor's steps.

        Args:
            name: As for `attach`, and so are the others.
            link: Link to which it will be fixed.
            geometry: Its shape.
            placement: Placement of the geometry in the frame of the link's joint.

        Raises:
            RobotError: As for `attach`.
            CoverError: As for `attach`.
        """
        # Few arms are given a tool or a part.
        from armguard.robot.attachments import AttachedBody, PreparedBody

        self._find_link(link)
        body = AttachedBody(name, geometry, placement)
        self._check_new(name)
        return PreparedBody(link, body, Cover.fit(body, spheres=SPHERES))

    def attach_prepared(self, prepared: PreparedBody) -> None:
        """Attach a body whose cover is already fitted, in less than 1 ms.

        Args:
            prepared: Result of `prepare`, of this robot or of another one with such a link.

        Raises:
            RobotError: The name is in use, or there is no such link.
        """
        link, name, body = prepared.link, prepared.name, prepared.body
        with _CHANGE:  # two threads may attach at once, and neither body must be lost
            joint, bodies = self._find_link(link).joint, self._bodies
            self._check_new(name)
            new = _Link(joint, body.triangles(name), body.surface(name), is_attached=True)
            # Another thread that reads meanwhile finds a cover for every link that there is.
            self.cover = _extend(self.cover, prepared.cover)
            self._bodies = _Bodies({**bodies.links, name: new}, bodies.revision + 1)

    def detach(self, name: str) -> None:
        """Detach an attached body; a running monitor removes it at its next step.

        Raises:
            RobotError: No body of that name is attached.
        """
        with _CHANGE:
            bodies = self._bodies
            attached = [link for link, entry in bodies.links.items() if entry.is_attached]
            if name not in attached:
                raise RobotError(
                    f"body {name!r}",
                    "is not attached",
                    expected=f"one of {', '.join(attached)}" if attached else "",
                )
            left = {link: entry for link, entry in bodies.links.items() if link != name}
            self._bodies = _Bodies(left, bodies.revision + 1)
            self.cover = _restrict(self.cover, left)

    def source(self, joint: str, limit: str) -> str:
        """Source of a limit: `position`, `velocity`, `acceleration` or `braking`."""
        return self._sources[joint][limit]

    def triangles(self, link: str) -> FloatArray:
        """The surface of a link, or of a polyhedron that contains it.

        Args:
            link: One of `links`.

        Returns:
            Triangles in the frame of the link's parent joint, in [m]. Shape (n, 3, 3).

        Raises:
            RobotError: No watched joint moves such a link, or it has no collision geometry.
        """
        return self._find_link(link).triangles

    def surface(self, link: str) -> FloatArray:
        """The surface of a link, in the pieces from which its cover is proved.

        Args:
            link: One of `links`.

        Returns:
            Triangles, or patches where it is round, as `armguard.cover.patches` has them, in the
            frame of the link's parent joint, in [m]. Shape (n, 3, 3) or (n, 3, 6).

        Raises:
            RobotError: As `triangles` does.
        """
        return self._find_link(link).pieces

    def joint_index(self, link: str) -> int:
        """Index in `model.joints` of the joint that moves a link."""
        return self._find_link(link).joint

    def hull(self, link: str) -> FloatArray:
        """Points whose convex hull contains a link.

        Returns:
            Vertices of its surface in the frame of its parent joint, in [m]; read-only, computed
            once. Shape (n, 3).

        Raises:
            RobotError: As `triangles` does.
        """
        return self._find_link(link).hull

    def fixed_points(self) -> Mapping[str, FloatArray]:
        """Points of each link that no watched joint moves; their convex hull contains the link.

        A link behind a joint that is locked with a travel counts as everything that it can reach.
        Two kinds of links are not included: links of joints that are neither watched nor locked by
        name, which can move, and links without collision geometry, whose shape is unknown.

        Returns:
            By link: points in the frame of the robot's base, in [m]. Shape (n, 3).
        """
        return self._fixed_points

    def _check_new(self, name: str) -> None:
        if name in self.links or any(frame.name == name for frame in self.model.frames):
            raise RobotError(
                f"attached body {name!r}", "has the name of another body", expected="a new name"
            )

    def _find_link(self, link: str) -> _Link:
        if isinstance(link, str) and link in self._bodies.links:
            return self._bodies.links[link]
        if any(frame.name == link for frame in self.model.frames):
            problem = "has no collision geometry that a watched joint moves"
        else:
            problem = f"is not a link of {self.name}"
        raise RobotError(f"link {link!r}", problem, expected=f"one of {', '.join(self.links)}")


def read_described(
    path: str | Path, package_dirs: Sequence[str | Path], description: RobotDescription
) -> UrdfModel:
    """Read a URDF or an MJCF as the description of its robot has it.

    Args:
        path: The file.
        package_dirs: Folders in which `package://` names are looked up.
        description: Says which fixed joints turn, and which links are collided with as drawn.

    Raises:
        RobotError: As `read_model` does.
    """
    return read_model(path, package_dirs, description.travelling, description.collision_from_visual)


def _choose_joints(description: RobotDescription, patterns: Sequence[str] | None) -> list[str]:
    """The joints of a description that names or patterns fit, in its order; None: all."""
    known = list(description.joints)
    if patterns is None:
        return known
    if isinstance(patterns, str) or not patterns:
        raise RobotError(
            "joints", f"is {patterns!r}", expected='a list of names or patterns: ["left_*"]'
        )
    for pattern in patterns:
        if not any(fnmatchcase(joint, pattern) for joint in known):
            raise RobotError(
                f"joint {pattern!r}", "fits none", expected=f"one of {', '.join(known)}"
            )
    return [one for one in known if any(fnmatchcase(one, pattern) for pattern in patterns)]


def _extend(cover: Cover, other: Cover) -> Cover:
    links = {**dict.fromkeys(cover.links, cover), **dict.fromkeys(other.links, other)}
    return Cover(
        {link: source.tree(link) for link, source in links.items()},
        {link: source.digest(link) for link, source in links.items()},
    )


def _restrict(cover: Cover, links: Iterable[str]) -> Cover:
    kept = list(links)
    return Cover(
        {link: cover.tree(link) for link in kept}, {link: cover.digest(link) for link in kept}
    )


def _read_published(
    published: OperatingDescription | None, joints: Sequence[str]
) -> PublishedLimits | None:
    if published is None:
        return None
    sources = published.sources
    return PublishedLimits(
        _read_only(published.velocity[joint] for joint in joints),
        _read_only(published.acceleration[joint] for joint in joints),
        f"velocity: {sources.velocity}; acceleration: {sources.acceleration}",
    )


def _read_only(values: Iterable[float]) -> FloatArray:
    array = np.array(list(values), dtype=np.float64)
    array.flags.writeable = False
    return array
