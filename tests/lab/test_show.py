import numpy as np
import pytest

from armguard.app.cli import Show
from armguard.cover.cover import Cover
from armguard.exceptions import ArmguardError
from armguard.lab.covers import Target
from armguard.lab.show import choose_posture, make_scene, show_arm
from armguard.robot import Robot
from armguard.robot.description import find_example_urdf
from armguard.view.arm import Arm


@pytest.fixture(scope="module")
def target():
    return Target("ur5")


def test_every_level_of_the_tree_covers_what_the_finest_does(target):
    robot = Robot.load("ur5")
    scene = make_scene(target, robot.cover)
    assert scene.levels[-1] == scene.cover
    assert len(scene.levels) > 2
    for level in scene.levels:
        for coarse, fine in zip(level, scene.cover, strict=True):
            # Each leaf has a ball above it in the level, which lies about the same surface.
            away = np.linalg.norm(coarse.spheres[:, None, :3] - fine.spheres[None, :, :3], axis=2)
            near = away <= coarse.spheres[:, None, 3] + fine.spheres[None, :, 3]
            assert near.any(axis=0).all()
    counts = [sum(len(link.spheres) for link in level) for level in scene.levels]
    assert counts == sorted(counts)
    assert counts[0] == len(robot.links)


def test_a_urdf_is_shown_as_it_is():
    urdf, packages = find_example_urdf("panda_description/urdf/panda.urdf")
    target = Target(str(urdf), None, [packages])
    cover = Cover.fit(target.robot, spheres=2)
    scene = make_scene(target, cover)
    arm = Arm(scene)
    q = choose_posture(target.robot)
    arm.place(tuple(q.tolist()))
    assert len(arm.compute_cover()) == sum(len(link.spheres) for link in scene.cover)


def test_an_arm_that_is_none_is_refused():
    with pytest.raises(ArmguardError, match="neither a URDF"):
        show_arm(Show("no-such-arm"))
