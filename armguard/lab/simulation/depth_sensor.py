"""What a stereo depth camera makes of true depths: noise, flying pixels and holes.

After what is published of such cameras: disparities are noisy, so noise grows with the square of
the depth [Grunnet]_; pixels at edges fly between two surfaces, as also with time of flight
[Tolgyessy2021]_; and what one of the two imagers does not see, left of each edge, has no depth
[Keselman2017]_. How often pixels at edges fly or miss is chosen: many do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bridges.depth import SUBPIXEL, PinholeCamera

Array = NDArray[np.float64]

EDGE = 0.04
"""Difference of the depths of two neighbouring pixels from which on there is an edge, in [m]."""

MISSED_EDGES = 0.33
"""Share of the pixels at edges that have no depth."""

SPOTS = 12, 3
"""How many squares of an image have no depth, and of how many pixels a side, in [pixels]."""


class StereoSensor(NamedTuple):
    """A stereo camera, as its images are spoilt."""

    camera: PinholeCamera
    """Of the images that it gives."""
    matched_focal_length: float
    """Of the images that it matches, before any decimation, in [pixels]."""
    baseline: float
    """Between its imagers, in [m]."""

    def expose(self, true: Array, random: np.random.Generator) -> NDArray[np.uint16]:
        """An image, in units of the camera's scale; 0 where there is no depth.

        Args:
            true: Depths, in [m]. Shape (height, width).
            random: Where noise comes from.
        """
        shape = height, width = true.shape
        rows, columns = np.indices(shape) + random.integers(-1, 2, (2, *shape))
        beside = true[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        is_edge = np.abs(beside - true) > EDGE
        depth = np.where(is_edge, true + random.random(shape) * (beside - true), true)
        noise = SUBPIXEL / (self.matched_focal_length * self.baseline) * np.square(depth)
        depth += noise * random.normal(size=shape)
        missed = is_edge & (random.random(shape) < MISSED_EDGES)
        # A surface s pixels to the right hides what it is moved across in the other imager.
        disparity = self.camera.focal_length[0] * self.baseline / true
        for shift in range(1, int(np.ptp(disparity)) + 1):
            missed[:, :-shift] |= disparity[:, shift:] - disparity[:, :-shift] >= shift
        count, side = SPOTS
        for top, left in random.integers(
            0, [max(1, height - side), max(1, width - side)], (count, 2)
        ):
            missed[top : top + side, left : left + side] = True
        units = np.where(missed, 0.0, depth / self.camera.scale)
        return np.rint(units.clip(0.0, 65535.0)).astype(np.uint16)
