"""Reports about a cover: whether it is proved, its number of balls, protrusion and volume.

The proof is that of `containment`. The figures beside it are for people: protrusion is measured
on the surface of the leaves, volumes on a grid of points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armguard.cover.containment import is_contained
from armguard.cover.patches import compute_corners
from armguard.cover.signed_distance import Surface, arrange_surface, compute_signed_distances
from armguard.cover.sphere_tree import SphereTree
from armguard.jit.arrays import FloatArray

_DIRECTIONS = 200  # points on each leaf
_CELLS = 3000  # points in the box around a link's leaves


@dataclass(frozen=True)
class LinkReport:
    """Report about one link's cover."""

    proved: bool
    """Whether every piece of surface is proved to be inside a leaf and all balls above it."""
    count: int
    """Number of leaves."""
    max_protrusion: float
    """Greatest distance of a leaf's point from the link, in [m]."""
    mean_protrusion: float
    """Distance to the link, averaged over the surface of the union of leaves, in [m]."""
    area: float
    """Area of the surface of the union of leaves, in [m²]; measured on a few hundred points per
    leaf."""
    union_volume: float
    """Volume of the union of leaves, in [m³]; measured on a grid."""
    link_volume: float
    """Volume of the link, in [m³], measured on the same grid; 0 if its surface encloses nothing."""

    @property
    def volume_ratio(self) -> float:
        """Volume of the union of leaves over that of the link; inf if the link has none."""
        return _divide(self.union_volume, self.link_volume)


@dataclass(frozen=True)
class CoverReport:
    """The result of `Cover.check`, by link and in total."""

    links: dict[str, LinkReport]

    @property
    def proved(self) -> bool:
        """Whether every link is covered."""
        return all(link.proved for link in self.links.values())

    @property
    def count(self) -> int:
        """Number of leaves."""
        return sum(link.count for link in self.links.values())

    @property
    def max_protrusion(self) -> float:
        """Greatest distance of a leaf's point from its link, in [m]."""
        return max(link.max_protrusion for link in self.links.values())

    @property
    def mean_protrusion(self) -> float:
        """Distance to the link, averaged over the surfaces of all unions, in [m]."""
        links = self.links.values()
        return _divide(
            sum(link.mean_protrusion * link.area for link in links),
            sum(link.area for link in links),
        )

    @property
    def volume_ratio(self) -> float:
        """Volume of all unions over that of all links; inf if these have none."""
        links = self.links.values()
        return _divide(
            sum(link.union_volume for link in links), sum(link.link_volume for link in links)
        )


def report_link(tree: SphereTree, surface: FloatArray) -> LinkReport:
    """Prove and measure one link's cover.

    Args:
        tree: Its balls.
        surface: Its pieces as `patches` has them, in [m], finite; n > 0.
    """
    leaves = tree.spheres[tree.child_count == 0]
    arranged = arrange_surface(compute_corners(surface))
    protrusions = leaves[:, 3] + compute_signed_distances(leaves[:, :3], arranged)
    mean, area = _measure_surface(leaves, arranged)
    union_volume, link_volume = _measure_volumes(leaves, arranged)
    return LinkReport(
        proved=is_contained(surface, tree),
        count=len(leaves),
        max_protrusion=float(protrusions.max()),
        mean_protrusion=mean,
        area=area,
        union_volume=union_volume,
        link_volume=link_volume,
    )


def _measure_surface(leaves: FloatArray, link: Surface) -> tuple[float, float]:
    """Mean protrusion in [m] and area in [m²] of the surface of the union."""
    centers, radii = leaves[:, :3], leaves[:, 3]
    directions = _spread_directions(_DIRECTIONS)
    points, weights = [np.zeros((0, 3))], [np.zeros(0)]
    for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        surface = center + radius * directions
        distances = np.sqrt(((surface[:, None] - centers) ** 2).sum(axis=2))
        distances[:, i] = np.inf
        exposed = surface[(distances >= radii).all(axis=1)]
        points.append(exposed)
        weights.append(np.full(len(exposed), 4.0 * np.pi * radius**2 / _DIRECTIONS))
    outside = np.maximum(compute_signed_distances(np.concatenate(points), link), 0.0)
    weight = np.concatenate(weights)
    area = float(weight.sum())
    return _divide(float((outside * weight).sum()), area), area


def _measure_volumes(leaves: FloatArray, link: Surface) -> tuple[float, float]:
    """Volumes of the union and of the link, in [m³], counted on one grid around the union."""
    lower = (leaves[:, :3] - leaves[:, 3:]).min(axis=0)
    extent = (leaves[:, :3] + leaves[:, 3:]).max(axis=0) - lower
    step = float(np.prod(extent) / _CELLS) ** (1 / 3)
    axes = [lower[i] + step * (np.arange(np.ceil(extent[i] / step)) + 0.5) for i in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    squared = ((points[:, None] - leaves[:, :3]) ** 2).sum(axis=2)
    in_union = (squared <= leaves[:, 3] ** 2).any(axis=1)
    corners = link.triangles.reshape(-1, 3)
    near = ((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1)
    in_link = compute_signed_distances(points[near], link) < 0.0
    return float(in_union.sum()) * step**3, float(in_link.sum()) * step**3


def _spread_directions(count: int) -> FloatArray:
    """Unit vectors spread evenly over the sphere, on a Fibonacci spiral. Shape (count, 3)."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)


def _divide(numerator: float, denominator: float) -> float:
    return numerator / denominator if denominator > 0.0 else float("inf")
