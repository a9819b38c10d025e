"""Points of surfaces, and whether they are inside spheres, in plain NumPy."""

import numpy as np


def areas(triangles):
    sides = triangles[:, 1:] - triangles[:, :1]
    return np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2.0


def sample(triangles, count, seed=0):
    """Points spread evenly over triangles. Shape (count, 3)."""
    generator = np.random.default_rng(seed)
    share = areas(triangles) / areas(triangles).sum()
    chosen = triangles[generator.choice(len(triangles), size=count, p=share)]
    return np.einsum("ij,ijk->ik", generator.dirichlet(np.ones(3), size=count), chosen)


def is_inside(points, spheres):
    offsets = np.linalg.norm(points[:, None] - spheres[:, :3], axis=2)
    return (offsets <= spheres[:, 3]).any(axis=1)
