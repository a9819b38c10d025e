import pytest

from armguard.exceptions import CoverError
from armguard.lab.extremes import arms
from armguard.lab.extremes.arms import make_arm


@pytest.mark.parametrize(("joints", "edge"), [(1, 1), (3, 2), (14, 1)])
def test_arms_have_so_many_joints_and_spheres(joints, edge):
    robot = make_arm(joints, edge)
    assert len(robot.joints) == len(robot.links) == joints
    assert [len(robot.cover.spheres(link)) for link in robot.links] == [edge**3] * joints
    assert robot.cover.check(robot).proved


def test_a_grid_that_does_not_cover_is_refused(monkeypatch):
    monkeypatch.setattr(arms, "OVERLAP", 0.99)
    with pytest.raises(CoverError, match="not inside"):
        make_arm(1, 3)
