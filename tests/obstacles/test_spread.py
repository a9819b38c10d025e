"""Errors larger than stated are found, and those that are as stated never are."""

import numpy as np
import pytest

from armguard.obstacles import Obstacles
from support.obstacle_samples import see

ACCEL, SPEED = 10.0, 2.0


def walk(rng, count, period):
    """Positions and velocities of a body that uses its bounds up. Shapes (count, 3)."""
    position, velocity = np.zeros(3), np.zeros(3)
    positions, velocities = [], []
    push = np.zeros(3)
    for k in range(count):
        positions.append(position)
        velocities.append(velocity)
        if k % 10 == 0:
            push = rng.normal(size=3)
            push *= ACCEL * (1.0 - 1e-9) / np.linalg.norm(push)
        after = velocity + push * period
        if np.linalg.norm(after) > SPEED:
            push = -push
            after = velocity + push * period
        position = position + velocity * period + push * period * period / 2.0
        velocity = after
    return np.array(positions), np.array(velocities)


def on_sphere(rng, count):
    directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None]


def tell(positions, velocities, period, position_error, velocity_error, points=1, **fields):
    """Table after those samples, and how many of them left something to tell."""
    obstacles, told = Obstacles(accel=ACCEL, speed=SPEED), 0
    shift = np.linspace(0.0, 0.3, points)[:, None] * [0.0, 0.0, 1.0]
    for k, (position, velocity) in enumerate(zip(positions, velocities, strict=True)):
        obstacles.update(
            ["body"], k * period, [position + shift], [np.tile(velocity, (points, 1))], radius=0.1,
            position_error=position_error, velocity_error=velocity_error, source="camera", **fields,
        )  # fmt: skip
        told += obstacles.has_wide_spreads
    return obstacles, told


def follow(median, proved, known):
    if known < 10:
        return min(median, proved)
    return max(1e-9, max(median, 1e-9) * 1.02 if proved > median else median / 1.02)


def reckon(stamps, points, velocities, error):
    """Running medians of what three samples prove of a position and two of a velocity."""
    position, velocity, known = 0.0, np.inf, 0
    for i, (stamp, x) in enumerate(zip(stamps, points, strict=True)):
        h2 = stamp - stamps[i - 1] if i else np.inf
        if h2 > 1.0:
            position, velocity, known = 0.0, np.inf, 0
        if known > 0:
            room = ACCEL * h2 / 2 + 2 * max(error, position) / h2
            off = np.linalg.norm(velocities[i] - (x - points[i - 1]) / h2, axis=1).max()
            velocity = follow(velocity, max(0.0, off - room), known)
        if known > 1:
            h1 = stamps[i - 1] - stamps[i - 2]
            ratio = h2 / h1
            second = x - points[i - 1] - ratio * (points[i - 1] - points[i - 2])
            off = np.linalg.norm(second, axis=1).max() - ACCEL * h2 * (h1 + h2) / 2
            before = position if known > 2 else np.inf
            position = follow(before, max(0.0, off / (2 + 2 * ratio)), known)
        known += 1
    return position, velocity


@pytest.mark.parametrize("points", [1, 3])
def test_medians_are_those_of_the_formulas(points):
    """However far apart samples are, gaps among them, and whatever they jump by."""
    rng = np.random.default_rng(8)
    for count in (2, 3, 4, 60):
        stamps = np.cumsum(rng.uniform(0.004, 0.02, count) + (rng.random(count) < 0.02))
        places = rng.normal(size=(count, points, 3)) * rng.choice([0.002, 0.1])
        velocities = rng.normal(size=(count, points, 3)) * 0.9
        obstacles = Obstacles(accel=ACCEL, speed=50.0)
        for stamp, place, velocity in zip(stamps, places, velocities, strict=True):
            obstacles.update(
                ["body"], stamp, [place], [velocity], radius=0.1, position_error=0.001,
                velocity_error=0.1,
            )  # fmt: skip
        spreads, row = obstacles.table.spreads, obstacles.row("body")
        position, velocity = reckon(stamps, places, velocities, 0.001)
        assert spreads.position[row] == pytest.approx(position, rel=1e-9)
        assert spreads.velocity[row] == pytest.approx(velocity, rel=1e-9)


