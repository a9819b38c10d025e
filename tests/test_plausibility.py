from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard import ArmguardError
from armguard.plausibility import (
    ALLOWED,
    NOT_FINITE,
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    SHAPE,
    TIME_BACKWARDS,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
    JointHistory,
    body_allows,
)

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


def judge(old, new):
    return body_allows(
        old["points"],
        old["velocities"],
        len(old["points"]),
        old["radius"],
        old["accel"],
        old["speed"],
        old["position_error"],
        old["velocity_error"],
        old["stamp"],
        new["points"],
        new["velocities"],
        len(new["points"]),
        new["radius"],
        new["position_error"],
        new["velocity_error"],
        new["stamp"],
    )


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


def test_a_larger_body_is_refused_and_a_smaller_inside_it_is_not():
    assert judge(record(radius=0.1), record(radius=0.2)) == POSITION_BY_ACCEL
    assert judge(record(radius=0.2), record((0.1, 0.0, 0.0), radius=0.1)) == ALLOWED
    assert judge(record(radius=0.2), record((0.11, 0.0, 0.0), radius=0.1)) == POSITION_BY_ACCEL


def test_the_shape_must_not_change():
    two = record(np.zeros((2, 3)), np.zeros((2, 3)))
    assert judge(record(), two) == SHAPE
    assert judge(two, record()) == SHAPE
    none = record(np.zeros((0, 3)), np.zeros((0, 3)))
    assert judge(none, none) == SHAPE


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


# Joints

LIMITS = {
    "velocity_limit": np.array([2.0, 0.5, 3.0]),
    "acceleration_limit": np.array([15.0, 7.5, 20.0]),
}


def history(position_error=1e-3, velocity_error=0.02):
    return JointHistory(
        **LIMITS,
        position_error=np.full(3, position_error),
        velocity_error=np.full(3, velocity_error),
    )


def move_joints(rng, steps, period):
    """True joint states that press against their limits: constant acceleration in each step."""
    top, accel = LIMITS["velocity_limit"], LIMITS["acceleration_limit"]
    stamp, q, v = 0.0, np.zeros(3), np.zeros(3)
    push = np.zeros(3)
    for step in range(steps):
        yield stamp, q.copy(), v.copy()
        h = period * rng.uniform(0.2, 1.8)
        if step % 50 == 0:
            push = accel * rng.choice([-1.0, 0.0, 1.0, rng.uniform(-1, 1)], size=3)
        after = np.clip(v + push * h, -top, top)
        q = q + (v + after) / 2 * h
        v = after
        stamp += h


@pytest.mark.parametrize("period", [1e-3, 2e-2])
@pytest.mark.parametrize(
    ("position_error", "velocity_error"), [(1e-3, 0.02), (1e-3, 1e-9), (1e-9, 0.02), (1e-11, 1e-9)]
)
def test_joints_within_limits_and_errors_never_fail(period, position_error, velocity_error):
    rng = np.random.default_rng(3)
    for epoch in (0.0, 12345.0, 1.7e9):
        joints = history(position_error, velocity_error)
        for stamp, q, v in move_joints(rng, 4000, period):
            q = q + position_error * rng.choice([-1.0, 1.0], size=3) * (1 - 1e-9)
            v = v + velocity_error * rng.choice([-1.0, 1.0], size=3) * (1 - 1e-9)
            assert joints.accept(epoch + stamp, q, v) == ALLOWED, joints.describe("abc")
            assert joints.joint == -1


def test_a_jump_beyond_limits_and_errors_fails_at_once_and_leaves_the_history():
    rng = np.random.default_rng(4)
    joints = history()
    last = 0.0
    failures = set()
    for stamp, q, v in move_joints(rng, 4000, 1e-3):
        if stamp > 0.0:
            elapsed = stamp - last
            joint = int(rng.integers(3))
            sign = rng.choice([-1.0, 1.0])
            far, fast = q.copy(), v.copy()
            top = LIMITS["velocity_limit"][joint]
            # One error is spent on the state before, one on this one, the rest is impossible.
            far[joint] += sign * ((top + abs(v[joint])) * elapsed + 2.0e-3) * 1.001
            fast[joint] += sign * (2 * LIMITS["acceleration_limit"][joint] * elapsed + 0.04) * 1.001
            code = joints.accept(stamp, far, v)
            assert code in (POSITION_BY_SPEED, POSITION_BY_ACCEL)
            assert joints.joint == joint
            failures.add(code)
            code = joints.accept(stamp, q, fast)
            assert code in (VELOCITY_BY_ACCEL, VELOCITY_BY_SPEED)
            assert joints.joint == joint
            failures.add(code)
        assert joints.accept(stamp, q, v) == ALLOWED
        last = stamp
    assert failures >= {POSITION_BY_SPEED, VELOCITY_BY_ACCEL, VELOCITY_BY_SPEED}


