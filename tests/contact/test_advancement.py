from __future__ import annotations

import math

import numpy as np

from armguard.contact import earliest_contact_hull
from armguard.contact.advancement import pair_distance_time, trace_contact_time
from armguard.contact.bodies import Ball, Bounds, Hull
from support.contact_cases import CONVERGED, mixed_case, ordinary_case


def test_more_advances_never_lower_the_time():
    rng = np.random.default_rng(6)
    cases = [mixed_case(rng) for _ in range(1_000)]
    for case in cases:
        whole = case | {"p2": np.atleast_2d(case["p2"]), "v2": np.atleast_2d(case["v2"])}
        times = [earliest_contact_hull(**whole, advances=k) for k in (1, 2, 3, 5, 8, 20)]
        assert times == sorted(times)


def test_cheaper_rung_is_below():
    rng = np.random.default_rng(7)
    points, velocities = np.zeros((8, 3)), np.zeros((8, 3))
    positive = 0
    for _ in range(2_000):
        case = ordinary_case(rng, int(rng.integers(1, 9)))
        corners = np.atleast_2d(case["p2"])
        count = len(corners)
        points[:count], velocities[:count] = corners, np.broadcast_to(case["v2"], corners.shape)
        bounds1, bounds2 = (
            Bounds(*(float(case[f"{name}{n}"]) for name in ("a", "s", "velocity_error", "age")))
            for n in (1, 2)
        )
        ball = Ball(*case["p1"], *case["v1"], bounds1)
        arguments = ball, Hull(points, velocities, count, bounds2), case["contact_distance"]
        cheap = pair_distance_time(*arguments)
        assert 0.0 <= cheap <= trace_contact_time(*arguments, CONVERGED, None) * (1.0 + 1e-9)
        positive += cheap > 0.0
    assert positive > 200


def test_cheaper_rung_ends_at_0_where_speeds_overflow():
    points, velocities = np.zeros((8, 3)), np.zeros((8, 3))
    points[0], velocities[0] = 1.0, -1.7e308  # faster along the diagonal than a float can tell
    for speed in (1.0, math.inf):
        hull = Hull(points, velocities, 1, Bounds(1.0, speed, 0.0, 0.0))
        still = Ball(*[0.0] * 6, Bounds(0.0, 0.0, 0.0, 0.0))
        assert pair_distance_time(still, hull, 0.0) == 0.0
