"""An arm with its dynamics, in MuJoCo, whose controller follows a shield's commands.

In each millisecond the controller has the torques that the arm of the description would need for
the command (inverse dynamics), and a correction of what its encoders see as errors. The simulated
arm differs from that description: its joints have friction, and its tool a load, of which the
controller does not know. Its motors have no more than their torques, and its encoders are off.

Bodies of people are capsules of the same simulation. They push nothing: a contact is counted, and
the arm goes on.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import mujoco
import numpy as np
import pinocchio

from armguard.bridges.mujoco import add_arm
from armguard.robot import Robot
from armguard.shield import Command
from scene.clearance import Leaves
from scene.recorded_people import NAMES, RADII
from scene.shielded import SLOWEST, Following

STEP = 1e-3
"""Of the simulation and of the controller, in [s]."""

BANDWIDTH = 2.0 * math.pi * 10.0
"""Of the controller's correction, in [1]/[s]; critically damped."""

ARMATURE = 0.1
"""Reflected inertia of each motor, in [kg m²], which the controller knows."""

DAMPING, FRICTION = 1.0, 0.01
"""Friction of each joint: by speed in [N m s], and as a share of its motor's greatest torque."""

LOAD, LOAD_AWAY = 0.25, 0.1
"""Of the tool, in [kg], and how far it is from the last joint along its axis, in [m]."""

NEAR = 0.05
"""Distances are measured up to here, in [m]."""


