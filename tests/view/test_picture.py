import math

import numpy as np
import pytest

from armguard.robot.description import find_example_urdf
from armguard.view import ObstacleShapes, Pairs, VerdictSummary
from armguard.view.buckets import BUCKET_COUNT, compute_buckets
from armguard.view.colours import FIRST_LEVEL, LEVELS, REFUSED, STILL
from armguard.view.picture import OUTSIDE, Picture
from support.view_samples import PERIOD, make_frame, make_scene, read_command


class Page:
    """What the page would show."""

    def __init__(self):
        self.payloads = {}
        self.picture = Picture(self.draw, self.payloads.clear)

    def draw(self, command):
        self.payloads[command.key] = command.payload

    def __getitem__(self, key):
        return read_command(self.payloads[key])


@pytest.fixture(scope="module")
def shared_page():
    page = Page()
    page.picture.draw_scene(make_scene())
    return page


@pytest.fixture
def page(shared_page):
    shared_page.picture.draw_frame(make_frame())
    return shared_page


def test_the_arm_is_drawn_from_its_visual_meshes_with_a_pose_each(page):
    meshes = [key for key in page.payloads if key.startswith("set_object /armguard/arm/")]
    poses = [key for key in page.payloads if key.startswith("set_transform /armguard/arm/")]
    assert len(meshes) == len(poses) == 11
    assert all(page[key]["object"]["object"]["format"] == "dae" for key in meshes)
    assert page["banner "]["notes"] == []


@pytest.mark.parametrize("contact_time", [0.01, 0.3, 3.0, math.inf])
def test_everything_has_the_colours_of_its_bucket_and_its_level(page, contact_time):
    page.picture.draw_frame(make_frame(contact_time))
    level = "STOP" if contact_time < 0.2 else "CLEAR"
    bucket = compute_buckets(contact_time, PERIOD)
    for key in (
        "instances /armguard/cover",
        "instances /armguard/obstacles/balls",
        "instances /armguard/obstacles/rods",
        "instances /armguard/pairs/first",
        "surface /armguard/obstacles/hulls",
    ):
        assert page[key]["buckets"].size, key
        assert (page[key]["buckets"] == bucket).all(), key
        assert (page[key]["levels"] == FIRST_LEVEL + LEVELS.index(level)).all(), key


def test_no_contact_time_looks_more_alarming_than_the_verdict(page):
    """An arm that is proved to rest before contact is slow, however short the contact time."""
    for level, time, earned in [("SLOW", 0.164, "SLOW"), ("STOP", 0.4, "AWARE")]:
        verdict = VerdictSummary(level=level, contact_time=time, stop_time=0.171)
        page.picture.draw_frame(make_frame(time, verdict=verdict))
        assert page["banner "]["contact_level"] == earned


def test_where_contact_limits_are_stated_the_time_of_harm_earns_a_level_of_its_own(page):
    verdict = VerdictSummary(
        level="AWARE", contact_time=0.05, stop_time=0.171, harm_time=1.5, contact_speed=0.21
    )
    page.picture.draw_frame(make_frame(0.05, verdict=verdict))
    told = page["banner "]
    assert (told["contact_level"], told["harm_level"]) == ("AWARE", "CLEAR")
    assert (told["harm_time"], told["contact_speed"]) == (1.5, 0.21)
    page.picture.draw_frame(make_frame(0.05))
    told = page["banner "]
    assert told["harm_time"] is told["contact_speed"] is None


def test_matrices_place_balls_and_rods(page):
    balls = page["instances /armguard/obstacles/balls"]["matrices"].reshape(-1, 4, 4)
    assert len(balls) == 3  # one ball, and the two ends of a capsule
    assert np.allclose(balls[0, 3, :3], (0.9, 0.1, 0.7))
    drawn = np.diag(balls[0])[:3]
    assert ((drawn >= 0.15 - 1e-6) & (drawn <= 0.15 * (1.0 + OUTSIDE * BUCKET_COUNT))).all()
    (rod,) = page["instances /armguard/obstacles/rods"]["matrices"].reshape(-1, 4, 4)
    assert np.allclose(rod[3, :3], (0.2, 0.7, 0.55))
    assert np.allclose(rod[1, :3], (0.0, 0.0, 0.7), atol=1e-6)
    axes = rod[:3, :3].astype(float)
    assert np.allclose(np.linalg.norm(axes, axis=1), (0.1, 0.7, 0.1), rtol=OUTSIDE * BUCKET_COUNT)
    assert np.linalg.det(axes) > 0.0


def test_of_parts_that_meet_the_more_imminent_one_lies_outside(page):
    radii = []
    for contact_time in (math.inf, 0.4, 0.1, 0.0):
        page.picture.draw_frame(make_frame(contact_time))
        radii.append(page["instances /armguard/obstacles/balls"]["matrices"][0])
    assert radii[0] == pytest.approx(0.15)
    assert (np.diff(radii) > 0.0).all()
    assert radii[-1] < 1.04 * 0.15


