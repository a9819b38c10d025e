"""The scenes of `bench_near.py`: an arm at work, and people, parts and balls right beside it.

Everything is a closed form of time. The arm swings slowly between places left and right of it; its
plan is the same motion, so that it can be told to the monitor. People stand with their arms
hanging and shift their weight; they are nine bodies each, balls and capsules.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bounds import Plan
from armguard.lab.simulation.bodies import publish_person
from armguard.obstacles import Obstacles
from armguard.robot import Kinematics, Robot
from scene.example_limits import LIMITS, PATTERNS_OF_REGIONS

Floats = NDArray[np.float64]

RATE, UPDATE_RATE = 1000.0, 100.0  # of ticks and of measurements, [Hz]
MIDDLE = (0.0, -0.3, 0.0, -2.1, 0.0, 1.8, 0.785)  # of the swing, [rad]
SIZE = (0.7, 0.35, 0.05, 0.2, 0.05, 0.2, 0.1)  # of the swing, [rad]
TURN = 0.35  # of the swing, [rad/s]: its joints get to a tenth of their speed limits
STANDING = (  # head, collar, hip, shoulders, elbows, hands: forward, left and up, [m]
    (0.02, 0.0, 0.88), (0.0, 0.0, 0.60), (0.0, 0.0, 0.20), (0.0, 0.19, 0.58), (0.0, -0.19, 0.58),
    (0.02, 0.19, 0.28), (0.02, -0.19, 0.28), (0.13, 0.19, -0.03), (0.13, -0.19, -0.03),
)  # fmt: skip
SWAY, SWAYING = 0.03, 1.5  # of people, [m] and [rad/s]
ACCEL, SPEED = 10.0, 2.0  # of everybody: [m/s²], [m/s]
BALL, PART = 0.1, 0.06  # radii, [m]
PIECE = 0.1  # of a committed plan, before its stop, [s]
SAMPLE = 5e-3  # between samples of plans, [s]


class Swing:
    """What the arm does, a smooth swing about a middle.

    Attributes:
        robot: The arm, a Panda.
        centers: Of all spheres of its cover, at many places of the swing, in [m]. Shape (k, 3).
        radii: Of these spheres, in [m]. Shape (k,).
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        kinematics = Kinematics(robot)
        leaves = kinematics.spheres.child_count == 0
        places = []
        for time in np.linspace(0.0, 2.0 * math.pi / TURN, 60):
            kinematics.compute(*self.sample(time))
            places.append(kinematics.centers[leaves])
        self.centers = np.concatenate(places)
        self.radii = np.tile(kinematics.spheres.radius[leaves], len(places))

    def sample(self, time: float) -> tuple[Floats, Floats]:
        """Joint positions in [rad] and velocities in [rad]/[s]."""
        angle = TURN * time
        q = np.array(MIDDLE) + np.array(SIZE) * math.sin(angle)
        return q, np.array(SIZE) * (TURN * math.cos(angle))

    def plan(self, start: float, duration: float) -> Plan:
        """The piece of the swing from a time on; not at rest at its end."""
        times = np.arange(round(duration / SAMPLE) + 1) * SAMPLE
        states = [self.sample(start + time) for time in times]
        q, v = (np.array([state[k] for state in states]) for k in range(2))
        errors = np.full(len(MIDDLE), 2e-3)
        return Plan(start, times, q, v, errors, 25.0 * errors)

    def find_distance(self, places: Floats) -> Floats:
        """Distances of places, (n, 3), from all that the swing sweeps, in [m]. Shape (n,)."""
        nearest, lengths = np.full(len(places), np.inf), (places**2).sum(axis=1)
        for radius in np.unique(self.radii):
            centers = self.centers[self.radii == radius]
            squared = (centers**2).sum(axis=1) - 2.0 * (places @ centers.T)
            away = np.sqrt(np.maximum(lengths + squared.min(axis=1), 0.0)) - radius
            np.minimum(nearest, away, out=nearest)
        return nearest


