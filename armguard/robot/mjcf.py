"""Reads an MJCF file, MuJoCo's format, into Pinocchio's model and its collision geometry.

MuJoCo compiles the file; what it makes of includes, default classes, frames and all forms of
orientation is taken as it is. Pinocchio's own reader passes over much of the format.

A geom collides where `contype`, `conaffinity` or a contact pair says so; the others are drawn. A
mesh is taken with its own triangles: MuJoCo collides its convex hull, and so does armguard where
vertices alone are given. Equality constraints of two joints are mimic relations. Other couplings,
of bodies or by tendons, only take configurations away, so a bound without them holds with them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio

from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.robot.urdf import Mimic, UrdfModel, check_drawn

WORLD = "world"
"""What MuJoCo calls the body that all others stand on."""

_KINDS = {
    "hinge": pinocchio.JointModelRevoluteUnaligned,
    "slide": pinocchio.JointModelPrismaticUnaligned,
}
"""Pinocchio's joints by MuJoCo's names."""

_OLDEST = (3, 17)
"""The first version of MuJoCo that has all that is used here."""

_INSTALL = "pip install 'armguard[mujoco]'"


def read_mjcf(path: str | Path, drawn: Collection[str] = ()) -> UrdfModel:
    """Read the model and the collision geometry of an MJCF file.

    Args:
        path: The file.
        drawn: Bodies without collision geometry whose visual geometry is taken for it.

    Returns:
        As of a URDF, bodies being links. The format has no velocity limits: those of all joints are
        0, which stands for none, as in a URDF.

    Raises:
        RobotError: MuJoCo is missing, too old or cannot compile the file, or something in it is
            not supported; the message names it.
    """
    mujoco = _import_mujoco(path)
    try:
        with _without_log_file(mujoco):
            spec = mujoco.MjSpec.from_file(str(path))
            # Bodies and what they are drawn with stay, each by its name.
            spec.compiler.fusestatic = spec.compiler.discardvisual = False
            compiled = spec.compile()
    except ValueError as error:
        raise RobotError(str(path), f"cannot be read: {' '.join(str(error).split())}") from error
    return _Reader(Path(path), mujoco, compiled, drawn, _has_all_inertias(mujoco, spec)).read()


def _import_mujoco(path: str | Path) -> Any:
    try:
        import mujoco
    except (ImportError, OSError, RuntimeError) as error:
        # It raises the others where its own library or settings are wrong.
        raise RobotError(
            str(path), f"is an MJCF, which MuJoCo reads, and mujoco cannot be imported: {error}",
            remedy=_INSTALL,
        ) from error  # fmt: skip
    version = str(getattr(mujoco, "__version__", "of no version"))
    numbers = tuple(int(part) for part in version.split(".")[:2] if part.isdecimal())
    if numbers < _OLDEST:
        raise RobotError(
            str(path), f"is an MJCF, which MuJoCo reads, and mujoco is {version}",
            expected=f"{'.'.join(map(str, _OLDEST))} or later",
            remedy=_INSTALL,
        )  # fmt: skip
    return mujoco


@contextmanager
def _without_log_file(mujoco: Any) -> Iterator[None]:
    """Let MuJoCo warn on stderr only: by default it also writes a file into the current folder."""
    before, quiet = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    quiet.logto_file = False
    quiet.set()
    try:
        yield
    finally:
        before.set()


def _has_all_inertias(mujoco: Any, spec: Any) -> bool:
    """Whether the compiled inertias of all bodies are those that the file states.

    MuJoCo infers others from what is drawn, or changes them as a compiler tells it. They are a
    guess, beside which no effort counts.
    """
    # An attached body has the compiler of its own file.
    return all(body.explicitinertial for body in spec.bodies[1:]) and not any(
        body.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        or body.compiler.boundmass > 0.0
        or body.compiler.boundinertia > 0.0
        or body.compiler.settotalmass > 0.0
        or body.compiler.balanceinertia
        for body in spec.bodies
    )


def find_solid(compiled: Any) -> list[int]:
    """Geoms of an `mjModel` that can collide."""
    is_solid = (compiled.geom_contype != 0) | (compiled.geom_conaffinity != 0)
    is_solid[compiled.pair_geom1] = is_solid[compiled.pair_geom2] = True
    return np.flatnonzero(is_solid).tolist()


def read_vertices(compiled: Any, mesh: int) -> FloatArray:
    """Vertices of a mesh of an `mjModel`, whose convex hull MuJoCo collides. Shape (n, 3)."""
    first, count = compiled.mesh_vertadr[mesh], compiled.mesh_vertnum[mesh]
    vertices: FloatArray = compiled.mesh_vert[first : first + count].astype(np.float64)
    return vertices


class _Reader:
    """Makes Pinocchio's model of MuJoCo's, which numbers bodies, joints and geoms."""

    def __init__(
        self,
        path: Path,
        mujoco: Any,
        compiled: Any,
        drawn: Collection[str],
        has_all_inertias: bool,
    ) -> None:
        self._path, self._mujoco, self._compiled, self._drawn = path, mujoco, compiled, drawn
        self._has_all_inertias = has_all_inertias
        self._model = pinocchio.Model()
        self._model.name = path.stem
        self._geometry = pinocchio.GeometryModel()
        self._bodies = self._name_bodies()
        self._joints = self._name_joints()
        self._efforts = self._read_efforts()
        self._continuous: list[str] = []

    def read(self) -> UrdfModel:
        """Read all of it."""
        compiled = self._compiled
        if compiled.nflex:
            name = self._mujoco.mj_id2name(compiled, self._mujoco.mjtObj.mjOBJ_FLEX, 0)
            raise self._refuse(
                f"flex {name or 0!r}", "is flexible", expected="rigid bodies",
                remedy="remove it, or replace it by a geom that contains it",
            )  # fmt: skip
        # Pinocchio's own root is among its names of joints.
        joints = [*self._model.names, *self._joints]
        for kind, names in (("body", self._bodies), ("joint", joints)):
            for name, count in Counter(names).items():
                if count > 1:
                    raise self._refuse(
                        f"{kind} {name!r}", "is there twice",
                        expected="a name of its own, also beside those made for unnamed ones",
                        remedy=f"name every {kind}",
                    )  # fmt: skip
        for name in self._drawn:
            check_drawn(name, self._bodies, has_own=False, is_drawn=True)
        if compiled.nbody < 2:
            raise self._refuse("", "has no body", expected="<worldbody> with bodies")
        carriers, places = [0], [pinocchio.SE3.Identity()]
        for body, name in enumerate(self._bodies):
            if body:
                parent = compiled.body_parentid[body]
                carrier, place = self._add_joints(body, carriers[parent], places[parent])
                carriers.append(carrier)
                places.append(place)
            frame = pinocchio.Frame(name, carriers[body], 0, places[body], pinocchio.FrameType.BODY)
            self._model.addFrame(frame, False)
        bare = [
            name
            for body, name in enumerate(self._bodies)
            if self._add_geoms(body, carriers[body], places[body])
        ]
        mimics, continuous = self._read_mimics(), frozenset(self._continuous)
        return UrdfModel(self._model, self._geometry, mimics, continuous, tuple(bare))

    def _refuse(self, what: str, problem: str, expected: str = "", remedy: str = "") -> RobotError:
        place = f"{self._path}: {what}" if what else str(self._path)
        return RobotError(place, problem, expected=expected, remedy=remedy)

    def _name_bodies(self) -> list[str]:
        """Names of bodies; an unnamed one is called by its place among those of its parent."""
        compiled = self._compiled
        names: list[str] = []
        for body, parent in enumerate(compiled.body_parentid):
            place = np.count_nonzero(compiled.body_parentid[1:body] == parent)
            names.append(compiled.body(body).name or f"{names[parent]}_body{place}")
        return names

    def _name_joints(self) -> list[str]:
        """Names of joints; an unnamed one is called by its place among those of its body."""
        compiled = self._compiled
        names: list[str] = []
        for joint, body in enumerate(compiled.jnt_bodyid):
            place = joint - compiled.body_jntadr[body]
            names.append(compiled.joint(joint).name or f"{self._bodies[body]}_joint{place}")
        return names

    def _add_joints(self, body: int, carrier: int, place: Any) -> tuple[int, Any]:
        """Add a body's joints; what carries it then, and where it is in that frame."""
        compiled, name = self._compiled, self._bodies[body]
        if compiled.body_mocapid[body] >= 0:
            raise self._refuse(
                f"body {name!r}", "is a mocap body", expected="bodies that joints move",
                remedy="remove it",
            )  # fmt: skip
        place = place * _place(compiled.body_pos[body], compiled.body_quat[body])
        first = compiled.body_jntadr[body]
        for number in range(first, first + compiled.body_jntnum[body]):
            what = f"joint {self._joints[number]!r}"
            kind = self._mujoco.mjtJoint(int(compiled.jnt_type[number])).name[6:].lower()
            if kind not in _KINDS:
                raise self._refuse(
                    what, f"is of type {kind!r}",
                    expected="hinge or slide (no moving base)",
                    remedy="describe the arm on its fixed base",
                )  # fmt: skip
            zero = float(compiled.qpos0[compiled.jnt_qposadr[number]])
            if zero:
                raise self._refuse(
                    what, f"has ref={zero:g}", expected="0: its zero is where it is drawn"
                )
            lower, upper = compiled.jnt_range[number]
            if not compiled.jnt_limited[number]:
                lower, upper = (-math.inf, math.inf) if kind == "hinge" else (0.0, 0.0)
                self._continuous += [self._joints[number]] * (kind == "hinge")
            anchor = pinocchio.SE3(np.eye(3), compiled.jnt_pos[number])
            carrier = self._model.addJoint(
                carrier, _KINDS[kind](compiled.jnt_axis[number]), place * anchor,
                self._joints[number], self._efforts[number : number + 1], np.zeros(1),
                np.array([lower]), np.array([upper]),
            )  # fmt: skip
            self._model.addJointFrame(carrier)
            place = anchor.inverse()
        if self._has_all_inertias:
            mass, diagonal = float(compiled.body_mass[body]), compiled.body_inertia[body]
            inertia = pinocchio.Inertia(mass, np.zeros(3), np.diag(diagonal))
            there = place * _place(compiled.body_ipos[body], compiled.body_iquat[body])
            self._model.appendBodyToJoint(carrier, inertia, there)
        return carrier, place

    def _add_geoms(self, body: int, carrier: int, place: Any) -> bool:
        """Add a body's collision geometry; whether it is drawn and has none."""
        compiled, name = self._compiled, self._bodies[body]
        first = compiled.body_geomadr[body]
        geoms = range(first, first + compiled.body_geomnum[body])
        solid = [geom for geom in find_solid(compiled) if geom in geoms]
        if name in self._drawn:
            check_drawn(name, self._bodies, has_own=bool(solid), is_drawn=bool(geoms))
            solid = list(geoms)
        frame = self._model.getFrameId(name, pinocchio.FrameType.BODY)
        for geom in solid:
            shape = self._make_shape(name, geom)
            there = place * _place(compiled.geom_pos[geom], compiled.geom_quat[geom])
            self._geometry.addGeometryObject(
                pinocchio.GeometryObject(f"{name}_{geom}", carrier, frame, there, shape)
            )
        return bool(geoms) and not solid

    def _make_shape(self, body: str, geom: int) -> Any:
        compiled = self._compiled
        kind = self._mujoco.mjtGeom(int(compiled.geom_type[geom])).name[7:].lower()
        if kind == "mesh":
            return _make_mesh(compiled, compiled.geom_dataid[geom])
        radius, along, _ = size = compiled.geom_size[geom]
        if kind == "sphere":
            return coal.Sphere(radius)
        if kind == "box":
            return coal.Box(*(2.0 * size))
        if kind in ("capsule", "cylinder"):
            return getattr(coal, kind.capitalize())(radius, 2.0 * along)
        raise self._refuse(
            f"geom {compiled.geom(geom).name or geom!r} of body {body!r}",
            f"is of type {kind!r}",
            expected="a sphere, capsule, cylinder, box or mesh",
            remedy="replace it; of a scene with a floor, take the file of the arm alone",
        )

    def _read_efforts(self) -> FloatArray:
        """Of each joint, its own range or what its actuators push with, in [Nm] or [N]; 0: none."""
        compiled, efforts = self._compiled, np.zeros(self._compiled.njnt)
        for actuator in np.flatnonzero(compiled.actuator_forcelimited):
            if compiled.actuator_trntype[actuator] == self._mujoco.mjtTrn.mjTRN_JOINT:
                force = np.abs(compiled.actuator_forcerange[actuator]).max()
                gear = abs(compiled.actuator_gear[actuator, 0])
                efforts[compiled.actuator_trnid[actuator, 0]] += force * gear
        own = np.abs(compiled.jnt_actfrcrange).max(axis=1)
        chosen: FloatArray = np.where(compiled.jnt_actfrclimited, own, efforts)
        return chosen * self._has_all_inertias

    def _read_mimics(self) -> dict[str, Mimic]:
        compiled, mimics = self._compiled, {}
        for number in np.flatnonzero(compiled.eq_active0):
            if compiled.eq_type[number] != self._mujoco.mjtEq.mjEQ_JOINT:
                continue
            follower, leader = compiled.eq_obj1id[number], compiled.eq_obj2id[number]
            offset, multiplier, *higher = map(float, compiled.eq_data[number, :5])
            if leader < 0 or any(higher):
                raise self._refuse(
                    f"equality of joint {self._joints[follower]!r}",
                    f"has polycoef {[offset, multiplier, *higher]} of joint number {leader}",
                    expected="two joints, one linear in the other",
                    remedy="remove it, and lock the joints by position or travel",
                )  # fmt: skip
            mimics[self._joints[follower]] = Mimic(self._joints[leader], multiplier, offset)
        return mimics


def _place(position: Any, quaternion: Any) -> Any:
    w, x, y, z = quaternion
    return pinocchio.SE3(pinocchio.Quaternion(w, x, y, z).normalized().matrix(), position)


def _make_mesh(compiled: Any, mesh: int) -> Any:
    corners = read_vertices(compiled, mesh)
    first, count = compiled.mesh_faceadr[mesh], compiled.mesh_facenum[mesh]
    faces = compiled.mesh_face[first : first + count]
    made = coal.BVHModelOBBRSS()
    made.beginModel(len(faces), len(corners))
    made.addVertices(corners)
    made.addTriangles(faces.astype(np.uint32))
    made.endModel()
    return made
