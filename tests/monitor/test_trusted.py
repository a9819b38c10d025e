import json

import msgspec
import numpy as np
import pytest

from armguard.bounds.limits import read_limits
from armguard.bounds.reach import ReachMotion
from armguard.bounds.sums import compute_sphere_levers
from armguard.messages.proof import spell_numbers
from armguard.monitor.trusted import TrustedParts
from armguard.robot import Robot
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce
from armguard_check.proof import digest
from support.panda_monitor import ranged_panda


def describe(robot):
    in_force = LimitsInForce(robot, None)
    limits, kinematics = read_limits(robot, in_force), Kinematics(robot)
    levers, reach = compute_sphere_levers(robot), ReachMotion(robot)
    return TrustedParts(kinematics, limits, levers, reach.link_balls), in_force


def test_an_arm_is_described_once_until_its_limits_change():
    parts, in_force = describe(ranged_panda())
    first = parts.describe_arm()
    assert parts.describe_arm() is first
    in_force.load(0.0)
    light = parts.describe_arm()
    assert light.digest != first.digest
    assert light.brakes[0].speed != first.brakes[0].speed
    in_force.suspend()
    assert parts.describe_arm() == light  # without operating limits these are the hardware's
    in_force.load(None)
    assert parts.describe_arm() == first


@pytest.mark.parametrize("name", ["panda", "tiago"])
def test_an_arm_is_the_robot(name):
    robot = Robot.load(name)
    arm = describe(robot)[0].describe_arm()
    assert tuple(joint.name for joint in arm.joints) == robot.joints
    assert [joint.parent for joint in arm.joints] == list(range(-1, len(robot.joints) - 1))
    assert arm.lower == robot.lower_position_limit.tolist()
    assert arm.velocity_error == robot.velocity_error.tolist()
    assert [joint.slides for joint in arm.joints].count(True) == (name == "tiago")


def test_a_cover_is_the_links_tree():
    robot = ranged_panda()
    parts, _ = describe(robot)
    for number, link in enumerate(robot.links):
        tree = robot.cover.tree(link)
        last = len(tree.spheres) - 1
        cover = parts.describe_cover(link, number, [last, 0])
        assert cover.digest
        assert [ball.node for ball in cover.balls] == sorted([0, last])
        for ball in cover.balls:
            assert [*ball.center, ball.radius] == tree.spheres[ball.node].tolist()
        children = np.array(cover.parents) >= 0
        assert cover.parents[0] == -1
        assert children[1:].all()
        for node, (first, count) in enumerate(zip(tree.first_child, tree.child_count, strict=True)):
            assert cover.parents[first : first + count] == [node] * count


def test_digests_are_those_of_the_checker():
    parts, _ = describe(ranged_panda())
    for part in (parts.describe_arm(), parts.describe_cover("panda_hand", 8, [0])):
        plain = json.loads(json.dumps(spell_numbers(msgspec.to_builtins(part))))
        assert digest(plain) == part.digest
