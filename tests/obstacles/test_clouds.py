import copy
import math

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.messages.events import DroppedPoints
from armguard.messages.incoming import RemoveMessage
from armguard.obstacles import FaultKind, Frame, Obstacles
from armguard.obstacles.clouds import CELLS, find_half_window
from support.depth_camera import DepthCamera
from support.told_journal import Journal

EDGE = 0.05
AHEAD = DepthCamera([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])


def voxels(obstacles, source="depth"):
    """Index and centre of each voxel in the table, by id."""
    found = {}
    for row, name in enumerate(obstacles.ids):
        if name and obstacles.source_of(row) == source:
            index = tuple(map(int, name.removeprefix("voxel ").split()))
            found[index] = obstacles.table.points[row, 0].copy()
    return found


def kinds(obstacles):
    return [fault.kind for fault in obstacles.take_faults()]


@pytest.mark.parametrize("edge", [0.05, 0.1, 0.037])
def test_each_point_is_in_a_voxel_of_the_lattice(edge):
    random = np.random.default_rng(1)
    obstacles = Obstacles(accel=9.0, speed=1.5)
    # Corners and edges of voxels, and both sides of 0, among points anywhere.
    points = np.concatenate(
        [random.normal(scale=2.0, size=(5000, 3)), edge * random.integers(-9, 9, (500, 3))]
    )
    obstacles.update_cloud("depth", 1.0, points, [0, 0, 0], edge)
    expected = {tuple(index) for index in np.floor(points / edge).astype(int).tolist()}
    found = voxels(obstacles)
    assert found.keys() == expected
    for index, center in list(found.items())[:200]:
        assert center == pytest.approx(edge * (np.array(index) + 0.5), abs=1e-12)
    centers = np.array([found[tuple(i)] for i in np.floor(points / edge).astype(int).tolist()])
    table, rows = obstacles.table, np.flatnonzero(obstacles.table.alive)
    assert np.linalg.norm(points - centers, axis=1).max() <= table.radius[rows[0]] + 1e-9
    assert table.radius[rows] == pytest.approx(math.sqrt(0.75) * edge)
    assert set(table.speed[rows]) == set(table.velocity_error[rows]) == {1.5}
    assert set(table.accel[rows]) == {9.0}
    assert kinds(obstacles) == []


def test_frames_place_the_lattice_in_the_world():
    lens = Frame([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0.0, 1.0], 0.01)
    obstacles = Obstacles(frames={"lens": lens}, bounds=[("voxel*", 4.0, 3.0)])
    points = np.random.default_rng(2).normal(size=(300, 3))
    obstacles.update_cloud("depth", 1.0, points, [0, 0, 0], frame="lens", position_error=0.02)
    moved = points @ lens.rotation.T + lens.translation
    assert voxels(obstacles).keys() == {
        tuple(index) for index in np.floor(moved / EDGE).astype(int).tolist()
    }
    rows = np.flatnonzero(obstacles.table.alive)
    assert obstacles.table.position_error[rows] == pytest.approx(0.03)
    assert set(obstacles.table.speed[rows]) == {3.0}


def test_what_is_not_finite_or_too_far_is_left_out_and_said():
    obstacles = Obstacles(extent=50.0)
    points = np.array([[1, 0, 0], [math.nan, 0, 0], [2, 0, math.inf], [0, 60, 0], [3, 0, 0]])
    obstacles.update_cloud("depth", 1.0, points, [0, 0, 0])
    assert len(voxels(obstacles)) == 2
    (fault,) = obstacles.take_faults()
    assert fault.kind is FaultKind.POINTS_DROPPED
    assert (fault.source, fault.value) == ("depth", "without 3 of 5 points")
    # A covered lens: what it would see is not known, and no longer believed to be nothing.
    assert obstacles.disbelieved_sources() == []
    obstacles.update_cloud("depth", 1.1, np.full((50, 3), math.nan), [0, 0, 0])
    assert [name for name, _ in obstacles.disbelieved_sources()] == ["depth"]
    assert len(voxels(obstacles)) == 2


