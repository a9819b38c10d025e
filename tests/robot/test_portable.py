import coal
import msgspec
import numpy as np
import pinocchio
import pytest

from armguard.exceptions import RobotError
from armguard.robot import Robot
from armguard.robot.portable import (
    LIMITS,
    RestoredRobot,
    describe_bodies,
    describe_robot,
    read_numbers,
    write_number,
    write_numbers,
)

NAMES = ("panda", "ur5", "tiago", "kinova")


def through_json(data):
    return msgspec.json.decode(msgspec.json.encode(data))


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_that_was_written_and_read_is_the_same_to_the_bit(name):
    robot = Robot.load(name)
    robot.position_error = robot.position_error * 1.1  # as it is now counts, not as it was loaded
    restored = RestoredRobot(through_json(describe_robot(robot)))
    assert describe_robot(restored) == describe_robot(robot)
    assert (restored.links, restored.joints) == (robot.links, robot.joints)
    for limit in LIMITS:
        assert getattr(restored, limit).tobytes() == getattr(robot, limit).tobytes()
    for link in robot.links:
        assert restored.hull(link).tobytes() == robot.hull(link).tobytes()
        assert restored.joint_index(link) == robot.joint_index(link)
    curves = zip(restored.brakes.make_curves(), robot.brakes.make_curves(), strict=True)
    assert all(new.tobytes() == old.tobytes() for new, old in curves)
    random, data = np.random.default_rng(0), [one.model.createData() for one in (robot, restored)]
    for _ in range(50):
        q, v = random.uniform(-3.0, 3.0, (2, len(robot.joints)))
        for one, its in zip((robot, restored), data, strict=True):
            pinocchio.forwardKinematics(one.model, its, q, v)
            pinocchio.computeJointJacobians(one.model, its, q)
        assert data[0].J.tobytes() == data[1].J.tobytes()
        for old, new in zip(data[0].oMi, data[1].oMi, strict=True):
            assert old.homogeneous.tobytes() == new.homogeneous.tobytes()


def test_a_joint_about_any_axis_is_kept():
    robot = Robot.load("panda")
    data = through_json(describe_robot(robot))
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    data["joints"][3] |= {"kind": "JointModelRevoluteUnaligned", "axis": axis.tolist()}
    data["joints"][4] |= {"kind": "JointModelPrismaticUnaligned", "axis": axis.tolist()}
    again = describe_robot(RestoredRobot(through_json(describe_robot(RestoredRobot(data)))))
    assert again["joints"] == data["joints"]


def test_what_is_attached_and_taken_off_is_told_alone():
    robot = Robot.load("panda")
    restored = RestoredRobot(through_json(describe_robot(robot)))
    before = robot.links
    robot.attach("gripper", "panda_hand", coal.Box(0.1, 0.1, 0.1))
    told = through_json(describe_bodies(robot, before))
    assert [len(link) > 1 for link in told["links"]] == [False] * len(before) + [True]
    restored.replace_bodies(told)
    assert describe_robot(restored) == describe_robot(robot)
    robot.detach("gripper")
    restored.replace_bodies(through_json(describe_bodies(robot, robot.links)))
    assert restored.links == before
    assert restored.revision == robot.revision == 2


def test_numbers_that_json_has_no_word_for_are_spelled():
    values = np.array([[np.nan, np.inf], [-np.inf, -0.0]])
    listed = through_json(write_numbers(values))
    assert listed == [["NaN", "Infinity"], ["-Infinity", -0.0]]
    assert read_numbers(listed).tobytes() == values.tobytes()
    assert write_number(1.5) == 1.5


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.pop("joints"),
        lambda data: data.pop("brakes"),
        lambda data: data["joints"][0].update(kind="JointModelFreeFlyer"),
        lambda data: data["joints"][0].update(kind="JointModelRubbish"),
        lambda data: data["joints"][1].update(parent="nothing"),
        lambda data: data["joints"][1].update(rotation=[1.0]),
        lambda data: data.update(velocity_limit=["fast"] * 7),
        lambda data: data.update(velocity_limit=[1.0]),
        lambda data: data["links"][0].update(joint="nothing"),
        lambda data: data["links"].append({"name": "unknown"}),
        lambda data: data["links"][0].pop("hull"),
        lambda data: data.update(links=None),
    ],
)
def test_data_that_are_damaged_are_refused_by_name(change):
    data = through_json(describe_robot(Robot.load("panda")))
    change(data)
    with pytest.raises(RobotError, match="robot"):
        RestoredRobot(data)
