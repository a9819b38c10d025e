"""Reads an MJCF file, MuJoCo's format, into Pinocchio's model and its collision geometry.

Pinocchio's reader passes over much of the format: includes, extrinsic Euler angles, all but the
first body of the world, defaults of meshes, frames; and it takes the range of a slide for degrees.
So the file is first resolved here, as MuJoCo documents it, into one that needs none of these. What
is not supported is refused by name.

A geom collides where `contype`, `conaffinity` or a contact pair says so; the others are drawn. A
mesh is taken as its file has it: MuJoCo collides its convex hull, and so does armguard where
vertices alone are given. Equality constraints of two joints are mimic relations. Other couplings,
of bodies or by tendons, only take configurations away, so a bound without them holds with them.
"""

from __future__ import annotations

import math
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.robot.urdf import Mimic, UrdfModel, describe_error

ROOT = "mujoco"
"""The root element of an MJCF file."""

WORLD = "world"
"""What MuJoCo calls the body that all others stand on."""

_WITHOUT_FORM = ("camera", "light", "site", "inertial")
_SHAPES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}
"""Primitive geoms that a cover can contain, and how many sizes each has."""

_MESH_FILES = (".stl", ".obj")
ACTUATOR = "actuator"
_ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper")
"""Kinds that share one set of defaults."""

_AXES = {"x": 0, "y": 1, "z": 2}
Attributes = dict[str, str]


class _Joint(NamedTuple):
    is_hinge: bool
    limits: tuple[float, float] | None
    """In [rad] or [m]; None where it has none."""
    effort: float
    """In [Nm] or [N]; 0 where the file has none."""


