import itertools

import numpy as np
import pinocchio
import pytest

from armguard.cover.signed_distance import compute_signed_distances
from armguard.exceptions import RobotError
from armguard.robot import Robot
from armguard.robot.description import read_description
from armguard.robot.links import UrdfLinks
from armguard.robot.urdf import read_urdf
from support.urdf_arms import BOX, joint_xml, limits_for, link_xml, write_urdf


def reach(path, travel, carriers, base=None):
    """Corners of links all over the travels, in the frame of a joint; None: of the world."""
    full = pinocchio.buildModelFromUrdf(str(path))
    data = full.createData()
    corners = np.array(list(itertools.product((-0.05, 0.05), (-0.03, 0.03), (-0.02, 0.02))))
    reached = {link: [] for link in carriers}
    for shares in itertools.product(np.linspace(0.0, 1.0, 13), repeat=2):
        q = np.zeros(full.nq)
        for share, (joint, (lower, upper)) in zip(shares, travel.items(), strict=True):
            q[full.joints[full.getJointId(joint)].idx_q] = lower + share * (upper - lower)
        pinocchio.forwardKinematics(full, data, q)
        for link, joint in carriers.items():
            place = data.oMi[full.getJointId(joint)]
            if base is not None:
                place = data.oMi[full.getJointId(base)].actInv(place)
            reached[link].append(corners @ place.rotation.T + place.translation)
    return {link: np.concatenate(points) for link, points in reached.items()}


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "fixed"])
def test_a_travelling_link_is_all_that_it_reaches(tmp_path, kind):
    def chain(kind):
        return write_urdf(
            tmp_path,
            *(link_xml(name) for name in ("base", "upper", "lower", "tip")),
            joint_xml("shoulder", "base", "upper"),
            joint_xml("elbow", "upper", "lower", kind),
            joint_xml("wrist", "lower", "tip", kind),
        )

    travel = {"elbow": [-0.4, 1.7], "wrist": [0.2, 2.0]}
    locked = {joint: {"travel": ends} for joint, ends in travel.items()}
    limits = limits_for("shoulder", locked=locked)
    description = read_description(limits)
    urdf = read_urdf(chain(kind), (), description.travelling)
    robot = Robot("arm", urdf, description, ["shoulder"])
    assert robot.links == ("upper", "lower", "tip")
    # A joint that is drawn fixed turns all the same.
    path = chain("revolute" if kind in ("fixed", "continuous") else kind)
    reached = reach(path, travel, {"lower": "elbow", "tip": "wrist"}, "shoulder")
    for link, points in reached.items():
        assert compute_signed_distances(points, robot.triangles(link)).max() < 1e-9


def test_what_travels_beside_the_arm_is_fixed_as_all_that_it_reaches(tmp_path):
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "upper", "neck", "head", "hatch")),
        joint_xml("shoulder", "base", "upper"),
        joint_xml("nod", "base", "neck"),
        joint_xml("turn", "neck", "head"),
        joint_xml("hinge", "base", "hatch"),
    )
    travel = {"nod": [-0.4, 1.7], "turn": [0.2, 2.0]}
    limits = limits_for("shoulder", locked={key: {"travel": ends} for key, ends in travel.items()})
    description = read_description(limits)
    robot = Robot("arm", read_urdf(path, (), description.travelling), description, ["shoulder"])
    fixed = robot.fixed_points()
    assert set(fixed) == {"base", "neck", "head"}, "nobody says where the hatch is"
    for link, points in reach(path, travel, {"neck": "nod", "head": "turn"}).items():
        assert (points >= fixed[link].min(axis=0) - 1e-9).all()
        assert (points <= fixed[link].max(axis=0) + 1e-9).all()


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
