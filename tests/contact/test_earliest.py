"""Contact times against high precision and the quartic, and arguments of all kinds."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from armguard.contact import (
    earliest_contact,
    earliest_contact_hull,
    earliest_contact_pair,
)
from support.contact_cases import CONVERGED, ORDINARY, free_cases, grazing_case, random_case, stack

ULPS = 64 * 2.0**-52  # "a few ulp": the kernels subtract 8 of each, several times over


@pytest.mark.parametrize(("decades", "count"), [(3.0, 12_000), (150.0, 12_000)])
def test_free_bodies_against_60_digits(decades, count):
    """No contact before tau, and contact just after it for inputs a few ulp worse."""
    position, velocity, distance, accel = free_cases(np.random.default_rng(7), count, decades)
    times = earliest_contact(position, velocity, distance, accel, advances=CONVERGED)
    never = 0
    with mpmath.workdps(80):
        mpf = mpmath.mpf
        worse = 1 + mpf(ULPS)
        for x, v, eps, a, tau in zip(
            position.tolist(), velocity.tolist(), distance.tolist(), accel.tolist(), times.tolist(),
            strict=True,
        ):  # fmt: skip
            p = [mpf(c) for c in x]
            u = [mpf(c) for c in v]
            xx = p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
            vv = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
            xv = p[0] * u[0] + p[1] * u[1] + p[2] * u[2]

            def apart(t, eps, a, more=0, xx=xx, vv=vv, xv=xv):
                reach = eps + a / 2 * t * t + more
                return xx + 2 * xv * t + vv * t * t > reach * reach

            if tau == math.inf:
                never += 1
                assert apart(mpf(10) ** 400, mpf(eps), mpf(a)), (x, v, eps, a)
                continue
            if tau > 0.0:
                for share in (1, 0.999999, 0.9, 0.37):
                    t = mpf(tau) * share
                    assert apart(t * (1 - mpf(2) ** -150), mpf(eps), mpf(a)), (x, v, eps, a, tau)
            if tau > 1e100:  # products with the time may overflow: safe, and tight enough
                continue
            t = mpf(tau) * (1 + mpf("1e-9"))
            more = (mpmath.sqrt(xx) + mpmath.sqrt(vv) * t) * ULPS
            close = not apart(t, mpf(eps) * worse, mpf(a) * worse, more)
            assert close, ("loose", x, v, eps, a, tau)
    assert never < count / 8


@pytest.mark.parametrize("name", ORDINARY)
def test_nan_anywhere_is_contact_now(name):
    assert earliest_contact_pair(**ORDINARY) > 0.0
    for index in range(np.size(ORDINARY[name])):
        value = np.array(ORDINARY[name])
        value.flat[index] = math.nan
        assert earliest_contact_pair(**ORDINARY | {name: value}) == 0.0
    # Not even where the value can make no difference.
    still = {"a1": 0.0, "s1": 0.0, "v1": np.zeros(3), "a2": 0.0, "s2": 0.0, "v2": np.zeros(3)}
    bad = np.full(np.shape(ORDINARY[name]), math.nan)
    assert earliest_contact_pair(**ORDINARY | still | {name: bad}) == 0.0
    corner = {"p2": np.ones((3, 3)), "v2": np.zeros((3, 3))}
    if name in corner:
        corner[name] = corner[name].copy()
        corner[name][2, 1] = math.nan
        assert earliest_contact_hull(**ORDINARY | corner) == 0.0
    else:
        assert earliest_contact_hull(**ORDINARY | corner | {name: bad}) == 0.0


def test_a_negative_zero_is_a_zero():
    assert earliest_contact_pair(**ORDINARY | {"a1": -0.0, "s2": -0.0, "age1": -0.0}) == (
        earliest_contact_pair(**ORDINARY | {"a1": 0.0, "s2": 0.0, "age1": 0.0})
    )


def test_batch_equals_scalar_loop():
    rng = np.random.default_rng(12)
    cases = [random_case(rng, 3.0) for _ in range(300)] + [grazing_case(rng) for _ in range(100)]
    batch = earliest_contact_pair(**stack(cases))
    assert batch.tolist() == [earliest_contact_pair(**case) for case in cases]
