import shutil
import tomllib
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from armguard.cover import Cover
from armguard.exceptions import CoverError, RobotError
from armguard.robot import Robot
from armguard.robot.description import find_example_urdf, robots_directory
from support.urdf_arms import brakes_for, limits_for, two_links


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


def test_panda_has_its_seven_joints_and_moving_links(panda):
    assert panda.joints == tuple(f"panda_joint{i}" for i in range(1, 8))
    arm = tuple(f"panda_link{i}" for i in range(1, 8))
    assert panda.links == (*arm, "panda_hand", "panda_leftfinger", "panda_rightfinger")
    assert panda.model.nq == panda.model.nv == 7
    assert [panda.joint_index(link) for link in panda.links] == [1, 2, 3, 4, 5, 6, 7, 7, 7, 7]


def test_every_limit_is_the_files_and_read_only(panda):
    content = tomllib.loads((robots_directory() / "panda" / "robot.toml").read_text())
    for key, array in {
        "velocity": panda.velocity_limit,
        "acceleration": panda.acceleration_limit,
    }.items():
        np.testing.assert_array_equal(array, [content["joints"][j][key] for j in panda.joints])
        assert all(panda.source(joint, key) for joint in panda.joints)
    positions = np.array([content["joints"][joint]["position"] for joint in panda.joints])
    np.testing.assert_array_equal(panda.lower_position_limit, positions[:, 0])
    np.testing.assert_array_equal(panda.model.upperPositionLimit, positions[:, 1])
    np.testing.assert_array_equal(panda.acceleration_limit, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_array_equal(panda.position_error, np.full(7, 1e-3))
    np.testing.assert_array_equal(panda.velocity_error, np.full(7, 0.02))
    # What 1 kg, the heaviest load of its table, leaves of them at low speed.
    np.testing.assert_array_equal(panda.braking_deceleration, 0.25 * panda.acceleration_limit)
    assert all(panda.source(joint, "braking") for joint in panda.joints)
    with pytest.raises(ValueError, match="read-only"):
        panda.velocity_limit[0] = 100.0


def test_panda_agrees_with_its_urdf(panda):
    path, _ = find_example_urdf("panda_description/urdf/panda.urdf")
    model = pinocchio.buildModelFromUrdf(str(path))
    np.testing.assert_array_equal(panda.velocity_limit, model.velocityLimit[:7])
    np.testing.assert_array_equal(panda.lower_position_limit, model.lowerPositionLimit[:7])
    np.testing.assert_array_equal(panda.upper_position_limit, model.upperPositionLimit[:7])


def test_unknown_robot_lists_those_that_exist():
    with pytest.raises(RobotError, match=r"'pandas'.* is not known.*panda"):
        Robot.load("pandas")


def test_a_folder_with_a_description_and_a_cover_is_a_robot(panda, tmp_path, monkeypatch):
    folder = tmp_path / "panda"
    shutil.copytree(robots_directory() / "panda", folder)
    text = (folder / "robot.toml").read_text()
    (folder / "robot.toml").write_text(text.replace("acceleration = 15.0", "acceleration = 14.5"))
    own = Robot.load(folder)
    assert (own.name, own.joints) == ("panda", panda.joints)
    assert own.acceleration_limit[0] == 14.5
    monkeypatch.chdir(tmp_path)
    # A known name is that robot, wherever one is.
    assert Robot.load("panda").acceleration_limit[0] == 15.0
    assert Robot.load("./panda").acceleration_limit[0] == 14.5
    assert Robot.load(Path("panda")).acceleration_limit[0] == 14.5


def test_a_folder_without_its_files_is_refused_with_what_makes_them(tmp_path):
    with pytest.raises(RobotError, match=r"has no robot\.toml; `armguard robot new"):
        Robot.load(tmp_path)
    (tmp_path / "robot.toml").write_text(
        (robots_directory() / "panda" / "robot.toml").read_text().replace("panda.urdf", "no.urdf")
    )
    with pytest.raises(
        RobotError, match=r"urdf: is 'panda_description/urdf/no\.urdf', which is no"
    ):
        Robot.load(tmp_path)


def test_unknown_link_lists_those_that_exist(panda):
    with pytest.raises(RobotError, match=r"'elbow': is not a link.*panda_link1"):
        panda.triangles("elbow")
    with pytest.raises(RobotError, match="'panda_link8': has no collision geometry"):
        panda.hull("panda_link8")
    with pytest.raises(RobotError, match="'panda_link0': has no collision geometry that a watched"):
        panda.joint_index("panda_link0")


def test_corners_of_a_link_are_found_once_and_shared_by_all_who_ask(panda):
    for link in panda.links:
        corners = panda.hull(link)
        assert panda.hull(link) is corners
        assert not corners.flags.writeable
        assert {*map(tuple, corners)} == {*map(tuple, panda.triangles(link).reshape(-1, 3))}
        assert len({*map(tuple, corners)}) == len(corners)


def test_a_joints_own_source_comes_before_the_robots(tmp_path):
    row = brakes_for("shoulder", source="")
    limits = limits_for("shoulder", sources={"braking": "measured"}, brakes=[row])
    robot = Robot.from_urdf(two_links(tmp_path), limits=limits)
    assert robot.source("shoulder", "braking") == "measured"
    assert robot.source("shoulder", "velocity") == "a test"


def test_links_without_geometry_are_refused(tmp_path):
    with pytest.raises(RobotError, match="no watched joint moves a link with collision geometry"):
        Robot.from_urdf(two_links(tmp_path, geometry=""), limits=limits_for("shoulder"))


def test_a_supplied_cover_is_proved_again(tmp_path):
    path = two_links(tmp_path)
    limits = limits_for("shoulder")
    robot = Robot.from_urdf(path, limits=limits)
    robot.cover.save(tmp_path / "cover.json")
    again = Robot.from_urdf(path, limits=limits, cover=tmp_path / "cover.json")
    np.testing.assert_array_equal(again.cover.spheres("upper"), robot.cover.spheres("upper"))
    path = two_links(tmp_path, '<geometry><box size="0.1 0.06 0.05"/></geometry>')
    with pytest.raises(CoverError, match=r"'upper'.*made for other geometry"):
        Robot.from_urdf(path, limits=limits, cover=tmp_path / "cover.json")
    other = Robot.from_urdf(path, limits=limits)
    stale = Cover({"upper": robot.cover.tree("upper")}, {"upper": other.cover.digest("upper")})
    stale.save(tmp_path / "cover.json")
    with pytest.raises(CoverError, match=r"'upper'.*is not inside its spheres"):
        Robot.from_urdf(path, limits=limits, cover=tmp_path / "cover.json")


def test_another_cover_of_a_known_robot_is_proved_again(panda, tmp_path):
    file = tmp_path / "cover.json"
    panda.cover.cut(2).save(file)
    robot = Robot.load("panda", cover=file)
    for link in panda.links:
        level = min(2, panda.cover.levels(link) - 1)
        np.testing.assert_array_equal(robot.cover.spheres(link), panda.cover.spheres(link, level))
    trees = {link: panda.cover.tree(link) for link in panda.links}
    shrunk = trees["panda_hand"].spheres - [0.0, 0.0, 0.0, 1e-3]
    trees["panda_hand"] = trees["panda_hand"]._replace(spheres=shrunk)
    Cover(trees, {link: panda.cover.digest(link) for link in trees}).save(file)
    with pytest.raises(CoverError, match=r"'panda_hand'.*is not inside its spheres in .*json"):
        Robot.load("panda", cover=file)
    with pytest.raises(CoverError, match="cover"):
        Robot.load("ur5", cover=file)


def test_a_level_ends_the_tree(panda, tmp_path):
    robot = Robot.load("panda", level=0)
    assert [robot.cover.levels(link) for link in robot.links] == [1] * len(robot.links)
    assert robot.cover.check(robot).proved
    with pytest.raises(CoverError, match="level: is 4; expected 0 to 3"):
        Robot.load("panda", level=4)
    path, limits = two_links(tmp_path), limits_for("shoulder")
    coarse = Robot.from_urdf(path, limits=limits, level=0)
    assert len(coarse.cover.spheres("upper")) == 1
