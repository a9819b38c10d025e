"""Nothing touches a moving arm, whatever a camera loses, swaps or misplaces.

ARMGUARD_SCENES sets how many scenes are played; 10,000 take some ten minutes.
"""

import os

import numpy as np
import pytest

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics
from armguard.verdict import Level
from support.panda_monitor import HOME, panda
from support.synthetic_camera import (
    ACCEL,
    POSITION_ERROR,
    RADIUS,
    SPEED,
    VELOCITY_ERROR,
    Body,
    SyntheticCamera,
)

SCENES = int(os.environ.get("ARMGUARD_SCENES", "24"))
DT, SECONDS = 0.01, 1.5
LATENCY, REACTION = 0.002, 0.018  # [s], together two ticks
PERIODS = (0.01, 0.03)  # of the camera, [s]
SWEEP = 0.5  # of the first joint, [rad/s]
KINEMATICS = Kinematics(panda())
EXACT = HullDistance(panda(), KINEMATICS)
LINKS = len(panda().links)


class Arm:
    """A Panda that turns its first joint, and brakes as hard as its brakes guarantee."""

    def __init__(self):
        self.q, self.v = HOME.copy(), np.zeros(7)
        self.stops = [True, True]  # verdicts on their way

    def move(self, stop):
        """One tick; the verdict arrives after the delays."""
        self.stops.append(stop)
        braking = panda().braking_deceleration[0]
        wanted = 0.0 if self.stops.pop(0) else SWEEP
        change = np.clip(wanted - self.v[0], -braking * DT, 0.5 * DT)
        after = self.v.copy()
        after[0] += change
        self.q, self.v = self.q + 0.5 * DT * (self.v + after), after


def find_nearest(body):
    """Distance from the arm, and the direction to it."""
    found = [EXACT.distance(k, body.position[None], RADIUS) for k in range(1, LINKS)]
    distance, on_link, on_body = min(found, key=lambda one: one[0])
    towards = on_link - on_body
    return distance, towards / max(np.linalg.norm(towards), 1e-9)


def play(seed, state_premises=lambda obstacles: None, *, obeys=True):
    """One scene: contacts while the arm moved, ticks in which it moved, and the camera.

    Args:
        seed: Of all random numbers.
        state_premises: Tells the table what else holds of the bodies.
        obeys: Whether the arm stops when the monitor says so.
    """
    rng = np.random.default_rng(seed)
    bodies = []
    for name in ("left", "right"):
        place = rng.normal(size=3)
        place[2] = abs(place[2])
        bodies.append(Body(name, rng.uniform(0.9, 1.8) * place / np.linalg.norm(place)))
    camera = SyntheticCamera(rng, bodies, PERIODS[seed % 2])
    obstacles = Obstacles(sources=["camera"])
    state_premises(obstacles)
    monitor = Monitor(
        panda(), obstacles, rate=1.0 / DT, latency=LATENCY, reaction_time=REACTION,
        source_timeout=0.2,
    )  # fmt: skip
    arm, contacts, moving, next_look = Arm(), 0, 0, 0.0
    for tick in range(round(SECONDS / DT)):
        now = tick * DT
        KINEMATICS.compute(arm.q, arm.v)
        found = [find_nearest(body) for body in bodies]
        if abs(arm.v[0]) > 1e-9:
            moving += 1
            contacts += sum(distance <= 0.0 for distance, _ in found)
        if now >= next_look - 1e-9:
            next_look += camera.period
            samples = camera.look(now)
            obstacles.update(
                [one.name for one in samples], now,
                np.array([one.position for one in samples]).reshape(-1, 3),
                np.array([one.velocity for one in samples]).reshape(-1, 3),
                radius=RADIUS, accel=ACCEL, speed=SPEED, position_error=POSITION_ERROR,
                velocity_error=VELOCITY_ERROR, source="camera",
            )  # fmt: skip
        verdict = monitor.step(now, arm.q, arm.v)
        arm.move(obeys and verdict.level is Level.STOP)
        for k, (body, (distance, towards)) in enumerate(zip(bodies, found, strict=True)):
            is_unseen = camera.is_hidden(k, now)
            direction = rng.normal(size=3)
            if is_unseen or rng.random() < 0.3:
                direction = towards
            elif distance < 0.4:
                direction = -towards
            body.move(direction / np.linalg.norm(direction), DT)
    return contacts, moving, camera


@pytest.mark.parametrize("part", range(4))
def test_nothing_touches_a_moving_arm_whatever_the_camera_does(part):
    moving = false = swaps = 0
    for seed in range(part, SCENES, 4):
        contacts, ticks, camera = play(seed)
        assert contacts == 0, seed
        moving += ticks
        false += camera.false_count
        swaps += camera.swap_count
    assert moving > 0
    assert false > 0


def test_an_arm_that_ignores_its_monitor_is_touched():
    assert any(play(seed, obeys=False)[0] > 0 for seed in range(8))
