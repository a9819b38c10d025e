import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.view.arm import Arm
from support.view_samples import Q, make_scene


def test_cover_balls_stand_where_the_joints_are():
    arm = Arm(make_scene())
    arm.place((0.0,) * 7)
    centres = arm.compute_cover()[:, :3]
    # Panda stretched upwards: its shoulder is 0.333 m above the base, its elbow 0.649 m.
    assert np.allclose(centres[0], (0.0, 0.0, 0.333))
    assert np.allclose(centres[4], (0.0, 0.0, 0.649))
    base = np.eye(4)
    base[:3, 3] = (1.0, 2.0, 3.0)
    moved = Arm(make_scene(base=tuple(base.ravel())))
    moved.place((0.0,) * 7)
    assert np.allclose(moved.compute_cover()[:, :3], centres + base[:3, 3])


def test_joints_may_come_in_any_order():
    scene = make_scene()
    mixed = Arm(make_scene(joints=scene.joints[::-1]))
    straight = Arm(scene)
    mixed.place(Q[::-1])
    straight.place(Q)
    assert np.allclose(mixed.compute_cover(), straight.compute_cover())


def test_joints_that_the_robot_lacks_are_refused():
    with pytest.raises(ArmguardError, match="elbow"):
        Arm(make_scene(joints=("elbow",)))


def test_each_level_of_the_tree_is_placed_like_the_cover():
    scene = make_scene()
    arm = Arm(make_scene(levels=(scene.cover[:2], scene.cover)))
    arm.place(Q)
    coarse, fine = arm.compute_levels()
    assert np.array_equal(fine, arm.compute_cover())
    assert np.array_equal(coarse, fine[:4])
    assert arm.links.tolist() == [number for number in range(7) for _ in range(2)]
