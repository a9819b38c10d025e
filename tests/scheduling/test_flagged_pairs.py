import math

import numpy as np
import pytest

from armguard.bounds.arm import ArmMotion
from armguard.obstacles import Obstacles
from armguard.obstacles.reference_states import expire
from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_distance import HullDistance
from armguard.pairs.hull_gap import lay_out_hulls
from armguard.robot import Kinematics
from armguard.scheduling.flagged_pairs import FlaggedCheck
from armguard.scheduling.pair_certificates import PairCertificates
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
    state = TickState(KINEMATICS, motion, obstacles, margin=0.03, by_distance=False)
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
    state = TickState(KINEMATICS, motion, obstacles, margin=0.0, by_distance=False)
    check = FlaggedCheck(HULLS, motion.isotropic, state)
    for now in (0.0, 1e6):
        state.begin(now, 0.0, 0.0)
        assert check.contact_time(obstacles.row("post"), 3) > 0.1
        assert check.contact_time(obstacles.row("wild"), 3) == 0.0


def make_crowd(rng, obstacles):
    """Bodies of all kinds near the arm and far from it; some were refused, some stand still."""
    count = 60
    ids = [f"{k}" for k in range(count)]
    away = rng.choice([0.4, 1.0, 3.0, 30.0], (count, 1, 1), p=[0.1, 0.3, 0.3, 0.3])
    points = rng.normal(size=(count, 1, 3)) * away + rng.uniform(-0.1, 0.1, (count, 4, 3))
    velocities = np.repeat(rng.uniform(-0.5, 0.5, (count, 1, 3)), 4, axis=1)
    errors = rng.choice([0.0, 0.02], count)
    obstacles.update(
        ids, 4.96, points, velocities, radius=rng.uniform(0.0, 0.2, count), position_error=errors
    )
    obstacles.add_static("post", [0.9, 0.2, 0.1], 0.05)
    # Where these were said to be is off by more than they can do, or is no number.
    obstacles.update(ids[:5], 4.97, points[:5] + 2.0, velocities[:5], radius=0.1)
    obstacles.update(ids[5:7], 4.97, points[5:7] + math.nan, velocities[5:7], radius=0.1)
    obstacles.update(["new"], 4.97, [[math.nan, 0.0, 0.0]], radius=0.1)


@pytest.mark.parametrize("seed", range(6))
def test_all_flagged_pairs_at_once_are_as_imminent_as_each_by_itself(seed):
    rng, robot = np.random.default_rng(seed), panda()
    motion, obstacles = ArmMotion(robot, 0.02), Obstacles()
    make_crowd(rng, obstacles)
    KINEMATICS.compute(HOME + rng.uniform(-0.3, 0.3, 7), np.zeros(7))
    state = TickState(KINEMATICS, motion, obstacles, margin=0.01, by_distance=False)
    check = FlaggedCheck(HULLS, motion.isotropic, state)
    certificates = PairCertificates(
        LINKS, lambda row: np.ones(LINKS, dtype=bool), keeps_certificates=True
    )
    added, removed = obstacles.drain_membership()
    pairs, _ = certificates.change(added, removed, len(obstacles.table.alive))
    state.begin(5.0, 0.004, 0.0)
    state.prepare_arm(HOME, np.zeros(7))
    before = 1.0 + rng.choice([-1.0, 0.05, 0.3, 2.0], len(pairs))
    certificates.expiry[pairs] = before
    flagged = rng.permutation(pairs)[: rng.choice([1, 40, len(pairs)])]
    now, stop_time = 1.0, float(rng.choice([0.0, 0.1, 0.4]))
    measured = certificates.extend(check, flagged, now, 7, stop_time)
    after = certificates.expiry[pairs]
    is_flagged = np.isin(pairs, flagged)
    exact = np.array([expire(now, check.contact_time(*divmod(pair, LINKS))) for pair in pairs])
    best = np.where(is_flagged, np.maximum(before, exact), before)
    # Nothing is promised that is not proved, nothing is taken back, and others are left alone.
    assert (before <= after).all()
    assert (after <= best).all()
    assert (certificates.tick[pairs] == np.where(is_flagged, 7, -1)).all()
    # What comes first, and all that could stop the arm, is as it would be if all were measured.
    assert after[is_flagged].min() == best[is_flagged].min()
    imminent = is_flagged & (best <= now + stop_time)
    assert (after[imminent] == best[imminent]).all()
    assert 1 <= measured <= len(flagged)
    # A certificate rests on the state that it was made from.
    table, states = obstacles.table, certificates._reference_states
    for pair in pairs[after > before]:
        row = pair // LINKS
        assert states.stamp[pair] == table.stamp[row]
        assert (states.points[pair] == table.points[row]).all()


def test_most_of_a_far_crowd_is_not_measured_exactly():
    motion, obstacles = ArmMotion(panda(), 0.02), Obstacles()
    rng = np.random.default_rng(0)
    places = rng.normal(size=(400, 3))
    places *= rng.uniform(4.0, 12.0, (400, 1)) / np.linalg.norm(places, axis=1)[:, None]
    obstacles.update([f"{k}" for k in range(400)], 0.0, places, np.zeros((400, 3)), radius=0.1)
    KINEMATICS.compute(HOME, np.zeros(7))
    state = TickState(KINEMATICS, motion, obstacles, margin=0.0, by_distance=False)
    check = FlaggedCheck(HULLS, motion.isotropic, state)
    certificates = PairCertificates(
        LINKS, lambda row: np.ones(LINKS, dtype=bool), keeps_certificates=True
    )
    pairs, _ = certificates.change(*obstacles.drain_membership(), len(obstacles.table.alive))
    state.begin(0.0, 0.0, 0.0)
    state.prepare_arm(HOME, np.zeros(7))
    assert certificates.extend(check, pairs, 0.0, 1, 0.1) < 100
    assert certificates.extend(check, pairs[:0], 0.0, 1, 0.1) == 0
