"""Converts depth images to point clouds, and finds pixels that are not obstacles.

A depth camera gives an image with the depth of the visible surface in each pixel, along the
camera's axis. Apart from usual noise, three effects matter. *Holes* are pixels without a depth.
*Flying pixels* are at edges of surfaces: their depth is somewhere between the surface and what is
behind it, where nothing exists. And the *background* is measured with noise as well.

Points are in the optical frame, as ROS and the makers of cameras have it: x to the right of the
image, y down, z forward along the axis.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEVIATIONS = 4.0
"""Standard deviations that count as the error of a depth: of normal noise, 1 depth in 16,000 is off
by more."""

SUBPIXEL = 0.08
"""Of the disparity, the noise in [pixels] that RealSense's makers advise to reckon with [Grunnet]_.
"""


@dataclasses.dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera, which converts a depth image without distortion to points.

    A pixel (u, v) of depth z is the point (z (u - c_x) / f_x, z (v - c_y) / f_y, z).

    Args:
        focal_length: f_x and f_y, in [pixels].
        center: c_x and c_y, in [pixels]; the centre of the first pixel is (0, 0).
        scale: Metres in a unit of the image: 0.001 for millimetres.
        nearest: Least depth, in [m]; smaller ones count as missing.
        farthest: Greatest depth, in [m]; larger ones count as missing.

    Raises:
        ArmguardError: A number is not finite, or not above 0 where it has to be.
    """

    focal_length: tuple[float, float]
    center: tuple[float, float]
    scale: float = 0.001
    nearest: float = 0.1
    farthest: float = 10.0

    def __post_init__(self) -> None:
        if not (len(self.focal_length) == 2 and all(0.0 < f < math.inf for f in self.focal_length)):
            raise ArmguardError("focal_length", f"is {self.focal_length}", expected="2 above 0")
        if not (len(self.center) == 2 and all(map(math.isfinite, self.center))):
            raise ArmguardError("center", f"is {self.center}", expected="2 finite numbers")
        if not 0.0 < self.scale < math.inf:
            raise ArmguardError("scale", f"is {self.scale}", expected="finite, above 0")
        if not 0.0 < self.nearest < self.farthest < math.inf:
            raise ArmguardError(
                "nearest, farthest",
                f"are {self.nearest} and {self.farthest}",
                expected="0 < nearest < farthest, in m",
            )

    def read(self, image: ArrayLike) -> Array:
        """Depths of an image in [m], NaN where missing. Shape (height, width).

        Args:
            image: In units of `scale`; 0, negative, not finite, nearer than `nearest` or farther
                than `farthest`: none. Shape (height, width).

        Raises:
            ArmguardError: It is no image.
        """
        units = np.asarray(image)
        if units.ndim != 2 or units.dtype.kind not in "iuf":
            raise ArmguardError(
                "image",
                f"has shape {units.shape} of {units.dtype}",
                expected="(height, width) of numbers",
            )
        depth = units * np.float64(self.scale)
        depth[~((depth >= self.nearest) & (depth <= self.farthest))] = np.nan
        return depth

    def place(self, depth: Array) -> Array:
        """Points of all pixels, row by row, NaN where there is none.

        Pass the holes on as well: a source whose clouds are mostly holes is not believed, since a
        covered lens looks like that.

        Args:
            depth: In [m]. Shape (height, width).

        Returns:
            In the optical frame, in [m]. Shape (height * width, 3).
        """
        height, width = depth.shape
        points = np.empty((height, width, 3))
        (x, y), (across, down) = self.center, self.focal_length
        points[..., 0] = depth * ((np.arange(width) - x) / across)
        points[..., 1] = depth * ((np.arange(height) - y) / down)[:, None]
        points[..., 2] = depth
        return points.reshape(-1, 3)

    def position_error(self, depth: float, error: float, shape: tuple[int, int]) -> float:
        """Greatest error of points up to a depth, for `update_cloud(…, position_error=…)`, in [m].

        An error of the depth moves a point along its ray, which is longer than the depth, the most
        in a corner of the image. What lies between points is not measured: half the diagonal
        between four pixels is added, on a surface across the axis.

        Args:
            depth: The farthest, in [m].
            error: Of depths, there, in [m].
            shape: Height and width of the image, in [pixels].
        """
        (x, y), (across, down) = self.center, self.focal_length
        rays = [
            math.hypot(1.0, (column - x) / across, (row - y) / down)
            for row in (0, shape[0] - 1)
            for column in (0, shape[1] - 1)
        ]
        return error * max(rays) + 0.5 * depth * math.hypot(1.0 / across, 1.0 / down)


