"""The point of a hull that is closest to the origin, by an algorithm of its own."""

from __future__ import annotations

import numpy as np


def closest_in_hull(points, iterations=200):
    """Wolfe's algorithm: the point of a convex hull that is closest to the origin."""
    active = [int(np.argmin((points**2).sum(axis=1)))]
    weights = np.array([1.0])
    for _ in range(iterations):
        nearest = weights @ points[active]
        entering = int(np.argmin(points @ nearest))
        if entering in active or nearest @ (nearest - points[entering]) <= 1e-15:
            break
        active, weights = [*active, entering], np.append(weights, 0.0)
        while True:
            corners = points[active]
            size = len(active)
            system = np.ones((size + 1, size + 1))
            system[:size, :size] = corners @ corners.T
            system[-1, -1] = 0.0
            right = np.append(np.zeros(size), 1.0)
            affine = np.linalg.lstsq(system, right, rcond=None)[0][:size]
            if (affine >= -1e-12).all():
                weights = np.maximum(affine, 0.0)
                break
            falling = affine < weights
            shares = weights[falling] / (weights[falling] - affine[falling])
            weights = weights + min(shares.min(), 1.0) * (affine - weights)
            kept = weights > 1e-14
            active = [corner for corner, keep in zip(active, kept, strict=True) if keep]
            weights = weights[kept] / weights[kept].sum()
    return weights @ points[active]
