"""A Panda that goes evenly to where it is told in each step, beside balls that hunt it."""

from __future__ import annotations

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from armguard.lab.tradeoff.truth import TrueArm
from armguard.robot import Robot
from support.shielded_arm import ACCEL, HOME, RADIUS, SPEED, Ball

PERIODS = {"velocity": 0.02, "position": 0.02, "chunk": 0.1}
POINTS = 5
FINE = 5  # parts of a point, in which the balls and the arm move on


class JointEnv(gymnasium.Env):
    """Counts, on the true surface of the arm, how often a ball was in an arm that moved."""

    metadata = {"render_modes": [], "render_fps": 50}  # noqa: RUF012

    def __init__(self, action_kind, balls=1):
        self.robot = Robot.load("panda")
        self.action_kind, self.period = action_kind, PERIODS[action_kind]
        self.points = POINTS if action_kind == "chunk" else 1
        shape = (POINTS, 7) if action_kind == "chunk" else (7,)
        self.action_space = Box(-4.0, 4.0, shape, np.float64)
        self.observation_space = Box(-10.0, 10.0, (14 + 3 * balls,), np.float64)
        self._arm, self._count = TrueArm(self.robot, None), balls
        self.actions = []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.q, self.v = HOME.copy(), np.zeros(7)
        self.balls = [Ball(self.np_random) for _ in range(self._count)]
        self.contacts = 0
        return self._observe(), {}

    def step(self, action):
        self.actions.append(np.array(action))
        apart = self.period / self.points
        places = np.atleast_2d(
            self.q + action * self.period if self.action_kind == "velocity" else action
        )
        for place in places:
            self.v = (place - self.q) / apart
            for _ in range(FINE):
                self.q = self.q + self.v * apart / FINE
                self._arm.place(self.q)
                for ball in self.balls:
                    ball.move(self._arm.placement(6).translation, apart / FINE)
                if np.abs(self.v).max() > 0.01:
                    gaps = [self._arm.gap(ball.place[None], RADIUS)[0] for ball in self.balls]
                    self.contacts += min(gaps, default=1.0) <= 0.0
        return self._observe(), 0.0, False, False, {"contacts": self.contacts}

    def read_joints(self):
        return self.q, self.v

    def publish(self, obstacles, stamp):
        places, paces = (
            np.array([getattr(ball, name) for ball in self.balls]).reshape(-1, 3)
            for name in ("place", "velocity")
        )
        ids = [f"ball{k}" for k in range(len(places))]
        obstacles.update(ids, stamp, places, paces, radius=RADIUS, accel=ACCEL, speed=SPEED)

    def _observe(self):
        return np.concatenate([self.q, self.v, *(ball.place for ball in self.balls)])
