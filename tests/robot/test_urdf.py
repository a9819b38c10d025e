import os
import re

import numpy as np
import pinocchio
import pytest

from armguard.exceptions import RobotError
from armguard.robot import Robot
from armguard.robot.description import read_description
from armguard.robot.joints import check_joints
from armguard.robot.urdf import read_urdf
from support.urdf_arms import (
    BOX,
    joint_xml,
    limits_for,
    link_xml,
    mesh_xml,
    two_links,
    write_stl,
    write_urdf,
)


@pytest.mark.hazard("H-15")
@pytest.mark.parametrize("content", ["", "<robot", "<robot/>", '<robot name="x"/>'])
def test_unusable_urdfs_are_refused(tmp_path, content):
    path = tmp_path / "arm.urdf"
    path.write_text(content)
    with pytest.raises(RobotError, match=r"arm|shoulder"):
        Robot.from_urdf(path, limits=limits_for("shoulder"))
    with pytest.raises(RobotError, match="cannot be read"):
        Robot.from_urdf(tmp_path / "none.urdf", limits=limits_for("shoulder"))


def test_mimic_joints_are_refused(tmp_path):
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "upper", "lower")),
        joint_xml("shoulder", "base", "upper"),
        joint_xml("elbow", "upper", "lower", extra='<mimic joint="shoulder"/>'),
    )
    with pytest.raises(RobotError, match="'elbow': mimics joint 'shoulder'"):
        Robot.from_urdf(path, limits=limits_for("shoulder", locked={"elbow": {"position": 0.0}}))


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        ({"travel": [0.0, 0.1]}, {"travel": [-0.3, 0.0]}, None),
        ({"travel": [0.0, 0.1]}, {"travel": [-0.3, -0.1]}, r"takes it: all of \[-0.22, -0.02\]"),
        ({"travel": [0.0, 0.1]}, {"travel": [-0.2, 0.0]}, "has travel"),
        ({"travel": [0.0, 0.1]}, {"position": -0.02}, "has position = -0.02; expected"),
        ({"position": 0.1}, {"position": -0.22}, None),
        ({"position": 0.1}, {"position": 0.1}, "has position = 0.1; expected"),
        ({"position": 0.1}, {"travel": [-0.3, 0.0]}, None),
        (None, {"travel": [-5.0, 2.0]}, "carried by"),
    ],
)
def test_a_mimic_joint_is_locked_where_its_leader_takes_it(tmp_path, left, right, words):
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "upper", "left", "right")),
        joint_xml("shoulder", "base", "upper"),
        joint_xml("left", "upper", "left", "prismatic"),
        joint_xml(
            "right",
            "upper",
            "right",
            "prismatic",
            '<mimic joint="left" multiplier="-2" offset="-0.02"/>',
        ),
    )
    urdf = read_urdf(path)
    locked = {name: entry for name, entry in (("left", left), ("right", right)) if entry}
    description = read_description(limits_for("shoulder", locked=locked))
    if words is None:
        assert check_joints(urdf, description, ["shoulder"]) == ["left", "right"]
        return
    with pytest.raises(RobotError, match=words):
        check_joints(urdf, description, ["shoulder"])


@pytest.mark.parametrize(("kind", "freedoms"), [("floating", 6), ("planar", 3)])
def test_moving_bases_are_refused(tmp_path, kind, freedoms):
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("world", "base", "upper")),
        joint_xml("drive", "world", "base", kind),
        joint_xml("shoulder", "base", "upper"),
    )
    with pytest.raises(RobotError, match=f"'drive': has {freedoms} degrees of freedom"):
        Robot.from_urdf(path, limits=limits_for("shoulder"))


def test_continuous_joints_become_unbounded_revolute_ones(tmp_path):
    path = two_links(tmp_path, kind="continuous")
    with pytest.raises(RobotError, match="'shoulder': is continuous and has no range"):
        Robot.from_urdf(path, limits=limits_for("shoulder"))
    robot = Robot.from_urdf(path, limits=limits_for("shoulder", position=None))
    assert robot.model.nq == robot.model.nv == 1
    assert (robot.lower_position_limit, robot.upper_position_limit) == (-np.inf, np.inf)
    original = pinocchio.buildModelFromUrdf(str(path))
    assert original.nq == 2
    for angle in (-7.0, 0.3, 100.0):
        data, expected = robot.model.createData(), original.createData()
        pinocchio.forwardKinematics(robot.model, data, np.array([angle]))
        pinocchio.forwardKinematics(original, expected, np.array([np.cos(angle), np.sin(angle)]))
        np.testing.assert_allclose(data.oMi[1].homogeneous, expected.oMi[1].homogeneous, atol=1e-13)


@pytest.mark.hazard("H-16")
@pytest.mark.parametrize("damage", ["missing", "empty", "noise", "nan", "package"])
def test_unreadable_meshes_are_refused_by_name(tmp_path, damage):
    path = tmp_path / "bad.stl"
    if damage == "empty":
        write_stl(path, [])
    elif damage == "noise":
        path.write_bytes(bytes(range(256)))
    elif damage == "nan":
        write_stl(path, [np.full((3, 3), np.nan), np.eye(3)])
    name = "package://none/bad.stl" if damage == "package" else "bad.stl"
    with pytest.raises(RobotError, match=r"bad\.stl|'upper'"):
        Robot.from_urdf(two_links(tmp_path, mesh_xml(name)), limits=limits_for("shoulder"))


