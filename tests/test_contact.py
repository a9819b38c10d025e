"""Contact times against high precision, the quartic, an adversary, and the laws they must obey."""

from __future__ import annotations

import math
import warnings

import mpmath
import numpy as np
import pytest
from contact_cases import grazing_case, mixed_case, ordinary_case, random_case

from armguard.contact import (
    earliest_contact,
    earliest_contact_hull,
    earliest_contact_pair,
    pair_contact_time,
    pair_distance_time,
)
from armguard.exceptions import ArmguardError

CONVERGED = 200
ULPS = 64 * 2.0**-52  # "a few ulp": the kernels subtract 8 of each, several times over


def _stack(cases):
    """Many cases of single points as arrays."""
    return {name: np.array([case[name] for case in cases]) for name in cases[0]}


def _converged(cases):
    return earliest_contact_pair(**_stack(cases), advances=CONVERGED)


def _turned(case, rotation):
    vectors = {name: np.asarray(case[name]) @ rotation.T for name in ("p1", "v1", "p2", "v2")}
    return case | vectors


def _swapped(case):
    other = {"1": "2", "2": "1"}
    return {
        name[:-1] + other[name[-1]] if name[-1] in other else name: value
        for name, value in case.items()
    }


# The quartic -----------------------------------------------------------------------------------


def _free_cases(rng, count, decades):
    """One moving point without speed bound, in any mixture of magnitudes: the quartic's domain."""
    position = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-decades, decades, (count, 1))
    velocity = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-decades, decades, (count, 1))
    accel = 10.0 ** rng.uniform(-decades, decades, count)
    distance = np.linalg.norm(position, axis=1) * rng.uniform(0.0, 1.0, count)
    velocity[::17] = 0.0
    accel[5::17] = 0.0
    distance[3::17] = 0.0
    graze = slice(7, None, 4)  # an acceleration that just about fills the gap at its narrowest
    closest = -np.sum(position * velocity, 1)[graze] / np.sum(velocity**2, 1).clip(1e-300)[graze]
    miss = np.linalg.norm(position[graze] + velocity[graze] * closest[:, None], axis=1)
    distance[graze] = miss * rng.uniform(0.0, 1.0, miss.size)
    with np.errstate(all="ignore"):
        filling = 2.0 * (miss - distance[graze]) / closest**2
        filling *= 1.0 + 10.0 ** rng.uniform(-16, -1, miss.size) * rng.choice([-1, 1], miss.size)
        usable = (filling > 1e-150) & (filling < 1e150)
    accel[graze] = np.where(usable, filling, accel[graze])
    return position, velocity, distance, accel


@pytest.mark.parametrize(("decades", "count"), [(3.0, 12_000), (150.0, 12_000)])
def test_free_bodies_against_60_digits(decades, count):
    """No contact before tau, and contact just after it for inputs a few ulp worse."""
    position, velocity, distance, accel = _free_cases(np.random.default_rng(7), count, decades)
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
            t = mpf(tau) * (1 + mpf("1e-9"))
            more = (mpmath.sqrt(xx) + mpmath.sqrt(vv) * t) * ULPS
            close = not apart(t, mpf(eps) * worse, mpf(a) * worse, more)
            assert close, ("loose", x, v, eps, a, tau)
    assert never < count / 8