def test_a_source_that_sends_empty_clouds_after_a_bad_one_is_believed_again():
    obstacles = Obstacles()
    obstacles.update_cloud("depth", 1.0, np.full((50, 3), math.nan), [0, 0, 0])
    for stamp in (1.5, 1.9):
        obstacles.update_cloud("depth", stamp, [], [0, 0, 0])
        assert [name for name, _ in obstacles.disbelieved_sources()] == ["depth"]
    obstacles.update_cloud("depth", 2.1, [], [0, 0, 0])
    assert obstacles.disbelieved_sources() == []


@pytest.mark.parametrize(
    ("change", "offender"),
    [
        ({"points": [[1.0, 2.0]]}, "points"),
        ({"points": [1.0, 2.0, 3.0]}, "points"),
        ({"points": [[[1.0, 2.0, 3.0]]]}, "points"),
        ({"points": "many"}, "points"),
        ({"points": [[1.0, 2.0, 3.0], [1.0]]}, "points"),
        ({"origin": [0.0, math.nan, 0.0]}, "origin"),
        ({"origin": [0.0, 0.0]}, "origin"),
        ({"voxel": 0.0}, "voxel"),
        ({"voxel": math.nan}, "voxel"),
        ({"voxel": -0.05}, "voxel"),
        ({"voxel": 0.04}, "voxel.*was 0.05 m"),
        ({"occupied": [True, False]}, "occupied"),
        ({"occupied": [1.0]}, "occupied"),
        ({"position_error": -1.0}, "position_error"),
        ({"stamp": math.nan}, "stamp"),
        ({"source": ""}, "source"),
        ({"frame": "moon"}, "frame"),
    ],
)
def test_a_malformed_cloud_is_refused_by_name(change, offender):
    obstacles = Obstacles()
    obstacles.update_cloud("depth", 0.5, [[1.0, 0.0, 0.0]], [0, 0, 0])
    given = {"source": "depth", "stamp": 1.0, "points": [[2.0, 0.0, 0.0]], "origin": [0, 0, 0]}
    with pytest.raises(ObstacleError, match=offender):
        obstacles.update_cloud(**(given | change))
    assert kinds(obstacles) == [FaultKind.MALFORMED]
    assert voxels(obstacles).keys() == {(20, 0, 0)}


def test_a_cloud_without_points_is_a_heartbeat_and_clears_nothing():
    obstacles = Obstacles(sources=["depth"])
    obstacles.update_cloud("depth", 0.5, [[1.0, 0.0, 0.0]], [0, 0, 0])
    obstacles.update_cloud("depth", 1.5, [], [0, 0, 0])
    assert obstacles.silent_sources(1.6, 0.2) == []
    assert len(voxels(obstacles)) == 1


def test_more_voxels_than_there_is_room_for_are_a_fault(monkeypatch):
    monkeypatch.setattr("armguard.obstacles.table.MAXIMUM_ROWS", 64)
    obstacles = Obstacles()
    points = np.column_stack([np.arange(0.5, 10.5, 0.1), np.zeros((100, 2))])
    obstacles.update_cloud("depth", 0.5, points, [0, 0, 0])
    assert len(voxels(obstacles)) == 64
    assert set(kinds(obstacles)) == {FaultKind.TABLE_FULL}
    assert len(obstacles.unplaced()) == 36


# When a voxel goes


def watch(ball, stamp, obstacles, camera=AHEAD, chosen=slice(None), **fields):
    """One cloud of a ball before a wall, which is the background."""
    points, met = camera.see([ball[:3]], [ball[3]])
    points, met = points[chosen], met[chosen]
    obstacles.update_cloud("depth", stamp, points, camera.origin, occupied=met >= 0, **fields)


