"""No motion that keeps its operating limits gets further than any motion model says.

ARMGUARD_MOTIONS sets how many joint motions are tried in all, for joints and for points.
"""

import os

import numba
import numpy as np
import pytest

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion
from armguard.bounds.displacement import (
    arrival,
    fill_displacements,
    free_displacement,
    operating_arrival,
    operating_displacement,
    operating_velocity,
)
from armguard.bounds.limits import JointLimits
from armguard.robot.brakes import BrakeCurves
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from support.example_arms import load_arm
from support.hostile_joints import chain_to, place_point
from support.operating_motions import Law, record_joint

MOTIONS = int(os.environ.get("ARMGUARD_MOTIONS", "30000"))
ARMS = ("panda", "ur5")
REACTION, HORIZON = 0.02, 0.003

CASES = [
    (start, accel, speeding, top)
    for start in (-2.0, -0.1, 0.0, 0.4, 1.5)
    for accel in (0.7, 20.0)
    for speeding in (0.01, 0.5)
    for top in (0.5, 2.0)
]


def fastest(start, accel, speeding, top, times):
    """Velocities of the joint that goes as far as it can, step by step."""
    found = [min(start, top)]
    step = times[1] - times[0]
    for _ in times[1:]:
        v = found[-1]
        after = v + accel * step
        if v < 0.0 < after:
            after = speeding * (step + v / accel)
        elif v >= 0.0:
            after = v + speeding * step
        found.append(min(after, top))
    return np.array(found)


@pytest.mark.parametrize(("start", "accel", "speeding", "top"), CASES)
def test_a_joint_turns_round_hard_and_speeds_up_gently(start, accel, speeding, top):
    times = np.linspace(0.0, 4.0, 40_001)
    rates = fastest(start, accel, speeding, top, times)
    ways = np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1]) * times[1])])
    for k in range(0, len(times), 500):
        law = accel, speeding, top
        assert operating_velocity(start, *law, times[k]) == pytest.approx(rates[k], abs=1e-6)
        assert operating_displacement(start, *law, times[k]) == pytest.approx(ways[k], abs=1e-6)


@pytest.mark.parametrize(("start", "accel", "speeding", "top"), CASES)
@pytest.mark.parametrize("room", [1e-9, 0.02, 1.0])
def test_nothing_arrives_early_and_nothing_much_later(start, accel, speeding, top, room):
    law = accel, speeding, top
    time = operating_arrival(start, *law, room)
    slack = 1e-9 * top * time
    assert operating_displacement(start, *law, time) <= room * (1.0 + 1e-9) + slack
    assert (
        operating_displacement(start, *law, time * (1.0 + 1e-6) + 1e-9)
        >= room * (1.0 - 1e-5) - slack
    )


@pytest.mark.parametrize("start", [-2.0, -0.3, 0.0, 0.4, 3.0])
def test_with_the_hardware_s_acceleration_nothing_changes_to_the_bit(start):
    for s in np.linspace(0.0, 2.0, 101):
        assert operating_displacement(start, 0.7, 0.7, 1.5, s) == free_displacement(
            start, 0.7, 1.5, s
        )
        assert operating_velocity(start, 0.7, 0.7, 1.5, s) == min(1.5, start + 0.7 * s)
        assert operating_arrival(start, 0.7, 0.7, 1.5, s) == arrival(start, 0.7, 1.5, s)


@numba.njit(cache=True)
def measure(value, error, random):
    """What is measured: off by all of the error, more often than not."""
    size = 3.0 * random.uniform(-1.0, 1.0)
    return value + error * min(max(size, -1.0), 1.0)


@numba.njit(cache=True)
def one_of(brakes, j):
    """The brakes of one joint."""
    return BrakeCurves(
        brakes.speed[j : j + 1], brakes.deceleration[j : j + 1],
        brakes.time[j : j + 1], brakes.distance[j : j + 1],
    )  # fmt: skip


