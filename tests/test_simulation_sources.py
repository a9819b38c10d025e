"""Simulated obstacles: bounds held at every time, plausible samples, each published once."""

import math
from itertools import pairwise

import numpy as np
import pytest
from growth_sink import GrowthSink

from armguard.exceptions import ArmguardError
from armguard.obstacles import Obstacles
from armguard.simulation import ProceduralPerson, WanderingBalls
from armguard.simulation.bodies import BODIES, POINTS

LARGEST_JERK = 180.0  # [m/s³]

NAMES = {
    "head",
    "collar",
    "hip",
    "left_shoulder",
    "left_elbow",
    "left_hand",
    "right_shoulder",
    "right_elbow",
    "right_hand",
}


def sample_densely(source, times):
    return (np.array(part) for part in zip(*(source.sample(time) for time in times), strict=True))


def check_motion(source, duration, speed, accel, dt=2e-3):
    """Speeds and accelerations within bounds, velocities the derivative of positions."""
    times = np.arange(0.0, duration, dt)
    x, v = sample_densely(source, times)
    a = np.diff(v, axis=0) / dt
    assert np.linalg.norm(v, axis=2).max() <= speed
    assert np.linalg.norm(a, axis=2).max() <= accel
    # Simpson's rule, off by some dt³ where the jerk jumps: a forgotten factor would show.
    travel = (v[:-2] + 4 * v[1:-1] + v[2:]) * (dt / 3)
    assert np.abs(x[2:] - x[:-2] - travel).max() < 2.0 * dt**3
    # Twice continuously differentiable: accelerations do not jump.
    assert np.linalg.norm(np.diff(a, axis=0), axis=2).max() < LARGEST_JERK * dt
    return x, v


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("accel", "speed"), [(10.0, 2.0), (0.3, 5.0), (50.0, 0.1)])
def test_balls_keep_their_bounds_and_their_box(seed, accel, speed):
    lower, upper = np.array([-2.0, -3.0, 0.1]), np.array([2.0, 1.0, 1.5])
    balls = WanderingBalls(
        8, seed, accel=accel, speed=speed, lower=lower, upper=upper, clearance=0.8
    )
    x, v = check_motion(balls, 20.0, speed, accel)
    assert (x >= lower).all()
    assert (x <= upper).all()
    assert np.hypot(x[..., 0], x[..., 1]).min() >= 0.8
    assert np.abs(v).max(axis=(0, 1)).min() > 0.01  # none of the axes stands still


def test_balls_are_published_by_name_and_never_implausible():
    balls, sink = WanderingBalls(5, 1), GrowthSink()
    for now in np.arange(0.0, 10.0, 0.001):
        balls.publish(sink, now)
    assert set(sink.last) == {f"ball-{number}" for number in range(5)}
    assert not sink.refused
    assert {call[-1] for call in sink.calls} == {"balls"}


@pytest.mark.parametrize("make", [lambda: WanderingBalls(3, 9), lambda: ProceduralPerson(9, 8.0)])
def test_every_sample_is_published_once_and_in_order_whatever_the_ticks(make):
    slow, quick = GrowthSink(), GrowthSink()
    source = make()
    for now in (-1.0, 0.0, 0.0, 3.21, 3.0, 8.0):
        source.publish(slow, now)
    source = make()
    for tick in range(8001):
        source.publish(quick, tick / 1000)
    assert len(slow.calls) == len(quick.calls)
    for one, other in zip(slow.calls, quick.calls, strict=True):
        assert one[:2] == other[:2]
        assert np.array_equal(one[2], other[2])
        assert np.array_equal(one[3], other[3])
    stamps = sorted({call[1] for call in quick.calls})
    assert stamps == [k / source.rate for k in range(int(8.0 * source.rate) + 1)]
    assert [call[1] for call in quick.calls] == sorted(call[1] for call in quick.calls)


def test_seeds_decide():
    def at(seed):
        return ProceduralPerson(seed).sample(9.0)[0]

    assert np.array_equal(at(1), at(1))
    assert not np.array_equal(at(1), at(2))
    assert not np.array_equal(WanderingBalls(2, 1).sample(1.0), WanderingBalls(2, 2).sample(1.0))


