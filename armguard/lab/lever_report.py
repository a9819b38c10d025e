"""How tight proved levers are: each beside the largest that random configurations show.

A lever of `levers` is proved over all configurations, and revolute joints turn without limits in
that proof. What is sampled here is below the truth, and stays within the position limits; the ratio
of the two says how much is lost between them. It is for people: no bound rests on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio

from armguard.bounds.levers import bound_levers, moving_joints
from armguard.cover.cover import Cover
from armguard.jit.arrays import FloatArray
from armguard.robot.joints import is_prismatic
from armguard.robot.robot import Robot

SAMPLES = 1000


@dataclass(frozen=True)
class JointLevers:
    """The levers of one revolute joint over the spheres that it moves."""

    proved: float
    """No centre gets farther from the joint's axis than this, in [m]."""
    sampled: float
    """How far one of them was seen to get, in [m]."""
    ratio: float
    """Median over the spheres of what is proved for one to what was seen of it; at least 1."""


def compare_levers(robot: Robot, cover: Cover, samples: int = SAMPLES) -> dict[str, JointLevers]:
    """Proved and sampled levers, by joint; prismatic ones, whose lever is 1, are left out.

    Args:
        robot: Whose joints.
        cover: Its spheres, of which the finest level is taken.
        samples: How many configurations are drawn; the same at every call.
    """
    turns, places = _draw_placements(robot, samples)
    travel = np.column_stack([robot.lower_position_limit, robot.upper_position_limit])
    proved: dict[str, list[FloatArray]] = {}
    seen: dict[str, list[FloatArray]] = {}
    for link in robot.links:
        number, centers = robot.joint_index(link), cover.spheres(link)[:, :3]
        bounds = bound_levers(robot.model, number, centers, travel)
        world = np.einsum("sij,kj->ski", turns[:, number], centers) + places[:, None, number]
        for joint in moving_joints(robot.model, number):
            if is_prismatic(robot.model, joint):
                continue
            axis = robot.model.joints[joint].createData().S[3:].ravel()
            offsets = world - places[:, None, joint]
            across = np.cross(offsets, (turns[:, joint] @ axis)[:, None])
            name = str(robot.model.names[joint])
            proved.setdefault(name, []).append(bounds[:, robot.model.idx_vs[joint]])
            seen.setdefault(name, []).append(np.linalg.norm(across, axis=2).max(axis=0))
    levers = {}
    for name in robot.joints:
        if name in proved:
            bound, sampled = np.concatenate(proved[name]), np.concatenate(seen[name])
            ratios = bound[sampled > 0.0] / sampled[sampled > 0.0]
            ratio = float(np.median(ratios)) if len(ratios) else 1.0
            levers[name] = JointLevers(float(bound.max()), float(sampled.max()), ratio)
    return levers


def _draw_placements(robot: Robot, samples: int) -> tuple[FloatArray, FloatArray]:
    """Rotations (samples, joints, 3, 3) and translations (samples, joints, 3) of all joints."""
    random, data = np.random.default_rng(0), robot.model.createData()
    lower = np.where(np.isfinite(robot.lower_position_limit), robot.lower_position_limit, -np.pi)
    upper = np.where(np.isfinite(robot.upper_position_limit), robot.upper_position_limit, np.pi)
    turns = np.empty((samples, robot.model.njoints, 3, 3))
    places = np.empty((samples, robot.model.njoints, 3))
    for sample in range(samples):
        pinocchio.forwardKinematics(robot.model, data, random.uniform(lower, upper))
        for joint in range(robot.model.njoints):
            turns[sample, joint] = data.oMi[joint].rotation
            places[sample, joint] = data.oMi[joint].translation
    return turns, places
