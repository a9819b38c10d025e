import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from armguard.cover import Cover
from armguard.exceptions import CoverError, RobotError
from armguard.robot import Robot
from armguard.robot.description import robots_directory
from support.urdf_arms import limits_for, two_links


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


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