@pytest.mark.parametrize("duration", [8.0, 9.5, 12.4, 14.0, 20.0, 60.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_person_moves_as_people_can_for_any_duration(duration, seed):
    person = ProceduralPerson(seed, duration, direction=2.0 * seed)
    x, _ = check_motion(person, duration, 1.6, 8.0, dt=5e-3)
    hip = np.hypot(x[:, 2, 0], x[:, 2, 1])
    assert hip[0] == pytest.approx(person.far)
    assert hip[-1] == pytest.approx(person.far)
    assert hip.min() == pytest.approx(1.0, abs=1e-3)
    assert person.far == 6.0 or duration < 12.5
    assert person.far > 3.0


def test_a_person_reaches_the_arm_and_is_far_away_before_and_after():
    person = ProceduralPerson(3, direction=0.5)
    target = 0.4 * np.array([math.cos(0.5), math.sin(0.5), 0.0]) + [0.0, 0.0, 0.35]
    times = np.arange(0.0, 20.0, 0.02)
    x, _ = sample_densely(person, times)
    hands = x[:, [POINTS.index("left_hand"), POINTS.index("right_hand")]]
    distance = np.linalg.norm(hands - target, axis=2)
    assert (distance.min(axis=0) < 0.2).all()
    working = distance.max(axis=1) < 0.25
    assert working.sum() * 0.02 > 4.0
    horizontal = np.hypot(x[..., 0], x[..., 1])
    for still in (times < 0.9, times > 19.1):
        assert horizontal[still].min() > 5.7
    assert x[..., 2].min() > -0.75  # the floor, below the table


def test_arms_keep_their_lengths_and_stretch_no_further():
    random = np.random.default_rng(0)
    for seed in range(12):
        person = ProceduralPerson(seed, 10.0, target=random.uniform(-2.0, 2.0, 3))
        x, _ = check_motion(person, 10.0, 1.6, 8.0, dt=0.01)
        for side in ("left", "right"):
            shoulder, elbow, hand = (
                x[:, POINTS.index(f"{side}_{part}")] for part in ("shoulder", "elbow", "hand")
            )
            assert np.allclose(np.linalg.norm(elbow - shoulder, axis=1), 0.30)
            assert np.allclose(np.linalg.norm(hand - elbow, axis=1), 0.33)


def test_a_person_is_nine_bodies_none_of_which_a_table_ever_refuses():
    assert {body.name for body in BODIES} == set(POINTS) == NAMES
    person, sink, table = ProceduralPerson(4), GrowthSink(), Obstacles()
    twin = ProceduralPerson(4)
    for now in np.arange(0.0, 20.01, 0.01):
        person.publish(sink, now)
        twin.publish(table, now)
    assert set(sink.last) == NAMES
    assert not sink.refused
    assert sink.taken == 9 * 2001
    assert len(table) == 9
    assert table.take_faults() == []


def test_what_is_between_two_tracked_points_is_covered():
    person, sink = ProceduralPerson(4), GrowthSink()
    person.publish(sink, 10.0)
    points = dict(zip(POINTS, person.sample(10.0)[0], strict=True))
    radius = {body.name: body.radius for body in BODIES}
    shapes = [(sink.last[name][1], radius[name]) for name in NAMES]
    for start, end in pairwise(["head", "collar", "hip"]):
        check_covered(points[start], points[end], shapes)
    for side in ("left", "right"):
        way = ["collar", f"{side}_shoulder", f"{side}_elbow", f"{side}_hand"]
        for start, end in pairwise(way):
            check_covered(points[start], points[end], shapes)


def check_covered(start, end, shapes):
    """Every point of a bone, and 4 cm of flesh around it, is in some ball or capsule."""
    for share in np.linspace(0.0, 1.0, 21):
        point = start + share * (end - start)
        depth = max(r - distance_to_segment(point, p[0], p[-1]) for p, r in shapes)
        assert depth > 0.04


def distance_to_segment(point, start, end):
    along = end - start
    share = np.clip((point - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
    return np.linalg.norm(point - start - share * along)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: ProceduralPerson(0, 7.9), "8 to 3600 s"),
        (lambda: ProceduralPerson(0, float("nan")), "8 to 3600 s"),
        (lambda: ProceduralPerson(0, direction=float("inf")), "direction"),
        (lambda: ProceduralPerson(0, target=(1.0, float("nan"), 0.0)), "reach"),
        (lambda: ProceduralPerson(0, target=(1.0, 2.0)), "reach"),
        (lambda: ProceduralPerson(0, rate=0.0), "rate"),
        (lambda: WanderingBalls(0, 0), "at least one"),
        (lambda: WanderingBalls(1, 0, radius=float("nan")), "radius"),
        (lambda: WanderingBalls(1, 0, accel=float("inf")), "accel"),
        (lambda: WanderingBalls(1, 0, speed=0.0), "speed"),
        (lambda: WanderingBalls(1, 0, lower=(0, 0, 0), upper=(1, 0, 1)), "box"),
        (lambda: WanderingBalls(1, 0, clearance=9.0), "no room"),
        (lambda: WanderingBalls(1, 0, duration=float("nan")), "duration"),
        (lambda: WanderingBalls(1, 0).publish(GrowthSink(), float("inf")), "asked"),
    ],
)
def test_bad_input_is_refused_by_name(make, named):
    with pytest.raises(ArmguardError, match=named):
        make()
