import numpy as np
import pytest

from armguard.bounds import IsotropicMotion, compute_levers
from armguard.bounds.sums import compute_sphere_levers


@pytest.fixture(scope="module")
def motion(robot):
    return IsotropicMotion(robot)


def test_levers_of_spheres_are_those_of_each_link_in_turn(robot):
    levers = compute_sphere_levers(robot)
    assert not levers.flags.writeable
    begin = 0
    for link in robot.links:
        centers = robot.cover.tree(link).spheres[:, :3]
        end = begin + len(centers)
        assert (levers[begin:end] == compute_levers(robot, link, centers)).all()
        begin = end
    assert begin == len(levers)


def test_sums_agree_with_their_formulas(robot, motion, models):
    v = np.linspace(-1.0, 1.0, 7)
    motion.update(v)
    order = np.arange(7)
    distal = np.maximum(order[:, None], order[None, :])
    fastest, strongest = robot.velocity_limit, robot.acceleration_limit
    for i in range(0, len(motion.lever), 7):
        lever = motion.lever[i]
        both = np.where(np.outer(lever, lever) > 0.0, lever[distal], 0.0)
        error = lever @ robot.velocity_error
        error += (np.abs(v) + robot.velocity_error) @ both @ robot.position_error
        np.testing.assert_allclose(motion.speed[i], lever @ fastest, rtol=1e-9)
        accel = lever @ strongest + fastest @ both @ fastest
        np.testing.assert_allclose(motion.accel[i], accel, rtol=1e-9)
        np.testing.assert_allclose(motion.velocity_error[i], error, rtol=1e-9)
        np.testing.assert_allclose(motion.position_error[i], lever @ robot.position_error)
    for name in ("joint", "braking"):
        np.testing.assert_array_equal(models[name].position_error, motion.position_error)