class _Resolver:
    """Turns a model into the plain one that Pinocchio reads, and keeps what it would lose."""

    def __init__(self, path: Path, drawn: Collection[str]) -> None:
        self.path = path
        self.root = ElementTree.Element(ROOT, model=path.stem)
        self.joints: dict[str, _Joint] = {}
        self.mimics: dict[str, Mimic] = {}
        self.solids: dict[str, int] = {}
        """How many collision geoms each body has."""
        self.visible: list[str] = []
        """Bodies that are drawn, but have no collision geometry."""
        self._drawn = drawn
        self._defaults: dict[str, dict[str, Attributes]] = {}
        self._compiler: Attributes = {}
        self._has_all_inertias = True
        source = _include(path, path.resolve().parent, [])
        if source.find("worldbody/body") is None:
            raise self._refuse("", "has no body", expected="<worldbody> with bodies")
        if source.find("deformable") is not None:
            raise self._refuse("<deformable>", "is not supported", expected="rigid bodies")
        for element in source.findall("compiler"):
            self._compiler |= element.attrib
        if self._compiler.get("coordinate", "local") != "local":
            raise self._refuse("<compiler>", "has global coordinates", expected="local ones")
        main = ""
        for element in source.findall("default"):
            main = element.get("class", "main")
            self._read_defaults(element, main, self._defaults.get(main, {}))
        self._main = main or "main"
        self._paired = {
            pair.get(key, "")
            for pair in source.iterfind("contact/pair")
            for key in ("geom1", "geom2")
        }
        ElementTree.SubElement(self.root, "compiler", angle="radian", autolimits="true")
        self._assets = ElementTree.SubElement(self.root, "asset")
        self._meshes = self._read_meshes(source)
        self._put_bodies(source)
        for name in drawn:
            if name not in self.solids:
                raise RobotError(
                    f"link {name!r}",
                    "is not in the MJCF",
                    expected=f"one of {', '.join(self.solids)}",
                )
        self._read_efforts(source)
        self._read_equalities(source)

    def _refuse(self, what: str, problem: str, expected: str = "", remedy: str = "") -> RobotError:
        place = f"{self.path}: {what}" if what else str(self.path)
        return RobotError(place, problem, expected=expected, remedy=remedy)

    def _read_defaults(
        self, element: ElementTree.Element, name: str, inherited: dict[str, Attributes]
    ) -> None:
        own = dict(inherited)
        for child in element:
            if child.tag != "default" and isinstance(child.tag, str):
                kind = ACTUATOR if child.tag in _ACTUATORS else child.tag
                own[kind] = own.get(kind, {}) | child.attrib
        self._defaults[name] = own
        for child in element.findall("default"):
            if not child.get("class"):
                raise self._refuse("a nested <default>", "has no class", expected='class="…"')
            self._read_defaults(child, child.get("class", ""), own)

    def _merge(
        self, element: ElementTree.Element, childclass: str, what: str, kind: str = ""
    ) -> Attributes:
        """Attributes of an element after those that its class has for its kind."""
        name = element.get("class") or childclass or self._main
        if name not in self._defaults and name != self._main:
            raise self._refuse(
                what, f"is of class {name!r}, which no <default> has",
                expected=f"one of {', '.join(self._defaults)}",
            )  # fmt: skip
        return self._defaults.get(name, {}).get(kind or element.tag, {}) | element.attrib

    def _numbers(self, what: str, attributes: Attributes, key: str, default: str) -> FloatArray:
        """Numbers of an attribute, as many as its default has."""
        text = attributes.get(key, default)
        numbers = _read_floats(text)
        if not (len(numbers) == len(default.split()) and np.isfinite(numbers).all()):
            raise self._refuse(
                what, f"has {key}={text!r}", expected=f"{len(default.split())} finite numbers"
            )
        return numbers

    def _angle(self, value: float) -> float:
        return value if self._compiler.get("angle", "degree") == "radian" else math.radians(value)

    def _place(self, what: str, attributes: Attributes) -> Any:
        """The placement that `pos` and an orientation give, as `pinocchio.SE3`."""
        return pinocchio.SE3(
            self._turn(what, attributes), self._numbers(what, attributes, "pos", "0 0 0")
        )

    def _turn(self, what: str, attributes: Attributes) -> FloatArray:
        """A rotation matrix; like MuJoCo, `quat` counts where no other form is given."""
        rotation = np.eye(3)
        if "axisangle" in attributes:
            numbers = self._numbers(what, attributes, "axisangle", "0 0 1 0")
            return _rotate(self._unit(what, "axisangle", numbers[:3]), self._angle(numbers[3]))
        if "euler" in attributes:
            sequence = self._compiler.get("eulerseq", "xyz")
            if not (len(sequence) == 3 and set(sequence.lower()) <= set(_AXES)):
                raise self._refuse(
                    "<compiler>", f"has eulerseq={sequence!r}", expected="three of xyzXYZ"
                )
            angles = self._numbers(what, attributes, "euler", "0 0 0")
            for letter, angle in zip(sequence, angles, strict=True):
                step = _rotate(np.eye(3)[_AXES[letter.lower()]], self._angle(angle))
                rotation = rotation @ step if letter.islower() else step @ rotation
            return rotation
        if "xyaxes" in attributes:
            numbers = self._numbers(what, attributes, "xyaxes", "1 0 0 0 1 0")
            x = self._unit(what, "xyaxes", numbers[:3])
            y = self._unit(what, "xyaxes", numbers[3:] - x * (x @ numbers[3:]))
            return np.column_stack([x, y, np.cross(x, y)])
        if "zaxis" in attributes:
            numbers = self._numbers(what, attributes, "zaxis", "0 0 1")
            return _turn_z_to(self._unit(what, "zaxis", numbers))
        w, *xyz = self._unit(what, "quat", self._numbers(what, attributes, "quat", "1 0 0 0"))
        turned: FloatArray = pinocchio.Quaternion(w, *xyz).matrix()
        return turned

    def _unit(self, what: str, key: str, vector: FloatArray) -> FloatArray:
        length = float(np.linalg.norm(vector))
        if not length > 1e-10:
            raise self._refuse(what, f"has {key} of length {length:g}", expected="a direction")
        return vector / length

    def _read_meshes(self, source: ElementTree.Element) -> dict[str, Attributes]:
        meshes = {}
        for element in source.iterfind("asset/mesh"):
            name = element.get("name") or Path(element.get("file", "")).stem
            meshes[name] = self._merge(element, "", f"mesh {name!r}")
        return meshes

    def _put_mesh(self, geom: str, name: str) -> str:
        """Put a mesh among the assets of the plain model; its name there."""
        what = f"mesh {name!r}"
        if name not in self._meshes:
            raise self._refuse(
                geom, f"has mesh={name!r}, which is no asset",
                expected=f"a mesh of <asset>: {', '.join(self._meshes)}",
            )  # fmt: skip
        mesh = self._meshes[name]
        moved = self._numbers(what, mesh, "refpos", "0 0 0").any()
        quat = self._numbers(what, mesh, "refquat", "1 0 0 0")
        if moved or quat[1:].any():
            raise self._refuse(
                what, "has refpos or refquat", remedy="move the vertices, or the geoms, instead"
            )
        plain = {"name": name, "scale": _spell(self._numbers(what, mesh, "scale", "1 1 1"))}
        if "file" in mesh:
            file = self._find_mesh(mesh["file"])
            if file.suffix.lower() not in _MESH_FILES:
                raise self._refuse(
                    what, f"is in {file.name}", expected="STL or OBJ", remedy="convert the mesh"
                )
            if not file.is_file():
                raise self._refuse(
                    what, f"was not found: {file} is no file",
                    remedy="put it there, or correct meshdir of <compiler>",
                )  # fmt: skip
            plain["file"] = str(file)
        else:
            corners = _read_floats(mesh.get("vertex", ""))
            if not (len(corners) >= 12 and len(corners) % 3 == 0 and np.isfinite(corners).all()):
                raise self._refuse(
                    what,
                    "has no file, and no four vertices",
                    expected="file, or vertex of x y z each",
                )
            plain["vertex"] = _spell(corners)
        if self._assets.find(f"mesh[@name={name!r}]") is None:
            ElementTree.SubElement(self._assets, "mesh", plain)
        return name

    def _find_mesh(self, name: str) -> Path:
        file = Path(name)
        if self._compiler.get("strippath") == "true":
            file = Path(file.name)
        folder = self._compiler.get("meshdir", self._compiler.get("assetdir", ""))
        return self.path.resolve().parent / folder / file

    def _put_bodies(self, source: ElementTree.Element) -> None:
        """Put all bodies into the plain model, those of the world into one that stands for it."""
        plain = ElementTree.SubElement(self.root, "worldbody")
        world = _add_body(plain, WORLD, pinocchio.SE3.Identity())
        whole = ElementTree.Element("body")
        for element in source.findall("worldbody"):
            whole.extend(element)
        self._fill_body(whole, world, WORLD, "")

    def _put_body(
        self, element: ElementTree.Element, parent: ElementTree.Element, name: str, childclass: str
    ) -> None:
        what = f"body {name!r}"
        if name in self.solids:
            raise self._refuse(what, "is there twice", expected="names of their own")
        if element.get("mocap") == "true":
            raise self._refuse(
                what, "is a mocap body", expected="bodies that joints move", remedy="remove it"
            )
        placement = self._place(what, element.attrib)
        joints = element.findall("joint")
        free = element.find("freejoint")
        if free is not None:
            raise self._refuse_joint(free.get("name") or name, "free")
        # Pinocchio makes one joint of several: a body of its own for each keeps them apart.
        body = _add_body(parent, f"{name} (joint 0)" if len(joints) > 1 else name, placement)
        for i, joint in enumerate(joints):
            if i:
                is_last = i == len(joints) - 1
                inner = name if is_last else f"{name} (joint {i})"
                body = _add_body(body, inner, pinocchio.SE3.Identity())
            self._put_joint(joint, body, joint.get("name") or f"{name}_joint{i}", childclass)
        self._put_inertia(what, element, body)
        self._fill_body(element, body, name, childclass)

    def _fill_body(
        self, element: ElementTree.Element, body: ElementTree.Element, name: str, childclass: str
    ) -> None:
        """Put in the geoms of a body, and the bodies that hang on it."""
        solid: list[tuple[str, Attributes]] = []
        drawn: list[tuple[str, Attributes]] = []
        self.solids[name] = 0
        children = 0
        for child in element:
            if not isinstance(child.tag, str) or child.tag in (*_WITHOUT_FORM, "joint"):
                continue
            if child.tag == "geom":
                what = f"geom {child.get('name') or len(solid) + len(drawn)!r} of body {name!r}"
                attributes = self._merge(child, childclass, what)
                (solid if self._collides(what, attributes) else drawn).append((what, attributes))
            elif child.tag == "body":
                own = child.get("name") or f"{name}_body{children}"
                children += 1
                self._put_body(child, body, own, child.get("childclass", childclass))
            else:
                raise self._refuse(
                    f"body {name!r}", f"has a <{child.tag}>",
                    expected="joints, geoms and bodies",
                    remedy="let MuJoCo expand the model: mujoco.mj_saveLastXML writes it",
                )  # fmt: skip
        if name in self._drawn:
            if solid or not drawn:
                problem = "has collision geometry of its own" if solid else "is not drawn"
                raise RobotError(
                    f"link {name!r}", problem, remedy="leave it out of collision_from_visual"
                )
            solid = drawn
        elif drawn and not solid:
            self.visible.append(name)
        for what, attributes in solid:
            self._put_geom(what, attributes, body)
        self.solids[name] = len(solid)

    def _collides(self, what: str, attributes: Attributes) -> bool:
        masks = [self._numbers(what, attributes, key, "1") for key in ("contype", "conaffinity")]
        return any(mask[0] != 0 for mask in masks) or attributes.get("name") in self._paired

    def _put_geom(self, what: str, attributes: Attributes, body: ElementTree.Element) -> None:
        kind = attributes.get("type", "sphere")
        placement = self._place(what, attributes)
        if kind == "mesh":
            mesh = self._put_mesh(what, attributes.get("mesh", ""))
            ElementTree.SubElement(body, "geom", _spell_placement(placement), type=kind, mesh=mesh)
            return
        if kind not in _SHAPES or "mesh" in attributes:
            problem = f"is of type {kind!r}" + (" fitted to a mesh" if "mesh" in attributes else "")
            raise self._refuse(
                what, problem, expected="a sphere, capsule, cylinder, box or mesh",
                remedy="replace it; of a scene with a floor, take the file of the arm alone",
            )  # fmt: skip
        sizes = _read_floats(attributes.get("size", ""))
        if "fromto" in attributes and kind != "sphere":
            ends = self._numbers(what, attributes, "fromto", "0 0 0 0 0 0")
            along = ends[:3] - ends[3:]
            middle, turned = 0.5 * (ends[:3] + ends[3:]), self._unit(what, "fromto", along)
            placement = pinocchio.SE3(_turn_z_to(turned), middle)
            half = 0.5 * float(np.linalg.norm(along))
            sizes = np.array([*sizes[:1], *([*sizes[:1]] if kind == "box" else []), half])
        count = _SHAPES[kind]
        if not (len(sizes) >= count and all(0.0 < size < math.inf for size in sizes[:count])):
            raise self._refuse(
                what, f"has size={attributes.get('size', '')!r}",
                expected=f"{count} positive numbers",
            )  # fmt: skip
        ElementTree.SubElement(
            body, "geom", _spell_placement(placement), type=kind, size=_spell(sizes[:count])
        )

    def _refuse_joint(self, name: str, kind: str) -> RobotError:
        return self._refuse(
            f"joint {name!r}", f"is of type {kind!r}", expected="hinge or slide (no moving base)",
            remedy="describe the arm on its fixed base",
        )  # fmt: skip

    def _put_joint(
        self, element: ElementTree.Element, body: ElementTree.Element, name: str, childclass: str
    ) -> None:
        what = f"joint {name!r}"
        attributes = self._merge(element, childclass, what)
        kind = attributes.get("type", "hinge")
        if kind not in ("hinge", "slide"):
            raise self._refuse_joint(name, kind)
        if name in self.joints:
            raise self._refuse(what, "is there twice", expected="names of their own")
        if self._numbers(what, attributes, "ref", "0").any():
            raise self._refuse(
                what, f"has ref={attributes['ref']!r}", expected="0: its zero is where it is drawn"
            )
        has_range = "range" in attributes
        limited = attributes.get("limited", "auto")
        if limited == "auto" and has_range and self._compiler.get("autolimits") == "false":
            raise self._refuse(
                what, "has a range without `limited`, and autolimits is off",
                remedy='say limited="true" or "false"',
            )  # fmt: skip
        limits = None
        if limited == "true" or (limited == "auto" and has_range):
            lower, upper = map(float, self._numbers(what, attributes, "range", "0 0"))
            if kind == "hinge":
                lower, upper = self._angle(lower), self._angle(upper)
            if not lower < upper:
                raise self._refuse(
                    what, f"has range={attributes.get('range', '')!r}", expected="lower < upper"
                )
            limits = lower, upper
        effort = self._numbers(what, attributes, "actuatorfrcrange", "0 0")
        self.joints[name] = _Joint(kind == "hinge", limits, float(np.abs(effort).max()))
        axis = self._unit(what, "axis", self._numbers(what, attributes, "axis", "0 0 1"))
        anchor = self._numbers(what, attributes, "pos", "0 0 0")
        ElementTree.SubElement(
            body, "joint", name=name, type=kind, axis=_spell(axis), pos=_spell(anchor)
        )

    def _put_inertia(
        self, what: str, element: ElementTree.Element, body: ElementTree.Element
    ) -> None:
        """Replace the zero inertia of a body by what the file says."""
        inertial = element.find("inertial")
        is_inferred = self._compiler.get("inertiafromgeom") == "true"
        if inertial is None or is_inferred:
            self._has_all_inertias = False
            return
        found = inertial.attrib
        plain = _spell_placement(self._place(f"inertial of {what}", found))
        plain["mass"] = _spell(self._numbers(f"inertial of {what}", found, "mass", "0"))
        key = "fullinertia" if "fullinertia" in found else "diaginertia"
        zero = "0 0 0 0 0 0" if key == "fullinertia" else "0 0 0"
        plain[key] = _spell(self._numbers(f"inertial of {what}", found, key, zero))
        placeholder = body.find("inertial")
        if placeholder is not None:
            placeholder.attrib.clear()
            placeholder.attrib.update(plain)

    def _read_efforts(self, source: ElementTree.Element) -> None:
        """Add what actuators can push with; without all inertias nothing may be derived of it."""
        pushed = dict.fromkeys(self.joints, 0.0)
        for actuator in source.iterfind("actuator/*"):
            driven = actuator.get("joint", "")
            if driven not in pushed:
                continue
            what = f"actuator of joint {driven!r}"
            attributes = self._merge(actuator, "", what, ACTUATOR)
            force = np.abs(self._numbers(what, attributes, "forcerange", "0 0")).max()
            gear = _read_floats(attributes.get("gear", "1"))
            if not (len(gear) and math.isfinite(gear[0])):
                raise self._refuse(what, f"has gear={attributes['gear']!r}", expected="numbers")
            pushed[driven] += float(force * abs(gear[0]))
        for name, joint in self.joints.items():
            effort = joint.effort or pushed[name]
            self.joints[name] = joint._replace(effort=effort if self._has_all_inertias else 0.0)

    def _read_equalities(self, source: ElementTree.Element) -> None:
        for element in source.iterfind("equality/joint"):
            attributes = self._merge(element, "", "<equality>", "equality")
            follower, leader = attributes.get("joint1", ""), attributes.get("joint2", "")
            what = f"equality of joint {follower!r}"
            if attributes.get("active", "true") == "false":
                continue
            terms = self._numbers(what, attributes, "polycoef", "0 1 0 0 0")
            if follower not in self.joints or leader not in self.joints or terms[2:].any():
                raise self._refuse(
                    what, f"with joint2={leader!r} and polycoef={_spell(terms)!r} is not supported",
                    expected="two joints, one linear in the other",
                    remedy="remove it, and lock the joints by position or travel",
                )  # fmt: skip
            self.mimics[follower] = Mimic(leader, float(terms[1]), float(terms[0]))


