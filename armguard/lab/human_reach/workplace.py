"""An arm in MuJoCo that follows joint velocities, and a person beside it; MuJoCo finds contacts.

The arm has its masses, gravity and the torques that its motors can give; its controller knows its
dynamics (computed torque). The person passes through it, so that contacts can be counted. They are
found on the convex hulls of the arm's links, and on the person's bodies and legs, by MuJoCo's own
distances: armguard's covers and bounds play no part.
"""

from __future__ import annotations

from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from armguard.bridges.mujoco import MujocoJoints, add_arm
from armguard.lab.simulation.mujoco_person import MujocoPerson
from armguard.robot.robot import Robot

Array = NDArray[np.float64]

STEP = 0.001
"""Of the simulation, in [s]."""

CHECK_STEPS = 5
"""Contacts are looked for after so many steps."""

BANDWIDTH = 200.0
"""Of the controller, in [rad]/[s]."""

AT_REST = 0.01
"""An arm rests whose joints are all slower, in [rad]/[s]."""

FLOOR = -0.75
"""Height of what the person stands on, below the base of the arm, in [m]."""


class Person(Protocol):
    """A person of nine tracked points, see `simulation.bodies`."""

    duration: float

    def sample(self, time: float) -> tuple[Array, Array]:
        """Positions and velocities of the points, in [m] and [m]/[s]. Shapes (9, 3)."""


class Workplace:
    """The simulation.

    Args:
        robot: The arm, with all that is attached to it.
        part: The attached body that is there only while `holds_part`.

    Attributes:
        time: Since the beginning, in [s].
        contacts: How many times a part of the body began to be touched by an arm that moved, or an
            arm moved on while it touched one.
        contacts_at_rest: How many times a part of the body touched an arm that rested.
        holds_part: Whether the attached part counts.
    """

    def __init__(self, robot: Robot, part: str) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep = STEP
        add_arm(spec, robot)
        self._body = MujocoPerson(spec, FLOOR)
        self._model = model = spec.compile()
        self._data = mujoco.MjData(model)
        self._joints = MujocoJoints(model, robot)
        self._dofs = self._joints.dofs
        self._effort = np.array(robot.model.effortLimit)
        self._lower, self._upper = robot.lower_position_limit, robot.upper_position_limit
        self._arm = np.array([model.geom(link).id for link in robot.links])
        self._is_part = np.array([link == part for link in robot.links])
        self._people = np.array(self._body.find_geoms(model))

    def reset(self, q: Array, person: Person, begin: float) -> None:
        """Begin anew: the arm rests somewhere, and the person is as at a time of theirs, in [s]."""
        mujoco.mj_resetData(self._model, self._data)
        self._person, self._begin = person, begin
        self._wanted = q.copy()
        self._data.qpos[self._dofs] = q
        self.time, self._steps = 0.0, 0
        self.contacts = self.contacts_at_rest = 0
        self.holds_part = False
        self._touching: dict[int, bool] = {}
        self._look()

    def read_joints(self) -> tuple[Array, Array]:
        """Positions and velocities, in [rad] and [rad]/[s]. Shapes (nv,)."""
        return self._joints.read(self._data)

    def sample_person(self) -> tuple[Array, Array]:
        """Where the person is now, and how fast. Shapes (9, 3)."""
        return self._person.sample(self._begin + self.time)

    def move(self, velocity: Array, steps: int) -> None:
        """Simulate some steps of an arm that keeps to velocities, in [rad]/[s]; limits hold it."""
        model, data = self._model, self._data
        before = self._wanted
        after = np.clip(before + velocity * (steps * STEP), self._lower, self._upper)
        pace = (after - before) / (steps * STEP)
        pull, force = np.zeros(model.nv), np.zeros(model.nv)
        for step in range(1, steps + 1):
            mujoco.mj_step1(model, data)
            wanted = before + pace * (step * STEP)
            q, v = data.qpos[self._dofs], data.qvel[self._dofs]
            pull[self._dofs] = BANDWIDTH**2 * (wanted - q) + 2.0 * BANDWIDTH * (pace - v)
            mujoco.mj_mulM(model, data, force, pull)
            torque = (force + data.qfrc_bias)[self._dofs]
            data.qfrc_applied[self._dofs] = np.clip(torque, -self._effort, self._effort)
            mujoco.mj_step2(model, data)
            self._steps += 1
            self.time = self._steps * STEP
            if self._steps % CHECK_STEPS == 0:
                self._look()
        self._wanted = after

    def _look(self) -> None:
        """Count the contacts that begin."""
        self._body.place(self._model, self._data, self.sample_person()[0])
        mujoco.mj_kinematics(self._model, self._data)
        moves = bool(np.abs(self._data.qvel[self._dofs]).max() > AT_REST)
        touching = {}
        for body in self._find_touched():
            counted = self._touching.get(body)
            if counted is None and not moves:
                self.contacts_at_rest += 1
            self.contacts += moves and not counted
            touching[body] = bool(counted or moves)
        self._touching = touching

    def _find_touched(self) -> set[int]:
        """Geoms of the person that touch the arm; looked at closely where their balls meet."""
        model, data = self._model, self._data
        arm = self._arm if self.holds_part else self._arm[~self._is_part]
        apart = data.geom_xpos[arm][:, None] - data.geom_xpos[self._people]
        reach = model.geom_rbound[arm][:, None] + model.geom_rbound[self._people]
        near = np.argwhere(np.linalg.norm(apart, axis=2) <= reach)
        found: set[int] = set()
        for i, j in near.tolist():
            link, body = int(arm[i]), int(self._people[j])
            if body not in found:
                gap = mujoco.mj_geomDistance(model, data, link, body, 1.0, None)
                if not gap > 0.0:
                    found.add(body)
        return found
