import numpy as np
import pytest

from armguard.exceptions import RobotError
from armguard.robot import Robot
from armguard.robot_description import find_example_urdf
from armguard.urdf_links import UrdfLinks
from support.urdf_arms import BOX, joint_xml, limits_for, link_xml, two_links, write_urdf


def test_surfaces_are_those_of_a_robot_with_limits(tmp_path):
    path = two_links(tmp_path)
    bare, robot = UrdfLinks(path), Robot.from_urdf(path, limits=limits_for("shoulder"))
    assert bare.links == robot.links == ("upper",)
    assert bare.name == "arm"
    assert bare.joint_index("upper") == robot.joint_index("upper") == 1
    np.testing.assert_array_equal(bare.triangles("upper"), robot.triangles("upper"))


def test_every_joint_counts_as_one_that_moves():
    path, packages = find_example_urdf("panda_description/urdf/panda.urdf")
    bare = UrdfLinks(path, [packages])
    assert "panda_link0" not in bare.links
    assert set(bare.links) >= {"panda_link1", "panda_hand", "panda_rightfinger"}
    assert bare.joint_index("panda_hand") != bare.joint_index("panda_leftfinger")
    assert list(bare.links) == sorted(bare.links, key=bare.joint_index)


def test_a_urdf_without_moving_geometry_is_refused(tmp_path):
    path = write_urdf(
        tmp_path, link_xml("base"), link_xml("upper", None), joint_xml("joint", "base", "upper")
    )
    with pytest.raises(RobotError, match="no joint moves"):
        UrdfLinks(path)


def test_what_is_drawn_and_moved_but_has_no_collision_geometry_is_told(tmp_path):
    drawn = f"<visual>{BOX}</visual>"
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "upper")),
        f'<link name="hand">{drawn}</link><link name="sign">{drawn}</link><link name="tip"/>',
        joint_xml("shoulder", "base", "upper"),
        joint_xml("grip", "upper", "hand", "fixed"),
        joint_xml("point", "hand", "tip", "fixed"),
        joint_xml("post", "base", "sign", "fixed"),
    )
    assert UrdfLinks(path).bare == ("hand",)
    assert UrdfLinks(path).links == ("upper",)
