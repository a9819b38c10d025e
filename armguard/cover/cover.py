"""`Cover`: a tree of spheres for each link, proved to contain the link's whole surface.

The sphere sets of VAMP and cuRobo are fitted to samples, and leave 20 % to 50 % of Panda's surface
uncovered. A cover here is a proof object: `check` proves, from the triangles alone, that each piece
of surface is inside a leaf and inside every ball above that leaf. So any set of nodes that cuts all
paths from the root (a level, or a descent stopped anywhere) covers the whole link.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.cover.patches import compute_corners
from armguard.cover.sphere_tree import GRID, SphereTree, compute_parents
from armguard.exceptions import CoverError
from armguard.jit.arrays import FloatArray
from armguard.jit.kept_results import keep_results

if TYPE_CHECKING:
    from armguard.cover.report import CoverReport

CoverTree = SphereTree

FORMAT = 1
DEFAULT_PROTRUSION = 0.02  # [m]
SMALLEST, LARGEST = 5e-4, 10.0
"""How far a link may extend, in [m]: a mesh in millimetres read as metres is larger than that."""
FARTHEST = 100.0
"""How far a link may be from the origin of its joint, in [m]."""
MOST_SPHERES = 500
"""Greatest number of leaves per link; more would take hours to fit, and slow down each tick."""
MOST_KEPT = 64
"""Fitted trees that are kept: those of the links of a few arms and of what they hold."""


class Surfaces(Protocol):
    """An object with links and their surfaces, such as a `Robot`."""

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""

    def surface(self, link: str) -> FloatArray:
        """Pieces of a link's surface, as `patches` has them, in its parent joint's frame [m]."""


class Cover:
    """A tree of spheres for each link.

    Args:
        trees: A sphere tree for each link.
        geometry: Digest of each link's surface, as `hash_surface` makes it.
    """

    def __init__(self, trees: Mapping[str, CoverTree], geometry: Mapping[str, str]) -> None:
        if set(trees) != set(geometry):
            raise CoverError("cover", "its trees and its digests are for different links")
        self._trees = {link: CoverTree(*map(_read_only, tree)) for link, tree in trees.items()}
        for link, tree in self._trees.items():
            _check_tree(link, tree)
        self._geometry = dict(geometry)

    @classmethod
    def fit(
        cls,
        robot: Surfaces,
        *,
        spheres: int | None = None,
        protrusion: float | None = None,
        on_link: Callable[[str], None] | None = None,
    ) -> Cover:
        """Fit and prove a cover; the same robot gives the same cover.

        Args:
            robot: The robot whose links to cover.
            spheres: Greatest number of leaves per link; they stick out as little as possible.
            protrusion: How far leaves may stick out, in [m]; the number of leaves is as small as
                possible. If neither is given, `DEFAULT_PROTRUSION`. Large open shells may exceed
                it: see `check`.
            on_link: Called with the name of each link before it is fitted, to show progress.

        Raises:
            CoverError: An argument is unusable, or the fit could not be proved.
        """
        if spheres is not None and protrusion is not None:
            raise CoverError("spheres and protrusion", "exclude each other")
        if spheres is not None and not 1 <= spheres <= MOST_SPHERES:
            raise CoverError("spheres", f"is {spheres}", expected=f"1 to {MOST_SPHERES}")
        if protrusion is not None and not 0.0 < protrusion <= LARGEST:
            raise CoverError(
                "protrusion", f"is {protrusion:g} m", expected=f"positive, at most {LARGEST:g} m"
            )
        if spheres is None and protrusion is None:
            protrusion = DEFAULT_PROTRUSION
        trees, geometry = {}, {}
        surfaces = {link: get_surface(robot, link) for link in robot.links}
        for link, surface in surfaces.items():
            if on_link is not None:
                on_link(link)
            tree = _fit_proved(surface, spheres, protrusion)
            if tree is None:
                raise CoverError(f"link {link!r}", "its fitted spheres could not be proved")
            trees[link] = tree
            geometry[link] = hash_surface(surface)
        return cls(trees, geometry)

    @property
    def links(self) -> tuple[str, ...]:
        """The links that have a tree."""
        return tuple(self._trees)

    def tree(self, link: str) -> CoverTree:
        """The spheres of a link as a tree."""
        if link not in self._trees:
            raise CoverError(
                f"link {link!r}", "has no cover", expected=f"one of {', '.join(self.links)}"
            )
        return self._trees[link]

    def digest(self, link: str) -> str:
        """Digest of the surface that a link's tree was made for."""
        self.tree(link)
        return self._geometry[link]

    def levels(self, link: str) -> int:
        """Number of levels of a link: one more than the depth of its deepest leaf."""
        return int(_compute_depths(self.tree(link)).max()) + 1

    def spheres(self, link: str, level: int = -1) -> FloatArray:
        """The spheres of one level: nodes at that depth, and the leaves above it.

        Args:
            link: One of `links`.
            level: From 0, one ball, to `levels(link) - 1`, all leaves; -1 is the finest.

        Returns:
            Centre and radius in the frame of the link's parent joint, in [m]. Shape (n, 4).
        """
        tree, levels = self.tree(link), self.levels(link)
        if not -levels <= level < levels:
            raise CoverError(f"level {level}", f"is not one of the {levels} of link {link!r}")
        depths = _compute_depths(tree)
        wanted = level % levels
        chosen: FloatArray = tree.spheres[
            (depths == wanted) | ((depths < wanted) & (tree.child_count == 0))
        ]
        return chosen

    def cut(self, level: int) -> Cover:
        """The same cover without the nodes below a level: fewer and larger spheres.

        A ball of that level contains all of the surface that it owns, whether or not it is refined.
        So the result is a cover too, by the same proof.

        Args:
            level: Finest level to keep, from 0, one ball per link; links with fewer levels keep
                all.

        Raises:
            CoverError: No link has such a level.
        """
        deepest = max(self.levels(link) for link in self.links)
        if isinstance(level, bool) or not isinstance(level, int) or not 0 <= level < deepest:
            raise CoverError("level", f"is {level!r}", expected=f"0 to {deepest - 1}")
        trees = {link: _cut_tree(self.tree(link), level) for link in self.links}
        return Cover(trees, self._geometry)

    def prove(self, robot: Surfaces, name: str) -> None:
        """Prove that this cover was made for this geometry, and contains it.

        Args:
            robot: The robot whose links it must cover.
            name: Name of the cover in errors.

        Raises:
            CoverError: It was made for other geometry, or does not contain it.
        """
        self.verify(robot)
        for link, report in self.check(robot).links.items():
            if not report.proved:
                raise CoverError(f"link {link!r}", f"is not inside its spheres in {name}")

    def check(self, robot: Surfaces) -> CoverReport:
        """Prove for every link that all of its surface is inside its spheres.

        A triangle is inside a ball if its corners are, since balls are convex. A triangle that is
        not inside a leaf and its ancestors is bisected until its parts are, or until a corner is
        outside of all. Distances are rounded up, and radii are reduced by the resolution of the
        digest.

        Raises:
            CoverError: The cover is for other links.
        """
        if set(robot.links) != set(self._trees):
            raise CoverError(
                "cover",
                f"is for links {', '.join(self.links)}",
                expected=", ".join(robot.links),
            )
        # A cover that was made before is loaded by its digest, without a proof.
        from armguard.cover.report import CoverReport, report_link

        return CoverReport(
            {link: report_link(self.tree(link), get_surface(robot, link)) for link in robot.links}
        )

    def verify(self, robot: Surfaces) -> None:
        """Check that this cover was made for exactly this geometry.

        Raises:
            CoverError: It was not; the message names the first link that differs.
        """
        for link in (*robot.links, *self._geometry):
            if link not in robot.links or link not in self._geometry:
                raise CoverError(f"link {link!r}", "is in the robot or in the cover, not in both")
            if hash_surface(get_surface(robot, link)) != self._geometry[link]:
                raise CoverError(
                    f"link {link!r}",
                    "its cover was made for other geometry",
                    remedy="fit a cover for this robot",
                )

    def save(self, path: str | Path) -> None:
        """Write the cover as JSON; equal covers give equal bytes."""
        links = {
            link: _LinkFile(
                geometry=self._geometry[link],
                spheres=[tuple(sphere) for sphere in tree.spheres.tolist()],
                first_child=tree.first_child.tolist(),
                child_count=tree.child_count.tolist(),
            )
            for link, tree in self._trees.items()
        }
        file = _CoverFile(format=FORMAT, digest=_hash_links(links), links=links)
        content = msgspec.json.encode(file).replace(b"],[", b"],\n[").replace(b"},", b"},\n")
        Path(path).write_bytes(content + b"\n")

    @classmethod
    def load(cls, path: str | Path) -> Cover:
        """Read a cover that `save` wrote.

        Raises:
            CoverError: The file is unreadable, malformed, or was changed by hand.
        """
        try:
            file = msgspec.json.decode(Path(path).read_bytes(), type=_CoverFile)
        except OSError as error:
            raise CoverError(str(path), f"cannot be read: {error.strerror}") from error
        except (msgspec.ValidationError, msgspec.DecodeError, UnicodeDecodeError) as error:
            raise CoverError(str(path), str(error)) from error
        if file.format != FORMAT:
            raise CoverError(str(path), f"has format {file.format}", expected=str(FORMAT))
        if file.digest != _hash_links(file.links):
            raise CoverError(str(path), "does not match its digest", remedy="fit it again")
        try:
            trees = {
                link: CoverTree(
                    np.array(entry.spheres, dtype=np.float64).reshape(-1, 4),
                    np.array(entry.first_child, dtype=np.int64),
                    np.array(entry.child_count, dtype=np.int64),
                )
                for link, entry in file.links.items()
            }
        except OverflowError as error:
            raise CoverError(str(path), str(error)) from error
        return cls(trees, {link: entry.geometry for link, entry in file.links.items()})


