"""Bridge to MuJoCo: moving bodies as obstacles, joint states by name, and a simulated arm.

Positions and velocities are read at the present `qpos` and `qvel`. After `mj_step` what MuJoCo has
computed of bodies belongs to the step before, so reading brings kinematics and velocities up to
date first; the next step computes them anew, and so takes no notice.

Needs the package mujoco (the extra `mujoco`).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.joints import find_axis, is_prismatic
from armguard.robot.mjcf import find_solid, read_vertices
from armguard.robot.robot import Robot

try:
    import mujoco
except ModuleNotFoundError:
    raise ArmguardError(
        "armguard.bridges.mujoco",
        "needs the package mujoco, which is not installed",
        remedy="pip install 'armguard[mujoco]'",
    ) from None

Array = NDArray[np.float64]

SPARE = 1e-9
"""What radii grow by, in [m]. Points of bodies within a kilometre are off by less: MuJoCo turns and
moves them in float64, which is good to 1e-12 m there."""

AXIS_OFFSET = 1e-3
"""How far the axis of a simulated joint may be from where the robot has it, in [m]."""

AXIS_ANGLE = 1e-3
"""How far the axis of a simulated joint may be turned from that of the robot, in [rad]."""

_WIDEST = 3.0
"""Joints without limits are tried within this of 0, in [rad] or [m]."""

_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
_CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_ALONG = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])


class GeomShape(NamedTuple):
    """The hull of 1 to 8 points, rounded by a radius, that contains a geom."""

    points: Array
    """In the geom's frame, in [m]. Shape (k, 3)."""
    radius: float
    """[m]."""


class BodyStates(NamedTuple):
    """States of obstacles that have as many points each: what `Obstacles.update` takes."""

    ids: list[str]
    position: Array
    """In the world, in [m]. Shape (n, k, 3)."""
    velocity: Array | None
    """[m/s]. Shape (n, k, 3); None where MuJoCo does not know it."""
    radius: Array
    """[m]. Shape (n,)."""


def enclose_geom(model: Any, geom: int) -> GeomShape:
    """The hull of at most 8 points, rounded by a radius, that contains a geom.

    Why it does, in the frame of the geom:

    - *Sphere*, *capsule*: they are such hulls themselves, of 1 and 2 points.
    - *Box*: the hull of its 8 corners.
    - *Ellipsoid*: |x_i| <= s_i for each half-axis s_i, so it lies in the box of its half-axes.
    - *Cylinder* of radius r and half-length h: in the box (r, r, h), and in the capsule of radius r
      about its axis, since each of its points is within r of the point of the axis at its height.
      The one with less volume is taken: 8 r² h, or 2 π r² h + 4/3 π r³.
    - *Mesh*: MuJoCo collides its convex hull. That is the hull of its vertices: of up to 8 it is
      taken as it is; of more, a box along the axes and a ball about the same middle contain every
      vertex, and so, both being convex, the hull. The one with less volume is taken.

    Args:
        model: An `mjModel`.
        geom: Index of the geom.

    Raises:
        ArmguardError: It is a plane, a height field or another geom that no such hull contains.
    """
    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom], float)
    if kind == _SPHERE:
        return _grow(np.zeros((1, 3)), size[0])
    if kind == _CAPSULE:
        return _grow(size[1] * _ALONG, size[0])
    if kind in (_BOX, _ELLIPSOID):
        return _grow(size * _CORNERS, 0.0)
    if kind == _CYLINDER:
        radius, half = size[:2]
        if 8.0 * half < 2.0 * np.pi * half + 4.0 / 3.0 * np.pi * radius:
            return _grow(np.array([radius, radius, half]) * _CORNERS, 0.0)
        return _grow(half * _ALONG, radius)
    if kind == _MESH:
        return _enclose_points(read_vertices(model, model.geom_dataid[geom]))
    raise ArmguardError(
        f"geom {_name_geom(model, geom)!r}",
        f"is of type {mujoco.mjtGeom(kind).name}",
        expected="a sphere, capsule, ellipsoid, cylinder, box or mesh",
        remedy="leave its body out, and bound it by a static obstacle where the arm can get to it",
    )


