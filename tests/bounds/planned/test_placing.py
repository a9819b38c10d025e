"""Configurations placed at once: where Pinocchio has them, and within the balls around them."""

import numpy as np
import pinocchio
import pytest

from armguard.bounds.closing import make_arms
from armguard.bounds.joint_box import make_box
from armguard.bounds.link_gaps import make_no_gaps
from armguard.bounds.planned.course import BLOCK, ArmShape
from armguard.bounds.planned.placing import (
    PlacedArm,
    check_chain,
    make_chain,
    place_all,
)
from armguard.exceptions import ArmguardError
from armguard.jit.handle import pack
from armguard.robot import Kinematics
from support.example_arms import load_arm
from support.plan_cases import place_spheres

ASIDE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.7, 2.0), np.array([0.5, -1.0, 0.2]))


def draw_configurations(robot, count, random):
    lower = np.maximum(robot.lower_position_limit, -np.pi)
    upper = np.minimum(robot.upper_position_limit, np.pi)
    return random.uniform(lower, upper, (count, len(lower)))


def pack_arm(robot, kinematics, random):
    """Its spheres, with levers of any lengths, and a handle on what is placed."""
    spheres = kinematics.spheres
    nothing = np.zeros(len(robot.joints))
    arm = ArmShape(
        spheres.tree, random.uniform(0.0, 1.0, (len(spheres), len(robot.joints))),
        make_box(np.ones(len(robot.joints), dtype=bool), nothing), np.array(spheres.joint),
        np.array(spheres.local), nothing, kinematics.placement.moves, make_no_gaps(),
        make_arms(len(robot.joints)),
    )  # fmt: skip
    return arm, pack(PlacedArm(make_chain(kinematics), arm))


@pytest.mark.parametrize("name", ["panda", "tiago", "ur5"])
@pytest.mark.parametrize("base", [None, ASIDE], ids=["origin", "aside"])
def test_places_are_those_of_pinocchio(name, base):
    robot, random = load_arm(name), np.random.default_rng(0)
    kinematics = Kinematics(robot, base)
    configurations = draw_configurations(robot, 20, random)
    arm, handle = pack_arm(robot, kinematics, random)
    placement, jacobian, _, _ = place_all(handle, configurations, np.zeros_like(configurations))
    centers = place_spheres(arm, placement)
    for k, q in enumerate(configurations):
        kinematics.compute(q, np.zeros(len(q)))
        np.testing.assert_allclose(centers[k], kinematics.centers, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(jacobian[k], kinematics.data.J, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("slabs", [1, BLOCK, 3 * BLOCK + 5])
def test_balls_contain_what_they_are_around(slabs):
    robot, random = load_arm("panda"), np.random.default_rng(slabs)
    kinematics = Kinematics(robot)
    arm, handle = pack_arm(robot, kinematics, random)
    configurations = draw_configurations(robot, slabs, random)
    half = random.uniform(0.0, 0.1, (slabs, len(robot.joints)))
    placement, _, balls, ball = place_all(handle, configurations, half)
    centers = place_spheres(arm, placement)
    assert balls.shape == (-(-slabs // BLOCK), len(arm.tree.root), 4)
    for slab in range(slabs):
        reach = arm.lever[arm.tree.root] @ half[slab] + arm.tree.radius[arm.tree.root]
        around = balls[slab // BLOCK]
        away = np.linalg.norm(centers[slab, arm.tree.root] - around[:, :3], axis=1)
        assert (away + reach <= around[:, 3]).all()
    away = np.linalg.norm(balls[..., :3] - ball[:3], axis=2) + balls[..., 3]
    assert away.max() <= ball[3] <= away.max() + 1e-9


def test_what_is_not_finite_is_anywhere():
    robot, random = load_arm("panda"), np.random.default_rng(0)
    kinematics = Kinematics(robot)
    arm, handle = pack_arm(robot, kinematics, random)
    configurations = draw_configurations(robot, 2 * BLOCK, random)
    configurations[3, 2] = np.nan
    placement, _, balls, ball = place_all(handle, configurations, np.zeros_like(configurations))
    centers = place_spheres(arm, placement)
    moved = np.isnan(centers[3, arm.tree.root]).any(axis=1)
    assert moved.any()
    assert not (balls[0, moved, 3] < np.inf).any()
    assert (balls[1, :, 3] < np.inf).all()
    assert not ball[3] < np.inf


def test_a_chain_that_leads_elsewhere_is_refused(monkeypatch):
    robot = load_arm("panda")
    kinematics = Kinematics(robot)
    _, handle = pack_arm(robot, kinematics, np.random.default_rng(0))
    monkeypatch.setattr("armguard.bounds.planned.placing.AGREES", 0.0)
    with pytest.raises(ArmguardError, match="pinocchio has them"):
        check_chain(handle, kinematics)
