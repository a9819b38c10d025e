"""Point clouds as obstacles: converts points to voxels, and finds voxels proved empty.

A voxel is a cube of a lattice that is fixed in the world, so its name is the same in each message.
A voxel with points becomes an obstacle: a ball around the cube. A voxel that no longer has points
may be hidden, so it stays. It is removed if rays of one cloud have passed through it.

The rule. A ray runs from the camera to a point. It has passed a voxel if it crosses the window, a
square through the voxel's centre that faces the camera, and ends behind the voxel. The window holds
the whole voxel as the camera sees it, from whatever side: half as wide as the ball around the voxel
and the error of points, and wider by what the near half of that ball gains in perspective. It is
cut into 5 by 5 cells, and a voxel is empty if rays have passed in each of them. A disc around a
place in the window that none of such rays has met does not hold the cell of that place, so its
radius is below the diagonal of a cell: sqrt(2) / 5 of the window's width, 0.49 of the edge where
points are exact and the camera is far. What is larger across the line of sight cannot be in the
voxel unseen. Where rays lie farther apart than a cell is wide, nothing is proved, and the voxel
stays.
"""

from __future__ import annotations

import functools
import math
import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ObstacleError
from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import TERM_ROUNDING
from armguard.obstacles.arguments import read_array, show

SMALLEST_EDGE = 1e-3
"""Of a voxel, in [m]: finer than any camera sees, and with the largest extent its index fits."""

LARGEST_EXTENT = 1000.0
"""From the world's origin, in [m], up to which there are voxels."""

HALF_DIAGONAL = math.sqrt(0.75)
"""Of a cube of edge 1."""

_BITS = 21
"""Of a key, for each coordinate of a voxel's index."""

_OFFSET = 1 << (_BITS - 1)
"""Added to each coordinate of an index: none is negative then."""

_MASK = (1 << _BITS) - 1

CELLS = 5
"""Along each side of a window."""

_ALL_CELLS = (1 << (CELLS * CELLS)) - 1

BINS = 64
"""Of directions, along each side of each face of a cube around the camera."""

_NAME = re.compile(r"voxel (-?[0-9]{1,7}) (-?[0-9]{1,7}) (-?[0-9]{1,7})")

NAMES_KEPT = 100_000
"""Names of voxels that are remembered, by key; all are forgotten when there are more."""


class CloudReader:
    """Makes voxels from clouds, and finds voxels that a cloud proves empty.

    Attributes:
        edges: Edge of the voxels of each source, by the source's name, in [m].
    """

    def __init__(self) -> None:
        self.edges: dict[str, float] = {}
        self._names: dict[int, str] = {}
        self._make_room(0)
        compile_clouds()

    def read(
        self,
        points: FloatArray,
        occupied: BoolArray,
        origin: FloatArray,
        rotation: FloatArray,
        translation: FloatArray,
        edge: float,
        extent: float,
    ) -> tuple[list[str], FloatArray, int]:
        """Read a cloud, and find the voxels that contain its points.

        Args:
            points: In the frame of the camera, in [m]. Shape (n, 3).
            occupied: Which of them make voxels; the others only tell what lies before them. (n,).
            origin: Where the rays begin, in that frame, in [m]. Shape (3,).
            rotation: World from frame. Shape (3, 3).
            translation: Origin of the frame in the world, in [m]. Shape (3,).
            edge: Of the voxels, in [m].
            extent: How far from the world's origin a coordinate may be, in [m].

        Returns:
            Names of the voxels, their centres in the world in [m] of shape (m, 3), and how many
            points cannot be used: they are not finite, or beyond the extent.
        """
        if len(points) > len(self._world):
            self._make_room(len(points))
        self._count = len(points)
        self._origin = rotation @ origin + translation
        found, dropped = gather_voxels(
            points,
            occupied,
            rotation,
            translation,
            edge,
            min(extent, LARGEST_EXTENT),
            self._world,
            self._slots,
            self._found,
        )
        keys = self._found[:found]
        return self._name(keys), place_voxels(keys, edge), dropped

    def find_empty(self, names: list[str], edge: float, error: float) -> list[str]:
        """Those of some voxels that rays of the last cloud have passed through, by the rule above.

        Args:
            names: Of the voxels; those of none are left out.
            edge: Of the voxels, in [m].
            error: What points may be off by, in [m].
        """
        known = [(key, name) for name in names if (key := find_key(name)) is not None]
        if not known or not self._count:
            return []
        keys = np.array([key for key, _ in known], dtype=np.int64)
        empty = np.zeros(len(keys), dtype=np.bool_)
        sort_rays(self._world[: self._count], self._origin, self._bins, self._first, self._order)
        find_passed(
            self._world,
            self._origin,
            self._first,
            self._order,
            place_voxels(keys, edge),
            edge,
            error,
            empty,
        )
        return [name for (_, name), is_empty in zip(known, empty.tolist(), strict=True) if is_empty]

    def _name(self, keys: IntArray) -> list[str]:
        known = self._names
        if len(known) > NAMES_KEPT:
            known.clear()
        named = []
        for key in keys.tolist():
            name = known.get(key)
            if name is None:
                name = known[key] = make_name(key)
            named.append(name)
        return named

    def _make_room(self, count: int) -> None:
        """Make room for clouds of so many points."""
        self._world = np.full((count, 3), np.nan)
        self._found = np.zeros(count, dtype=np.int64)
        self._slots = np.zeros(1 << max(4, (2 * count).bit_length()), dtype=np.int64)
        self._bins = np.zeros(count, dtype=np.int64)
        self._order = np.zeros(count, dtype=np.int64)
        self._first = np.zeros(6 * BINS * BINS + 1, dtype=np.int64)
        self._origin = np.zeros(3)
        self._count = 0


