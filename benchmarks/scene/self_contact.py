"""Whether an arm goes through itself on its trajectory, as no real one can.

Random trajectories are not planned around the arm. Where two links overlap, a contact limit has
nothing to say: everything between them is clamped.
"""

from __future__ import annotations

import coal
import numpy as np
import pinocchio

from armguard.lab.simulation import JointTrajectory

NEXT = 3
"""Links with fewer joints between them are left out: their hulls overlap where they are joined."""
STEP = 0.05
"""Of the trajectory, in [s]."""


def meets_itself(trajectory: JointTrajectory, seconds: float) -> bool:
    """Whether two links overlap in that time, by their convex hulls.

    Args:
        trajectory: Of the arm.
        seconds: How much of it, in [s].
    """
    robot = trajectory.robot
    data = robot.model.createData()
    joints = [robot.joint_index(link) for link in robot.links]
    hulls = [_make_hull(robot.hull(link)) for link in robot.links]
    pairs = [
        (a, b)
        for b in range(len(joints))
        for a in range(b)
        if len({*robot.model.supports[joints[a]]} ^ {*robot.model.supports[joints[b]]}) >= NEXT
    ]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    for time in np.arange(0.0, seconds, STEP):
        pinocchio.forwardKinematics(robot.model, data, trajectory.sample(time)[0])
        places = [
            coal.Transform3s(data.oMi[joint].rotation.copy(), data.oMi[joint].translation.copy())
            for joint in joints
        ]
        for a, b in pairs:
            result.clear()
            if not coal.distance(hulls[a], places[a], hulls[b], places[b], request, result) > 0.0:
                return True
    return False


def _make_hull(vertices: np.ndarray) -> coal.Convex:
    points = coal.StdVec_Vec3s()
    points.extend(list(vertices))
    return coal.Convex.convexHull(points, True, "Qt")
