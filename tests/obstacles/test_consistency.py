from __future__ import annotations

import math
import sys
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.jit.numerics import (
    ALLOWED,
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    SHAPE,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
)
from armguard.obstacles.consistency import (
    body_allows,
    clearly_allows,
    find_broken_bound,
    find_square_limit,
)
from armguard.obstacles.record import Record
from armguard.obstacles.table import MAXIMUM_POINTS, make_states

INF = math.inf


def record(
    x=(0.0, 0.0, 0.0),
    v=(0.0, 0.0, 0.0),
    radius=0.1,
    accel=10.0,
    speed=2.0,
    position_error=0.0,
    velocity_error=0.0,
    stamp=0.0,
):
    return {
        "points": np.array(x, dtype=float).reshape(-1, 3),
        "velocities": np.array(v, dtype=float).reshape(-1, 3),
        "radius": radius,
        "accel": accel,
        "speed": speed,
        "position_error": position_error,
        "velocity_error": velocity_error,
        "stamp": stamp,
    }


def lay(old, new):
    states = make_states(2, MAXIMUM_POINTS)
    for row, one in enumerate((old, new)):
        states.point_count[row] = len(one["points"])
        for field, value in one.items():
            array = getattr(states, field)
            if field in ("points", "velocities"):
                array[row, : len(value)] = value
            else:
                array[row] = value
    return [
        Record(states, row, one["radius"], one["accel"], one["speed"])
        for row, one in enumerate((old, new))
    ]


def judge(old, new):
    return body_allows(*lay(old, new))


def judge_plainly(old, new):
    """The four conditions as they stand, in NumPy; the smallest room left in any, relative."""
    h = new["stamp"] - old["stamp"]
    norm = np.linalg.norm
    x0, v0, x1, v1 = old["points"], old["velocities"], new["points"], new["velocities"]
    errors = old["position_error"] + new["position_error"] + old["radius"] - new["radius"]
    by_accel = old["accel"] * h * h / 2 + old["velocity_error"] * abs(h)
    rooms = [
        errors + by_accel - norm(x1 - x0 - v0 * h, axis=1).max(),
        errors + old["speed"] * abs(h) - norm(x1 - x0, axis=1).max(),
        old["accel"] * abs(h)
        + old["velocity_error"]
        + new["velocity_error"]
        - norm(v1 - v0, axis=1).max(),
        old["speed"] + new["velocity_error"] - norm(v1, axis=1).max(),
    ]
    return min(rooms)


def in_ball(rng, count, radius):
    vector = rng.normal(size=(count, 3))
    vector /= np.linalg.norm(vector, axis=1, keepdims=True)
    # Errors are often as large as they may be.
    return vector * radius * rng.choice([1.0, 1.0, rng.uniform()]) * (1 - 1e-12)


def move_feasibly(rng, steps, accel, speed):
    """Times, positions and velocities of a body that presses against its bounds."""
    times, positions, velocities = [0.0], [np.zeros(3)], [np.zeros(3)]
    for _ in range(steps):
        h = rng.choice([0.001, 0.01, 0.1]) * rng.uniform(0.1, 1.0)
        push = in_ball(rng, 1, accel)[0]
        after = velocities[-1] + push * h
        if not np.linalg.norm(after) <= speed * (1 - 1e-12):
            # Between two velocities inside the bound lies none outside.
            after *= speed * (1 - 1e-12) / np.linalg.norm(after)
            push = (after - velocities[-1]) / h
            if not np.linalg.norm(push) <= accel:
                push, after = np.zeros(3), velocities[-1]
        positions.append(positions[-1] + velocities[-1] * h + push * h * h / 2)
        velocities.append(after)
        times.append(times[-1] + h)
    return np.array(times), np.array(positions), np.array(velocities)


@pytest.mark.parametrize("position_error", [1e-12, 0.02])
@pytest.mark.parametrize("velocity_error", [1e-12, 0.3])
@pytest.mark.parametrize(("accel", "speed"), [(10.0, 2.0), (100.0, 0.5), (10.0, INF), (INF, INF)])
def test_feasible_motions_are_never_refused(accel, speed, position_error, velocity_error):
    rng = np.random.default_rng(1)
    for _ in range(10):
        motion = move_feasibly(rng, 40, min(accel, 50.0), min(speed, 5.0))
        records = [
            record(
                x + in_ball(rng, 1, position_error)[0],
                v + in_ball(rng, 1, velocity_error)[0],
                accel=accel,
                speed=speed,
                position_error=position_error,
                velocity_error=velocity_error,
                stamp=100.0 + t,
            )
            for t, x, v in zip(*motion, strict=True)
        ]
        for old in records:
            for new in records:
                assert judge(old, new) == ALLOWED