@numba.njit(cache=True)
def attack_joints(limits, braking, motions, random):
    """Motions of single joints against tables of displacements at random times.

    Returns how many got beyond the table, and the greatest part of it that was reached.
    """
    nodes = 12
    one = np.zeros(1)
    q, v = one.copy(), one.copy()
    time, offsets = np.zeros(nodes), np.zeros(nodes + 1)
    high, low = np.zeros((nodes, 1)), np.zeros((nodes, 1))
    highest, lowest = one.copy(), one.copy()
    places, rates = np.zeros(nodes + 1), np.zeros(nodes + 1)
    broken, closest = 0, 0.0
    for _ in range(motions):
        j = random.integers(0, limits.lower.shape[0])
        top, speeding = limits.operating_velocity[j], limits.operating_acceleration[j]
        law = Law(
            max(limits.lower[j], -3.0), min(limits.upper[j], 3.0), top, speeding,
            limits.acceleration[j], limits.brakes.deceleration[j, 0],
        )  # fmt: skip
        own = JointLimits(
            one + law.lower, one + law.upper, limits.velocity[j : j + 1],
            limits.acceleration[j : j + 1], one_of(limits.brakes, j),
            limits.position_error[j : j + 1], limits.velocity_error[j : j + 1],
            limits.operating_velocity[j : j + 1], limits.operating_acceleration[j : j + 1],
        )  # fmt: skip
        age = 0.05 * random.uniform(-1.0, 1.0) if random.random() < 0.5 else 0.0
        horizon = 0.02 + 0.1 * random.random() if braking else np.inf
        free = max(age, 0.0) + horizon
        # The motion begins before its stamp where the state is newer than now. What a stop has
        # thrown back by then keeps its limits from then on, or breaks them.
        span = random.uniform(0.0, 0.6)
        for k in range(nodes):
            time[k] = span * random.random()
        time[0] = 0.0
        time.sort()
        true_q = random.uniform(law.lower, law.upper)
        true_v = top * random.uniform(-1.0, 1.0)
        kind = random.integers(0, 4)
        if kind == 0:
            true_v = np.sign(true_v) * top
        elif kind == 1:
            true_v = 0.1 * true_v
        before = 0
        while before < nodes and age + time[before] < 0.0:
            before += 1
        offsets[:before] = time[:before]
        offsets[before] = max(-age, 0.0)
        record_joint(
            true_q, true_v, np.inf, offsets[: before + 1], law, random,
            places[: before + 1], rates[: before + 1],
        )  # fmt: skip
        stamp = before
        offsets[before + 1 : nodes + 1] = age + time[before:]
        record_joint(
            places[stamp], rates[stamp], free, offsets[before + 1 : nodes + 1], law, random,
            places[before + 1 : nodes + 1], rates[before + 1 : nodes + 1],
        )  # fmt: skip
        q[0] = measure(places[stamp], own.position_error[0], random)
        v[0] = measure(rates[stamp], own.velocity_error[0], random)
        fill_displacements(q, v, age, free, own, time, high, low, highest, lowest)
        for k in range(nodes):
            way = places[k if k < before else k + 1] - places[stamp]
            most, least = min(high[k, 0], highest[0]), max(low[k, 0], lowest[0])
            slack = 1e-12 + 1e-11 * abs(way)
            if not least - slack <= way <= most + slack:
                broken += 1
            if most > 1e-3:
                closest = max(closest, way / most)
    return broken, closest