def test_a_voxel_goes_when_rays_have_passed_it_and_not_because_none_fell_into_it():
    obstacles = Obstacles()
    watch((1.5, 0.0, 0.0, 0.1), 0.0, obstacles)
    before = voxels(obstacles)
    assert len(before) > 10
    # Without points of the background nothing tells that the place is empty.
    watch((1.5, 0.3, 0.0, 0.1), 0.1, obstacles, chosen=AHEAD.see([(1.5, 0.3, 0)], [0.1])[1] >= 0)
    assert voxels(obstacles).keys() > before.keys()
    # Behind a ball that has come between it is hidden.
    watch((0.7, 0.0, 0.0, 0.2), 0.2, obstacles)
    assert voxels(obstacles).keys() > before.keys()
    watch((0.7, 0.0, 2.0, 0.1), 0.3, obstacles)
    assert voxels(obstacles) == {}
    assert kinds(obstacles) == []


def test_rays_begin_where_the_frame_has_the_camera():
    """The same scene, seen by a camera whose frame stands aside, turned."""
    lens = Frame([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, -0.2, 1.0], 0.0)
    obstacles, moved = Obstacles(), Obstacles(frames={"lens": lens})
    for stamp, ball in enumerate(
        [(1.5, 0.0, 0.0, 0.1), (0.7, 0.0, 0.0, 0.2), (0.7, 0.0, 2.0, 0.1)]
    ):
        watch(ball, 0.1 * stamp, obstacles)
        watch(ball, 0.1 * stamp, moved, frame="lens")
        assert (len(voxels(moved)) > 0) == (len(voxels(obstacles)) > 0) == (stamp < 2)


def test_rays_too_far_apart_prove_nothing_and_a_snapshot_says_it():
    sparse = DepthCamera([0, 0, 0], [1, 0, 0], (40, 31))
    obstacles = Obstacles()
    watch((1.5, 0.0, 0.0, 0.1), 0.0, obstacles)
    count = len(voxels(obstacles))
    watch((1.5, 0.0, 2.0, 0.1), 0.1, obstacles, sparse)
    assert len(voxels(obstacles)) == count
    obstacles.update_cloud("depth", 0.2, [[2, 0, 0]], [0, 0, 0], snapshot=True)
    assert voxels(obstacles).keys() == {(40, 0, 0)}


def test_a_late_cloud_tells_what_was_there_and_clears_nothing_newer():
    obstacles = Obstacles()
    watch((1.5, 0.0, 0.0, 0.1), 1.0, obstacles)
    count = len(voxels(obstacles))
    watch((1.5, 0.5, 0.0, 0.1), 0.9, obstacles)
    assert len(voxels(obstacles)) > count
    # A late one that shows nothing but background leaves no fault either; nor does it clear what
    # the same source has told of the same moment, as one of two cameras may.
    watch((1.5, 0.0, 2.0, 0.1), 0.9, obstacles)
    watch((1.5, 0.0, 2.0, 0.1), 1.0, obstacles)
    assert len(voxels(obstacles)) == count
    assert kinds(obstacles) == []
    # Nor does another source's.
    background, met = AHEAD.see([], [])
    obstacles.update_cloud("other", 5.0, background, [0, 0, 0], occupied=met >= 0)
    assert len(voxels(obstacles)) == count


@pytest.mark.parametrize("field", ["speed", "accel"])
def test_a_voxel_of_which_nothing_is_known_any_more_does_not_go_with_rays(field):
    """A cloud with a bound that is no number: what made it could be anywhere, and not there."""
    obstacles = Obstacles()
    watch((1.5, 0.0, 0.0, 0.1), 0.0, obstacles)
    before = voxels(obstacles)
    watch((1.5, 0.0, 0.0, 0.1), 0.1, obstacles, **{field: math.nan})
    assert obstacles.table.refused.any()
    watch((0.7, 0.0, 2.0, 0.1), 0.2, obstacles)
    assert voxels(obstacles).keys() == before.keys()


