"""Random scenes on three arms, and proofs of what is said there."""

import functools
import json

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.robot.operating_limits import OperatingLimits
from armguard.settings.contact_limits import ContactLimit, ContactLimits

ARMS = "panda", "ur5", "tiago"
"""Brakes stated by speed; by time and distance; and an arm with a joint that slides."""

LIMITS = ContactLimits(
    {"hand": ContactLimit(force=140.0, stiffness=75.0, body_mass=0.6, source="test", gap=0.01)}
)


@functools.cache
def make_scene(name, *, touches):
    """A monitor of an arm that keeps to operating limits, and its table."""
    robot = Robot.load(name)
    velocity = np.minimum(0.3 * robot.velocity_limit, 0.8)
    operating = OperatingLimits(velocity, 0.5 * robot.acceleration_limit)
    obstacles = Obstacles(sources=["camera"])
    monitor = Monitor(
        robot,
        obstacles,
        operating=operating,
        rise_delay=0.0,
        contact_limits=LIMITS if touches else None,
    )
    return monitor, obstacles, velocity


def make_proof(random, *, name=None):
    """A proof of a random scene, as plain data; None where there is nothing to prove."""
    name = name or str(random.choice(ARMS))
    monitor, obstacles, velocity = make_scene(name, touches=bool(random.random() < 0.4))
    robot = monitor.robot
    monitor.reset()
    now = make_scene.now = getattr(make_scene, "now", 0.0) + 100.0
    lower, upper = (np.clip(one, -3.0, 3.0) for one in (
        robot.lower_position_limit, robot.upper_position_limit
    ))  # fmt: skip
    q = random.uniform(lower, upper)
    v = random.uniform(-1.0, 1.0, len(q)) * velocity * random.choice([0.0, 0.3, 1.0])
    points = int(random.integers(1, 4))
    place = random.normal(size=3)
    place *= random.uniform(0.3, 2.5) / np.linalg.norm(place)
    place[2] += 0.4
    corners = place + 0.1 * random.normal(size=(points, 3))
    speeds = np.tile(random.normal(size=3) * random.choice([0.0, 0.3, 1.0]), (points, 1))
    obstacles.update(
        ["it"],
        now - random.uniform(0.0, 0.05),
        corners[None],
        speeds[None],
        source="camera",
        radius=random.uniform(0.01, 0.15),
        accel=random.choice([2.0, 10.0, np.inf]),
        speed=random.choice([0.5, 1.6, 3.0]),
        velocity_error=random.choice([0.0, 0.1]),
        position_error=random.choice([0.0, 0.01]),
        region="hand",
    )
    verdict = monitor.step(now - random.uniform(0.0, 0.005), q, v, now)
    proof = monitor.prove(verdict)
    return None if proof is None else json.loads(proof.to_json())


def make_proofs(seed, count):
    """So many proofs of random scenes."""
    random = np.random.default_rng(seed)
    made = 0
    while made < count:
        proof = make_proof(random, name=ARMS[made % len(ARMS)])
        if proof is not None:
            made += 1
            yield proof
