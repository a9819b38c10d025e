"""Zones: hulls with faces that know their inside, and bodies that surely stay in them."""

import itertools

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.obstacles import Obstacles
from armguard.pairs.zone import find_staying, read_zone
from support.nearest_points import closest_in_hull

BOX = np.array(np.meshgrid([-1.0, 1.0], [-0.5, 0.5], [0.0, 0.4])).reshape(3, 8).T


def is_inside(zone, places):
    return (places @ zone.faces[:, :3].T <= zone.faces[:, 3]).all(axis=1)


@pytest.mark.parametrize("seed", range(20))
def test_faces_hold_the_hull_and_nothing_beyond_it(seed):
    """Against the nearest point of the hull, by an algorithm that knows no faces."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(rng.integers(4, 9), 3)) * 10.0 ** rng.uniform(-1.0, 2.0)
    corners += rng.normal(size=3)
    zone = read_zone(corners)
    length = np.ptp(corners, axis=0).max()
    weights = rng.dirichlet(np.ones(len(corners)), size=100)
    places = weights @ corners + rng.normal(size=(100, 3)) * 0.1 * length
    outside = np.array([np.linalg.norm(closest_in_hull(corners - one)) for one in places])
    found = is_inside(zone, places)
    assert not found[outside > 1e-9 * length].any()
    # Nor is anything of the hull left out but a film.
    shrunk = corners.mean(axis=0) + (weights @ corners - corners.mean(axis=0)) * (1.0 - 1e-3)
    assert is_inside(zone, shrunk).all()


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (BOX[:3], "shape"),
        (np.vstack([BOX, [[0, 0, 9]]]), "shape"),
        (BOX[:, :2], "shape"),
        (3.0, "shape"),
        ("bin", "corners"),
        ([[0, 0, 0], [1, 0]], "corners"),
        (None, "shape"),
        (np.where(BOX == 1.0, np.nan, BOX), "finite"),
        (np.where(BOX == 1.0, np.inf, BOX), "finite"),
        (1e6 * BOX, "finite"),
        (BOX * [1, 1, 0], "no room"),
        (BOX * [1, 0, 0], "no room"),
        (BOX * 0, "no room"),
        (1e-3 * BOX, "no room"),
        (BOX * [1, 1, 1e-3], "no room"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, -1e-6, 0]], "in a line"),
    ],
)
def test_what_encloses_no_room_is_refused_by_name(points, words):
    with pytest.raises(ArmguardError, match=f"zone.*{words}") as caught:
        read_zone(points)
    assert caught.value.expected


def stays(obstacles, zone, now, horizon):
    rows = np.flatnonzero(obstacles.table.alive)
    staying = np.zeros(len(rows), dtype=bool)
    find_staying(obstacles.table.handle, zone.faces, rows, now, horizon, staying)
    return staying


def move_freely(rng, position, velocity, accel, speed, times):
    """Positions of a free body at some times from 0 on: it pushes one way, then another."""
    place, pace, found, push = position.copy(), velocity.copy(), [position], None
    for before, after in itertools.pairwise(times):
        if push is None or rng.random() < 0.1:
            push = rng.normal(size=3)
            push *= accel / np.linalg.norm(push)
        step = after - before
        faster = pace + push * step
        length = np.linalg.norm(faster)
        faster *= min(1.0, speed / length) if length > 0.0 else 1.0
        place = place + 0.5 * (pace + faster) * step
        pace = faster
        found.append(place)
    return np.array(found)


def test_no_body_that_stays_ever_leaves():
    """Bodies as their bounds let them, from their stamps on; some of them stay only just."""
    rng = np.random.default_rng(7)
    zone = read_zone(BOX)
    staying = leaving = 0
    for _ in range(150):
        obstacles = Obstacles()
        accel, speed = rng.uniform(0.0, 4.0), rng.uniform(0.0, 1.5)
        radius, age, horizon = rng.uniform(0.0, 0.1), rng.uniform(0.0, 0.15), rng.uniform(0.0, 0.4)
        place = rng.uniform([-0.9, -0.4, 0.05], [0.9, 0.4, 0.35])
        velocity = rng.normal(size=3)
        velocity *= rng.uniform(0.0, speed) / np.linalg.norm(velocity)
        obstacles.update(["body"], 1.0, [place], [velocity], radius, accel, speed)
        expected = bool(stays(obstacles, zone, 1.0 + age, horizon)[0])
        staying, leaving = staying + expected, leaving + (not expected)
        if not expected:
            continue
        times = np.linspace(0.0, age + horizon, 60)
        for _ in range(20):
            way = move_freely(rng, place, velocity, accel, speed, times)[times >= age]
            low, high = BOX.min(axis=0) + radius, BOX.max(axis=0) - radius
            assert ((way >= low) & (way <= high)).all()
    assert staying > 15
    assert leaving > 15


def test_a_body_stays_for_as_long_as_its_fastest_way_out_takes():
    obstacles, zone = Obstacles(), read_zone(BOX)
    # 0.5 m from the nearest wall but one, all of it at 1 m/s; radius and error take 0.1 m of it.
    obstacles.update(
        ["body"], 5.0, [[0.0, 0.0, 0.2]], [[0.0, 1.0, 0.0]], 0.05, 0.0, 1.0, position_error=0.05
    )
    for age in (0.0, 0.1, 0.2):
        left = 0.4 - age
        assert stays(obstacles, zone, 5.0 + age, left - 1e-4)
        assert not stays(obstacles, zone, 5.0 + age, left + 1e-4)
    # A state from the future: it was so far back, at the most.
    obstacles.update(["body"], 5.2, [[0.0, 0.2, 0.2]], [[0.0, 1.0, 0.0]], 0.05, 0.0, 1.0)
    assert stays(obstacles, zone, 4.9, 0.5)
    assert not stays(obstacles, zone, 4.5, 0.01)


def test_what_is_not_known_never_stays():
    zone = read_zone(100.0 * BOX - [0.0, 0.0, 20.0])
    obstacles = Obstacles(speed=np.inf, accel=np.inf)
    obstacles.update(["free"], 0.0, [[0.0, 0.0, 0.2]], radius=0.1)
    obstacles.update(["nan"], 0.0, [[np.nan, 0.0, 0.2]], radius=0.1)
    assert not stays(obstacles, zone, 0.1, 0.1).any()
    still = Obstacles()
    still.add_static("table", BOX, 0.01)
    assert stays(still, zone, 3.0, 1e9)
    for now, horizon in ((np.nan, 0.1), (0.0, np.nan), (0.0, np.inf)):
        moving = Obstacles()
        moving.update(["one"], 0.0, [[0.0, 0.0, 0.2]], radius=0.1)
        assert stays(moving, zone, 0.0, 0.1)
        assert not stays(moving, zone, now, horizon)


@pytest.mark.parametrize(("first", "then"), [(0.0, 3.0), (3.0, 0.0), (0.0, 0.5)])
def test_all_states_that_may_be_true_must_stay(first, then):
    """Whether the accepted state is inside, or the one that was refused, or both."""
    obstacles, zone = Obstacles(accel=1.0, speed=1.0), read_zone(BOX)
    still = {"velocity": [[0.0, 0.0, 0.0]], "radius": 0.1}
    obstacles.update(["body"], 0.0, [[first, 0.0, 0.2]], **still)
    assert stays(obstacles, zone, 0.0, 0.1) == (first < 1.0)
    # It cannot have jumped there; one of the two is wrong, and none can tell which.
    obstacles.update(["body"], 0.01, [[then, 0.0, 0.2]], **still)
    assert obstacles.table.refused[0]
    assert stays(obstacles, zone, 0.01, 0.1) == (max(first, then) < 1.0)


def test_an_entrance_stays_where_all_that_comes_out_of_it_does():
    obstacles, zone = Obstacles(sources=[], speed=1.0), read_zone(BOX)
    obstacles.add_entrance("door", [0.0, 0.0, 0.2], 0.1, 0.0)
    assert stays(obstacles, zone, 7.0, 0.099)
    assert not stays(obstacles, zone, 7.0, 0.101)
