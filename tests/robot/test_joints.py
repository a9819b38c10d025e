import numpy as np
import pinocchio
import pytest

from armguard.exceptions import RobotError
from armguard.robot import Robot
from support.urdf_arms import BOX, joint_xml, limits_for, link_xml, two_links, write_urdf


def test_unknown_and_unlimited_joints_are_refused(tmp_path):
    path = two_links(tmp_path)
    with pytest.raises(RobotError, match=r"'elbow': is not in the URDF.*shoulder"):
        Robot.from_urdf(path, limits=limits_for("elbow"))
    with pytest.raises(RobotError, match="'shoulder': has no limits"):
        Robot.from_urdf(path, limits=limits_for("elbow"), joints=["shoulder"])
    with pytest.raises(RobotError, match="no joint is to be watched"):
        Robot.from_urdf(path, limits=limits_for("shoulder"), joints=[])


def test_unwatched_joints_beyond_watched_ones_must_be_locked_by_name(tmp_path):
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "upper", "lower", "lamp")),
        joint_xml("shoulder", "base", "upper"),
        joint_xml("elbow", "upper", "lower"),
        joint_xml("lamp_joint", "base", "lamp"),
    )
    for watched in ("shoulder", "elbow"):
        other = {"shoulder": "elbow", "elbow": "shoulder"}[watched]
        with pytest.raises(RobotError, match=f"'{other}': is not watched"):
            Robot.from_urdf(path, limits=limits_for(watched))
    limits = limits_for("elbow", locked={"shoulder": {"travel": [0.0, 1.0]}})
    with pytest.raises(RobotError, match="'shoulder': cannot be anywhere in its travel"):
        Robot.from_urdf(path, limits=limits)
    limits = limits_for("shoulder", locked={"elbow": {"travel": [0.0, 7.0]}})
    with pytest.raises(RobotError, match=r"'elbow': has travel.*at most one turn"):
        Robot.from_urdf(path, limits=limits)
    limits["locked"]["elbow"] = {}
    with pytest.raises(RobotError, match="expected position or travel"):
        Robot.from_urdf(path, limits=limits)
    limits["locked"]["elbow"] = {"position": 0.7}
    robot = Robot.from_urdf(path, limits=limits)
    assert robot.links == ("upper", "lower")
    assert [robot.joint_index(link) for link in robot.links] == [1, 1]
    full = pinocchio.buildModelFromUrdf(str(path))
    data = full.createData()
    q = pinocchio.neutral(full)
    q[full.joints[full.getJointId("elbow")].idx_q] = 0.7
    pinocchio.forwardKinematics(full, data, q)
    upper, lower = (data.oMi[full.getJointId(joint)] for joint in ("shoulder", "elbow"))
    expected = upper.actInv(lower).translation
    np.testing.assert_allclose(robot.hull("lower").mean(axis=0), expected, atol=1e-12)


def test_a_link_that_is_drawn_but_cannot_be_touched_is_refused_unless_it_is_named(tmp_path):
    drawn = f"<visual>{BOX}</visual>"
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "upper")),
        f'<link name="hand">{drawn}</link><link name="sign">{drawn}</link>',
        joint_xml("shoulder", "base", "upper"),
        joint_xml("grip", "upper", "hand", "fixed"),
        joint_xml("post", "base", "sign", "fixed"),
    )
    limits = limits_for("shoulder")
    with pytest.raises(RobotError, match="link 'hand': is drawn and moves, but has no collision"):
        Robot.from_urdf(path, limits=limits)
    robot = Robot.from_urdf(path, limits=limits | {"bare_links": ["hand"]})
    assert robot.links == ("upper",)
    with pytest.raises(RobotError, match="bare link 'upper': is not a link that is drawn"):
        Robot.from_urdf(path, limits=limits | {"bare_links": ["hand", "upper"]})