class MujocoObstacles:
    """Bodies of a simulation as obstacles: each geom that can collide is one.

    Their ids are the geoms' names; a geom without one has its body's, and a number. What is fixed
    to the world is a static obstacle. The velocity of a body on a mocap body is unknown, since
    MuJoCo has no velocity of mocap bodies. Bodies that are moved by writing `qpos` need a `qvel`
    that fits. Flexible bodies and skins are not looked at.

    Args:
        model: An `mjModel`.
        bodies: Names of bodies; all that hang on them are obstacles as well.
        source: Name of the source in the table.

    Attributes:
        source: As given.
        ids: Of the obstacles that move.

    Raises:
        ArmguardError: A body is not there, has nothing that can collide, or a geom that no hull of
            eight points contains; or two geoms would have one id.
    """

    def __init__(self, model: Any, bodies: Sequence[str], source: str = "mujoco") -> None:
        self.source = source
        self._model = model
        chosen = _find_geoms(model, bodies)
        names = [_name_geom(model, geom) for geom in chosen]
        twins = sorted({name for name in names if names.count(name) > 1})
        if twins:
            raise ArmguardError("geoms", f"share the name {twins[0]!r}", expected="one for each")
        groups: dict[tuple[int, bool, bool], list[tuple[str, int, Array, float]]] = {}
        for name, geom in zip(names, chosen, strict=True):
            shape, body = enclose_geom(model, geom), model.geom_bodyid[geom]
            is_placed = model.body_mocapid[model.body_rootid[body]] >= 0
            key = len(shape.points), is_placed, is_placed or model.body_weldid[body] != 0
            groups.setdefault(key, []).append((name, geom, *shape))
        self._fixed: list[_Group] = []
        self._groups: list[_Group] = []
        for (_, is_placed, moves), group in groups.items():
            ids, geoms, points, radii = map(list, zip(*group, strict=True))
            made = _Group(ids, geoms, np.array(points), np.array(radii), is_placed)
            (self._groups if moves else self._fixed).append(made)
        self.ids = [name for group in self._groups for name in group.ids]

    def add_statics(self, obstacles: Obstacles, data: Any) -> None:
        """Add what is fixed to the world to a table, once.

        Args:
            obstacles: The table.
            data: The simulation's `mjData`.
        """
        mujoco.mj_kinematics(self._model, data)
        for group in self._fixed:
            position = group.place(data)[0]
            for row in zip(group.ids, position, group.radius.tolist(), strict=True):
                obstacles.add_static(*row)

    def read(self, data: Any) -> list[BodyStates]:
        """Where all that moves is now, and how fast; in groups, as `Obstacles.update` takes them.

        A point p of a body that turns at ω, with a geom at o that moves at v, moves at
        v + ω × (p − o).

        Args:
            data: The simulation's `mjData`; its kinematics and velocities are brought up to date.
        """
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_comVel(self._model, data)
        return [self._read_group(data, group) for group in self._groups]

    def publish(self, obstacles: Obstacles, data: Any, stamp: float) -> None:
        """Hand the present states over to a table.

        Args:
            obstacles: The table.
            data: The simulation's `mjData`.
            stamp: Of these states, in [s] on the clock of the joint states; `data.time`, usually.
        """
        for ids, position, velocity, radius in self.read(data):
            obstacles.update(ids, stamp, position, velocity, radius, source=self.source)

    def _read_group(self, data: Any, group: _Group) -> BodyStates:
        position, arms = group.place(data)
        spins = np.empty((len(group.geoms), 1, 6))
        for geom, spin in zip(group.geoms, spins, strict=True):
            mujoco.mj_objectVelocity(
                self._model, data, mujoco.mjtObj.mjOBJ_GEOM, geom, spin[0], 0
            )  # in the axes of the world: first how it turns, then how the geom's middle moves
        velocity = spins[..., 3:] + np.cross(spins[..., :3], arms)
        told = None if group.is_placed else velocity
        return BodyStates(group.ids, position, told, group.radius)


class _Group(NamedTuple):
    """Geoms that have as many points each."""

    ids: list[str]
    geoms: list[int]
    points: Array
    """In the geoms' frames, in [m]. Shape (n, k, 3)."""
    radius: Array
    """[m]. Shape (n,)."""
    is_placed: bool
    """Whether they hang on mocap bodies."""

    def place(self, data: Any) -> tuple[Array, Array]:
        """Their points in the world, and as seen from the geoms' middles, in [m]."""
        rotations = data.geom_xmat[self.geoms].reshape(-1, 3, 3)
        arms = self.points @ rotations.transpose(0, 2, 1)
        return data.geom_xpos[self.geoms][:, None] + arms, arms


