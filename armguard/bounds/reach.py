"""Workspace balls: the region of a link in every posture of the arm.

`armguard.bounds.levers` encloses all that a point can take in a solid of revolution about the first
revolute joint's axis; a ball with its centre on that axis contains the solid if it contains the
circles on which its outline's corners turn. Its centre is put at the height that needs the least
radius. Prismatic joints before that one move the ball along, by at most half their travel to
either side of the middle. Angle limits are not used, limits of travel are.

For a far obstacle this is the tightest bound: the arm stays in its ball for ever, so only the
obstacle moves.
"""

from __future__ import annotations

import numpy as np
import pinocchio

from armguard.bounds.checks import read_only
from armguard.bounds.levers import MOST_KEPT, bound_outlines, moving_joints
from armguard.bounds.limits import read_limits, refuse_beyond
from armguard.bounds.model import MotionModel, Question
from armguard.bounds.sums import sum_levers, widened_ranges
from armguard.cover.miniball import enclose_points
from armguard.jit.arrays import FloatArray
from armguard.jit.kept_results import keep_results
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.joints import is_prismatic
from armguard.robot.robot import Robot


class ReachMotion(MotionModel):
    """Balls that links cannot leave, in the world.

    A ball is a body that never moves: any contact kernel can use it with acceleration, speed and
    error 0, and with its radius in the contact distance.

    Attributes:
        link_balls: Centre and radius of a ball for each link, in [m], that contains all its
            spheres in every configuration. Shape (L, 4).
        arm_ball: Of a ball for the whole arm. Shape (4,).
    """

    def __init__(self, robot: Robot, base_placement: pinocchio.SE3 | None = None) -> None:
        """Compute the balls; about as long as the levers take.

        Args:
            robot: The arm.
            base_placement: Placement of the robot's base in the world; None: they coincide.

        Raises:
            RobotError: A limit of the robot is missing or unusable.
        """
        super().__init__(robot, base_placement)
        self._limits = read_limits(robot)
        balls = []
        for link in robot.links:
            tree = robot.cover.tree(link)
            leaves = tree.spheres[tree.child_count == 0]
            balls.append(self._enclose(robot.joint_index(link), leaves))
        self.link_balls = read_only(np.array(balls))
        self.arm_ball = read_only(_enclose_balls(self.link_balls))

    def _bound(self, question: Question) -> float:
        """How far the point can still go within its own ball, the same for every t."""
        robot = self._robot
        refuse_beyond(robot, self._limits, question.q, question.v)
        ball = self._enclose(question.joint, np.append(question.local, 0.0)[None])
        pinocchio.forwardKinematics(robot.model, self._data, question.q)
        place = self._base.act(self._data.oMi[question.joint].act(question.local))
        missing = float(self._base.rotation @ question.along @ (ball[:3] - place) + ball[3])
        error = float(sum_levers(question.lever, robot.position_error)[0])
        return missing + error + SUM_ROUNDING * float(np.abs(place).sum() + ball[3])

    def _enclose(self, joint: int, spheres: FloatArray) -> FloatArray:
        """A ball in the world for spheres that ride a joint, (n, 4) in its frame. Shape (4,)."""
        model = self._robot.model
        travel = widened_ranges(self._robot)
        finite = np.isfinite(travel).all(axis=1, keepdims=True)
        middle = np.where(finite, travel, 0.0).mean(axis=1)
        pinocchio.forwardKinematics(model, self._data, middle)
        chain = moving_joints(model, joint)
        turning = [number for number in chain if not is_prismatic(model, number)]
        if turning:
            outlines, axis = bound_outlines(model, joint, spheres[:, :3], travel)
            height, radius = _lowest_radius(outlines, spheres[:, 3])
            center = self._data.oMi[turning[0]].act(height * axis)
            sliding = chain[: chain.index(turning[0])]
        else:
            middle_of, _ = enclose_points(spheres[:, :3])
            distances = np.linalg.norm(spheres[:, :3] - middle_of, axis=1)
            radius = float((distances + spheres[:, 3]).max())
            center = self._data.oMi[joint].act(middle_of)
            sliding = chain
        radius += sum(0.5 * float(np.ptp(travel[model.idx_vs[number]])) for number in sliding)
        center = self._base.act(center)
        radius += SUM_ROUNDING * (radius + float(np.abs(center).sum()))
        return np.append(center, radius)


@keep_results(MOST_KEPT)
def _lowest_radius(outlines: FloatArray, radii: FloatArray) -> tuple[float, float]:
    """Height on the axis, and the radius there, of the smallest ball around spheres on outlines.

    Args:
        outlines: Corners of each sphere centre's outline: distance, height. Shape (n, k, 2).
        radii: Of the spheres. Shape (n,).
    """

    def radius(height: float) -> float:
        reach = np.hypot(outlines[..., 0], outlines[..., 1] - height)
        return float((reach + radii[:, None]).max())

    # The radius is convex in the height.
    low, high = float(outlines[..., 1].min()), float(outlines[..., 1].max())
    for _ in range(60):
        first, second = low + (high - low) / 3.0, high - (high - low) / 3.0
        if radius(first) <= radius(second):
            high = second
        else:
            low = first
    height = 0.5 * (low + high)
    return height, radius(height)


def _enclose_balls(balls: FloatArray) -> FloatArray:
    """A ball around all balls: the largest, grown just enough for each of the others in turn."""
    order = np.argsort(-balls[:, 3])
    ball: FloatArray = balls[order[0]].copy()
    for other in balls[order[1:]]:
        offset = other[:3] - ball[:3]
        distance = float(np.linalg.norm(offset))
        if distance + other[3] <= ball[3]:
            continue
        radius = 0.5 * (distance + other[3] + ball[3])
        ball[:3] += offset * ((radius - ball[3]) / distance)
        ball[3] = radius * (1.0 + SUM_ROUNDING) + SUM_ROUNDING * float(np.abs(ball[:3]).sum())
    # Each step rounds; what was inside before is measured once more.
    reaches = np.linalg.norm(balls[:, :3] - ball[:3], axis=1) + balls[:, 3]
    ball[3] = max(ball[3], float(reaches.max()) * (1.0 + SUM_ROUNDING))
    return ball