def test_which_voxels_are_empty_is_as_the_rule_says():
    """The rule once more, ray by ray and voxel by voxel."""
    random = np.random.default_rng(4)
    cleared = kept = 0
    for trial in range(30):
        obstacles = Obstacles()
        edge, error = random.uniform(0.03, 0.2), random.choice([0.0, 0.01])
        origin = random.normal(scale=0.3, size=3)
        centers = origin + random.normal(size=3) + random.normal(scale=0.5, size=(40, 3))
        obstacles.update_cloud("depth", 0.0, centers, origin, edge, position_error=error)
        before = voxels(obstacles)
        towards = centers[random.integers(0, 40, 15000)] + random.normal(scale=0.1, size=(15000, 3))
        ends = origin + (towards - origin) * random.uniform(0.5, 3.0, (15000, 1))
        ends[random.random(len(ends)) < 0.05] = np.nan
        none = np.zeros(len(ends), dtype=bool)
        obstacles.update_cloud(
            "depth", 1.0, ends, origin, edge, occupied=none, position_error=error
        )
        left = voxels(obstacles)
        for index, center in before.items():
            axis = center - origin
            away = np.linalg.norm(axis)
            axis /= away
            # The same two directions across, since cells depend on them.
            aside = [-axis[1], axis[0], 0.0] if abs(axis[2]) < 0.9 else [0.0, -axis[2], axis[1]]
            aside = np.array(aside) / np.linalg.norm(aside)
            along = (ends - origin) @ axis
            behind = math.sqrt(0.75) * edge + error
            half = behind * away / (away - behind)
            passed = (ends - origin)[along > away + behind]
            passed = passed * (away / (passed @ axis))[:, None]
            across = np.column_stack([passed @ aside, passed @ np.cross(axis, aside)])
            inside = across[(np.abs(across) < half).all(axis=1)]
            cells = {tuple(cell) for cell in np.floor((inside + half) / (2 * half) * CELLS)}
            is_empty = away > behind and len(cells) == CELLS**2
            assert (index not in left) == is_empty, (trial, index)
            cleared, kept = cleared + is_empty, kept + (not is_empty)
    assert min(cleared, kept) > 100


def test_a_window_holds_the_whole_voxel_from_every_side():
    random = np.random.default_rng(5)
    for _ in range(300):
        edge, error = random.uniform(0.01, 0.3), random.choice([0.0, 0.02])
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        away = (math.sqrt(0.75) * edge + error) * random.uniform(1.01, 30.0)
        matter = random.uniform(-0.5, 0.5, (500, 3))
        matter[:300] = np.clip(3.0 * matter[:300], -0.5, 0.5)  # many at corners and edges
        seen = away * axis + edge * matter
        along = seen @ axis
        across = seen * (away / along)[:, None] - away * axis
        half = find_half_window(away, edge, error)
        assert np.linalg.norm(across, axis=1).max() + error <= half
    assert find_half_window(0.08, 0.1, 0.0) == find_half_window(math.nan, 0.1, 0.0) == math.inf


@pytest.mark.parametrize("hidden", [0.0501, 0.053])
def test_a_voxel_seen_obliquely_stays_while_a_side_of_it_is_hidden(hidden):
    edge, center = 0.1, np.array([2.05, 2.05, 0.05])
    aside, up = np.array([-1.0, 1.0, 0.0]) / math.sqrt(2.0), np.array([0.0, 0.0, 1.0])
    s, t = (grid.reshape(-1, 1) for grid in np.meshgrid(*[np.arange(-0.12, 0.12, 0.003)] * 2))
    through = center + s * aside + t * up
    none = np.zeros(len(through), dtype=bool)
    for post, left in (s < hidden, 1), (s < 1.0, 0):
        obstacles = Obstacles()
        obstacles.update_cloud("depth", 0.0, [center], [0, 0, 0], edge)
        ends = np.where(post, 2.0, 0.2) * through
        obstacles.update_cloud("depth", 1.0, ends, [0, 0, 0], edge, occupied=none)
        assert len(voxels(obstacles)) == left


