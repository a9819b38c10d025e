import itertools
import tomllib

import numpy as np
import pinocchio
import pytest
from arms import joint_xml, limits_for, link_xml, two_links, write_urdf

from armguard.cover import Cover
from armguard.exceptions import CoverError, RobotError
from armguard.robot import Robot
from armguard.robot_description import find_example_urdf, read_description, robots_directory
from armguard.surface_distance import compute_signed_distances
from armguard.urdf import read_urdf


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
        "braking": panda.braking_deceleration,
    }.items():
        np.testing.assert_array_equal(array, [content["joints"][j][key] for j in panda.joints])
        assert all(panda.source(joint, key) for joint in panda.joints)
    positions = np.array([content["joints"][joint]["position"] for joint in panda.joints])
    np.testing.assert_array_equal(panda.lower_position_limit, positions[:, 0])
    np.testing.assert_array_equal(panda.model.upperPositionLimit, positions[:, 1])
    np.testing.assert_array_equal(panda.acceleration_limit, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_array_equal(panda.position_error, np.full(7, 1e-3))
    np.testing.assert_array_equal(panda.velocity_error, np.full(7, 0.02))
    assert (panda.braking_deceleration <= panda.acceleration_limit).all()
    with pytest.raises(ValueError, match="read-only"):
        panda.velocity_limit[0] = 100.0


def test_panda_agrees_with_its_urdf(panda):
    path, _ = find_example_urdf("panda_description/urdf/panda.urdf")
    model = pinocchio.buildModelFromUrdf(str(path))
    np.testing.assert_array_equal(panda.velocity_limit, model.velocityLimit[:7])
    np.testing.assert_array_equal(panda.lower_position_limit, model.lowerPositionLimit[:7])
    np.testing.assert_array_equal(panda.upper_position_limit, model.upperPositionLimit[:7])


def test_fingers_are_covered_wherever_they_are_in_their_travel(panda):
    path, packages = find_example_urdf("panda_description/urdf/panda.urdf")
    model = pinocchio.buildModelFromUrdf(str(path))
    geometry = pinocchio.buildGeomFromUrdf(
        model, str(path), pinocchio.GeometryType.COLLISION, package_dirs=[str(packages)]
    )
    data, geometry_data = model.createData(), geometry.createData()
    corners = np.array(list(itertools.product((-1, 1), repeat=3)), dtype=float)
    for opening in np.linspace(0.0, 0.04, 9):
        q = np.append(np.zeros(7), [opening, opening])
        pinocchio.updateGeometryPlacements(model, data, geometry, geometry_data, q)
        for i, shape in enumerate(geometry.geometryObjects):
            link = model.frames[shape.parentFrame].name
            if "finger" not in link:
                continue
            placement = data.oMi[7].actInv(geometry_data.oMg[i])
            points = (corners * shape.geometry.halfSide) @ placement.rotation.T
            points += placement.translation
            assert (compute_signed_distances(points, panda.triangles(link)) < 1e-9).all()
            for level in range(panda.cover.levels(link)):
                balls = panda.cover.spheres(link, level)
                offsets = np.linalg.norm(points[:, None] - balls[:, :3], axis=2)
                assert (offsets <= balls[:, 3]).any(axis=1).all()


def test_triangles_are_the_meshes_as_pinocchio_places_them(panda):
    for shape in panda.collision_model.geometryObjects:
        if shape.name in ("panda_link5_0", "panda_hand_0"):
            link = panda.model.frames[shape.parentFrame].name
            expected = shape.geometry.vertices() @ shape.placement.rotation.T
            expected = np.unique(expected + shape.placement.translation, axis=0)
            np.testing.assert_allclose(panda.hull(link), expected, atol=1e-15)


def test_unknown_robot_lists_those_that_exist():
    with pytest.raises(RobotError, match=r"'pandas'.* is not known.*panda"):
        Robot.load("pandas")


def test_unknown_link_lists_those_that_exist(panda):
    with pytest.raises(RobotError, match=r"'elbow': is not a link.*panda_link1"):
        panda.triangles("elbow")
    with pytest.raises(RobotError, match="'panda_link8': has no collision geometry"):
        panda.hull("panda_link8")
    with pytest.raises(RobotError, match="'panda_link0': has no collision geometry that a watched"):
        panda.joint_index("panda_link0")


def test_a_joints_own_source_comes_before_the_robots(tmp_path):
    limits = limits_for("shoulder", sources={"braking": "measured"})
    robot = Robot.from_urdf(two_links(tmp_path), limits=limits)
    assert robot.source("shoulder", "braking") == "measured"
    assert robot.source("shoulder", "velocity") == "a test"


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
    full = pinocchio.buildModelFromUrdf(str(path))
    data, number = full.createData(), full.getJointId("shoulder")
    corners = np.array(list(itertools.product((-0.05, 0.05), (-0.03, 0.03), (-0.02, 0.02))))
    reached = {"lower": [], "tip": []}
    for shares in itertools.product(np.linspace(0.0, 1.0, 13), repeat=2):
        q = np.zeros(3)
        for share, (joint, (lower, upper)) in zip(shares, travel.items(), strict=True):
            q[full.joints[full.getJointId(joint)].idx_q] = lower + share * (upper - lower)
        pinocchio.forwardKinematics(full, data, q)
        for link, joint in (("lower", "elbow"), ("tip", "wrist")):
            placement = data.oMi[number].actInv(data.oMi[full.getJointId(joint)])
            reached[link].append(corners @ placement.rotation.T + placement.translation)
    for link, points in reached.items():
        distances = compute_signed_distances(np.concatenate(points), robot.triangles(link))
        assert distances.max() < 1e-9


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