def test_a_hull_spans_its_points(page):
    corners = page["surface /armguard/obstacles/hulls"]["positions"].reshape(-1, 3)
    assert np.allclose(corners.min(axis=0), (0.4, -0.9, 0.2), atol=2e-3)
    assert np.allclose(corners.max(axis=0), (0.8, -0.5, 0.4), atol=2e-3)


def test_flat_and_repeated_hulls_are_drawn_too(page):
    flat = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    obstacles = ObstacleShapes.pack(["flat", "point"], [flat, [[1, 1, 1]] * 4], [0.0, 0.0])
    page.picture.draw_frame(make_frame(obstacles=obstacles))
    assert len(page["surface /armguard/obstacles/hulls"]["positions"]) > 0
    assert page["banner "]["obstacles"] == 2


def test_a_refused_obstacle_has_a_colour_of_its_own(page):
    obstacles = ObstacleShapes.pack(["ghost"], [[0, 0, 1]], [0.1], refused=[True], times=[0.0])
    page.picture.draw_frame(make_frame(obstacles=obstacles))
    balls = page["instances /armguard/obstacles/balls"]
    assert balls["buckets"].tolist() == balls["levels"].tolist() == [REFUSED]
    edges = page["instances /armguard/refused"]
    assert edges["wire"]
    assert edges["buckets"].size == 1


def test_what_is_nowhere_is_not_drawn(page):
    points = [[0, 0, 1], [math.nan, 0, 1], [0, 0, 2], [0, math.inf, 0]]
    obstacles = ObstacleShapes.pack(list("abcd"), points, [0.1, 0.1, math.nan, 0.1])
    pairs = Pairs.pack([0, 0], [1, 3], [0.1, 0.1])
    page.picture.draw_frame(make_frame(obstacles=obstacles, pairs=pairs))
    assert page["instances /armguard/obstacles/balls"]["buckets"].size == 1
    assert page["instances /armguard/pairs/first"]["matrices"].size == 0


@pytest.mark.parametrize(
    "changes",
    [{"q": (0.0,) * 6}, {"q": (math.nan,) * 7}, {"sphere_times": bytes(4)}],
)
def test_an_arm_that_cannot_be_placed_is_said_and_the_rest_is_drawn(page, changes):
    page.picture.draw_frame(make_frame(sequence=77, **changes))
    banner = page["banner "]
    assert "not moved" in banner["notes"][0]
    assert banner["sequence"] == 77


def test_an_unknown_robot_is_said_and_the_rest_is_drawn():
    page = Page()
    page.picture.draw_frame(make_frame())
    assert not page.payloads
    page.picture.draw_scene(make_scene(robot="no-such-arm"))
    page.picture.draw_frame(make_frame())
    assert "no-such-arm" in page["banner "]["notes"][0]
    assert "instances /armguard/obstacles/balls" in page.payloads


def test_collision_geometry_stands_in_for_missing_meshes_and_says_so(tmp_path):
    urdf, packages = find_example_urdf("panda_description/urdf/panda.urdf")
    text = urdf.read_text().replace("meshes/visual/", "meshes/nowhere/")
    path = tmp_path / "own.urdf"
    path.write_text(text)
    page = Page()
    page.picture.draw_scene(make_scene(robot="own", urdf=str(path), package_dirs=(str(packages),)))
    page.picture.draw_frame(make_frame())
    assert "collision geometry" in page["banner "]["notes"][0]
    mesh = page["set_object /armguard/arm/panda_link1_0"]["object"]["geometries"][0]
    assert mesh["data"]["attributes"]["position"]["array"].size > 100


def test_the_same_scene_again_costs_nothing_and_another_one_starts_afresh():
    page = Page()
    page.picture.draw_scene(make_scene(robot="a"))
    page.payloads["marker"] = b""
    page.picture.draw_scene(make_scene(robot="a"))
    assert "marker" in page.payloads
    page.picture.draw_scene(make_scene(robot="b"))
    assert "marker" not in page.payloads