def test_a_person_in_view_is_never_outside_the_voxels():
    """A person of balls walks and bends among dropouts, glitches, blind stripes and lost clouds.

    Wherever the person's surface was in view in the last cloud that came, measured or not, the
    voxels contain it, and go on containing what it does until the next one. Errors are stated as
    large as the distance to the next rays.
    """
    random = np.random.default_rng(7)
    camera = DepthCamera([0.0, 0.0, 1.2], [2.0, 0.0, 1.0], (110, 90))
    pace, error = 2.0, 1.6 * 2.0 * camera.spacing
    obstacles = Obstacles(speed=pace)
    offsets = np.array([[0, 0, 1.6], [0, 0, 1.2], [0, 0, 0.9], [0.2, 0.3, 1.3], [0.2, -0.3, 1.1]])
    radii = np.array([0.12, 0.2, 0.2, 0.08, 0.08])

    def person(time):
        walk = np.array([2.0 + 0.3 * np.sin(0.9 * time), 0.6 * np.sin(1.3 * time), 0.0])
        arms = 0.15 * np.sin(2.0 * time) * np.array([[0], [0], [0], [1], [-1]])
        return walk + offsets + arms * [1.0, 0.0, 1.0]

    for tick in range(60):
        time = tick / 30.0
        if tick == 0 or random.random() < 0.8:  # else the cloud is lost
            ends, met = camera.see(person(time), radii)
            points, glitch = ends.copy(), random.random(len(ends)) < 0.001
            depth = random.uniform(0.3, 1.6, (len(points), 1))
            points[glitch] = camera.origin + (depth * camera.rays)[glitch]
            points[random.random(len(points)) < 0.1] = np.nan
            if tick > 0:
                stripe = random.integers(0, 80)
                points.reshape(90, 110, 3)[:, stripe : stripe + 30] = np.nan
            obstacles.update_cloud(
                "depth", time, points, camera.origin, 0.06,
                occupied=(met >= 0) | glitch, position_error=error,
            )  # fmt: skip
            stamp = time
            # Points of the surface by the ball that they ride on; its rim comes into view anew.
            offset = ends - person(time)[met]
            rim = np.linalg.norm(np.cross(offset, camera.rays), axis=1) / radii[met]
            inner = (met >= 0) & (rim < 0.8 * np.linalg.norm(camera.rays, axis=1))
            chosen = random.permutation(np.flatnonzero(inner))[:200]
            body, riding = met[chosen], offset[chosen]
        table = obstacles.table
        rows = np.flatnonzero(table.alive)
        for later in (time, time + 1.0 / 30.0):
            places = person(later)[body] + riding
            reach = table.radius[rows] + table.position_error[rows]
            reach = reach + pace * (later - table.stamp[rows])
            gaps = np.linalg.norm(places[:, None] - table.points[rows, 0], axis=2) - reach
            assert gaps.min(axis=1).max() <= 0.0, (tick, stamp)


@pytest.mark.hazard("H-02")
def test_a_person_behind_an_arm_is_kept_where_they_may_be():
    """Rays that end on what came between say nothing of what is behind it."""
    camera, pace = DepthCamera([0.0, 0.0, 1.2], [2.0, 0.0, 1.2]), 2.0
    obstacles = Obstacles(speed=pace)
    for tick in range(30):
        time = tick / 30.0
        place = np.array([2.0, 0.1 * np.sin(3.0 * time), 1.2])
        balls = [place] if tick < 10 else [place, [0.6, 0.0, 1.2]]
        ends, met = camera.see(balls, [0.15, 0.25][: len(balls)])
        obstacles.update_cloud("depth", time, ends, camera.origin, occupied=met == 0)
        assert (met == 0).any() == (tick < 10)
        table = obstacles.table
        rows = np.flatnonzero(table.alive)
        reach = table.radius[rows] + pace * (time - table.stamp[rows])
        front = place - [0.15, 0.0, 0.0]
        assert (np.linalg.norm(table.points[rows, 0] - front, axis=1) <= reach + 0.02).any()


# What others see of it