@given(
    st.integers(0, 2),
    st.floats(1e-6, 1e3),
    st.floats(1e-4, 10.0),
    st.floats(-5.0, 5.0),
    st.floats(-10.0, 10.0),
    st.floats(0.0, 1e6),
)
def test_full_acceleration_without_errors_is_not_refused_for_rounding(
    axis, accel, h, x0, v0, stamp
):
    later = stamp + h
    exact_h = Fraction(later) - Fraction(stamp)
    x1 = Fraction(x0) + Fraction(v0) * exact_h + Fraction(accel) * exact_h**2 / 2
    v1 = Fraction(v0) + Fraction(accel) * exact_h
    unit = np.eye(3)[axis]
    old = record(x0 * unit, v0 * unit, accel=accel, speed=INF, stamp=stamp)
    new = record(float(x1) * unit, float(v1) * unit, accel=accel, speed=INF, stamp=later)
    assert judge(old, new) == ALLOWED
    assert judge(new, old) == ALLOWED


JUST_BEYOND = 1.0 + 1e-9


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_each_bound_refuses_what_is_just_beyond(sign, scale):
    h = 0.25 * sign
    old = record(accel=10.0 * scale, speed=2.0 * scale, radius=0.0)
    tight = record(accel=10.0 * scale, speed=0.5 * scale, radius=0.0)
    unit = np.array([0.6, 0.0, 0.8])
    by_accel = 5.0 * scale * h * h
    cases = [
        (POSITION_BY_ACCEL, old, record(unit * by_accel * JUST_BEYOND, radius=0.0, stamp=h)),
        (POSITION_BY_SPEED, tight, record(unit * 0.125 * scale * JUST_BEYOND, radius=0, stamp=h)),
        (VELOCITY_BY_SPEED, tight, record(v=unit * 0.5 * scale * JUST_BEYOND, radius=0, stamp=h)),
    ]
    old["speed"] = INF
    change = record(v=unit * 2.5 * scale * JUST_BEYOND, radius=0.0, stamp=h)
    cases.append((VELOCITY_BY_ACCEL, old, change))
    for code, before, after in cases:
        assert judge(before, after) == code
        for key in ("points", "velocities"):
            after[key] = after[key] / JUST_BEYOND**2
        assert judge(before, after) == ALLOWED


def test_agrees_with_plain_arithmetic():
    rng = np.random.default_rng(2)
    seen = {True: 0, False: 0}
    for _ in range(3000):
        count = rng.integers(1, 9)
        h = rng.uniform(-0.5, 0.5)
        old = record(
            rng.normal(size=(count, 3)),
            rng.normal(size=(count, 3)),
            radius=rng.uniform(0.0, 0.2),
            accel=rng.uniform(0.0, 10.0),
            speed=rng.uniform(0.5, 4.0),
            position_error=rng.uniform(0.0, 0.1),
            velocity_error=rng.uniform(0.0, 0.1),
            stamp=5.0,
        )
        new = record(
            old["points"] + old["velocities"] * h + rng.normal(size=(count, 3)) * 0.05,
            old["velocities"] + rng.normal(size=(count, 3)) * 0.3,
            radius=old["radius"] * rng.uniform(0.5, 1.1),
            position_error=rng.uniform(0.0, 0.1),
            velocity_error=rng.uniform(0.0, 0.1),
            stamp=5.0 + h,
        )
        room = judge_plainly(old, new)
        if abs(room) > 1e-9:
            assert (judge(old, new) == ALLOWED) == (room > 0.0)
            seen[room > 0.0] += 1
    assert min(seen.values()) > 100


def test_the_shape_must_not_change():
    two = record(np.zeros((2, 3)), np.zeros((2, 3)))
    assert judge(record(), two) == SHAPE
    assert judge(two, record()) == SHAPE
    none = record(np.zeros((0, 3)), np.zeros((0, 3)))
    assert judge(none, none) == SHAPE


@pytest.mark.hazard("H-23")
@pytest.mark.parametrize("bound", [10.0, INF])
def test_nan_anywhere_never_passes(bound):
    base = record(accel=bound, speed=bound)
    assert judge(base, base) == ALLOWED
    for side in (0, 1):
        for key in base:
            if side == 1 and key in ("accel", "speed"):
                continue
            pair = [record(accel=bound, speed=bound), record(accel=bound, speed=bound)]
            if key in ("points", "velocities"):
                pair[side][key][0, 1] = math.nan
            else:
                pair[side][key] = math.nan
            assert judge(*pair) != ALLOWED, (side, key)


def test_without_bounds_anything_finite_passes_even_at_once():
    free = record(accel=INF, speed=INF, velocity_error=INF)
    assert judge(free, record((1e9, 0.0, 0.0), (1e9, 0.0, 0.0))) == ALLOWED
    assert judge(free, record((INF, 0.0, 0.0))) != ALLOWED
    assert judge(record(speed=INF), record((1e-6, 0.0, 0.0))) == POSITION_BY_ACCEL
    assert judge(record(accel=INF), record((1e-6, 0.0, 0.0))) == POSITION_BY_SPEED