def test_smallest_root_of_the_quartic():
    position, velocity, distance, accel = _free_cases(np.random.default_rng(8), 600, 3.0)
    times = earliest_contact(position, velocity, distance, accel, advances=CONVERGED)
    compared = 0
    for x, v, eps, a, tau in zip(position, velocity, distance, accel, times, strict=True):
        if not 0.0 < tau < math.inf or a == 0.0:
            continue
        with mpmath.workdps(60):
            x, v, eps, a = mpmath.matrix(x), mpmath.matrix(v), mpmath.mpf(eps), mpmath.mpf(a)
            xx, vv, xv = (x.T * x)[0], (v.T * v)[0], (x.T * v)[0]
            scale = mpmath.mpf(tau)
            coefficients = [
                -(a**2) / 4 * scale**4, 0, (vv - eps * a) * scale**2, 2 * xv * scale, xx - eps**2
            ]  # fmt: skip
            with warnings.catch_warnings():  # the order of coefficients changes with mpmath 1.4
                warnings.simplefilter("ignore", DeprecationWarning)
                roots = mpmath.polyroots(coefficients, maxsteps=400, extraprec=400)
            real = [mpmath.re(r) for r in roots if abs(mpmath.im(r)) < mpmath.mpf(10) ** -40]
            # Beyond this, the square of a negative reach would count as contact.
            smallest = min(r for r in real if r > 0)
            assert smallest >= 1 - mpmath.mpf(10) ** -50
        compared += 1
        assert float(smallest) == pytest.approx(1.0, rel=1e-7) or _is_graze(coefficients)
    assert compared > 400


def _is_graze(coefficients):
    """Whether contact a hair's breadth closer would come right now: the root may then jump."""
    near = [sum(c * t ** (4 - i) for i, c in enumerate(coefficients)) for t in (1.0, 1.0 + 1e-7)]
    return min(near) < 1e-12 * max(abs(c) for c in coefficients)


# Laws ------------------------------------------------------------------------------------------


def _law_cases(seed, count=400):
    """Pairs that no speed bound is broken in, whose contact time is neither 0 nor inf."""
    rng = np.random.default_rng(seed)
    cases = []
    while len(cases) < count:
        case = ordinary_case(rng)
        for i in "12":
            speed = float(np.linalg.norm(case["v" + i])) - case["velocity_error" + i]
            case["s" + i] = max(case["s" + i], 1.01 * speed)
        if 0.0 < earliest_contact_pair(**case, advances=CONVERGED) < math.inf:
            cases.append(case)
    return cases


def test_rotation_exchange_and_units_change_nothing():
    rng = np.random.default_rng(3)
    cases = _law_cases(3)
    times = _converged(cases)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    np.testing.assert_allclose(_converged([_turned(c, rotation) for c in cases]), times, rtol=1e-9)
    np.testing.assert_allclose(_converged([_swapped(c) for c in cases]), times, rtol=1e-9)
    length, time = 0.3048, 1e-3  # feet and milliseconds
    unit = {
        "p": length, "v": length / time, "a": length / time**2, "s": length / time,
        "velocity_error": length / time, "age": time, "contact_distance": length,
    }  # fmt: skip
    changed = [{n: v / unit[n.rstrip("12")] for n, v in case.items()} for case in cases]
    np.testing.assert_allclose(_converged(changed) * time, times, rtol=1e-9)


@pytest.mark.parametrize(
    "name", ["a1", "a2", "s1", "s2", "contact_distance", "velocity_error1", "velocity_error2"]
)
def test_looser_bounds_never_raise_the_time(name):
    cases = _law_cases(4)
    times = _converged(cases)
    for more in (1e-9, 0.01, 1.0):
        looser = _converged([case | {name: case[name] + more} for case in cases])
        assert (looser <= times * (1.0 + 1e-9)).all()


def test_age_of_both_lowers_the_time_by_as_much():
    cases = _law_cases(5)
    times = _converged(cases)
    for older in (0.003, 0.1):
        aged = _converged(
            [c | {"age1": c["age1"] + older, "age2": c["age2"] + older} for c in cases]
        )
        assert (aged >= times - older - 1e-9).all()
        reached = times >= older
        np.testing.assert_allclose(aged[reached], times[reached] - older, rtol=1e-9, atol=1e-9)


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
        arguments = (
            *case["p1"], *case["v1"], case["a1"], case["s1"], case["velocity_error1"], case["age1"],
            points, velocities, count, case["a2"], case["s2"], case["velocity_error2"],
            case["age2"], case["contact_distance"],
        )  # fmt: skip
        cheap = pair_distance_time(*arguments)
        assert 0.0 <= cheap <= pair_contact_time(*arguments, CONVERGED) * (1.0 + 1e-9)
        positive += cheap > 0.0
    assert positive > 200


