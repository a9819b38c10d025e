from __future__ import annotations

import math

import numpy as np
import pytest

from armguard.contact import earliest_contact, earliest_contact_hull, earliest_contact_pair
from support.contact_cases import CONVERGED, ordinary_case


def test_hull_of_one_place_is_a_ball_and_order_does_not_matter():
    rng = np.random.default_rng(9)
    for _ in range(300):
        case = ordinary_case(rng)
        ball = earliest_contact_pair(**case, advances=CONVERGED)
        eight = {name: np.repeat(case[name][None], 8, axis=0) for name in ("p2", "v2")}
        assert earliest_contact_hull(**case | eight, advances=CONVERGED) == pytest.approx(
            ball, rel=1e-9
        )
        box = ordinary_case(rng, 8)
        order = rng.permutation(8)
        shuffled = {name: box[name][order] for name in ("p2", "v2")}
        assert earliest_contact_hull(**box | shuffled, advances=CONVERGED) == pytest.approx(
            earliest_contact_hull(**box, advances=CONVERGED), rel=1e-6
        )


def test_capsule_is_the_earliest_of_its_balls():
    """Without speed bounds and at rest relative to each other its points can be taken singly."""
    rng = np.random.default_rng(10)
    for _ in range(100):
        ends, velocity, accel = rng.normal((3.0, 0, 0), 1.0, (2, 3)), rng.normal(size=3), 2.0
        share = np.linspace(0.0, 1.0, 2_001)[:, None]
        balls = earliest_contact(
            ends[0] * (1 - share) + ends[1] * share, velocity, 0.1, accel, advances=CONVERGED
        )
        still = np.zeros(3)
        capsule = earliest_contact_hull(
            still, still, 0.0, 0.0, ends, velocity[None], accel, math.inf, 0.1, advances=CONVERGED
        )
        assert capsule <= balls.min() * (1.0 + 1e-12)
        assert capsule == pytest.approx(balls.min(), rel=1e-4)
