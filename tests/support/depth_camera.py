"""A camera that measures depth: rays on a grid, cast among balls."""

import numpy as np


class DepthCamera:
    """A pinhole camera, and what its rays meet.

    Args:
        origin: Its centre, in [m].
        target: What it looks at, in [m].
        shape: Rays across and down.
        view: Width of its view, in [rad].
        wall: How far along its axis the background is, in [m].
    """

    def __init__(self, origin, target, shape=(160, 125), view=1.05, wall=5.0):
        self.origin = np.array(origin, dtype=float)
        forward = np.array(target, dtype=float) - self.origin
        forward /= np.linalg.norm(forward)
        aside = np.cross(forward, [0.0, 0.0, 1.0])
        aside /= np.linalg.norm(aside)
        half = np.tan(0.5 * view)
        u = np.linspace(-half, half, shape[0])
        v = np.linspace(-half, half, shape[1]) * shape[1] / shape[0]
        u, v = (grid.ravel()[:, None] for grid in np.meshgrid(u, v))
        self.rays = forward + u * aside + v * np.cross(aside, forward)
        self.wall = wall
        self.spacing = 2.0 * half / (shape[0] - 1)
        """Between neighbouring rays, at a distance of 1 m along the axis, in [m]."""

    def see(self, centers, radii):
        """Where rays end, in [m] of shape (n, 3), and which ball each meets, -1 for none."""
        depth = np.full(len(self.rays), self.wall)
        met = np.full(len(self.rays), -1)
        square = (self.rays**2).sum(axis=1)
        for number, (center, radius) in enumerate(zip(centers, radii, strict=True)):
            offset = np.asarray(center) - self.origin
            along = self.rays @ offset
            root = along**2 - square * (offset @ offset - radius**2)
            first = (along - np.sqrt(np.maximum(root, 0.0))) / square
            hit = (root > 0.0) & (first > 0.0) & (first < depth)
            depth[hit], met[hit] = first[hit], number
        return self.origin + depth[:, None] * self.rays, met
