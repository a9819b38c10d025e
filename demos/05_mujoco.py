"""A MuJoCo simulation of an arm among moving bodies, supervised in its loop at 1 kHz.

Needs the extra `mujoco`. The arm follows a path among a swinging beam, a cart, a drone and a rock,
whose states come from the simulation. It obeys: it follows the speed scale, and brakes on STOP.
With `main(is_obeying=False)` the arm ignores the monitor. MuJoCo measures the distances between the
arm and the bodies; they pass through each other, so that contacts can be counted.
"""

from typing import NamedTuple

import mujoco
import numpy as np

import armguard
from armguard.bridges.mujoco import MujocoJoints, MujocoObstacles, add_arm
from armguard.lab.simulation import JointTrajectory, SimulatedArm

LEFT = [1.2, 0.2, 0.2, -1.8, 0.0, 2.0, 0.785]
RIGHT = [-1.2, 0.3, -0.2, -1.6, 0.0, 1.9, 0.785]  # [rad]
PERIOD = 0.001  # [s], of a tick and of a step of the simulation
CAMERA_TICKS, CHECK_TICKS = 10, 5  # bodies are reported at 100 Hz, distances measured at 200 Hz
BODIES = ["beam", "cart", "drone", "rock"]
STIFFNESS, DAMPING = 400.0, 40.0  # of the controller, 1/s² and 1/s


class Outcome(NamedTuple):
    """What happened, as MuJoCo saw it."""

    least_moving_distance: float
    """Between a body and the arm while the arm moved by itself, in [m]; below 0 they overlap."""
    path: float
    """How far joint 1 went, in [rad]."""
    levels: dict[str, int]
    """Ticks in each level."""


def make_model(robot: armguard.Robot) -> mujoco.MjModel:
    """The arm, and around it a body of each kind, that nothing but springs moves."""
    spec = mujoco.MjSpec()
    spec.option.timestep = PERIOD
    add_arm(spec, robot)
    kinds, turn, slide = mujoco.mjtGeom, mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    beam = spec.worldbody.add_body(name="beam", pos=[0.45, 0.0, 2.6], gravcomp=1.0)
    beam.add_joint(name="beam", type=turn, axis=[1.0, 0.0, 0.0], stiffness=30.0)
    beam.add_geom(
        name="beam", type=kinds.mjGEOM_CAPSULE, fromto=[0, 0, 0, 0, 0, -2.1], size=[0.1, 0, 0]
    )
    cart = spec.worldbody.add_body(name="cart", pos=[1.2, 0.0, 0.2])
    cart.add_joint(name="cart", type=slide, axis=[1.0, 0.0, 0.0], stiffness=10.0)
    cart.add_geom(name="cart", type=kinds.mjGEOM_CYLINDER, size=[0.2, 0.2, 0], mass=10.0)
    drone = spec.worldbody.add_body(name="drone", pos=[0.3, 0.9, 0.9], gravcomp=1.0)
    drone.add_joint(name="drone", type=slide, axis=[0.0, 1.0, 0.0], stiffness=2.0)
    drone.add_geom(name="drone", type=kinds.mjGEOM_SPHERE, size=[0.12, 0, 0], mass=1.0)
    corners = np.random.default_rng(0).normal(size=(20, 3)) * 0.08
    spec.add_mesh(name="rock", uservert=corners.ravel())
    rock = spec.worldbody.add_body(name="rock", pos=[0.2, -1.0, 0.5], gravcomp=1.0)
    rock.add_joint(name="rock", type=slide, axis=[0.0, 1.0, 0.0], stiffness=3.0)
    rock.add_geom(name="rock", type=kinds.mjGEOM_MESH, meshname="rock", mass=1.0)
    return spec.compile()


def main(duration: float = 20.0, is_obeying: bool = True) -> Outcome:
    """Simulate `duration` seconds; what MuJoCo saw."""
    robot = armguard.Robot.load("panda")
    model = make_model(robot)
    data = mujoco.MjData(model)
    joints, bodies = MujocoJoints(model, robot), MujocoObstacles(model, BODIES)
    limits = armguard.OperatingLimits.published(robot)
    # More than the springs can do: the rock is the fastest, at 1.0 m/s and 1.8 m/s².
    obstacles = armguard.Obstacles(accel=4.0, speed=1.6, sources=["mujoco"])
    monitor = armguard.Monitor(robot, obstacles, rate=1.0 / PERIOD, operating=limits)
    way = JointTrajectory(robot, [LEFT, RIGHT], speed_fraction=0.3, loop=True)
    arm = SimulatedArm(way, limits)  # what the controller wants
    dofs, moving = joints.dofs, [model.geom(name).id for name in bodies.ids]
    pairs = [(model.geom(link).id, geom) for link in robot.links for geom in moving]
    data.qpos[dofs] = LEFT
    for name, offset in {"beam": 0.7, "cart": 0.5, "drone": 0.6, "rock": -0.6}.items():
        data.joint(name).qpos[0] = offset  # [rad], [m]
    least, path, levels, level = np.inf, 0.0, {}, None
    for tick in range(round(duration / PERIOD)):
        if tick % CAMERA_TICKS == 0:
            bodies.publish(obstacles, data, data.time)
        verdict = monitor.step(data.time, *joints.read(data))
        levels[verdict.level.name] = levels.get(verdict.level.name, 0) + 1
        if verdict.level is not level:
            level = verdict.level
            print(f"{data.time:6.3f} s: {level.name:5} {verdict.obstacle or ''}")
        before = arm.v
        q, v = arm.step(PERIOD, verdict.speed_scale if is_obeying else 1.0)  # 0 on STOP: it brakes
        path += abs(v[0]) * PERIOD
        mujoco.mj_forward(model, data)
        if v.any() and tick % CHECK_TICKS == 0:
            measured = (mujoco.mj_geomDistance(model, data, *pair, 1.0, None) for pair in pairs)
            least = min(least, *measured)
        # Computed torque: the acceleration that is wanted, and springs to the wanted state.
        pull = STIFFNESS * (q - data.qpos[dofs]) + DAMPING * (v - data.qvel[dofs])
        wanted = np.zeros(model.nv)
        wanted[dofs] = (v - before) / PERIOD + pull
        force = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, force, wanted)
        data.qfrc_applied[dofs] = (force + data.qfrc_bias)[dofs]
        mujoco.mj_step(model, data)
    print(f"least distance while the arm moved: {1000 * least:.0f} mm; joint 1 went {path:.1f} rad")
    return Outcome(least, path, levels)


if __name__ == "__main__":
    main()