@settings(max_examples=200)
@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=28, max_size=28))
def test_hostile_numbers_get_a_code(numbers):
    old = record(numbers[0:3], numbers[3:6], *numbers[6:11], numbers[11])
    new = record(numbers[12:15], numbers[15:18], *numbers[18:23], numbers[23])
    with np.errstate(all="ignore"):
        assert ALLOWED <= judge(old, new) <= SHAPE


def test_squares_below_their_limit_have_roots_within_the_room():
    rng = np.random.default_rng(0)
    squares = [*(10.0 ** rng.uniform(-320.0, 308.0, 4000)).tolist(), 0.0, math.inf, math.nan]
    for square in squares:
        length = math.sqrt(square)
        for added in (0.0, 0.05, length, 1e-300):
            for ulps in (-8, -3, -2, -1, 0, 1, 2, 3, 2**30):
                bound = length + added
                bound += ulps * math.ulp(bound) if math.isfinite(bound) else 0.0
                if square < find_square_limit(bound - added):
                    assert length < math.inf
                    assert length + added <= bound
        assert (square < find_square_limit(math.inf)) == (length < math.inf)
        if 1e-290 < square < math.inf:
            assert square < find_square_limit(length * (1.0 + 1e-12))
        assert not square < find_square_limit(-length)
        assert not square < find_square_limit(math.nan)


def at_the_edge(rng):
    """Two records of which the second is about as far as the first allows, by one of the bounds."""
    stamps = rng.choice([0.0, 1.0, 1e6]) + np.array([0.0, rng.choice([0.0, 0.001, 0.1, -0.1])])
    errors = rng.choice([1e-9, 0.01], 4)
    old = record(
        rng.normal(size=3) * rng.choice([1.0, 100.0]), rng.normal(size=3), *rng.uniform(0, 0.2, 1),
        rng.choice([0.0, 10.0, INF]), rng.choice([0.0, 2.0, INF]), *errors[:2], stamps[0],
    )  # fmt: skip
    h = abs(stamps[1] - stamps[0])
    reach = old["position_error"] + errors[2] + min(2.0, old["speed"]) * h
    change = min(10.0, old["accel"]) * h + old["velocity_error"] + errors[3]
    edge = 1.0 + rng.choice([-1e-3, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1e-3, -0.5])
    new = record(
        old["points"] + edge * reach * in_ball(rng, 1, 1.0), old["velocities"] * edge,
        old["radius"] * rng.choice([1.0, 0.5]), 10.0, 2.0, *errors[2:], stamps[1],
    )  # fmt: skip
    new["velocities"] = old["velocities"] + edge * change * in_ball(rng, 1, 1.0)
    return old, new


def test_what_is_clearly_allowed_breaks_no_bound():
    rng = np.random.default_rng(5)
    clear = unclear = broken = 0
    for _ in range(4000):
        records = lay(*at_the_edge(rng))
        is_clear, code = clearly_allows(*records), find_broken_bound(*records)
        assert not (is_clear and code != ALLOWED)
        assert body_allows(*records) == code
        clear += is_clear
        unclear += not is_clear and code == ALLOWED
        broken += code != ALLOWED
    assert min(clear, unclear, broken) > 20


@settings(max_examples=200)
@given(st.lists(st.floats(min_value=0.0, allow_infinity=True), min_size=28, max_size=28))
def test_hostile_numbers_are_not_clearly_allowed_where_they_break_a_bound(numbers):
    numbers[0:6] = [-number for number in numbers[0:6]]
    old = record(numbers[0:3], numbers[3:6], *numbers[6:11], numbers[11])
    new = record(numbers[12:15], numbers[15:18], *numbers[18:23], numbers[23])
    records = lay(old, new)
    if clearly_allows(*records):
        assert find_broken_bound(*records) == ALLOWED


LAST = sys.float_info.max


@pytest.mark.parametrize("stamps", [(0.0, LAST), (LAST, LAST), (-0.5 * LAST, 0.5 * LAST)])
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.0, 0.5, 0.5)])
def test_nothing_is_clear_at_stamps_whose_slack_is_no_number(stamps, velocity):
    records = lay(*(record(v=velocity, position_error=0.01, stamp=stamp) for stamp in stamps))
    assert find_broken_bound(*records) == POSITION_BY_ACCEL
    assert not clearly_allows(*records)


def test_most_of_what_moves_within_its_bounds_is_clear():
    rng = np.random.default_rng(6)
    for _ in range(100):
        position, velocity = rng.normal(size=3), in_ball(rng, 1, 1.0)[0]
        old = record(position, velocity, position_error=0.005, velocity_error=0.05)
        new = record(position + 0.01 * velocity, velocity, position_error=0.005, stamp=0.01)
        assert clearly_allows(*lay(old, new))