def test_the_ten_most_imminent_pairs_stand_out_and_the_others_are_faint(page):
    pairs = Pairs.pack([5] * 25, [0] * 25, np.linspace(0.3, 2.0, 25))
    page.picture.draw_frame(make_frame(pairs=pairs))
    counts = [
        page[f"instances /armguard/pairs/{path}"]["matrices"].size // 16
        for path in ("first", "near")
    ]
    faint = page["lines /armguard/pairs/rest"]
    assert [*counts, faint["positions"].size // 6] == [1, 9, 15]
    assert faint["opacity"] < 0.5


def test_an_entrance_says_what_it_is_and_is_as_bright_as_what_moves(page):
    obstacles = ObstacleShapes.pack(
        ["door", "wall", "ball"],
        [[1, 0, 1], [2, 0, 1], [3, 0, 1]],
        [0.1, 0.1, 0.1],
        times=[0.3, 0.3, 0.3],
        statics=[True, True, False],
        entrances=[True, False, False],
    )
    assert obstacles.statics.tolist() == [True, True, False]
    assert obstacles.entrances.tolist() == [True, False, False]
    page.picture.draw_frame(make_frame(obstacles=obstacles))
    standing = page["instances /armguard/statics/balls"]
    assert standing["names"] == [
        "door (entrance: a body can appear here)",
        "wall (static)",
    ]
    door, wall = standing["buckets"]
    (ball,) = page["instances /armguard/obstacles/balls"]["buckets"]
    assert door == ball == wall - STILL
    levels = [
        page[f"instances /armguard/{one}/balls"]["levels"] for one in ("statics", "obstacles")
    ]
    assert levels[0].tolist() == [levels[1][0], levels[1][0] + STILL]
    # The camera follows what moves.
    assert page["camera "]["bodies"].size == 4


def test_a_told_path_is_drawn_with_the_arm_at_its_end(page):
    frame = make_frame()
    q = np.array(frame.q)
    plan = np.stack([q, q + 0.1, q + 0.2]).astype("<f4").tobytes()
    path = np.stack([q + 0.1 * k for k in range(5)]).astype("<f4").tobytes()
    page.picture.draw_frame(make_frame(plan=plan, path=path))
    corners = page["surface /armguard/plan/ribbon"]["positions"].reshape(-1, 3)
    assert len(corners) == 3 * 4
    assert len(page["instances /armguard/plan/path"]["buckets"]) == 4
    ghost = page["instances /armguard/plan/ghost"]["matrices"].reshape(-1, 16)
    cover = page["instances /armguard/cover"]["matrices"].reshape(-1, 16)
    assert len(ghost) == len(cover)
    # The arm itself stays where it is.
    page.picture.draw_frame(make_frame(q=tuple(q + 0.2)))
    moved = page["instances /armguard/cover"]["matrices"].reshape(-1, 16)
    assert np.allclose(ghost, moved, atol=1e-5)
    assert not np.allclose(cover, moved, atol=1e-2)
    # And without anything told there is nothing of it.
    assert page["surface /armguard/plan/ribbon"]["positions"].size == 0
    assert len(page["instances /armguard/plan/path"]["buckets"]) == 0


def test_many_obstacles_are_drawn_with_less_detail_and_said_so(page):
    segments, notes = [], []
    for count in (3, 100, 1000):
        many = ObstacleShapes.pack(list(map(str, range(count))), np.ones((count, 3)), [0.1] * count)
        page.picture.draw_frame(make_frame(obstacles=many, omitted=7))
        segments.append(page["instances /armguard/obstacles/balls"]["segments"])
        notes.append(" ".join(page["banner "]["notes"]))
    assert segments[0] > segments[1] > segments[2]
    assert ["detail" in said for said in notes] == [False, True, True]
    assert "less detail" in notes[1]
    assert "the least detail" in notes[2]
    assert all("7 more obstacles" in said for said in notes)


@pytest.mark.parametrize(
    ("recording", "since", "explanation", "asking"),
    [
        (
            "/var/two words.mcap",
            12.3456,
            (),
            "armguard replay '/var/two words.mcap' --explain 12.345",
        ),
        ("", 7.0, (), "armguard replay FILE --explain 7.000"),
        ("/var/run.mcap", 7.0, ("the answer itself",), ""),
        ("/var/run.mcap", None, (), ""),
        ("/var/run.mcap", math.nan, (), ""),
    ],
)
def test_a_stop_of_a_running_monitor_tells_how_to_have_it_explained(
    recording, since, explanation, asking
):
    page = Page()
    page.picture.draw_scene(make_scene(recording=recording))
    for level in ("STOP", "SLOW"):
        verdict = VerdictSummary(level=level, contact_time=0.1, stop_time=0.2, since=since)
        page.picture.draw_frame(make_frame(verdict=verdict, explanation=explanation))
        assert page["banner "]["asking"] == (asking if level == "STOP" else "")


def test_a_stopping_volume_that_cannot_be_found_is_said(page):
    page.picture.draw_frame(make_frame(), with_volume=True)
    assert "stopping volume is not drawn" in page["banner "]["notes"][0]
    page.picture.draw_frame(make_frame())
    assert page["banner "]["notes"] == []


def test_a_moment_that_cannot_be_drawn_to_its_end_changes_nothing(page, monkeypatch):
    before = dict(page.payloads)
    monkeypatch.setattr(page.picture, "_describe", None)
    with pytest.raises(TypeError):
        page.picture.draw_frame(make_frame(0.01, sequence=99))
    assert page.payloads == before
