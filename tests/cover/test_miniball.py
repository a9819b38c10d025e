from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.cover.miniball import enclose_points


def enclose_by_trying_all(points):
    """The smallest ball around few points: every ball on two to four of them that holds all."""
    best = np.inf
    for size in (2, 3, 4):
        for chosen in combinations(range(len(points)), size):
            corners = points[list(chosen)]
            edges = corners[1:] - corners[0]
            weights = np.linalg.pinv(2 * edges @ edges.T) @ (edges**2).sum(axis=1)
            center = corners[0] + weights @ edges
            radius = np.linalg.norm(corners - center, axis=1).max()
            if np.linalg.norm(points - center, axis=1).max() <= radius * (1 + 1e-9):
                best = min(best, radius)
    return best


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.sampled_from([1e-3, 1.0, 1e3]))
@settings(max_examples=60)
def test_it_is_the_smallest_ball(seed, count, scale):
    points = np.random.default_rng(seed).normal(size=(count, 3)) * scale
    center, radius = enclose_points(points)
    assert np.linalg.norm(points - center, axis=1).max() <= radius * (1 + 1e-15)
    assert radius == pytest.approx(enclose_by_trying_all(points), rel=1e-9)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([[1.0, 2.0, 3.0]], 0.0),
        ([[1.0, 2.0, 3.0]] * 7, 0.0),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.5),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]], 0.5**0.5),
    ],
)
def test_degenerate_points(points, expected):
    _, radius = enclose_points(np.array(points))
    assert radius == pytest.approx(expected, abs=1e-12)
