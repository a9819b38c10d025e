import numpy as np
import pinocchio
import pytest

from armguard.lab.lever_report import compare_levers
from armguard.robot import Robot
from armguard.robot.description import list_robots
from support.joint_axes import distances_from_axes
from support.urdf_arms import joint_xml, limits_for, link_xml, write_urdf


@pytest.mark.parametrize("name", list_robots())
def test_what_is_seen_never_exceeds_what_is_proved(name):
    robot = Robot.load(name)
    levers = compare_levers(robot, robot.cover, samples=50)
    sliding = {"torso_lift_joint"}
    assert list(levers) == [joint for joint in robot.joints if joint not in sliding]
    for joint in levers.values():
        assert 0.0 < joint.sampled <= joint.proved
        assert 1.0 <= joint.ratio < 3.0


def test_samples_are_distances_from_axes_as_pinocchio_places_them():
    robot = Robot.load("tiago")
    levers = compare_levers(robot, robot.cover, samples=1)
    data = robot.model.createData()
    q = np.random.default_rng(0).uniform(robot.lower_position_limit, robot.upper_position_limit)
    pinocchio.forwardKinematics(robot.model, data, q)
    pinocchio.computeJointJacobians(robot.model, data, q)
    seen = dict.fromkeys(robot.joints, 0.0)
    for link in robot.links:
        number = robot.joint_index(link)
        centers = [data.oMi[number].act(ball[:3]) for ball in robot.cover.spheres(link)]
        distances = distances_from_axes(robot.model, data, number, np.array(centers))
        for joint, column in zip(robot.joints, distances.max(axis=0), strict=True):
            seen[joint] = max(seen[joint], column)
    for joint, lever in levers.items():
        assert lever.sampled == pytest.approx(seen[joint], rel=1e-9)


def test_the_last_joints_levers_are_what_they_are(tmp_path):
    """One joint turns its spheres at a fixed distance, so nothing is lost."""
    path = write_urdf(
        tmp_path, link_xml("base"), link_xml("upper"), joint_xml("shoulder", "base", "upper")
    )
    robot = Robot.from_urdf(path, limits=limits_for("shoulder"))
    (lever,) = compare_levers(robot, robot.cover, samples=3).values()
    assert lever.proved == pytest.approx(lever.sampled, rel=1e-9)
    assert lever.ratio == pytest.approx(1.0, abs=1e-9)
