"""A part that an arm clamps is pressed by no more than its limit permits."""

import math

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra `mujoco` simulates the arm")

import bench_clamped
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import OperatingLimits
from support.clamp_attacks import (
    BLOCK,
    CART,
    LINK,
    ClampFight,
    make_clamp_limits,
    make_tight_robot,
)
from support.contact_attacks import PARTS
from support.contact_physics import RIGID, Arm, make_cover_surface


@pytest.fixture(scope="module")
def robot():
    return make_tight_robot("panda")


@pytest.fixture(scope="module")
def arm(robot):
    return Arm(robot, make_cover_surface(robot))


def attack_often(arm, velocity, modes, *, with_clamping, attacks):
    joints = len(arm.q)
    operating = OperatingLimits(np.full(joints, velocity), np.full(joints, 0.1))
    limits = make_clamp_limits(with_clamping=with_clamping)
    fight = ClampFight(arm, operating, [5], limits)
    found = [
        fight.attack(PARTS[0], modes[k % len(modes)], (5e4, RIGID)[k // 2 % 2])
        for k in range(attacks)
    ]
    return [one.share(touch) for one in found if one is not None for touch in one.touches]


def test_the_surface_is_where_the_spheres_are(arm, robot):
    random = np.random.default_rng(0)
    kinematics = Kinematics(robot)
    leaves = np.flatnonzero(kinematics.spheres.child_count == 0)
    for _ in range(20):
        q = random.uniform(-1.0, 1.0, len(arm.q))
        arm.start(q, np.zeros(len(q)), RIGID)
        kinematics.compute(q, np.zeros(len(q)))
        p, point = random.uniform(-0.7, 0.9, 3), np.zeros(3)
        away, _ = arm.find_nearest(p, math.inf, point)
        apart = np.linalg.norm(kinematics.centers[leaves] - p, axis=1)
        assert away == pytest.approx((apart - kinematics.spheres.radius[leaves]).min())
        assert np.linalg.norm(p - point) == pytest.approx(abs(away))


@pytest.mark.hazard("H-12")
def test_force_stays_within_its_limit_where_it_is_watched(arm):
    shares = attack_often(arm, 0.1, (BLOCK, CART, LINK), with_clamping=True, attacks=45)
    assert len(shares) >= 8
    assert max(shares) <= 1.0 + bench_clamped.ROUNDING


def test_force_exceeds_its_limit_where_nothing_counts_as_clamped(arm):
    shares = attack_often(arm, 0.3, (CART,), with_clamping=False, attacks=16)
    assert max(shares) > 1.0


def test_the_benchmark_runs(capsys, tmp_path):
    table = tmp_path / "table.md"
    arguments = f"--contacts 12 --arms panda --chunk 1 --out {table}"
    bench_clamped.main(arguments.split())
    assert "| another link | panda |" in table.read_text()