class _LinkFile(msgspec.Struct, forbid_unknown_fields=True):
    geometry: str
    spheres: list[tuple[float, float, float, float]]
    first_child: list[int]
    child_count: list[int]


class _CoverFile(msgspec.Struct, forbid_unknown_fields=True):
    format: int
    digest: str
    links: dict[str, _LinkFile]


def get_surface(robot: Surfaces, link: str) -> FloatArray:
    """Pieces of a link's surface in [m], refused where they cannot be a link's.

    Raises:
        CoverError: There are none, one is not finite, or the link is of no plausible size.
    """
    surface = robot.surface(link)
    if surface.shape not in ((len(surface), 3, 3), (len(surface), 3, 6)) or not len(surface):
        raise CoverError(f"link {link!r}", f"has a surface of shape {surface.shape}")
    if not np.isfinite(surface).all():
        raise CoverError(f"link {link!r}", "has a surface that is not finite")
    corners = compute_corners(surface)
    extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if not SMALLEST <= extent <= LARGEST:
        raise CoverError(
            f"link {link!r}",
            f"is {extent:.6g} m across",
            expected=f"{SMALLEST:g} m to {LARGEST:g} m",
            remedy="give the mesh's unit in the scale of its URDF element (mm: 0.001)",
        )
    farthest = float(np.abs(corners).max())
    if not farthest <= FARTHEST:
        raise CoverError(
            f"link {link!r}",
            f"reaches {farthest:.6g} m from its joint",
            expected=f"at most {FARTHEST:g} m",
            remedy="give lengths in metres",
        )
    return surface


