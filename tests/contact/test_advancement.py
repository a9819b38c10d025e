from __future__ import annotations

import numpy as np

from armguard.contact import earliest_contact_hull
from support.contact_cases import mixed_case


def test_more_advances_never_lower_the_time():
    rng = np.random.default_rng(6)
    cases = [mixed_case(rng) for _ in range(1_000)]
    for case in cases:
        whole = case | {"p2": np.atleast_2d(case["p2"]), "v2": np.atleast_2d(case["v2"])}
        times = [earliest_contact_hull(**whole, advances=k) for k in (1, 2, 3, 5, 8, 20)]
        assert times == sorted(times)