def first_failure(states, **errors):
    joints = history(**errors)
    for stamp, q, v in states:
        code = joints.accept(stamp, np.array([0.0, 0.0, q]), np.array([0.0, 0.0, v]))
        if code != ALLOWED:
            assert joints.joint == 2
            return code, stamp
    return ALLOWED, INF


def test_breaking_a_limit_a_little_at_a_time_is_found_as_soon_as_errors_are_used_up():
    times = np.arange(0.0, 2.0, 1e-3)
    # 4 rad/s^2 beyond the limit: 2 dv = 0.04 rad/s are used up in 10 ms.
    code, stamp = first_failure((t, 12.0 * t * t, 24.0 * t) for t in times)
    assert code == VELOCITY_BY_ACCEL
    assert stamp == pytest.approx(0.01, abs=2e-3)
    # Beyond the speed limit by 0.1 rad/s while the velocity reads the limit: 2 dq in 20 ms.
    code, stamp = first_failure((t, 3.1 * t, 3.0) for t in times)
    assert code in (POSITION_BY_SPEED, POSITION_BY_ACCEL)
    assert stamp <= 0.025
    # Reads at rest but moves.
    code, stamp = first_failure((t, 0.5 * t, 0.0) for t in times)
    assert code == POSITION_BY_ACCEL
    assert stamp < 0.1
    # Faster than the limit, but not by more than the error: believed.
    assert first_failure((t, 3.015 * t, 3.015) for t in times)[0] == ALLOWED
    assert first_failure((t, 3.03 * t, 3.03) for t in times)[0] == VELOCITY_BY_SPEED


def test_the_running_form_equals_a_look_at_the_whole_history():
    rng = np.random.default_rng(5)
    accel, top = 20.0, 3.0
    position_error, velocity_error = 1e-3, 0.02
    decided = {True: 0, False: 0}
    for _ in range(200):
        joints = history()
        accepted = []
        stamp, q, v = 0.0, 0.0, 0.0
        for _ in range(30):
            state = np.array([0.0, 0.0, q]), np.array([0.0, 0.0, v])
            room = INF
            for s0, q0, v0 in accepted:
                h = stamp - s0
                room = min(
                    room,
                    2 * velocity_error + accel * h - abs(v - v0),
                    2 * position_error + top * h - abs(q - q0),
                )
            code = joints.accept(stamp, *state)
            if code != POSITION_BY_ACCEL and abs(room) > 1e-9:
                assert (code == ALLOWED) == (room > 0.0)
                decided[room > 0.0] += 1
            if code == ALLOWED:
                accepted.append((stamp, q, v))
            stamp, before, q0, v0 = stamp + rng.uniform(1e-3, 5e-3), *accepted[-1]
            change = rng.uniform(-1.0, 1.0) * (accel * (stamp - before) + 0.05)
            v = float(np.clip(v0 + change, -top, top))
            q = q0 + (v0 + v) / 2 * (stamp - before) + rng.uniform(-1.5e-3, 1.5e-3)
    assert min(decided.values()) > 100


def test_states_that_are_no_states():
    joints = history()
    rest = np.zeros(3)
    assert joints.accept(math.nan, rest, rest) == NOT_FINITE
    assert joints.accept(0.0, np.array([0.0, math.nan, 0.0]), rest) == NOT_FINITE
    assert joints.joint == 1
    assert joints.describe(["a", "b", "c"]) == ("b", "is not finite")
    assert joints.accept(0.0, rest, np.array([0.0, 0.0, INF])) == NOT_FINITE
    assert joints.accept(0.0, np.zeros(2), rest) == SHAPE
    assert joints.accept(1.0, rest, rest) == ALLOWED
    assert joints.describe("abc") == ("joint states", "")
    assert joints.accept(0.5, rest, rest) == TIME_BACKWARDS
    assert joints.joint == -1
    assert joints.accept(1.0, rest, rest) == ALLOWED


def test_restart_forgets():
    joints = history()
    assert joints.accept(10.0, np.zeros(3), np.zeros(3)) == ALLOWED
    assert joints.accept(10.001, np.ones(3), np.zeros(3)) == POSITION_BY_SPEED
    assert joints.restart(5.0, np.ones(3), np.zeros(3)) == ALLOWED
    assert joints.accept(5.001, np.ones(3), np.zeros(3)) == ALLOWED


@pytest.mark.parametrize("bad", [-1.0, math.nan, INF])
def test_limits_must_be_limits(bad):
    with pytest.raises(ArmguardError, match="joint limits"):
        JointHistory([bad], [1.0], [0.0], [0.0])


@settings(max_examples=100)
@given(st.lists(st.tuples(st.floats(), st.floats(), st.floats()), max_size=10))
def test_hostile_joint_states_never_raise(states):
    joints = JointHistory([2.0], [10.0], [1e-3], [0.02])
    for stamp, q, v in states:
        code = joints.accept(stamp, np.array([q]), np.array([v]))
        assert ALLOWED <= code <= TIME_BACKWARDS
        if code == ALLOWED:
            assert abs(v) <= 2.02 * (1 + 1e-14)