def test_relative_form_is_a_pair_with_one_at_rest():
    rng = np.random.default_rng(8)
    position, velocity, distance, accel = _free_cases(rng, 500, 3.0)
    speed = np.linalg.norm(velocity, axis=1) * rng.uniform(0.5, 3.0, 500)
    relative = earliest_contact(position, velocity, distance, accel, speed)
    still = np.zeros(3)
    pair = earliest_contact_pair(still, still, 0.0, 0.0, position, velocity, accel, speed, distance)
    np.testing.assert_array_equal(relative, pair)


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


# An adversary ----------------------------------------------------------------------------------


def _pursuit(v, accel, speed, heading, t):
    """Displacement at `t` of a body in the plane that makes for `heading` as hard as it may.

    Full acceleration along the heading until the speed bound is met, then at that speed with all
    the acceleration spent on turning, then straight on: feasible at every moment.
    """
    along, across = v @ heading, abs(v[0] * heading[1] - v[1] * heading[0])
    side = np.array([-heading[1], heading[0]])
    if v @ side < 0.0:
        side = -side
    limit = math.sqrt(max(speed**2 - across**2, 0.0))
    meet = max(0.0, (limit - along) / accel)
    first = np.minimum(t, meet)
    forward = along * first + 0.5 * accel * first**2
    sideward = across * first
    angle = math.atan2(across, along + accel * meet)
    turning = np.clip(t - meet, 0.0, angle * speed / accel)
    left = angle - turning * accel / speed
    forward += speed**2 / accel * (math.sin(angle) - np.sin(left))
    sideward += speed**2 / accel * (np.cos(left) - math.cos(angle))
    forward += speed * np.maximum(t - meet - angle * speed / accel, 0.0)
    return forward[:, None] * heading + sideward[:, None] * side


def test_an_adversary_within_bounds_comes_just_after():
    """Never before tau: soundness. Soon after: tightness, with speed bounds."""
    rng = np.random.default_rng(11)
    ratios = []
    while len(ratios) < 120:
        case = ordinary_case(rng)
        case |= {"age1": 0.0, "age2": 0.0, "velocity_error1": 0.0, "velocity_error2": 0.0}
        for name in ("p1", "v1", "p2", "v2"):
            case[name] = case[name] * [1.0, 1.0, 0.0]
        for i in "12":
            case["a" + i] = float(rng.uniform(1.0, 20.0))
            speed = float(np.linalg.norm(case["v" + i]))
            case["s" + i] = speed * float(rng.choice([1.0 + 1e-12, 1.2, 3.0])) + 1e-3
        tau = earliest_contact_pair(**case, advances=CONVERGED)
        if not 0.0 < tau < 10.0:
            continue
        away = case["p1"] - case["p2"]
        centre, span = math.atan2(away[1], away[0]), 0.75 * math.pi
        for _ in range(5):
            headings = centre + span * np.linspace(-1.0, 1.0, 25)
            centre = min(headings, key=lambda heading: _miss(case, heading, tau))
            span /= 6.0
        best = _arrival(case, centre, tau)
        assert best >= tau * (1.0 - 1e-9), case
        ratios.append(tau / best)
    assert min(ratios) > 0.95
    assert np.median(ratios) > 0.99


def _apart(case, heading, t):
    """Distance from contact at `t`, both making for each other along the heading."""
    way = np.array([math.cos(heading), math.sin(heading)])
    one = _pursuit(case["v1"][:2], case["a1"], case["s1"], -way, t)
    other = _pursuit(case["v2"][:2], case["a2"], case["s2"], way, t)
    gap = (case["p2"] - case["p1"])[:2] + other - one
    return np.hypot(gap[:, 0], gap[:, 1]) - case["contact_distance"]