def read_mjcf(path: str | Path, drawn: Collection[str] = ()) -> UrdfModel:
    """Read the model and the collision geometry of an MJCF file.

    Args:
        path: The file. Included files are looked up in its folder, meshes there or in `meshdir`.
        drawn: Bodies without collision geometry whose visual geometry is taken for it.

    Returns:
        As of a URDF, bodies being links. The format has no velocity limits: those of all joints are
        0, which stands for none, as in a URDF.

    Raises:
        RobotError: The file is missing or malformed, a mesh cannot be read, or something in it is
            not supported; the message names it.
    """
    path = Path(path)
    plain = _Resolver(path, drawn)
    with tempfile.TemporaryDirectory(prefix="armguard-") as folder:
        file = str(Path(folder) / "plain.xml")
        ElementTree.ElementTree(plain.root).write(file)
        try:
            model = pinocchio.buildModelFromMJCF(file)
            geometry = pinocchio.buildGeomFromMJCF(model, file, pinocchio.GeometryType.COLLISION)
        except (ValueError, RuntimeError, IndexError) as error:
            raise RobotError(str(path), f"cannot be read: {describe_error(error)}") from error
    names = [str(name) for name in model.names][1:]
    if sorted(names) != sorted(plain.joints):
        raise RobotError(
            str(path),
            f"was read with joints {', '.join(names)}",
            expected=", ".join(plain.joints),
        )
    found = [str(model.frames[one.parentFrame].name) for one in geometry.geometryObjects]
    for body, count in plain.solids.items():
        if found.count(body) != count:
            raise RobotError(
                f"{path}: body {body!r}", f"only {found.count(body)} of its {count} geoms were read"
            )
    for name, joint in plain.joints.items():
        index = model.joints[model.getJointId(name)].idx_q
        unlimited = (-math.inf, math.inf) if joint.is_hinge else (0.0, 0.0)
        lower, upper = joint.limits or unlimited
        model.lowerPositionLimit[index], model.upperPositionLimit[index] = lower, upper
        model.lowerEffortLimit[index], model.upperEffortLimit[index] = -joint.effort, joint.effort
        model.lowerVelocityLimit[index] = model.upperVelocityLimit[index] = 0.0
    continuous = [name for name, one in plain.joints.items() if one.is_hinge and one.limits is None]
    return UrdfModel(model, geometry, plain.mimics, frozenset(continuous), tuple(plain.visible))


