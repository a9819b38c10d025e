import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.view.arm import Arm
from support.view_samples import Q, make_scene


def test_cover_balls_stand_where_the_joints_are():
    arm = Arm(make_scene())
    arm.place((0.0,) * 7)
    centres = arm.compute_centres()
    # Panda stretched upwards: its shoulder is 0.333 m above the base, its elbow 0.649 m.
    assert np.allclose(centres[0], (0.0, 0.0, 0.333))
    assert np.allclose(centres[4], (0.0, 0.0, 0.649))
    base = np.eye(4)
    base[:3, 3] = (1.0, 2.0, 3.0)
    moved = Arm(make_scene(base=tuple(base.ravel())))
    moved.place((0.0,) * 7)
    assert np.allclose(moved.compute_centres(), centres + base[:3, 3])


def test_joints_may_come_in_any_order():
    scene = make_scene()
    mixed = Arm(make_scene(joints=scene.joints[::-1]))
    straight = Arm(scene)
    mixed.place(Q[::-1])
    straight.place(Q)
    assert np.allclose(mixed.compute_centres(), straight.compute_centres())


def test_joints_that_the_robot_lacks_are_refused():
    with pytest.raises(ArmguardError, match="elbow"):
        Arm(make_scene(joints=("elbow",)))