def _miss(case, heading, tau):
    """How soon the two touch, as the step of a grid; if they do not, how closely they miss."""
    distances = _apart(case, heading, tau * np.linspace(0.9, 1.06, 33))
    touching = np.flatnonzero(distances <= 0.0)
    if not touching.size:
        return 100.0 + float(distances.min())
    first = int(touching[0])
    return first - float(distances[first]) / (float(distances[first - 1] - distances[first]))


def _arrival(case, heading, tau):
    grid = tau * np.linspace(0.9, 1.2, 3_001)
    touching = np.flatnonzero(_apart(case, heading, grid) <= 0.0)
    if not touching.size:
        return math.inf
    low, high = grid[max(touching[0] - 1, 0)], grid[touching[0]]
    for _ in range(40):
        middle = 0.5 * (low + high)
        if _apart(case, heading, np.array([middle]))[0] <= 0.0:
            high = middle
        else:
            low = middle
    return float(high)


# Bad and unusual input -------------------------------------------------------------------------

ORDINARY = {
    "p1": np.zeros(3), "v1": np.array([0.1, 0.0, 0.0]), "a1": 5.0, "s1": 2.0,
    "p2": np.array([1.0, 0.5, 0.0]), "v2": np.array([0.0, -0.2, 0.0]), "a2": 10.0, "s2": 2.0,
    "contact_distance": 0.2, "age1": 0.01, "age2": -0.005,
    "velocity_error1": 0.01, "velocity_error2": 0.02,
}  # fmt: skip


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


@pytest.mark.parametrize(
    "name", ["a1", "s1", "a2", "s2", "contact_distance", "velocity_error1", "velocity_error2"]
)
def test_negative_bounds_are_named_with_their_index(name):
    values = np.ones((2, 3))
    values[1, 2] = -0.5
    with pytest.raises(ArmguardError, match=rf"{name}\[1, 2\]: is -0.5"):
        earliest_contact_pair(**ORDINARY | {name: values})
    with pytest.raises(ArmguardError, match=rf"{name}: is -1.0"):
        earliest_contact_pair(**ORDINARY | {name: -1.0})


def test_malformed_arguments_are_named():
    for name in ("p1", "v1", "p2", "v2"):
        with pytest.raises(ArmguardError, match=name):
            earliest_contact_pair(**ORDINARY | {name: [1.0, 2.0]})
    with pytest.raises(ArmguardError, match="do not broadcast"):
        earliest_contact_pair(**ORDINARY | {"a1": np.ones(3), "a2": np.ones(4)})
    with pytest.raises(ArmguardError, match="advances"):
        earliest_contact_pair(**ORDINARY, advances=0)
    with pytest.raises(ArmguardError, match="points"):
        earliest_contact_hull(**ORDINARY | {"p2": np.ones((9, 3)), "v2": np.ones((9, 3))})
    with pytest.raises(ArmguardError, match="accel"):
        earliest_contact([1.0, 0, 0], [0.0, 0, 0], 0.1, -1.0)


def test_shapes_broadcast_and_scalars_stay_scalars():
    single = earliest_contact_pair(**ORDINARY)
    assert isinstance(single, float)
    assert isinstance(earliest_contact([1.0, 0, 0], [0.0, 0, 0], 0.1, 1.0), float)
    many = earliest_contact_pair(**ORDINARY | {"a1": np.full((4, 1), 5.0), "s2": np.full(3, 2.0)})
    assert many.shape == (4, 3)
    assert (many == single).all()
    assert earliest_contact_pair(**ORDINARY | {"a1": np.ones(0)}).shape == (0,)


def test_batch_equals_scalar_loop():
    rng = np.random.default_rng(12)
    cases = [random_case(rng, 3.0) for _ in range(300)] + [grazing_case(rng) for _ in range(100)]
    batch = earliest_contact_pair(**_stack(cases))
    assert batch.tolist() == [earliest_contact_pair(**case) for case in cases]
