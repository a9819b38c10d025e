"""No joint motion that obeys the limits gets further than any motion model says.

ARMGUARD_MOTIONS sets how many motions are tried in all; a million take a quarter of an hour.
"""

import os

import numpy as np
import pytest

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion, ReachMotion
from support.example_arms import load_arm
from support.hostile_joints import (
    STEP,
    attack,
    chain_to,
    limits_of,
    random_state,
)

MOTIONS = int(os.environ.get("ARMGUARD_MOTIONS", "12000"))
ARMS = ("panda", "xarm7", "ur5", "tiago")
CHECKS = np.array([5, 20, 50, 100, 200, 300])
TRIES, CLIMBS = 10, 6
REACTION = 0.02


def random_question(robot, random):
    link = robot.links[random.integers(len(robot.links))]
    direction = random.normal(size=3)
    return link, random.normal(size=3) * 0.1, direction / np.linalg.norm(direction)


def worst_ways(robot, q, v, link, point, direction, free, random):
    """Furthest ways up to each check: of motions that hit no stop, and of all. Shape (2, 6)."""
    chain = chain_to(robot, robot.joint_index(link))
    worst = np.zeros((2, len(CHECKS)))
    attack(
        chain, limits_of(robot), q, v, robot.position_error, robot.velocity_error,
        point, direction, free, TRIES, CLIMBS, CHECKS, worst, random,
    )  # fmt: skip
    return worst


@pytest.mark.parametrize("name", ARMS)
def test_no_motion_gets_further(name, record_property):
    robot, random = load_arm(name), np.random.default_rng(ARMS.index(name))
    free = [ReachMotion(robot), IsotropicMotion(robot), JointMotion(robot)]
    braking = BrakingMotion(robot, REACTION)
    states = max(1, MOTIONS // (len(ARMS) * 2 * TRIES * (CLIMBS + 1)))
    closest = np.zeros((4, len(CHECKS)))
    for _ in range(states):
        question = random_question(robot, random)
        q, v = random_state(robot, random)
        loose = worst_ways(robot, q, v, *question, np.inf, random)
        braked = worst_ways(robot, q, v, *question, REACTION, random)
        for row, model in enumerate([*free, braking]):
            ways = braked if model is braking else loose
            # A stop's blow is beyond any bound on the acceleration of points.
            furthest = ways[0] if isinstance(model, IsotropicMotion) else ways[1]
            bounds = np.array([model.advance(q, v, *question, k * STEP) for k in CHECKS])
            assert (furthest <= bounds).all(), (model, question, q, v)
            assert (bounds >= 0.0).all()
            assert (np.diff(bounds) >= 0.0).all()
            moving = bounds > 1e-6
            ratio = furthest[moving] / bounds[moving]
            closest[row, moving] = np.maximum(closest[row, moving], ratio)
    record_property("furthest / bound", closest.round(4).tolist())
    # The adversary is worth its name: joint and braking bounds are nearly reached.
    assert (closest[2, :3] > 0.8).all()
    assert closest[3, 0] > 0.8
