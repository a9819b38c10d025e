"""Points of spheres and capsules, drawn without their patches."""

import coal
import numpy as np


def half_length(shape):
    return shape.halfLength if isinstance(shape, coal.Capsule) else 0.0


def distance_from_core(points, shape):
    """From the middle of a sphere, or the axis segment of a capsule."""
    end = half_length(shape)
    nearest = np.clip(points[..., 2], -end, end)
    return np.sqrt((points[..., :2] ** 2).sum(axis=-1) + (points[..., 2] - nearest) ** 2)


def surface_points(shape, count=3000, seed=0):
    """Points on the surface, drawn without its patches."""
    generator = np.random.default_rng(seed)
    across = generator.normal(size=(count, 3))
    axial = generator.uniform(-1.0, 1.0, size=count) * half_length(shape)
    side = generator.random(count) < 0.5
    across[side, 2] *= 0.0 if half_length(shape) else 1.0
    points = shape.radius * across / np.linalg.norm(across, axis=1, keepdims=True)
    cap = np.sign(points[:, 2]) * half_length(shape)
    points[:, 2] += np.where(side, axial, cap)
    np.testing.assert_allclose(distance_from_core(points, shape), shape.radius)
    return points
