"""Drawing commands for the page: Meshcat's own, and a few that it lacks.

Meshcat replaces a whole object for every change, and compiles its shaders again. Objects that
change 30 times a second (balls, rods, lines, hulls) therefore have their own commands, for which
the page refills its buffers. Each command has a key; a newer command with the same key replaces it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.view.colours import Paints

_UINT8, _FLOAT32 = 0x12, 0x17  # extension codes of msgpack-lite, which the viewer decodes with


class Command(NamedTuple):
    """One packed command."""

    key: str
    """Key; a later command with the same key replaces this one."""
    payload: bytes
    """The command in msgpack, as the page reads it."""


def draw_collada(path: str, text: str) -> Command:
    """A Collada file with its own materials."""
    document = {
        "uuid": path,
        "type": "_meshfile_object",
        "format": "dae",
        "data": text,
        "resources": {},
    }
    return _set_object(path, {"geometries": [], "materials": [], "object": document})


def draw_triangles(path: str, triangles: ArrayLike, colour: tuple[float, ...]) -> Command:
    """A mesh of triangles, in [m], shape (n, 3, 3), in one colour with flat shading."""
    position = {
        "itemSize": 3,
        "type": "Float32Array",
        "array": pack_floats(triangles),
        "normalized": False,
    }
    geometry = {
        "uuid": path + "/geometry",
        "type": "BufferGeometry",
        "data": {"attributes": {"position": position}},
    }
    material = {
        "uuid": path + "/material",
        "type": "MeshPhongMaterial",
        "color": int.from_bytes(bytes(round(255 * value) for value in colour), "big"),
        "flatShading": True,
        "side": 2,
    }
    mesh = {
        "uuid": path,
        "type": "Mesh",
        "geometry": geometry["uuid"],
        "material": material["uuid"],
    }
    return _set_object(path, {"geometries": [geometry], "materials": [material], "object": mesh})


def move(path: str, pose: NDArray[np.float64]) -> Command:
    """Place the object at `path`. `pose` is homogeneous, in [m]. Shape (4, 4)."""
    matrix = pose.T.ravel().tolist()
    return _pack("set_transform", path, {"matrix": matrix})


class Look(NamedTuple):
    """How bodies are drawn, apart from their colours."""

    opacity: float = 1.0
    """Opacity, 0 to 1."""
    segments: int = 20
    """Number of flat pieces around a body; fewer if there are many bodies."""
    is_wire: bool = False
    """Whether edges are drawn alone."""


class Labels(NamedTuple):
    """Labels that a pointer over bodies shows."""

    names: Sequence[str] = ()
    """Label of each body; empty: no labels."""
    times: ArrayLike = ()
    """Contact time of each body, in [s]; empty: no contact times."""


NO_LABELS = Labels()


def draw_balls(
    path: str,
    balls: ArrayLike,
    paints: Paints,
    look: Look,
    labels: Labels = NO_LABELS,
) -> Command:
    """Balls in one instanced mesh.

    Args:
        path: Path in the tree of the scene.
        balls: Centre and radius in the world, in [m]. Shape (n, 4).
        paints: Their colours.
        look: How they are drawn.
        labels: Labels that a pointer shows.
    """
    balls = np.asarray(balls, dtype=np.float32).reshape(-1, 4)
    centres, radii = balls[:, :3], balls[:, 3]
    matrices = np.zeros((len(radii), 4, 4), dtype=np.float32)
    matrices[:, [0, 1, 2], [0, 1, 2]] = radii[:, None]
    matrices[:, 3, :3] = centres  # the page reads matrices column by column
    matrices[:, 3, 3] = 1.0
    return _instances(path, "ball", matrices, paints, look, labels)


def draw_rods(
    path: str,
    segments: ArrayLike,
    radii: ArrayLike,
    paints: Paints,
    look: Look,
    labels: Labels = NO_LABELS,
) -> Command:
    """Open cylinders around segments, in one instanced mesh.

    Args:
        path: Path in the tree of the scene.
        segments: End points in the world, in [m]. Shape (n, 2, 3).
        radii: In [m]. Shape (n,).
        paints: Their colours.
        look: How they are drawn.
        labels: Labels that a pointer shows.
    """
    ends = np.asarray(segments, dtype=np.float64).reshape(-1, 2, 3)
    axis = ends[:, 1] - ends[:, 0]
    length = np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    along = axis / length
    # Any vector that is not parallel gives the two others.
    helper = np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(along, helper)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    radius = np.asarray(radii, dtype=np.float64)[:, None]
    matrices = np.zeros((len(ends), 4, 4), dtype=np.float32)
    matrices[:, 0, :3] = across * radius
    matrices[:, 1, :3] = axis
    matrices[:, 2, :3] = np.cross(across, along) * radius
    matrices[:, 3, :3] = ends.mean(axis=1)
    matrices[:, 3, 3] = 1.0
    return _instances(path, "rod", matrices, paints, look, labels)


def draw_lines(path: str, segments: ArrayLike, paints: Paints, opacity: float = 1.0) -> Command:
    """Thin lines in one object.

    Args:
        path: Path in the tree of the scene.
        segments: End points in the world, in [m]. Shape (n, 2, 3).
        paints: Their colours.
        opacity: 0 to 1.
    """
    content = {"positions": pack_floats(segments), "opacity": opacity}
    return _pack("lines", path, content | _pack_paints(paints))


def draw_surface(
    path: str,
    triangles: ArrayLike,
    owners: Sequence[int],
    paints: Paints,
    opacity: float,
    labels: Labels = NO_LABELS,
    *,
    is_on_top: bool = False,
) -> Command:
    """Triangles that may change, in one object.

    Args:
        path: Path in the tree of the scene.
        triangles: Corners in the world, in [m]. Shape (n, 3, 3).
        owners: Number of triangles of each body, in order.
        paints: Colours of the bodies.
        opacity: 0 to 1.
        labels: Label of each body that a pointer shows.
        is_on_top: Whether it is drawn over objects in front of it.
    """
    content = {
        "positions": pack_floats(triangles),
        "opacity": opacity,
        "top": is_on_top,
        "names": list(labels.names),
        "times": pack_floats(labels.times),
        "owners": list(owners),
    }
    return _pack("surface", path, content | _pack_paints(paints))


def delete(path: str) -> Command:
    """Remove everything at and below `path`."""
    return _pack("delete", path, {})


def show(panel: str, content: Mapping[str, Any]) -> Command:
    """Send the page a message other than drawing: `banner`, `legend`, `camera` or `news`."""
    return _pack(panel, "", content)


def _set_object(path: str, content: Mapping[str, Any]) -> Command:
    metadata = {"version": 4.5, "type": "Object"}
    return _pack("set_object", path, {"object": {"metadata": metadata, **content}})


def _instances(
    path: str,
    shape: str,
    matrices: NDArray[np.float32],
    paints: Paints,
    look: Look,
    labels: Labels,
) -> Command:
    content = {
        "shape": shape,
        "opacity": look.opacity,
        "segments": look.segments,
        "wire": look.is_wire,
        "names": list(labels.names),
        "times": pack_floats(labels.times),
        "matrices": pack_floats(matrices),
    }
    return _pack("instances", path, content | _pack_paints(paints))


def _pack_paints(paints: Paints) -> dict[str, msgspec.msgpack.Ext]:
    """Numbers of colours as the page's Uint8Arrays."""
    return {
        name: msgspec.msgpack.Ext(_UINT8, np.ascontiguousarray(some, dtype=np.uint8).tobytes())
        for name, some in (("buckets", paints.by_bucket), ("levels", paints.by_level))
    }


def _pack(kind: str, path: str, content: Mapping[str, Any]) -> Command:
    payload = msgspec.msgpack.encode({"type": kind, "path": path, **content})
    return Command(f"{kind} {path}", payload)


def pack_floats(values: ArrayLike) -> msgspec.msgpack.Ext:
    """Numbers as one flat Float32Array of the page."""
    return msgspec.msgpack.Ext(_FLOAT32, np.ascontiguousarray(values, dtype="<f4").tobytes())