class MujocoJoints:
    """Joint states of a simulated arm in the order of `robot.joints`, by the joints' names.

    The premise is that the simulated arm is where the monitor takes it to be. So axes of joints are
    held against the robot's description, at a few configurations: on an arm whose base stands
    elsewhere, whose links have other lengths, or whose joints count from another zero, some axis
    lies elsewhere. Where the last joint has its zero, and what hangs on it, no axis tells.

    Args:
        model: An `mjModel`.
        robot: The arm that the monitor watches.
        held: Names of joints of the simulated arm that the robot's description takes as fixed, as
            fingers, and that the simulation keeps at their `qpos0`, where the description has them.
        base_placement: Placement of the robot's base in the world, as the monitor has it; None:
            they coincide.

    Raises:
        ArmguardError: The model lacks a joint of the robot, has one of another kind under its name,
            or has one on the arm that the robot lacks; or the arm hangs on a mocap body, or an axis
            is off by more than `AXIS_OFFSET` or `AXIS_ANGLE`: links would be elsewhere than the
            monitor takes them to be.
    """

    def __init__(
        self,
        model: Any,
        robot: Robot,
        held: Sequence[str] = (),
        *,
        base_placement: pinocchio.SE3 | None = None,
    ) -> None:
        kind_of = mujoco.mjtObj.mjOBJ_JOINT
        joints = [mujoco.mj_name2id(model, kind_of, name) for name in robot.joints]
        there = [model.joint(k).name or f"joint {k}" for k in range(model.njnt)]
        for name, joint in zip(robot.joints, joints, strict=True):
            if joint < 0:
                raise ArmguardError(
                    f"joint {name!r}",
                    f"of {robot.name} is not in the model",
                    expected=f"all of {', '.join(robot.joints)}; there are {', '.join(there)}",
                )
            expected = _choose_type(robot, robot.model.getJointId(name))
            if model.jnt_type[joint] != int(expected):
                raise ArmguardError(
                    f"joint {name!r}",
                    f"is of type {mujoco.mjtJoint(model.jnt_type[joint]).name} in the model",
                    expected=expected.name,
                )
        arm = {int(model.jnt_bodyid[joint]) for joint in joints}
        known = {*robot.joints, *held}
        for joint in range(model.njnt):
            body = int(model.jnt_bodyid[joint])
            moves_arm = any(
                _hangs_on(model, one, body) or _hangs_on(model, body, one) for one in arm
            )
            if there[joint] not in known and moves_arm:
                raise ArmguardError(
                    f"joint {there[joint]!r}",
                    f"moves the arm in the model, and {robot.name} lacks it",
                    expected=f"no other joints than {', '.join(robot.joints)}",
                    remedy="watch it as well, or name it in `held` where it never moves",
                )
        for body in sorted(arm):
            root = int(model.body_rootid[body])
            if model.body_mocapid[root] >= 0:
                raise ArmguardError(
                    f"body {model.body(root).name or f'body {root}'!r}",
                    "is a mocap body that the arm hangs on",
                    expected="a base that stands",
                )
        _check_axes(model, robot, joints, base_placement or pinocchio.SE3.Identity())
        self._positions = model.jnt_qposadr[joints]
        self._velocities = model.jnt_dofadr[joints]

    def read(self, data: Any) -> tuple[Array, Array]:
        """Positions and velocities, in [rad] and [rad/s], or [m] and [m/s]. Shapes (nv,)."""
        return np.array(data.qpos[self._positions]), np.array(data.qvel[self._velocities])

    @property
    def dofs(self) -> NDArray[np.int64]:
        """Where the joints are in `qvel` and in forces. Shape (nv,)."""
        return np.array(self._velocities, np.int64)


def add_arm(spec: Any, robot: Robot) -> None:
    """Add the arm as armguard knows it to an `MjSpec`: joints, masses, and links as convex hulls.

    Its base stands at the origin, and joints are named as in `robot.joints`. Geoms are named after
    their links, and collide with nothing; links that no watched joint moves are left out. There are
    neither motors nor friction.

    Args:
        spec: An `MjSpec`.
        robot: The arm.

    Raises:
        ArmguardError: The robot's description has a moving link without a mass.
    """
    model = robot.model
    bodies = {0: spec.worldbody}
    for joint in range(1, model.njoints):
        name, place, inertia = (
            model.names[joint],
            model.jointPlacements[joint],
            model.inertias[joint],
        )
        if not inertia.mass > 0.0:
            raise ArmguardError(
                f"joint {name!r}", f"moves a mass of {inertia.mass} kg", expected="more than 0"
            )
        x, y, z, w = pinocchio.Quaternion(place.rotation).coeffs()
        body = bodies[model.parents[joint]].add_body(
            name=name, pos=place.translation, quat=[w, x, y, z]
        )
        kind = _choose_type(robot, joint)
        body.add_joint(name=name, type=kind, axis=find_axis(robot.model, joint))
        body.explicitinertial, body.mass, body.ipos = True, inertia.mass, inertia.lever
        i = inertia.inertia
        body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
        bodies[joint] = body
    for link in robot.links:
        spec.add_mesh(name=link, uservert=robot.hull(link).ravel())
        bodies[robot.joint_index(link)].add_geom(
            name=link, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=link, contype=0, conaffinity=0
        )