@pytest.mark.parametrize("scheme", ["package", "model"])
@pytest.mark.parametrize("by_ros", [False, True])
def test_packages_and_models_are_found_in_named_folders_and_in_those_of_ros(
    tmp_path, monkeypatch, scheme, by_ros
):
    """By the name of their folder, or by what their manifest says: clones have other names."""
    for folder, name in (("arm", "arm"), ("clone-of-it", "arm_description")):
        home = tmp_path / folder
        (home / "meshes").mkdir(parents=True)
        write_stl(home / "meshes" / "upper.stl", [np.eye(3), -np.eye(3)])
        (home / "package.xml").write_text(f"<package><name>{name}</name></package>")
        path = two_links(tmp_path, mesh_xml(f"{scheme}://{name}/meshes/upper.stl"))
        folders = f"{tmp_path / 'nowhere'}{os.pathsep}{tmp_path}"
        monkeypatch.setenv("ROS_PACKAGE_PATH", folders if by_ros else "")
        named = () if by_ros else (tmp_path,)
        robot = Robot.from_urdf(path, limits=limits_for("shoulder"), package_dirs=named)
        assert robot.triangles("upper").shape == (2, 3, 3)


def test_a_mesh_that_is_not_found_names_package_folders_and_option(tmp_path):
    path = two_links(tmp_path, mesh_xml("package://arm_description/meshes/upper.stl"))
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(RobotError) as caught:
        Robot.from_urdf(path, limits=limits_for("shoulder"), package_dirs=[empty])
    for words in ("'upper'", "arm_description", str(empty), "--package-dirs"):
        assert words in str(caught.value)


@pytest.mark.hazard("H-15")
@pytest.mark.parametrize("axis", ["0 0 0", "0 -0 0"])
def test_a_joint_without_an_axis_is_refused(tmp_path, axis):
    """Pinocchio takes such an axis as it is, and scales the link instead of turning it."""
    path = two_links(tmp_path)
    path.write_text(path.read_text().replace("0 0.6 0.8", axis))
    with pytest.raises(RobotError, match="'shoulder': has an axis of length 0; expected a dir"):
        Robot.from_urdf(path, limits=limits_for("shoulder"))


@pytest.mark.hazard("H-16")
@pytest.mark.parametrize(
    "geometry",
    [
        '<geometry><box size="0.1 nan 0.1"/></geometry>',
        '<geometry><box size="0.1 0.1"/></geometry>',
        "<geometry/>",
        f"{BOX}</collision><collision><geometry/>",
    ],
)
def test_a_collision_element_that_is_lost_is_refused_by_link(tmp_path, geometry):
    with pytest.raises(RobotError, match=r"link 'upper': only [01] of its [12] collision elem"):
        read_urdf(two_links(tmp_path, geometry))


@pytest.mark.parametrize("site", ["www.ros.org", "ros.org"])
def test_a_xacro_is_refused_with_what_expands_it(tmp_path, site):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(
        f'<robot name="arm" xmlns:xacro="http://{site}/wiki/xacro"><!-- a comment -->'
        '<xacro:include filename="other.xacro"/></robot>'
    )
    with pytest.raises(RobotError, match=r"is a xacro: it has <xacro:include>.*`xacro arm\.urdf"):
        read_urdf(path)


@pytest.mark.parametrize("limit", ["", '<limit lower="-1" upper="2"/>'])
@pytest.mark.parametrize("kind", ["revolute", "prismatic", "continuous"])
def test_limits_that_are_not_relied_on_may_be_missing(tmp_path, kind, limit):
    path = two_links(tmp_path, kind=kind)
    path.write_text(
        path.read_text().replace('<limit lower="-1" upper="2" effort="10" velocity="1"/>', limit)
    )
    model = read_urdf(path).model
    assert (model.velocityLimit, model.effortLimit) == (0.0, 0.0)


@pytest.mark.hazard("H-15")
@pytest.mark.parametrize("limit", ['velocity="-1"', 'effort="nan"', 'lower="x"'])
def test_a_limit_that_is_no_number_is_refused_by_joint(tmp_path, limit):
    path = two_links(tmp_path)
    key = limit.partition("=")[0]
    path.write_text(re.sub(f'{key}="[^"]*"', limit, path.read_text()))
    with pytest.raises(RobotError, match=f"'shoulder': has {key}="):
        read_urdf(path)


def draw_hand(folder, content=f'<origin xyz="0 0 1"/>{BOX}'):
    return write_urdf(
        folder,
        link_xml("base"),
        f'<link name="upper"><visual>{content}</visual></link>',
        '<link name="tip"/>',
        joint_xml("shoulder", "base", "upper"),
        joint_xml("wrist", "upper", "tip"),
    )


def test_a_link_is_collided_with_as_it_is_drawn(tmp_path):
    urdf = read_urdf(draw_hand(tmp_path), drawn=["upper"])
    assert urdf.bare == ()
    (drawn,) = (one for one in urdf.collision_model.geometryObjects if one.parentJoint == 1)
    np.testing.assert_array_equal(drawn.placement.translation, [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("link", "words"),
    [("hand", "is not in the model"), ("base", "of its own"), ("tip", "is not drawn")],
)
def test_a_link_without_such_a_drawing_is_refused(tmp_path, link, words):
    with pytest.raises(RobotError, match=words):
        read_urdf(draw_hand(tmp_path), drawn=[link])


def test_a_fixed_joint_may_have_the_name_of_a_link(tmp_path):
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "upper", "hand")),
        joint_xml("shoulder", "base", "upper"),
        joint_xml("hand", "upper", "hand", "fixed"),
    )
    robot = Robot.from_urdf(path, limits=limits_for("shoulder"))
    assert robot.links == ("upper", "hand")
