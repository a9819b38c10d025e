import math
from random import Random

import mpmath
import numpy as np
import pytest
from mpmath import mpf

from armguard_check.intervals import BITS, ProofError, read
from armguard_check.tube import read_sides
from support.false_proofs import NEVER, Extreme

SCALE = 1 << BITS


def make_arm(seed):
    """One joint with limits at random, and a state within them."""
    random = Random(seed)
    accel, speed = random.uniform(1.0, 20.0), random.uniform(0.3, 3.0)
    rate = random.choice([0.0, 0.8 * accel])
    brakes = {"speed": [speed, "Infinity"], "deceleration": [rate] * 2}
    for key, most in (("time", 0.5), ("distance", 0.8)):
        stated = rate == 0.0 or random.random() < 0.5
        brakes[key] = [random.uniform(0.3, most), 1.0] if stated else ["Infinity"] * 2
    arm = {
        "lower": [random.choice([-1.0, -0.02, "-Infinity"])],
        "upper": [random.choice([1.0, 0.02, "Infinity"])],
        "acceleration": [accel],
        "operating_velocity": [speed],
        "operating_acceleration": [accel * random.choice([0.3, 1.0])],
        "position_error": [random.choice([0.0, 1e-3])],
        "velocity_error": [random.choice([0.0, 1e-2])],
        "brakes": [brakes],
    }
    return {"arm": arm, "q": [random.uniform(-0.02, 0.02)], "v": [random.uniform(-speed, speed)]}


@pytest.mark.parametrize("seed", range(40))
def test_no_motion_within_limits_is_beyond_the_bounds(seed):
    random, proof = Random(-seed), make_arm(seed)
    sides = read_sides(proof["arm"], 0, read(proof["q"][0]), read(proof["v"][0]))
    for free in (None, random.uniform(0.0, 0.3)):
        held = None if free is None else read(free)
        for sign, side in zip((1, -1), sides, strict=True):
            one = Extreme(proof, 0, sign, NEVER if free is None else mpf(free))
            for s in np.linspace(0.0, 0.6, 13).tolist():
                found = one.at(mpf(s))
                if found is None:
                    continue
                highest = side.highest(read(s), held)
                assert found[0] * SCALE <= highest.high + 1
                if free is not None:
                    assert found[1] * SCALE <= side.fastest_from(read(s), held).high + 1
                else:
                    assert found[1] * SCALE <= side.velocity(read(s)).high + 1


@pytest.mark.parametrize("seed", range(20))
def test_a_joint_that_is_free_can_get_as_far_as_that(seed):
    proof = make_arm(100 + seed)
    proof["arm"] |= {"lower": [-50.0], "upper": [50.0]}
    (up, _) = read_sides(proof["arm"], 0, read(proof["q"][0]), read(proof["v"][0]))
    s = 0.025 * seed
    found = Extreme(proof, 0, 1, NEVER).at(mpf(s))[0]
    assert mpmath.almosteq(found * SCALE, up.highest(read(s), None).low, 1e-30, SCALE * 1e-30)


def test_a_joint_may_come_back_from_its_stop():
    proof = make_arm(1)
    proof["arm"] |= {"lower": [-0.1], "upper": ["Infinity"], "velocity_error": [0.0]}
    proof["arm"] |= {"acceleration": [10.0], "operating_acceleration": [0.1]}
    (up, _) = read_sides(proof["arm"], 0, read(0.0), read(-proof["arm"]["operating_velocity"][0]))
    arrival = 0.1 / proof["arm"]["operating_velocity"][0]
    # At rest there, it is thrown back as hard as its hardware can.
    thrown = -0.1 + 0.5 * 10.0 * 0.02**2
    assert up.highest(read(arrival + 0.02), None).high >= (thrown - 1e-9) * SCALE


def test_beyond_the_range_of_its_brakes_nothing_is_known():
    proof = make_arm(2)
    proof["arm"]["brakes"][0]["speed"] = [0.01, 0.02]
    (up, _) = read_sides(proof["arm"], 0, read(0.0), read(0.2))
    with pytest.raises(ProofError, match="faster"):
        up.highest(read(0.2), read(0.1))


NONSENSE = [
    ("position_error", -1e-9, "position_error of joint 0 is -1e-09"),
    ("velocity_error", -1.0, "velocity_error of joint 0 is -1.0"),
    ("acceleration", -1.0, "acceleration of joint 0 is -1.0"),
    ("acceleration", 0.0, "acceleration of joint 0 is 0"),
    ("operating_acceleration", 0.0, "acceleration of joint 0 is 0"),
    ("operating_velocity", -0.5, "operating_velocity of joint 0 is -0.5"),
    ("operating_velocity", math.nan, "operating_velocity of joint 0 is nan"),
    ("operating_velocity", "Infinity", "operating_velocity of joint 0 is 'Infinity'"),
    ("lower", 2.0, "lower of joint 0 is above its upper"),
    ("upper", math.nan, "upper is nan"),
]


@pytest.mark.parametrize(("key", "value", "why"), NONSENSE)
def test_limits_that_are_none_are_refused(key, value, why):
    proof = make_arm(3)
    proof["arm"] |= {"lower": [-1.0], "upper": [1.0]}
    read_sides(proof["arm"], 0, read(0.0), read(0.0))
    proof["arm"][key] = [value]
    with pytest.raises(ProofError, match=why):
        read_sides(proof["arm"], 0, read(0.0), read(0.0))


def test_brakes_beyond_the_acceleration_are_refused():
    for value in (1e6, "Infinity"):
        proof = make_arm(3)
        proof["arm"]["brakes"][0]["deceleration"] = [value, value]
        with pytest.raises(ProofError, match="brakes of joint 0 are stronger"):
            read_sides(proof["arm"], 0, read(0.0), read(0.0))


@pytest.mark.parametrize("key", ["speed", "deceleration", "time", "distance"])
@pytest.mark.parametrize("value", [-1e-9, math.nan, "-Infinity"])
def test_brakes_that_are_none_are_refused(key, value):
    proof = make_arm(3)
    proof["arm"]["brakes"][0][key][1] = value
    with pytest.raises(ProofError, match=f"{key} of joint 0 is"):
        read_sides(proof["arm"], 0, read(0.0), read(0.0))
