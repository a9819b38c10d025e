import hashlib
import os

import msgspec
import numpy as np
import pytest

from armguard.cover import Cover
from armguard.cover.containment import is_contained
from armguard.cover.cover import CoverTree, hash_surface
from armguard.cover.sphere_tree import GRID
from armguard.exceptions import CoverError
from armguard.robot import Robot
from armguard.robot.description import list_robots, robots_directory
from support.one_link import OneLink
from support.surface_samples import areas, is_inside, sample

SAMPLES = int(os.environ.get("ARMGUARD_COVER_SAMPLES", "20000"))  # a robot


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


@pytest.fixture(scope="module")
def cover_file(panda, tmp_path_factory):
    path = tmp_path_factory.mktemp("cover") / "cover.json"
    panda.cover.save(path)
    return path


def tree(spheres, first_child=(0,), child_count=(0,)):
    return CoverTree(
        np.array(spheres, dtype=np.float64).reshape(-1, 4),
        np.array(first_child, dtype=np.int64),
        np.array(child_count, dtype=np.int64),
    )


def cover_of(robot, *arguments):
    return Cover({"link": tree(*arguments)}, {"link": hash_surface(robot.triangles("link"))})


@pytest.mark.parametrize("name", list_robots())
def test_no_sample_is_outside_at_any_level(name):
    """ARMGUARD_COVER_SAMPLES=1000000 makes it a long run."""
    robot = Robot.load(name)
    area = {link: areas(robot.triangles(link)).sum() for link in robot.links}
    for link in robot.links:
        left = int(SAMPLES * area[link] / sum(area.values())) + 100
        seed = 0
        while left > 0:
            points = sample(robot.triangles(link), min(left, 20_000), seed)
            for level in range(robot.cover.levels(link)):
                assert is_inside(points, robot.cover.spheres(link, level)).all()
            left, seed = left - len(points), seed + 1


@pytest.mark.parametrize(
    "triangles",
    [np.empty((0, 3, 3)), np.full((1, 3, 3), np.nan), np.full((1, 3, 3), np.inf)],
    ids=["empty", "nan", "inf"],
)
def test_geometry_that_is_not_there_is_never_proved(triangles):
    here = OneLink(np.zeros((1, 3, 3)))
    cover = cover_of(here, [[0.0, 0.0, 0.0, 1.0]])
    with pytest.raises(CoverError, match="'link': "):
        Cover.fit(OneLink(triangles))
    with pytest.raises(CoverError, match="'link': "):
        cover.check(OneLink(triangles))
    with pytest.raises(CoverError, match="'link': "):
        cover.verify(OneLink(triangles))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spheres": 3, "protrusion": 0.01}, "exclude each other"),
        ({"spheres": 0}, "spheres: is 0"),
        ({"spheres": 10**21}, "spheres: is 1000000000000000000000; expected 1 to 500"),
        ({"protrusion": 1e300}, "protrusion: is 1e[+]300 m; expected positive, at most 10 m"),
        ({"protrusion": 0.0}, "protrusion: is 0 m"),
        ({"protrusion": float("nan")}, "protrusion: is nan"),
    ],
)
def test_unusable_requests_are_refused(arguments, message):
    with pytest.raises(CoverError, match=message):
        Cover.fit(OneLink(np.zeros((1, 3, 3))), **arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        ([],),
        ([[0, 0, 0, np.nan]],),
        ([[0, 0, 0, 0.0]],),
        ([[0, 0, 0, -1.0]],),
        ([[0, 0, 0, 1.0]] * 2,),
        ([[0, 0, 0, 1.0]] * 3, [1, 0, 0], [1, 0, 0]),
        ([[0, 0, 0, 1.0]] * 3, [1, 0, 0], [3, 0, 0]),
        ([[0, 0, 0, 1.0]] * 3, [0, 0, 0], [2, 0, 0]),
        ([[0, 0, 0, 1.0]] * 3, [2, 0, 0], [2, 0, 0]),
        ([[0, 0, 0, 1.0]] * 3, [1, 0, 0], [-1, 0, 3]),
    ],
)
def test_malformed_trees_are_refused(arguments):
    with pytest.raises(CoverError, match="cover of link 'link'"):
        Cover({"link": tree(*arguments)}, {"link": ""})


def test_files_come_back_as_they_were_and_bytes_are_the_same(panda, cover_file, tmp_path):
    again = Cover.load(cover_file)
    again.verify(panda)
    for link in panda.links:
        for one, other in zip(panda.cover.tree(link), again.tree(link), strict=True):
            np.testing.assert_array_equal(one, other)
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == cover_file.read_bytes()
    assert (robots_directory() / "panda" / "cover.json").read_bytes() == cover_file.read_bytes()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"", b"x", "JSON"),
        (b'"format":1', b'"format":2', "has format 2"),
        (b'"child_count":[4', b'"child_count":[3', "does not match its digest"),
        (b"[0.0", b"[0.1", "does not match its digest"),
        (b'"spheres"', b'"balls"', "balls"),
    ],
)
def test_changed_files_are_refused(cover_file, tmp_path, old, new, message):
    path = tmp_path / "cover.json"
    content = cover_file.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    with pytest.raises(CoverError, match=rf"cover\.json: .*{message}"):
        Cover.load(path)
    with pytest.raises(CoverError, match="cannot be read"):
        Cover.load(tmp_path / "none.json")


def test_numbers_that_no_array_can_hold_are_refused(cover_file, tmp_path):
    """Even where the digest was made to fit them."""
    content = msgspec.json.decode(cover_file.read_bytes())
    content["links"]["panda_hand"]["first_child"][0] = 2**64 - 1
    links = msgspec.json.encode(content["links"], order="deterministic")
    content["digest"] = hashlib.sha256(links).hexdigest()
    (tmp_path / "cover.json").write_bytes(msgspec.json.encode(content))
    with pytest.raises(CoverError, match=r"cover\.json: "):
        Cover.load(tmp_path / "cover.json")


def test_a_cover_never_serves_another_mesh(panda):
    triangles = panda.triangles("panda_hand")
    cover = cover_of(OneLink(triangles), panda.cover.tree("panda_hand").spheres[:1])
    cover.verify(OneLink(triangles))
    moved = triangles.copy()
    moved[7, 1, 2] += 3 * GRID
    with pytest.raises(CoverError, match=r"'link': its cover was made for other geometry"):
        cover.verify(OneLink(moved))
    with pytest.raises(CoverError, match="not in both"):
        cover.verify(panda)
    with pytest.raises(CoverError, match="is for links link"):
        cover.check(panda)


def test_rounding_of_another_machine_does_not_change_the_digest(panda):
    triangles = panda.triangles("panda_link3")
    assert hash_surface(triangles * (1.0 + 2.0**-52)) == hash_surface(triangles)


@pytest.mark.parametrize("level", range(4))
def test_what_is_left_above_a_level_is_a_cover_of_that_level(panda, level):
    cover = panda.cover.cut(level)
    for link in panda.links:
        kept = min(level, panda.cover.levels(link) - 1)
        np.testing.assert_array_equal(cover.spheres(link), panda.cover.spheres(link, kept))
        assert cover.levels(link) == kept + 1
        assert is_contained(panda.surface(link), cover.tree(link))
    cover.verify(panda)


@pytest.mark.parametrize("level", [-1, 4, True, 1.0, None])
def test_a_level_that_no_link_has_is_refused(panda, level):
    with pytest.raises(CoverError, match=r"level: is .*expected 0 to 3"):
        panda.cover.cut(level)