class SimulatedArm:
    """A `scene.shielded.Follower` with a mass.

    Args:
        robot: The arm.
        period: Of the shield's steps, in [s].
        following: What is stated of it; it takes up each command after that latency.
        seed: Of what encoders are off by, numbers of 0 or more.

    Attributes:
        seen: How far it was off its commands, as its encoders have it, at most: positions in [rad]
            and velocities in [rad]/[s]. Shape (2, nv).
        share: How far it truly was off, at most, as a share of what is stated, encoders included.
        steps_off: In how many steps of the shield it was farther off than is stated.
        least_gap: Between its surface and a body while it moved, in [m]; up to `NEAR`.
    """

    def __init__(
        self, robot: Robot, period: float, following: Following, seed: Sequence[int]
    ) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep = STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        add_arm(spec, robot)
        self._torque_limit = robot.model.effortLimit.copy()
        for joint, torque in zip(spec.joints, self._torque_limit, strict=True):
            joint.armature, joint.frictionloss = ARMATURE, FRICTION * torque
            joint.damping[0] = DAMPING
        load = spec.body(robot.joints[-1]).add_body(pos=[0.0, 0.0, LOAD_AWAY])
        load.explicitinertial, load.mass, load.inertia = True, LOAD, [1e-4, 1e-4, 1e-4]
        for name, radius in zip(NAMES, RADII, strict=True):
            spec.worldbody.add_geom(
                name=f"body {name}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 1e-3, 0.0],
                contype=0, conaffinity=0,
            )  # fmt: skip
        self._model = model = spec.compile()
        self._data = mujoco.MjData(model)
        self._links = [model.geom(link).id for link in robot.links]
        self._bodies = [model.geom(f"body {name}").id for name in NAMES]
        self._extents, self._turn = model.geom_rbound[self._links], np.zeros(4)
        self._robot, self._known = robot, robot.model.createData()
        self._following, self._random = following, np.random.default_rng(seed)
        encoders = np.stack([robot.position_error, robot.velocity_error])
        self._half, self._shares = 0.5 * encoders, np.zeros_like(encoders)
        self._stated = encoders.copy()
        self._stated[0] += following.position
        self._stated[1] += following.velocity
        self.leaves = Leaves(robot)
        self.looks = round(period / STEP)
        self.seen, self.share, self.steps_off = np.zeros_like(encoders), 0.0, 0
        self.least_gap = NEAR

    def start(self, q: np.ndarray) -> None:
        """Rest somewhere, in [rad]. Shape (nv,)."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = q
        rest = np.zeros_like(q)
        self._wanted = q.copy(), rest, rest
        self._command: Command | None = None
        self._due: deque[tuple[float, Command]] = deque()
        # One half of what encoders may be off by stays, and the other one is noise.
        self._bias = self._half * self._random.uniform(-1.0, 1.0, self._half.shape)
        self._was_off = self.is_off = False
        self._measure()

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Where it truly is, and how fast, in [rad] and [rad]/[s]. Shape (nv,) each."""
        return self._data.qpos.copy(), self._data.qvel.copy()

    @property
    def moves(self) -> bool:
        """Whether it is commanded to, or is faster than what is stated of an arm at rest."""
        is_fast = (np.abs(self._data.qvel) > self._stated[1]).any()
        return bool(np.abs(self._wanted[1]).max() > SLOWEST or is_fast)

    def take(self, command: Command, now: float) -> None:
        """Follow another command once it has arrived, `now` being when it was answered in [s]."""
        self._due.append((now + self._following.latency, command))
        self.steps_off += self._was_off
        self._was_off = False

    def advance(self, until: float) -> None:
        """Simulate a step of the controller, which ends at a time in [s]."""
        begin, data, model = until - STEP, self._data, self._robot.model
        while self._due and self._due[0][0] <= begin + 0.5 * STEP:
            self._command = self._due.popleft()[1]
            self._wanted = self._command.at(begin)
        (q, v), (aims, speeds, accels) = self.measured, self._wanted
        accels = accels + BANDWIDTH * (BANDWIDTH * (aims - q) + 2.0 * (speeds - v))
        torque = pinocchio.rnea(model, self._known, q, v, accels) + ARMATURE * accels
        data.qfrc_applied[:] = np.clip(torque, -self._torque_limit, self._torque_limit)
        mujoco.mj_step(self._model, data)
        self._measure()
        if self._command is not None:
            self._wanted = self._command.at(until)
        aims, speeds, _ = self._wanted
        for k, (seen, true, aim) in enumerate(
            zip(self.measured, (data.qpos, data.qvel), (aims, speeds), strict=True)
        ):
            np.maximum(self.seen[k], np.abs(seen - aim), out=self.seen[k])
            self._shares[k] = np.abs(true - aim) / self._stated[k]
        share = float(self._shares.max())
        self.share, self.is_off = max(self.share, share), not share <= 1.0
        self._was_off |= self.is_off
        self.leaves.place(*self.state)

    def find_gaps(self, ends: np.ndarray) -> np.ndarray:
        """Distance of its links' convex hulls from each body, at most `NEAR`, in [m]. Shape (9,).

        Args:
            ends: Of each body's axis, in [m]. Shape (9, 2, 3).
        """
        model, data = self._model, self._data
        mujoco.mj_kinematics(model, data)
        middles, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
        halves = 0.5 * np.linalg.norm(along, axis=1)
        apart = middles[:, None] - data.geom_xpos[self._links]
        sizes = self._extents + (RADII + halves)[:, None]
        gaps, laid = np.full(len(NAMES), NEAR), -1
        for body, link in np.argwhere((apart**2).sum(axis=2) < (sizes + NEAR) ** 2).tolist():
            geom = self._bodies[body]
            if body != laid:
                laid = body
                model.geom_size[geom, 1] = halves[body] + 1e-9
                data.geom_xpos[geom] = middles[body]
                mujoco.mju_quatZ2Vec(self._turn, along[body])
                mujoco.mju_quat2Mat(data.geom_xmat[geom], self._turn)
            gap = mujoco.mj_geomDistance(model, data, self._links[link], geom, NEAR, None)
            gaps[body] = min(gaps[body], gap)
        if self.moves:
            self.least_gap = min(self.least_gap, float(gaps.min()))
        return gaps

    def _measure(self) -> None:
        off = self._bias + self._half * (2.0 * self._random.random(self._half.shape) - 1.0)
        self.measured = self._data.qpos + off[0], self._data.qvel + off[1]