def find_renderer() -> str | None:
    """What MuJoCo can render with on this machine without a screen: `egl`, `osmesa`, or None.

    MuJoCo takes it from the environment variable `MUJOCO_GL` when it is imported, so it is for
    other processes. Where that variable is set, nothing else is tried. Takes a second.
    """
    wanted = os.environ.get("MUJOCO_GL")
    for name in ("egl", "osmesa") if wanted is None else (wanted,):
        done = subprocess.run(
            [sys.executable, "-c", "import mujoco; mujoco.GLContext(64, 64).make_current()"],
            env={**os.environ, "MUJOCO_GL": name},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        if done.returncode == 0:
            return name
    return None


def _grow(points: Array, radius: float) -> GeomShape:
    return GeomShape(points, float(radius) + SPARE)


def _enclose_points(points: Array) -> GeomShape:
    if len(points) <= len(_CORNERS):
        return _grow(points, 0.0)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    if 4.0 / 3.0 * np.pi * radius**3 < np.prod(high - low):
        return _grow(middle[None], radius)
    return _grow(middle + 0.5 * (high - low) * _CORNERS, 0.0)


def _find_geoms(model: Any, bodies: Sequence[str]) -> list[int]:
    """Geoms that can collide on bodies and on all that hang on these."""
    solid = find_solid(model)
    chosen: list[int] = []
    for name in bodies:
        top = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
        if top < 0:
            there = [model.body(k).name for k in range(1, model.nbody)]
            raise ArmguardError(
                f"body {name!r}", "is not in the model", expected=f"one of {', '.join(there)}"
            )
        # Everything hangs on the world, the arm as well: its name stands for what is fixed to it.
        bodies_of = ((geom, int(model.geom_bodyid[geom])) for geom in solid)
        found = [
            geom for geom, body in bodies_of if (_hangs_on(model, body, top) if top else body == 0)
        ]
        if not found:
            raise ArmguardError(
                f"body {name!r}",
                "has no geom that can collide",
                expected="one with a contype or conaffinity, or in a pair",
            )
        chosen += [geom for geom in found if geom not in chosen]
    return chosen


def _hangs_on(model: Any, body: int, top: int) -> bool:
    """Whether a body is another one, or moves with it."""
    while body not in (top, 0):
        body = int(model.body_parentid[body])
    return body == top


def _choose_type(robot: Robot, joint: int) -> Any:
    return _SLIDE if is_prismatic(robot.model, joint) else _HINGE


def _check_axes(model: Any, robot: Robot, joints: list[int], base: pinocchio.SE3) -> None:
    """Refuse an arm whose joints' axes are not where the robot has them.

    Where a hinge has its anchor along its axis moves nothing, so distances across it count. The
    anchor of a slide tells nothing but where its zero is drawn; those of the next joints count.
    """
    mirror, data = robot.model.createData(), mujoco.MjData(model)
    low = np.maximum(robot.lower_position_limit, -_WIDEST)
    high = np.minimum(robot.upper_position_limit, _WIDEST)
    share = np.linspace(0.2, 0.8, len(joints))
    for part in (share, share[::-1]):
        q = low + part * (high - low)
        data.qpos[model.jnt_qposadr[joints]] = q
        mujoco.mj_kinematics(model, data)
        pinocchio.forwardKinematics(robot.model, mirror, q)
        for name, joint in zip(robot.joints, joints, strict=True):
            number = robot.model.getJointId(name)
            place = base * mirror.oMi[number]
            axis, found = place.rotation @ find_axis(robot.model, number), data.xaxis[joint]
            angle = float(np.arctan2(np.linalg.norm(np.cross(axis, found)), axis @ found))
            away = data.xanchor[joint] - place.translation
            is_slide = is_prismatic(robot.model, number)
            offset = 0.0 if is_slide else float(np.linalg.norm(np.cross(axis, away)))
            if not (offset <= AXIS_OFFSET and angle <= AXIS_ANGLE):
                raise ArmguardError(
                    f"joint {name!r}",
                    f"has its axis {offset:.3g} m and {angle:.3g} rad off in the model",
                    expected=f"where {robot.name} has it, within {AXIS_OFFSET:g} m and "
                    f"{AXIS_ANGLE:g} rad",
                    remedy="give the base_placement that the monitor has, and a model of this arm",
                )


def _name_geom(model: Any, geom: int) -> str:
    name: str = model.geom(geom).name
    if name:
        return name
    body = int(model.geom_bodyid[geom])
    return f"{model.body(body).name or f'body {body}'}/{geom - int(model.body_geomadr[body])}"
