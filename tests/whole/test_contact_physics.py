"""Contact with a simulated body part does what the mathematics of contact limits says."""

import functools
import math

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra `mujoco` simulates the arm")

import bench_contact_physics
from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics
from armguard.robot.operating_limits import OperatingLimits
from support.contact_attacks import LOOPS, LUNGE, PARTS, REST, THROW, Fight, make_limits
from support.contact_physics import RIGID, Arm, Contact, Skin, advance_joints, make_surface
from support.panda_monitor import HOME, panda


@functools.cache
def make_arm():
    return Arm(panda(), make_surface(panda()))


def swing_into(skin, *, stiffness, speed=0.8):
    """What an arm that turns about its first joint does to a part in front of its hand."""
    arm, nv = make_arm(), len(HOME)
    v = speed * np.eye(nv)[0]
    arm.start(HOME, v, stiffness)
    link = arm.joint_of.index(max(arm.joint_of))
    points = arm.hulls[link] @ arm.turns[-1].reshape(3, 3).T + arm.places[-1]
    contact = Contact(arm, skin, points.mean(axis=0) + 0.3 * np.eye(3)[1], np.zeros(3))
    t, rest = 0.0, np.zeros(nv)
    while t < 1.0 and not (contact.touches and contact.gap > 0.01):
        dt = contact.choose_step(1e-3)
        advance_joints(arm.q, arm.v, arm.accel, v, rest + 1.0, rest + 1.0, rest, False, dt)
        contact.advance(dt)
        t += dt
    return contact


@pytest.mark.parametrize("damping", [0.0, 30.0])
def test_a_rigid_arm_gives_a_part_no_more_than_its_own_speed_does(damping):
    skin = Skin(0.6, 75e3, damping, 0.05)
    contact = swing_into(skin, stiffness=RIGID)
    (touch,) = contact.touches
    most = 0.5 * skin.mass * touch.surface_speed**2
    assert 0.05 * most < touch.energy <= most * (1.0 + 1e-3)
    if not damping:
        # Nothing is lost, so that the part leaves as fast as the surface has struck it, twice.
        struck = math.sqrt(2.0 * touch.energy / skin.mass)
        assert np.linalg.norm(contact.velocity) == pytest.approx(2.0 * struck, rel=0.02)


def test_a_softer_arm_does_less():
    skin = Skin(2.0, 40e3, 0.0, 0.05)
    energies = [swing_into(skin, stiffness=loop).touches[0].energy for loop in LOOPS]
    assert energies == sorted(energies)
    assert energies[0] < 0.9 * energies[-1]


def test_the_surface_is_where_exact_hulls_have_it():
    arm, random = make_arm(), np.random.default_rng(0)
    kinematics = Kinematics(panda())
    exact = HullDistance(panda(), kinematics)
    for _ in range(30):
        q = HOME + random.uniform(-0.5, 0.5, len(HOME))
        arm.start(q, np.zeros(len(q)), RIGID)
        kinematics.compute(q, np.zeros(len(q)))
        p = random.uniform(-1.0, 1.0, 3) + 0.5 * np.eye(3)[2]
        away = min(exact.distance(k, p[None], 0.0)[0] for k in range(len(panda().links)))
        found, _ = arm.find_nearest(p, math.inf, np.zeros(3))
        if away > 0.0:
            # Not every link is convex.
            assert found >= away - 1e-6
            assert found <= away + 0.02


@pytest.mark.parametrize("with_limits", [True, False])
def test_limits_are_kept_where_they_are_watched(with_limits):
    operating = OperatingLimits.fraction(panda(), velocity=0.45, acceleration=0.2)
    fight = Fight(make_arm(), operating, [3], make_limits() if with_limits else None)
    tally = bench_contact_physics.Tally()
    for k in range(64):
        # The last of the parts has the lowest limit.
        part = PARTS[-1 - k % 2]
        attack = fight.attack(part, (REST, REST, THROW, LUNGE)[k // 2 % 4], LOOPS[k % len(LOOPS)])
        if attack is not None:
            tally.add(attack)
    assert len(tally.shares[bench_contact_physics.AT_REST]) >= 4
    assert tally.true_share <= 1.0 + bench_contact_physics.ROUNDING
    assert tally.is_kept is with_limits