def make_name(key: int) -> str:
    """Name of the voxel of a key."""
    x, y, z = ((key >> shift & _MASK) - _OFFSET for shift in (2 * _BITS, _BITS, 0))
    return f"voxel {x} {y} {z}"


def find_key(name: str) -> int | None:
    """Key of the voxel of this name; None if it is that of none, as `make_name` makes them."""
    match = _NAME.fullmatch(name)
    if match is None:
        return None
    x, y, z = (int(number) + _OFFSET for number in match.groups())
    if not all(0 <= number <= _MASK for number in (x, y, z)):
        return None
    key = x << 2 * _BITS | y << _BITS | z
    return key if make_name(key) == name else None


def check_names(names: list[str]) -> None:
    """Check that no id is the name of a voxel, since it would be removed as voxels are.

    Raises:
        ObstacleError: One of them is.
    """
    if "voxel " not in "".join(names):
        return
    for name in names:
        if find_key(name) is not None:
            raise ObstacleError(
                "ids",
                f"holds {show(name)}, a name that is reserved for voxels of clouds",
                expected="another name",
                remedy="send clouds by `update_cloud`",
            )


def read_rays(points: ArrayLike, origin: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Where rays end, of shape (n, 3), and begin, of shape (3,), in [m].

    Raises:
        ObstacleError: They are no such arrays, or it is not known where the rays begin.
    """
    ends, begin = read_array("points", points), read_array("origin", origin)
    if ends.size == 0:
        ends = np.zeros((0, 3))
    if ends.ndim != 2 or ends.shape[1] != 3:
        raise ObstacleError("points", f"has shape {ends.shape}", expected="(n, 3)")
    if begin.shape != (3,) or not np.isfinite(begin).all():
        raise ObstacleError("origin", f"is {show(begin.tolist())}", expected="3 finite numbers")
    return np.ascontiguousarray(ends), begin


def read_edge(value: object, before: float | None, source: str) -> float:
    """Edge of a source's voxels, in [m].

    Args:
        value: What was given.
        before: That of its voxels in the table; None: there are none.
        source: Its name.

    Raises:
        ObstacleError: It is no edge, or another one than before.
    """
    edge = math.nan
    if isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool):
        edge = float(value)
    if not SMALLEST_EDGE <= edge < math.inf:
        raise ObstacleError("voxel", f"is {show(value)}", expected=f"{SMALLEST_EDGE:g} m at least")
    if before is not None and edge != before:
        raise ObstacleError(
            "voxel",
            f"is {edge:g} m, and was {before:g} m in earlier clouds of {source!r}",
            expected="one size for each source: voxels are known by their places in a lattice",
        )
    return edge


def read_mask(value: object, count: int) -> BoolArray:
    """The points that make voxels; None: all. Shape (count,).

    Raises:
        ObstacleError: It is no such array.
    """
    if value is None:
        return np.ones(count, dtype=np.bool_)
    mask: NDArray[np.bool_] = np.asarray(value)
    if mask.dtype != np.bool_ or mask.shape != (count,):
        raise ObstacleError(
            "occupied",
            f"has shape {mask.shape} of {mask.dtype} for {count} points",
            expected=f"({count},) of bool",
        )
    return np.ascontiguousarray(mask)


def place_voxels(keys: IntArray, edge: float) -> FloatArray:
    """Centres of voxels in the world, in [m]. Shape (n, 3)."""
    shifts = np.array([2 * _BITS, _BITS, 0])
    centers: FloatArray = ((keys[:, None] >> shifts & _MASK) - _OFFSET + 0.5) * edge
    return centers


def enclosing_radius(edge: float) -> float:
    """Of a ball around a voxel, in [m]."""
    return HALF_DIAGONAL * edge * (1.0 + TERM_ROUNDING)


@kernel
def gather_voxels(
    points: FloatArray,
    occupied: BoolArray,
    rotation: FloatArray,
    translation: FloatArray,
    edge: float,
    extent: float,
    world: FloatArray,
    slots: IntArray,
    found: IntArray,
) -> tuple[int, int]:
    """Move points to the world, and gather the voxels that they are in.

    Args:
        points: In their frame, in [m]. Shape (n, 3).
        occupied: Which of them make voxels. Shape (n,).
        rotation: World from frame. Shape (3, 3).
        translation: Of the frame, in [m]. Shape (3,).
        edge: Of the voxels, in [m].
        extent: How far from the world's origin a coordinate may be, in [m].
        world: Is filled: points in the world, NaN where they cannot be used. Shape (room, 3).
        slots: Room for a hash table, a power of 2 and at least twice as long as the points.
        found: Is filled with keys of voxels, each once. Shape (room,).

    Returns:
        How many voxels were found, and how many points cannot be used.
    """
    count = dropped = 0
    last = slots.shape[0] - 1
    slots[:] = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        usable = True
        for axis in range(3):
            value = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
            value += translation[axis]
            world[i, axis] = value
            usable = usable and abs(value) <= extent
        if not usable:
            world[i, 0] = world[i, 1] = world[i, 2] = math.nan
            dropped += 1
            continue
        if not occupied[i]:
            continue
        key = 0
        for axis in range(3):
            key = (key << _BITS) | (math.floor(world[i, axis] / edge) + _OFFSET)
        # Neighbours differ in few bits, which the product spreads over the upper ones.
        slot = ((key * 0x9E3779B97F4A7C1) >> 20) & last
        # Invariant: a slot holds one more than the place of its key among those found, or 0.
        while slots[slot] != 0 and found[slots[slot] - 1] != key:
            slot = (slot + 1) & last
        if slots[slot] == 0:
            found[count] = key
            count += 1
            slots[slot] = count
    return count, dropped


@kernel
def _find_face(x: float, y: float, z: float) -> tuple[int, float, float]:
    """Face of a cube that a direction meets, and where: coordinates in [-1, 1] on it."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        return (0 if x > 0.0 else 1), y / ax, z / ax
    if ay >= az:
        return (2 if y > 0.0 else 3), x / ay, z / ay
    return (4 if z > 0.0 else 5), x / az, y / az


@kernel
def _find_bin(u: float) -> int:
    """Bin of a coordinate on a face; the outermost ones go on beyond the face."""
    return max(0, min(BINS - 1, math.floor((u + 1.0) * (0.5 * BINS))))


@kernel
def sort_rays(
    world: FloatArray, origin: FloatArray, bins: IntArray, first: IntArray, order: IntArray
) -> None:
    """Sort rays by their directions, so that those through a window are found at once.

    Args:
        world: Where they end, in [m]; NaN where there is none. Shape (n, 3).
        origin: Where they begin, in [m]. Shape (3,).
        bins: Room for the bin of each. Shape (room,).
        first: Is filled: where the rays of each bin begin in `order`. Shape (6 BINS² + 1,).
        order: Is filled: numbers of the rays. Shape (room,).
    """
    first[:] = 0
    for i in range(world.shape[0]):
        x, y, z = world[i, 0] - origin[0], world[i, 1] - origin[1], world[i, 2] - origin[2]
        length = abs(x) + abs(y) + abs(z)
        # Of no direction are what was left out, and what is in the camera.
        if not 0.0 < length < math.inf:
            bins[i] = -1
            continue
        face, u, v = _find_face(x, y, z)
        bins[i] = (face * BINS + _find_bin(u)) * BINS + _find_bin(v)
        first[bins[i] + 1] += 1
    for k in range(first.shape[0] - 1):
        first[k + 1] += first[k]
    # Each bin is filled from its end, which thereby becomes its beginning, one place too far on.
    total = first[first.shape[0] - 1]
    for i in range(world.shape[0]):
        if bins[i] >= 0:
            first[bins[i] + 1] -= 1
            order[first[bins[i] + 1]] = i
    for k in range(first.shape[0] - 1):
        first[k] = first[k + 1]
    first[first.shape[0] - 1] = total


@kernel
def find_half_window(away: float, edge: float, error: float) -> float:
    """Half the width of a voxel's window, in [m]; inf where the camera may be in the voxel.

    What is `ball` aside of the line of sight and `ball` nearer than the centre is seen the widest.

    Args:
        away: From the camera to the voxel's centre, in [m].
        edge: Of the voxel, in [m].
        error: What points may be off by, in [m].
    """
    ball = HALF_DIAGONAL * edge + error
    if not away > ball:
        return math.inf
    return ball * away / (away - ball)


@kernel
def find_passed(
    world: FloatArray,
    origin: FloatArray,
    first: IntArray,
    order: IntArray,
    centers: FloatArray,
    edge: float,
    error: float,
    empty: BoolArray,
) -> None:
    """Find the voxels whose windows rays have passed in each cell; see the rule above.

    Args:
        world: Where rays end, in [m]. Shape (room, 3).
        origin: Where they begin, in [m]. Shape (3,).
        first: Beginnings of bins, as `sort_rays` fills them.
        order: Numbers of rays by bin.
        centers: Of the voxels, in [m]. Shape (m, 3).
        edge: Of the voxels, in [m].
        error: What points may be off by, in [m].
        empty: Is filled. Shape (m,).
    """
    behind = HALF_DIAGONAL * edge + error
    corner = np.empty((4, 3))
    for voxel in range(centers.shape[0]):
        empty[voxel] = False
        dx, dy, dz = (
            centers[voxel, 0] - origin[0],
            centers[voxel, 1] - origin[1],
            centers[voxel, 2] - origin[2],
        )
        away = math.sqrt(dx * dx + dy * dy + dz * dz)
        half = find_half_window(away, edge, error)
        if not half < math.inf:
            continue
        dx, dy, dz = dx / away, dy / away, dz / away
        # Two directions across the line of sight: any will do that are square to it.
        if abs(dz) < 0.9:
            size = math.sqrt(dx * dx + dy * dy)
            ax, ay, az = -dy / size, dx / size, 0.0
        else:
            size = math.sqrt(dy * dy + dz * dz)
            ax, ay, az = 0.0, -dz / size, dy / size
        bx, by, bz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
        for k in range(4):
            s = half if k & 1 else -half
            t = half if k & 2 else -half
            corner[k, 0] = away * dx + s * ax + t * bx
            corner[k, 1] = away * dy + s * ay + t * by
            corner[k, 2] = away * dz + s * az + t * bz
        cells = 0
        for face in range(6):
            # Where the window is seen on this face: anywhere if only a part is in front of it.
            axis, sign = face // 2, 1.0 if face % 2 == 0 else -1.0
            across, along_side = (1 if axis == 0 else 0), (1 if axis == 2 else 2)
            least_u = least_v = math.inf
            most_u = most_v = -math.inf
            in_front = 0
            for k in range(4):
                depth = sign * corner[k, axis]
                if not depth > 0.0:
                    continue
                in_front += 1
                u, v = corner[k, across] / depth, corner[k, along_side] / depth
                least_u, most_u = min(least_u, u), max(most_u, u)
                least_v, most_v = min(least_v, v), max(most_v, v)
            if 0 < in_front < 4:
                least_u = least_v = -1.0
                most_u = most_v = 1.0
            if in_front == 0 or least_u > 1.0 or most_u < -1.0 or least_v > 1.0 or most_v < -1.0:
                continue
            for row in range(_find_bin(least_u), _find_bin(most_u) + 1):
                start = (face * BINS + row) * BINS
                begin = first[start + _find_bin(least_v)]
                end = first[start + _find_bin(most_v) + 1]
                for place in range(begin, end):
                    i = order[place]
                    rx, ry, rz = (
                        world[i, 0] - origin[0],
                        world[i, 1] - origin[1],
                        world[i, 2] - origin[2],
                    )
                    along = rx * dx + ry * dy + rz * dz
                    if not along > away + behind:
                        continue
                    scale = away / along
                    s = (rx * ax + ry * ay + rz * az) * scale
                    t = (rx * bx + ry * by + rz * bz) * scale
                    if abs(s) < half and abs(t) < half:
                        column = int((s + half) * (CELLS / (2.0 * half)))
                        line = int((t + half) * (CELLS / (2.0 * half)))
                        cells |= 1 << (min(column, CELLS - 1) * CELLS + min(line, CELLS - 1))
        empty[voxel] = cells == _ALL_CELLS


@functools.cache
def compile_clouds() -> None:
    """Compile what clouds need, once in a process."""
    points, mask = np.ones((2, 3)), np.ones(2, dtype=np.bool_)
    room, found = np.zeros((2, 3)), np.zeros(2, dtype=np.int64)
    slots, first = np.zeros(16, dtype=np.int64), np.zeros(6 * BINS * BINS + 1, dtype=np.int64)
    order = found.copy()
    gather_voxels(points, mask, np.eye(3), np.zeros(3), 1.0, 9.0, room, slots, found)
    sort_rays(room, np.zeros(3), found.copy(), first, order)
    find_passed(room, np.zeros(3), first, order, points, 0.1, 0.0, mask)