def stereo_error(
    depth: ArrayLike, focal_length: float, baseline: float, subpixel: float = SUBPIXEL
) -> Array:
    """Greatest error of depths of a stereo camera, in [m]; it grows with the square of the depth.

    Disparity is d = f B / z. If it is off by s pixels, where z is measured the surface is at
    f B / (d - s) at most, farther by s z² / (f B - s z) [Grunnet]_; nearer it is by less. For s,
    four standard deviations are taken.

    Args:
        depth: As measured, in [m]. Any shape.
        focal_length: f of the images that are matched, in [pixels], before any decimation.
        baseline: B, between the two imagers, in [m].
        subpixel: Standard deviation of disparities, in [pixels].

    Returns:
        In the shape of the depths; NaN where they are, inf where a surface may be anywhere behind.

    Raises:
        ArmguardError: A number is not above 0, or not finite.
    """
    named = {"focal_length": focal_length, "baseline": baseline, "subpixel": subpixel}
    for name, value in named.items():
        if not 0.0 < value < math.inf:
            raise ArmguardError(name, f"is {value}", expected="finite, above 0")
    z, noise = np.asarray(depth, float), DEVIATIONS * subpixel
    left = focal_length * baseline - noise * z
    error = np.full(z.shape, np.inf)
    np.divide(noise * z, left, out=error, where=~(left <= 0.0))
    return error * z


def find_flying(depth: Array, step: float, reach: int = 2) -> Mask:
    """Flying pixels of a depth image, which may show no surface.

    A pixel is one if another is nearer by more than `step`, no more than `reach` rows and columns
    away; or if none of its eight neighbours is within `step` of it. Holes are none.

    **What is lost with them.** A pixel that does see a surface counts as flying only near something
    nearer, or where no neighbour sees the same surface. So a surface keeps each pixel that is more
    than `reach` away from all nearer ones, if it shows in two pixels side by side and its depth
    changes by no more than `step` over so many pixels: without noise, up to a slant of
    atan(f step / (z reach)) between the line of sight and the surface's normal. In other words, the
    shadow of what is nearer is wider by `reach` pixels.

    **What stays.** A flying pixel within `step` of a surface cannot be distinguished from it, and
    makes it thicker along the line of sight, by at most `step`.

    Args:
        depth: In [m], NaN where there is none. Shape (height, width).
        step: In [m]: what noise makes of two depths of one surface, and how much the depth of a
            slanted one changes over `reach` pixels.
        reach: How wide edges are that fly, in [pixels]: one, or two where both sides fly.

    Returns:
        Shape (height, width).

    Raises:
        ArmguardError: The step is no length, or the reach no number of pixels.
    """
    if not 0.0 < step < math.inf:
        raise ArmguardError("step", f"is {step}", expected="a length above 0, in m")
    if not (isinstance(reach, int) and reach >= 1):
        raise ArmguardError("reach", f"is {reach!r}", expected="a whole number, at least 1")
    nearest = depth
    for _ in range(reach):
        nearest = _find_nearest_around(nearest)
    height, width = depth.shape
    edged = np.pad(depth, 1, constant_values=np.nan)
    has_level = np.zeros(depth.shape, dtype=np.bool_)
    for row, column in itertools.product(range(3), range(3)):
        if row != 1 or column != 1:
            beside = edged[row : row + height, column : column + width]
            has_level |= np.abs(beside - depth) <= step
    return ((nearest < depth - step) | ~has_level) & np.isfinite(depth)


def _find_nearest_around(depth: Array) -> Array:
    """Least depth of each pixel and its neighbours, NaN where none has one, in [m]."""
    edged = np.pad(depth, 1, constant_values=np.nan)
    rows = np.fmin(np.fmin(edged[:-2], edged[1:-1]), edged[2:])
    least: Array = np.fmin(np.fmin(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
    return least


class Background:
    """The background of a camera: depths of the empty cell, pixel by pixel.

    Shown images of the empty cell, it keeps the least depth of each pixel and its eight neighbours,
    so that edges of the background are background even where their pixels fly. What is farther, or
    nearer by no more than a margin, is background: **a person that near to it is not seen**. A
    pixel in which no depth was ever seen has no background, and all that is seen in it counts as an
    obstacle.
    """

    def __init__(self) -> None:
        self._nearest: Array | None = None

    def learn(self, depth: Array) -> None:
        """Take in an image of the empty cell.

        Args:
            depth: In [m], NaN where there is none. Shape (height, width).

        Raises:
            ArmguardError: It has another shape than those before.
        """
        least = _find_nearest_around(depth)
        self._nearest = least if self._nearest is None else np.fmin(self._recall(depth), least)

    def find_nearer(self, depth: Array, margin: float | Array) -> Mask:
        """Pixels that see something before the background. Shape (height, width).

        Args:
            depth: In [m], NaN where there is none. Shape (height, width).
            margin: How much nearer, in [m], one for all or shape (height, width): errors of depths.

        Raises:
            ArmguardError: The shape is not that of the images before, or none was shown yet.
        """
        # Where either is unknown the comparison fails, so that it is not background.
        is_background: Mask = depth >= self._recall(depth) - margin
        return ~is_background & np.isfinite(depth)

    def _recall(self, depth: Array) -> Array:
        """The background, if it has the shape of an image."""
        if self._nearest is None or depth.shape != self._nearest.shape:
            known = "none was shown" if self._nearest is None else f"{self._nearest.shape}"
            raise ArmguardError(
                "depth", f"has shape {depth.shape}", expected=f"that of the background: {known}"
            )
        return self._nearest
