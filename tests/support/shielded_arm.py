"""An arm that follows a shield's commands exactly, beside balls that come and go."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Kinematics, OperatingLimits, Robot
from armguard.shield import Command, Shield

RATE = 100.0
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
JERK = 200.0
ACCEL, SPEED, RADIUS = 8.0, 1.5, 0.08
"""Of the balls, in [m/s²], [m/s] and [m]."""


class Ball:
    """One that hunts the arm as its bounds allow, in turns with going away from it."""

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self.place = random.uniform([-0.9, -0.9, 0.2], [0.9, 0.9, 0.9])
        self.place *= max(1.0, 0.8 / np.linalg.norm(self.place[:2]))
        self.velocity = np.zeros(3)
        self._hunts, self._left = True, 0.0

    def move(self, target: np.ndarray, dt: float) -> None:
        self._left -= dt
        if self._left < 0.0:
            self._hunts, self._left = bool(self._random.integers(2)), self._random.uniform(0.2, 2.0)
        away = target - self.place
        heading = away / max(float(np.linalg.norm(away)), 1e-9) * (1.0 if self._hunts else -1.0)
        wanted = SPEED * heading - self.velocity
        size = max(float(np.linalg.norm(wanted)), 1e-12)
        change = wanted * min(1.0, 0.999 * ACCEL * dt / size)
        after = self.velocity + change
        after *= min(1.0, 0.999 * SPEED / max(float(np.linalg.norm(after)), 1e-9))
        self.place = self.place + 0.5 * dt * (self.velocity + after)
        self.velocity = after


class ShieldedArm:
    """Steps a shield, and is where its last command has it.

    Attributes:
        shield: The shield.
        monitor: Its monitor.
        obstacles: The table.
        now: Time of the next step, in [s].
        moved: Positions, velocities and accelerations at every millisecond since the beginning.
        balls: What it moves beside.
        contacts: How often a ball was inside the cover of the moving arm.
    """

    def __init__(
        self,
        seed: int,
        *,
        balls: int = 2,
        operating: bool = True,
        settings: Mapping[str, object] | None = None,
        **options: object,
    ) -> None:
        random = np.random.default_rng(seed)
        robot = Robot.load("panda")
        self.obstacles = Obstacles(sources=["camera"])
        limits = OperatingLimits.fraction(robot, velocity=0.4, acceleration=0.3)
        self.monitor = Monitor(
            robot,
            self.obstacles,
            rate=RATE,
            motion="planned",
            operating=limits if operating else None,
            **(settings or {}),
        )
        self.shield = Shield(self.monitor, jerk=JERK, rate=RATE, **options)
        self.command: Command | None = None
        self.now = 0.0
        self.q, self.v = HOME.copy(), np.zeros(7)
        self.moved: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.contacts = 0
        self._kinematics = Kinematics(robot)
        self.balls = [Ball(random) for _ in range(balls)]

    @property
    def centers(self) -> np.ndarray:
        """Of all spheres of the arm, in [m]. Shape (n, 3)."""
        return self._kinematics.centers

    def see(self) -> None:
        """Tell the table where the balls are."""
        places = np.array([ball.place for ball in self.balls]).reshape(-1, 3)
        self.obstacles.update(
            [f"ball{k}" for k in range(len(places))], self.now, places,
            np.array([ball.velocity for ball in self.balls]).reshape(-1, 3), radius=RADIUS,
            accel=ACCEL, speed=SPEED, position_error=1e-3, velocity_error=1e-3, source="camera",
        )  # fmt: skip

    def step(self, *, sees: bool = True, asks: bool = True, **wish: object) -> Command | None:
        """One period: the shield is asked, and arm and balls move on."""
        if sees:
            self.see()
        if asks:
            self.command = self.shield.step(self.now, self.q, self.v, **wish)
        for _ in range(round(1e3 / RATE)):
            self.now += 1e-3
            if self.command is not None and len(self.command.times):
                self.q, self.v, a = self.command.at(self.now)
                self.moved.append((self.q, self.v, a))
            self._kinematics.compute(self.q, np.zeros(7))
            for ball in self.balls:
                target = self._kinematics.centers[-1]
                ball.move(target, 1e-3)
                apart = np.linalg.norm(self._kinematics.centers - ball.place, axis=1)
                leaves = self._kinematics.spheres.child_count == 0
                gaps = (apart - self._kinematics.spheres.radius)[leaves] - RADIUS
                self.contacts += bool(gaps.min() <= 0.0 and np.abs(self.v).max() > 1e-9)
        return self.command
