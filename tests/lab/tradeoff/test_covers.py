import pytest

from armguard.cover import Cover
from armguard.exceptions import CoverError
from armguard.lab.tradeoff.covers import Covers, cache_directory, fit_cover
from armguard.lab.tradeoff.ladder import AXES, Setting
from armguard.robot import Robot
from support.panda_monitor import ranged_panda
from support.urdf_arms import limits_for, two_links


@pytest.fixture
def robot(tmp_path):
    return Robot.from_urdf(two_links(tmp_path), limits=limits_for("shoulder"))


def test_a_cover_is_fitted_once(robot, tmp_path, monkeypatch):
    cover = fit_cover(robot, 0.03, tmp_path / "cache")
    monkeypatch.setattr(Cover, "fit", None)
    again = fit_cover(robot, 0.03, tmp_path / "cache")
    assert (again.spheres("upper") == cover.spheres("upper")).all()
    (file,) = (tmp_path / "cache").iterdir()
    assert file.name.startswith("arm-30mm-")


def test_what_lies_in_the_cache_is_believed_only_with_its_proof(robot, tmp_path):
    cover = fit_cover(robot, 0.03, tmp_path)
    (file,) = tmp_path.glob("*mm-*.json")
    for content in (b"{}", b"", file.read_bytes().replace(b"0", b"1")):
        file.write_bytes(content)
        again = fit_cover(robot, 0.03, tmp_path)
        assert (again.spheres("upper") == cover.spheres("upper")).all()
    tree = cover.tree("upper")
    bare = Cover(
        {"upper": tree._replace(spheres=tree.spheres - [0, 0, 0, 5e-3])},
        {"upper": cover.digest("upper")},
    )
    bare.save(file)
    assert fit_cover(robot, 0.03, tmp_path).check(robot).proved


def test_a_cache_that_cannot_be_written_costs_only_time(robot, tmp_path):
    (tmp_path / "file").touch()
    assert fit_cover(robot, 0.03, tmp_path / "file").check(robot).proved


def test_the_cache_is_the_users(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert str(cache_directory()) == "/somewhere/armguard/covers"


def test_settings_choose_among_covers():
    panda = ranged_panda()
    asked = []

    def fit(robot, protrusion):
        asked.append(protrusion)
        return robot.cover.cut(1)

    covers = Covers(panda, fit)
    level, fine = AXES["cover"][0], AXES["cover"][-1]
    assert covers.choose(Setting("default")) is panda.cover
    assert covers.choose(Setting("one", (level,))).levels("panda_hand") == 1
    for _ in range(2):
        assert covers.choose(Setting("two", (fine,))).levels("panda_hand") == 2
    assert asked == [0.01]
    with pytest.raises(CoverError):
        covers.choose(Setting("three", (fine, level._replace(level=7))))
    large = Covers(Robot.load("ur10"), fit)
    with pytest.raises(CoverError, match=r"cover 10 mm: would take many minutes.*armguard cover"):
        large.choose(Setting("two", (fine,)))
