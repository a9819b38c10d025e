import itertools
import math

import numpy as np
import pinocchio
import pytest
from mpmath import mpf

from armguard_check.arm import Ball, find_mean, read_joints
from armguard_check.intervals import BITS, ProofError, length, read, read_list, read_vector
from armguard_check.tube import Range
from support.false_proofs import dot, find_center
from support.proof_scenes import ARMS, make_proof, make_scene

SCALE = 1 << BITS


@pytest.fixture(scope="module", params=ARMS)
def proof(request):
    random = np.random.default_rng(11)
    while True:
        proof = make_proof(random, name=request.param)
        if proof is not None and proof["cover"]["balls"]:
            return proof


def read_ball(proof, place=0):
    arm, cover, count = proof["arm"], proof["cover"], len(proof["q"])
    ball = cover["balls"][place]
    joints = read_joints(arm, read_list(proof["q"], count))
    return ball, Ball(joints, cover["carrier"], ball)


def test_balls_are_where_pinocchio_places_them(proof):
    stated, ball = read_ball(proof)
    name = {"panda_joint1": "panda", "shoulder_pan_joint": "ur5"}.get(
        proof["arm"]["joints"][0]["name"], "tiago"
    )
    model = make_scene(name, touches=False)[0].robot.model
    data = model.createData()
    pinocchio.forwardKinematics(model, data, np.array(proof["q"]))
    true = data.oMi[proof["cover"]["carrier"] + 1].act(np.array(stated["center"]))
    found = [0.5 * (one.low + one.high) / SCALE for one in ball.center]
    assert found == pytest.approx(true.tolist(), abs=1e-14)
    assert all(one.high - one.low < SCALE >> 90 for one in ball.center)


@pytest.mark.parametrize("width", [1e-3, 0.05, 0.6])
def test_no_place_in_a_box_is_farther_than_the_bound(proof, width):
    random = np.random.default_rng(round(1e4 * width))
    stated, ball = read_ball(proof)
    q = [mpf(x) for x in proof["q"]]
    before, _ = find_center(proof, stated["node"], q)
    for _ in range(6):
        low, high = np.sort(random.uniform(-width, width, (2, len(q))), axis=0)
        ranges = [Range(read(float(a)), read(float(b))) for a, b in zip(low, high, strict=True)]
        n = random.normal(size=3)
        unit = [mpf(x) for x in (n / np.linalg.norm(n)).tolist()]
        bound = ball.displacement(read_vector([float(x) for x in unit]), ranges, read(-1e3))
        for _ in range(6):
            share = random.choice([0.0, 1.0, random.random()], len(q))
            there = [x + mpf(y) for x, y in zip(q, low + share * (high - low), strict=True)]
            after, _ = find_center(proof, stated["node"], there)
            moved = dot(unit, [a - b for a, b in zip(after, before, strict=True)])
            assert moved * SCALE <= bound.high


@pytest.mark.parametrize("width", [1e-3, 0.05, 0.5])
def test_no_velocity_in_a_box_is_faster_than_the_bound(proof, width):
    random = np.random.default_rng(round(1e4 * width))
    stated, ball = read_ball(proof)
    q = [mpf(x) for x in proof["q"]]
    for _ in range(4):
        low, high = np.sort(random.uniform(-width, width, (2, len(q))), axis=0)
        slow, fast = np.sort(random.uniform(-1.0, 1.0, (2, len(q))), axis=0)
        ranges = [Range(read(float(a)), read(float(b))) for a, b in zip(low, high, strict=True)]
        bound = ball.speed(ranges, *(list(map(read, one.tolist())) for one in (slow, fast)))
        for _ in range(6):
            there = [x + mpf(y) for x, y in zip(q, random.uniform(low, high), strict=True)]
            _, columns = find_center(proof, stated["node"], there)
            paces = [mpf(x) for x in np.where(random.random(len(q)) < 0.5, slow, fast).tolist()]
            moved = [sum(w * c[k] for w, c in zip(paces, columns, strict=True)) for k in range(3)]
            assert sum(x * x for x in moved) <= (mpf(bound.high) / SCALE) ** 2


def test_a_lever_that_is_too_short_now_is_refused(proof):
    stated, _ = read_ball(proof)
    before = list(stated["lever"])
    try:
        stated["lever"] = [0.5 * x for x in before]
        with pytest.raises(ProofError, match="lever"):
            read_ball(proof)
    finally:
        stated["lever"] = before


def test_mean_of_a_slope_that_is_cut_off():
    for slope, spread, lever in itertools.product((-2.0, 0.1, 0.9), (0.0, 0.3, 5.0), (0.5, 1.0)):
        s = (np.arange(100_000) + 0.5) / 100_000
        true = np.minimum(np.maximum(slope, -lever) + s * spread, lever).mean()
        found = find_mean(read(slope), read(spread), read(lever))
        assert found.high / SCALE == pytest.approx(true, abs=1e-8)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"axis": [0.0, 0.0, 1.0 + 1e-9]}, "axis of joint 0"),
        ({"axis": [0.0, 0.0, math.nan]}, r"axis\[2\] is nan"),
        ({"placement": [2.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0, 0, 0]}, "no rotation"),
        ({"placement": [-1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0, 0, 0]}, "no rotation"),
        ({"placement": [1.0, 0, 0.5, 0, 1.0, 0, 0, 0, 1.0, 0, 0, 0]}, "no rotation"),
        ({"placement": [1.0, 0, 1e-5, 0, 1.0, 0, 0, 0, 1.0, 0, 0, 0]}, "no rotation"),
        ({"placement": [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0 + 1e-9, 0, 0, 0]}, "no rotation"),
        ({"placement": [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0, 0, math.inf]}, "inf"),
        ({"placement": [1.0]}, "12 numbers"),
        ({"parent": 0}, "carried"),
        ({"parent": "base"}, "carried"),
        ({"parent": -2}, "carried"),
        ({"parent": math.nan}, "carried"),
        ({"slides": 1}, "neither slides"),
    ],
)
def test_joints_that_are_none_are_refused(change, why):
    unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    joint = {"parent": -1, "slides": False, "axis": [0.0, 0.0, 1.0], "placement": unit}
    arm = {"joints": [joint], "position_error": [0.0]}
    placed = read_joints(arm, [read(0.5)])
    assert abs(length(placed[0].axis).low / SCALE - 1.0) < 1e-15
    with pytest.raises(ProofError, match=why):
        read_joints(arm | {"joints": [joint | change]}, [read(0.5)])