@keep_results(MOST_KEPT)
def _fit_proved(
    surface: FloatArray, spheres: int | None, protrusion: float | None
) -> SphereTree | None:
    """A tree that is proved to contain a surface, as small as that allows; None: no proof.

    What is held again and again is fitted once.
    """
    # Only what makes covers needs these.
    from armguard.cover.containment import is_contained, tighten
    from armguard.cover.fitting import fit_tree

    tree = fit_tree(surface, spheres=spheres, protrusion=protrusion)
    return tighten(surface, tree) if is_contained(surface, tree) else None


def hash_surface(surface: FloatArray) -> str:
    """Digest of a surface, rounded to the grid so that another machine's rounding is the same."""
    cells = np.floor(np.asarray(surface) / GRID + 0.5).astype("<i8")
    return hashlib.sha256(cells.tobytes()).hexdigest()


def _hash_links(links: dict[str, _LinkFile]) -> str:
    return hashlib.sha256(msgspec.json.encode(links, order="deterministic")).hexdigest()


def _read_only(values: NDArray[Any]) -> NDArray[Any]:
    copy = values.copy()
    copy.flags.writeable = False
    return copy


def _check_tree(link: str, tree: CoverTree) -> None:
    """Refuse what is not a tree in breadth-first order, or not made of balls."""
    spheres, first_child, child_count = tree
    count = len(spheres)
    offender = f"cover of link {link!r}"
    if spheres.shape != (count, 4) or not count:
        raise CoverError(offender, f"has shape {spheres.shape}", expected="(n, 4), n > 0")
    if first_child.shape != (count,) or child_count.shape != (count,):
        raise CoverError(offender, "first_child, child_count and spheres differ in length")
    if not (np.isfinite(spheres).all() and (spheres[:, 3] > 0.0).all()):
        raise CoverError(offender, "has a sphere that is not finite or has no radius")
    following = 1
    for first, children in zip(first_child.tolist(), child_count.tolist(), strict=True):
        if children < 0 or (children and first != following) or following + children > count:
            raise CoverError(offender, "is not a tree in breadth-first order")
        following += children
    if following != count:
        raise CoverError(offender, "has spheres that belong to no parent")


def _cut_tree(tree: CoverTree, level: int) -> CoverTree:
    depths = _compute_depths(tree)
    kept = int(np.count_nonzero(depths <= level))  # breadth first: they stand in front
    is_leaf = depths[:kept] == level
    return CoverTree(
        tree.spheres[:kept],
        np.where(is_leaf, 0, tree.first_child[:kept]),
        np.where(is_leaf, 0, tree.child_count[:kept]),
    )


def _compute_depths(tree: CoverTree) -> NDArray[np.int64]:
    parents = compute_parents(tree)
    depths = np.zeros(len(parents), dtype=np.int64)
    for node in range(1, len(parents)):
        depths[node] = depths[parents[node]] + 1
    return depths
