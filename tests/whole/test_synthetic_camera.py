"""Nothing touches a moving arm, whatever a camera loses, swaps or misplaces.

ARMGUARD_SCENES sets how many scenes are played of each kind; 10,000 take about an hour.
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
    Limb,
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
ONE_BALL, ARM = ("hand",), ("shoulder", "elbow", "hand")


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


def play(seed, parts=ONE_BALL, *, told=1.0, obeys=True):
    """One scene: contacts while the arm moved, ticks in which it moved, and the camera.

    Args:
        seed: Of all random numbers.
        parts: Of each of the two limbs; the monitor knows how far one is from the next at most.
        told: By which factor the lengths of tethers are told.
        obeys: Whether the arm stops when the monitor says so.
    """
    rng = np.random.default_rng(seed)
    obstacles = Obstacles(sources=["camera"])
    limbs = []
    for side in ("left", "right"):
        place = rng.normal(size=3)
        place[2] = abs(place[2])
        place *= rng.uniform(0.9, 1.8) / np.linalg.norm(place)
        limb = Limb(rng, [f"{side} {part}" for part in parts], place)
        for k in range(1, len(parts)):
            before, after = limb.bodies[k - 1 : k + 1]
            obstacles.tether(after.name, before.name, told * limb.lengths[k], "drawn")
        limbs.append(limb)
    bodies = [body for limb in limbs for body in limb.bodies]
    camera = SyntheticCamera(rng, bodies, PERIODS[seed % 2])
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
        hidden = [camera.is_hidden(k, now) for k in range(len(bodies))]
        for n, limb in enumerate(limbs):
            own = slice(n * len(parts), (n + 1) * len(parts))
            limb.move(choose_ways(rng, hidden[own], found[own]), DT)
    return contacts, moving, camera


def choose_ways(rng, hidden, found):
    """Unit vectors along which the parts of a limb accelerate.

    All of it helps the nearest part that is hidden. While all are seen, each goes anywhere, often
    at the arm, and away from it where it is near.
    """
    unseen = [one for one, is_hidden in zip(found, hidden, strict=True) if is_hidden]
    if unseen:
        return [min(unseen, key=lambda one: one[0])[1]] * len(found)
    ways = []
    for distance, towards in found:
        way = rng.normal(size=3)
        if rng.random() < 0.3:
            way = towards
        elif distance < 0.4:
            way = -towards
        ways.append(way / max(np.linalg.norm(way), 1e-9))
    return ways


@pytest.mark.parametrize("parts", [ONE_BALL, ARM], ids=["balls", "tethered"])
@pytest.mark.parametrize("first", range(4))
def test_nothing_touches_a_moving_arm_whatever_the_camera_does(first, parts):
    moving = false = 0
    for seed in range(first, SCENES, 4):
        contacts, ticks, camera = play(seed, parts)
        assert contacts == 0, seed
        moving += ticks
        false += camera.false_count
    assert moving > 0
    assert false > 0


def test_an_arm_that_ignores_its_monitor_is_touched():
    assert any(play(seed, obeys=False)[0] > 0 for seed in range(8))


def test_tethers_let_the_arm_go_on():
    """Else the scenes with tethers would show no more than those without."""
    known, useless = (sum(play(seed, ARM, told=told)[1] for seed in range(12)) for told in (1, 10))
    assert known > 1.03 * useless