@pytest.mark.parametrize("braking", [False, True], ids=["free", "braking"])
@pytest.mark.parametrize("share", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("name", ARMS)
def test_no_joint_gets_further(name, share, braking, record_property):
    robot = load_arm(name)
    operating = OperatingLimits.fraction(robot, velocity=0.5 * (1.0 + share), acceleration=share)
    limits = JointMotion(robot, operating=operating).limits
    random = np.random.default_rng([ARMS.index(name), braking])
    broken, closest = attack_joints(limits, braking, MOTIONS // 10, random)
    record_property("furthest / bound", closest)
    assert broken == 0
    assert closest > 0.99


@numba.njit(cache=True)
def attack_point(
    chain, limits, q, v, local, direction, free, times, motions, random, worst, at_rest
):  # fmt: skip
    """Furthest ways of a point at `times`, of arms that were measured at q and v, in `worst`."""
    nv, count = q.shape[0], times.shape[0]
    places, rates = np.zeros((nv, count)), np.zeros((nv, count))
    start_q, joints = np.zeros(nv), np.zeros(nv)
    inner = np.empty((chain.column.shape[0] + 1, 3))
    moving = 0
    for _ in range(motions):
        hits = False
        for j in range(nv):
            top = limits.operating_velocity[j]
            law = Law(
                limits.lower[j], limits.upper[j], top, limits.operating_acceleration[j],
                limits.acceleration[j], limits.brakes.deceleration[j, 0],
            )  # fmt: skip
            start = measure(q[j], limits.position_error[j], random)
            start_q[j] = min(max(start, limits.lower[j]), limits.upper[j])
            pace = min(max(measure(v[j], limits.velocity_error[j], random), -top), top)
            hits |= record_joint(start_q[j], pace, free, times, law, random, places[j], rates[j])
        if not hits:
            begin = place_point(chain, start_q, local, inner).copy()
            for k in range(count):
                for j in range(nv):
                    joints[j] = places[j, k]
                place = place_point(chain, joints, local, inner)
                way = 0.0
                for i in range(3):
                    way += direction[i] * (place[i] - begin[i])
                worst[k] = max(worst[k], way)
            for j in range(nv):
                moving += abs(rates[j, count - 1]) > 1e-9 and at_rest
    return moving


@pytest.mark.parametrize("name", ARMS)
def test_no_point_gets_further(name, record_property):
    robot, random = load_arm(name), np.random.default_rng(ARMS.index(name))
    nv, tries = len(robot.joints), 60
    closest = np.zeros(3)
    # Levers take long, so there is one of each; what is in force is written in place.
    in_force = LimitsInForce(robot, None)
    joint, isotropic = (kind(robot, operating=in_force) for kind in (JointMotion, IsotropicMotion))
    braking = BrakingMotion(robot, REACTION, operating=in_force)
    for _ in range(max(20, MOTIONS // (len(ARMS) * 2 * tries * nv))):
        share = random.choice([0.05, 0.3, 1.0], 2)
        operating = OperatingLimits.fraction(robot, velocity=share[0], acceleration=share[1])
        velocity, acceleration = operating.resolve(robot)
        in_force.velocity[:], in_force.acceleration[:] = velocity, acceleration
        lower = np.maximum(robot.lower_position_limit, -3.0)
        upper = np.minimum(robot.upper_position_limit, 3.0)
        q = random.uniform(lower, upper)
        v = random.uniform(-1.0, 1.0, nv) * velocity * random.choice([0.0, 0.3, 1.0])
        v = np.where(random.random(nv) < 0.3, np.sign(v) * velocity, v)
        link = robot.links[-1 - random.integers(min(3, len(robot.links)))]
        chain = chain_to(robot, robot.joint_index(link))
        point, direction = random.normal(size=3) * 0.1, random.normal(size=3)
        direction /= np.linalg.norm(direction)
        question = link, point, direction
        stop_time = braking.stop_time(q, v, 0.0, 0.0)
        times = np.sort(np.append(random.uniform(0.0, 0.4, 7), stop_time * (1.0 + 1e-9)))
        for row, model in enumerate((joint, isotropic, braking)):
            free = REACTION if model is braking else np.inf
            asked = times[times <= stop_time * 1.1] if model is braking else times
            worst = np.zeros(len(asked))
            rests = model is braking and asked[-1] >= stop_time
            moving = attack_point(
                chain, joint.limits, q, v, point, direction, free, asked, tries, random, worst,
                rests,
            )  # fmt: skip
            assert moving == 0
            bounds = np.array([model.advance(q, v, *question, t) for t in asked])
            assert (worst <= bounds + 1e-12).all(), (model, question, q, v)
            some = bounds > 1e-4
            closest[row] = max(closest[row], (worst[some] / bounds[some]).max(initial=0.0))
    record_property("furthest / bound", closest.round(3).tolist())
    assert (closest[[0, 2]] > 0.6).all()
