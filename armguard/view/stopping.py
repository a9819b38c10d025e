"""Computes the volume in which the arm can be until it is at rest, for the view."""

from __future__ import annotations

import msgspec
import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.bounds.braking import BrakingMotion
from armguard.exceptions import ArmguardError
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.robot.portable import RestoredRobot
from armguard.view.messages import FrameMessage, SceneMessage


class StoppingVolume:
    """Computes the balls that contain the arm until it is at rest, for one scene.

    Args:
        scene: The arm, and how it stops.

    Raises:
        ArmguardError: The scene does not say how the arm stops, or the arm cannot stop.
    """

    def __init__(self, scene: SceneMessage) -> None:
        rule = scene.stopping
        if rule is None:
            raise ArmguardError(
                "the stopping volume", "needs how the arm stops, which this monitor does not send"
            )
        try:
            robot = RestoredRobot(msgspec.json.decode(rule.robot))
        except msgspec.DecodeError as error:
            raise ArmguardError("the robot of the scene", str(error)) from error
        base = np.array(scene.base, dtype=np.float64).reshape(4, 4)
        limits = OperatingLimits(velocity=rule.velocity, acceleration=rule.acceleration)
        self._motion = BrakingMotion(
            robot,
            rule.reaction_time,
            pinocchio.SE3(base[:3, :3], base[:3, 3]),
            operating=LimitsInForce(robot, limits, rule.payload),
        )
        self._response_time = rule.response_time
        # Inner balls of the tree contain what its leaves do; to draw those says it all.
        self._leaves = np.concatenate(
            [robot.cover.tree(link).child_count == 0 for link in robot.links]
        )

    def compute(self, frame: FrameMessage) -> NDArray[np.float64]:
        """Centres and radii in the world, in [m], from this moment until rest. Shape (n, 4).

        Raises:
            ArmguardError: The arm cannot stop from the frame's joint state.
        """
        if len(frame.v) != len(frame.q):
            raise ArmguardError(
                "the stopping volume", "needs joint velocities, which this monitor does not send"
            )
        volume = self._motion.stopping_volume(
            frame.q, frame.v, max(frame.arm_age, 0.0), self._response_time
        )
        found: NDArray[np.float64] = volume[self._leaves]
        return found