@pytest.mark.parametrize("period", [0.002, 0.01, 0.05])
@pytest.mark.parametrize("points", [1, 2])
def test_a_body_within_its_bounds_and_errors_is_never_told_of(period, points):
    """At the very edge of both: its errors as large as stated, each in some direction."""
    rng = np.random.default_rng(3)
    positions, velocities = walk(rng, 3000, period)
    positions = positions + 0.005 * on_sphere(rng, len(positions))
    velocities = velocities + 0.2 * on_sphere(rng, len(positions))
    _, told = tell(positions, velocities, period, 0.005, 0.2, points)
    assert told == 0


@pytest.mark.parametrize("factor", [3.0, 10.0])
def test_errors_larger_than_promised_are_named_with_their_size(factor):
    rng = np.random.default_rng(4)
    positions, velocities = walk(rng, 600, 0.01)
    positions = positions + factor * 0.002 * on_sphere(rng, len(positions))
    obstacles, told = tell(positions, velocities, 0.01, 0.002, 3.0)
    assert told > 350
    ((name, detail),) = obstacles.describe_spreads()
    assert name == "body"
    words = detail.split()
    assert detail.startswith("camera: the spread of body is ")
    assert detail.endswith(" mm, stated 2 mm")
    # What is proved is below what it is.
    assert 0.3 * factor * 2.0 < float(words[words.index("is") + 1]) < factor * 2.0


def test_velocities_worse_than_promised_are_named():
    rng = np.random.default_rng(5)
    positions, velocities = walk(rng, 600, 0.01)
    velocities = velocities + 0.9 * on_sphere(rng, len(positions))
    obstacles, told = tell(positions, velocities, 0.01, 1e-4, 0.1)
    assert told > 400
    ((_, detail),) = obstacles.describe_spreads()
    assert detail.startswith("camera: velocities of body are off by 0.")
    assert detail.endswith(" m/s, stated 0.1 m/s")


def test_glitches_in_fewer_than_half_of_the_samples_are_no_spread():
    """Every tenth marker is swapped for one that is a metre away."""
    rng = np.random.default_rng(6)
    positions, velocities = walk(rng, 3000, 0.01)
    positions = positions + 0.002 * on_sphere(rng, len(positions))
    positions[::10] += 1.0
    _, told = tell(positions, velocities, 0.01, 0.002, 0.5)
    assert told == 0


def test_errors_that_become_as_promised_are_forgotten_and_so_is_a_body_that_leaves():
    rng = np.random.default_rng(7)
    positions, velocities = walk(rng, 1500, 0.01)
    noise = on_sphere(rng, len(positions)) * np.where(np.arange(1500) < 400, 0.01, 0.002)[:, None]
    obstacles, told = tell(positions + noise, velocities, 0.01, 0.002, 5.0)
    assert 200 < told < 700
    assert not obstacles.has_wide_spreads
    assert obstacles.describe_spreads() == []
    obstacles, _ = tell((positions + noise)[:400], velocities[:400], 0.01, 0.002, 5.0)
    assert obstacles.has_wide_spreads
    # More room is made, and nothing of it is lost.
    obstacles.update([f"n{k}" for k in range(200)], 4.0, np.zeros((200, 8, 3)), radius=0.1)
    assert len(obstacles.describe_spreads()) == 1
    obstacles.remove(["body"])
    assert not obstacles.has_wide_spreads


def test_late_samples_gaps_and_what_is_no_number_tell_nothing():
    obstacles = Obstacles(accel=ACCEL, speed=SPEED)
    spreads = obstacles.table.spreads
    row = see(obstacles, 0.0)
    for k in range(1, 60):
        see(obstacles, 0.01 * k, position_error=0.002)
        kept = [array[row].copy() for array in spreads[:-1]]
        see(obstacles, 0.01 * k - 0.005, x=0.001, position_error=0.002)
        see(obstacles, 0.01 * k, x=np.nan)
        assert all(
            np.array_equal(before, array[row])
            for before, array in zip(kept, spreads[:-1], strict=True)
        )
    assert spreads.samples[row] == 50
    see(obstacles, 5.0, x=3.0)
    assert spreads.samples[row] == 1
    assert not obstacles.has_wide_spreads