def _include(path: Path, folder: Path, opened: list[Path]) -> ElementTree.Element:
    """The root of a file, with every <include> replaced by what it names."""
    if path.resolve() in opened:
        raise RobotError(str(path), "is included twice", expected="each file once")
    opened.append(path.resolve())
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except OSError as error:
        raise RobotError(str(path), f"cannot be read: {error.strerror}") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(str(path), f"is not XML: {error}") from error
    if root.tag not in (ROOT, f"{ROOT}include"):
        raise RobotError(
            str(path), f"has the root <{root.tag}>", expected=f"an MJCF file: <{ROOT}>"
        )
    for parent in list(root.iter()):
        for i, child in reversed(list(enumerate(parent))):
            if child.tag == "include":
                parent[i : i + 1] = list(_include(folder / child.get("file", ""), folder, opened))
    return root


def _add_body(parent: ElementTree.Element, name: str, placement: Any) -> ElementTree.Element:
    body = ElementTree.SubElement(parent, "body", _spell_placement(placement), name=name)
    ElementTree.SubElement(body, "inertial", pos="0 0 0", mass="0", diaginertia="0 0 0")
    return body


def _rotate(axis: FloatArray, angle: float) -> FloatArray:
    turned: FloatArray = pinocchio.AngleAxis(angle, np.asarray(axis)).matrix()
    return turned


def _turn_z_to(direction: FloatArray) -> FloatArray:
    """The rotation that MuJoCo takes for the least that turns z to a unit vector."""
    axis = np.array([-direction[1], direction[0], 0.0])
    sine = float(np.linalg.norm(axis))
    axis = axis / sine if sine > 1e-10 else np.array([1.0, 0.0, 0.0])
    return _rotate(axis, math.atan2(sine, direction[2]))


def _read_floats(text: str) -> FloatArray:
    """Numbers of a text; NaN for what is none."""
    numbers = []
    for word in text.split():
        try:
            numbers.append(float(word))
        except ValueError:
            numbers.append(math.nan)
    return np.array(numbers, dtype=np.float64)


def _spell(numbers: FloatArray) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _spell_placement(placement: Any) -> Attributes:
    x, y, z, w = pinocchio.Quaternion(placement.rotation).coeffs()
    return {"pos": _spell(placement.translation), "quat": _spell(np.array([w, x, y, z]))}