class Person(NamedTuple):
    """One who stands and faces the arm."""

    name: str
    distance: float
    """Of the feet from the axis of the arm's base, in [m]."""
    bearing: float
    """Where that is, in [rad] about z from x."""

    def find_points(self, time: float) -> tuple[Floats, Floats]:
        """Tracked points, in [m], shape (9, 3), and the velocity of all of them, in [m]/[s]."""
        ahead = np.array([-math.cos(self.bearing), -math.sin(self.bearing), 0.0])
        left, up = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
        angle = SWAYING * time + 3.0 * self.bearing
        shift = SWAY * (math.sin(angle) * ahead + math.cos(0.7 * angle) * left)
        pace = SWAYING * SWAY * (math.cos(angle) * ahead - 0.7 * math.sin(0.7 * angle) * left)
        place = np.array(STANDING) @ np.stack([ahead, left, up]) - self.distance * ahead + shift
        return place, pace

    def publish(self, obstacles: Obstacles, time: float, *, begin: float = 0.0) -> None:
        """Tell the obstacle table where the nine bodies are, who have moved since `begin`."""
        place, pace = self.find_points(begin + time)
        velocity = np.tile(pace, (len(STANDING), 1))
        publish_person(
            obstacles, self.name, time, place, velocity, np.zeros(len(STANDING)),
            accel=ACCEL, speed=SPEED, person=self.name,
        )  # fmt: skip


class Balls:
    """Balls that sway a little about places of their own, a group of them measured at a time.

    Args:
        name: What their names begin with, and their source.
        home: About where, in the world, in [m]. Shape (n, 3).
        radius: Of each, in [m].
        sway: How far, in [m].
    """

    def __init__(self, name: str, home: Floats, radius: float, sway: float) -> None:
        self._source, self._home, self._radius, self._sway = name, home, radius, sway
        self._phase = np.random.default_rng(7).uniform(0.0, 2.0 * math.pi, home.shape)
        self._names = [f"{name}-{k}" for k in range(len(home))]

    def publish(self, obstacles: Obstacles, time: float) -> None:
        """Tell the obstacle table where they are."""
        angle = SWAYING * time + self._phase
        position = self._home + self._sway * np.sin(angle)
        velocity = self._sway * SWAYING * np.cos(angle)
        obstacles.update(
            self._names, time, position, velocity,
            radius=self._radius, accel=ACCEL, speed=SPEED, source=self._source,
        )  # fmt: skip


class Setting(NamedTuple):
    """One scene: who is there, and whether the controller commits pieces."""

    crowd: tuple[Any, ...]
    """Whatever has `publish`."""
    commits: bool = False
    settings: dict[str, Any] = {}  # noqa: RUF012  # nobody writes to it
    """Of the monitor."""

    @property
    def regions(self) -> dict[str, str] | None:
        """By pattern of ids, where contact limits are stated; None where they are not."""
        return PATTERNS_OF_REGIONS if "contact_limits" in self.settings else None

    def with_limits(self) -> Setting:
        """The same with contact limits."""
        return self._replace(settings={**self.settings, "contact_limits": LIMITS})


WITH_LIMITS = ", contact limits"
"""What is added to the name of a scene that has them; the scene without it is the same otherwise,
pose by pose."""


def scatter_near(swing: Swing, count: int, nearest: float, outer: float) -> Floats:
    """Places no nearer than so to anything that the swing sweeps, even over a cube about it."""
    random = np.random.default_rng(3)
    found = np.empty((0, 3))
    while len(found) < count:
        places = random.uniform(-outer, outer, (4 * count, 3))
        places[:, 2] = np.abs(places[:, 2])
        found = np.concatenate([found, places[swing.find_distance(places) >= nearest]])
    return found[:count]


def make_settings(swing: Swing) -> dict[str, Setting]:
    """All scenes by name."""

    def balls(count: int, nearest: float, outer: float, radius: float = BALL) -> Balls:
        places = scatter_near(swing, count, nearest + radius, outer)
        return Balls("ball", places, radius, 0.02)

    around = [Person(f"person{k}", 1.2 + 0.2 * k, bearing) for k, bearing in enumerate((0, 2, 4))]
    parts = Balls("part", scatter_near(swing, 20, 0.35, 1.2), PART, 0.0)
    one = (Person("person", 1.1, -math.pi / 2.0),)
    scenes = {
        "person at 1.1 m": Setting(one),
        "person at 1.3 m": Setting((Person("person", 1.3, -math.pi / 2.0),)),
        "person at 2 m": Setting((Person("person", 2.0, -math.pi / 2.0),)),
        "person, commit": Setting(one, True, {"motion": "planned"}),
        "3 people, 20 parts": Setting((*around, parts)),
        "1,000 near balls": Setting((balls(1000, 0.2, 4.0),)),
        "5,000 at hand": Setting((balls(5000, 0.02, 0.9, 0.02),)),
    }
    with_limits = ("person at 1.1 m", "person, commit", "3 people, 20 parts")
    return {
        name + more: setting.with_limits() if more else setting
        for name, setting in scenes.items()
        for more in ("", WITH_LIMITS)[: 2 if name in with_limits else 1]
    }
