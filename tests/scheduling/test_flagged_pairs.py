import math

import numpy as np
import pytest

from armguard.bounds.arm import ArmMotion
from armguard.obstacles import Obstacles
from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_distance import HullDistance
from armguard.pairs.hull_gap import lay_out_hulls
from armguard.robot import Kinematics
from armguard.scheduling.flagged_pairs import FlaggedCheck
from support.panda_monitor import HOME, panda

KINEMATICS = Kinematics(panda())
EXACT = HullDistance(panda(), KINEMATICS)
HULLS = lay_out_hulls(EXACT.vertices, EXACT.joints)
LINKS = len(panda().links)


@pytest.mark.parametrize("age", [0.0, 0.03, -0.02])
@pytest.mark.parametrize("arm_age", [0.0, 0.01, -0.01])
@pytest.mark.parametrize("corners", [1, 2, 8])
def test_the_exact_check_is_its_formula(age, arm_age, corners):
    rng, robot = np.random.default_rng(corners), panda()
    motion, obstacles = ArmMotion(robot, 0.02), Obstacles()
    points = np.array([1.5, 0.3, 0.4]) + rng.uniform(-0.1, 0.1, (corners, 3))
    velocities = rng.uniform(-0.5, 0.5, (corners, 3))
    obstacles.update(
        ["body"], 5.0 - age, points[None], velocities[None], radius=0.2, speed=0.6,
        position_error=0.01, velocity_error=0.4,
    )  # fmt: skip
    KINEMATICS.compute(HOME, np.zeros(7))
    state = TickState(KINEMATICS, motion, obstacles, margin=0.03, advances=8, by_distance=False)
    check = FlaggedCheck(HULLS, motion.isotropic, state)
    state.begin(5.0, arm_age, 0.0)
    row = obstacles.row("body")
    top = max(0.6, max(math.hypot(*velocity) for velocity in velocities) + 0.4)
    for link in range(LINKS):
        distance, _, _ = EXACT.distance(link, points, 0.2)
        arm = motion.isotropic.surface_speed[link]
        gap = distance - 0.03 - 0.01 - motion.isotropic.surface_position_error[link]
        gap -= top * abs(5.0 - (5.0 - age)) + arm * abs(arm_age)
        assert check.contact_time(row, link) == pytest.approx(max(gap, 0.0) / (top + arm))
    # Beside a refused sample the nearer of the two counts; of what is no number nothing is known.
    known = check.contact_time(row, 0)
    for shift, sooner in ((5.0, False), (-0.5, True)):
        obstacles.update(["body"], 5.0 - age, points[None] + shift, 0.0 * velocities[None],
            radius=0.2, speed=0.6)  # fmt: skip
        assert (check.contact_time(row, 0) < known) == sooner
    obstacles.distrust(row)
    assert 0.0 <= check.contact_time(row, 0) < known
    obstacles.update(["body"], 5.0, points[None] + math.nan, radius=0.2)
    assert check.contact_time(row, 0) == 0.0


def test_the_exact_check_of_statics_and_of_bodies_without_bounds():
    obstacles = Obstacles()
    obstacles.add_static("post", [1.5, 0.0, 0.5], 0.1)
    obstacles.update(["wild"], 0.0, [[3.0, 0.0, 0.5]], radius=0.1, speed=math.inf)
    motion = ArmMotion(panda(), 0.02)
    KINEMATICS.compute(HOME, np.zeros(7))
    state = TickState(KINEMATICS, motion, obstacles, margin=0.0, advances=8, by_distance=False)
    check = FlaggedCheck(HULLS, motion.isotropic, state)
    for now in (0.0, 1e6):
        state.begin(now, 0.0, 0.0)
        assert check.contact_time(obstacles.row("post"), 3) > 0.1
        assert check.contact_time(obstacles.row("wild"), 3) == 0.0