def test_a_journal_is_told_voxels_removals_and_what_was_dropped():
    obstacles = Obstacles()
    obstacles.journal = Journal()
    watch((1.5, 0.0, 0.0, 0.1), 0.0, obstacles)
    obstacles.update_cloud("depth", 1.0, [[math.nan, 0, 0]], [0, 0, 0])
    watch((1.5, 0.0, 2.0, 0.1), 2.0, obstacles)
    assert obstacles.journal.kinds() == [
        *("note_update", DroppedPoints, "note_update", DroppedPoints),
        *("note_update", DroppedPoints, RemoveMessage),
    ]
    clean, dropped, _ = obstacles.journal.messages(DroppedPoints)
    other = Obstacles()
    other.update([], 1.0, source="depth")
    other.count_points(clean.source, clean.stamp, clean.points, clean.dropped)
    assert kinds(other) == []
    other.count_points(dropped.source, dropped.stamp, dropped.points, dropped.dropped)
    assert kinds(other) == [FaultKind.POINTS_DROPPED]


def test_copies_go_on_by_themselves():
    obstacles = Obstacles()
    watch((1.5, 0.0, 0.0, 0.1), 0.0, obstacles)
    copied = copy.deepcopy(obstacles)
    watch((1.5, 0.0, 2.0, 0.1), 1.0, copied)
    assert voxels(copied) == {}
    assert len(voxels(obstacles)) > 10


def test_a_cloud_of_which_much_is_missing_counts_by_its_share_of_a_second():
    """Whole clouds count as well, and voxels, which are fewer than points, do not."""
    obstacles, whole = Obstacles(), np.tile([2.0, 0.0, 0.0], (100, 1))
    for tick in range(10):
        obstacles.update_cloud("depth", 0.05 * tick, whole, [0, 0, 0])
    obstacles.update_cloud("depth", 0.5, np.full((100, 3), math.nan), [0, 0, 0])
    assert obstacles.disbelieved_sources() == []
    obstacles = Obstacles()
    mostly = np.concatenate([np.full((51, 3), math.nan), np.arange(147).reshape(49, 3) / 2.0])
    obstacles.update_cloud("depth", 0.0, mostly, [0, 0, 0])
    assert len(voxels(obstacles)) > 40
    assert obstacles.disbelieved_sources() == [
        ("depth", "51 of 100 points of a second could not be used")
    ]


def test_no_body_is_called_as_a_voxel_is():
    """It would go where rays pass, and share its name with a voxel of another source unnoticed."""
    obstacles = Obstacles()
    obstacles.update_cloud("depth", 0.0, [[2.01, 0.01, 0.01]], [0, 0, 0])
    (name,) = (name for name in obstacles.ids if name)
    for source in ("depth", "tracker"):
        # The same list again, which is known by then, as well.
        for _ in range(2):
            with pytest.raises(ObstacleError, match="reserved for voxels of clouds"):
                obstacles.update([name], 1.0, [[0, 0, 0]], radius=0.1, source=source)
    assert FaultKind.MALFORMED in kinds(obstacles)
    obstacles.update(["voxel", "voxel 03 0 0"], 1.0, np.eye(2, 3), radius=0.1, source="tracker")
    assert obstacles.count_of("tracker") == 2
    obstacles.update_cloud("depth", 2.0, [[2.01, 0.01, 0.01]], [0, 0, 0])
    assert kinds(obstacles) == []


def test_cameras_that_see_the_same_surface_are_no_fault():
    obstacles = Obstacles()
    for source in ("left", "right"):
        obstacles.update_cloud(source, 0.0, [[1.0, 0.0, 0.0], [1.0, 0.2, 0.0]], [0, 0, 0])
    assert len(voxels(obstacles, "left")) == len(voxels(obstacles, "right")) == 2
    assert kinds(obstacles) == []


@pytest.mark.parametrize(
    "name",
    ["voxel 9999999 0 0", "voxel 1048576 0 0", "voxel 03 0 0", "voxel -0 0 0", "voxel \u0663 0 0"],
)
def test_names_that_only_look_like_those_of_voxels_are_left_alone(name):
    obstacles = Obstacles()
    obstacles.update([name], 0.0, [[1.0, 0.0, 0.0]], None, 0.1, source="depth")
    obstacles.update_cloud("depth", 1.0, [[2.0, 0.0, 0.0]], [0, 0, 0])
    assert name in obstacles.ids
