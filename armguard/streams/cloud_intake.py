"""Processes point clouds: removes the arm's own points, and updates the table."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.messages.incoming import CloudMessage, count_rows, to_mask, to_rows
from armguard.streams.intake import Intake
from armguard.streams.joint_intake import JointState
from armguard.streams.obstacle_intake import widen
from armguard.streams.source_accounts import LimitError, SourceAccount


class OwnPoints(NamedTuple):
    """Removes the arm's own points from clouds."""

    find_others: Callable[
        [NDArray[np.float64], NDArray[np.float64], str, tuple[float, float, float]],
        NDArray[np.bool_],
    ]
    """Which of some points of shape (n, 3), in [m], are not the arm's; given its joint positions,
    in the order of the watched joints, the name of the points' frame, and where the rays begin in
    that frame, in [m]."""
    time_error: float
    """How far apart in time joint state and cloud may be for that, in [s]."""


class CloudIntake:
    """Processes clouds.

    Args:
        intake: The table, the fault log, and the clocks.
        bounds: Acceleration and speed of voxels that bring none and that no pattern of the table's
            fits, in [m/s²] and [m/s]; for sources without a clock.
        own_points: Removes the arm's own points; None: clouds are refused.
        past: Joint states of about the last second.
    """

    def __init__(
        self,
        intake: Intake,
        bounds: tuple[float, float],
        own_points: OwnPoints | None,
        past: Iterable[JointState],
    ) -> None:
        self._intake = intake
        self._bounds = bounds
        self._own_points = own_points
        self._past = past
        if own_points is not None:
            intake.obstacles.prepare_clouds()

    def take(self, message: CloudMessage, account: SourceAccount) -> None:
        """Update the table with a cloud; unusable parts are counted.

        Raises:
            MessageError: Its points are no rows of three, or its marks are not one a point.
            LimitError: It has too many points, or none is taken here.
        """
        intake, source, sequence = self._intake, message.source, message.seq
        self._check_size(message, account.limits.points)
        stamp, gap = intake.times.translate(message.stamp, account.clock)
        window = account.clock.error + gap
        points = to_rows("points", message.points, 3, of="coordinates")
        occupied = None
        if message.occupied is not None:
            occupied = to_mask("occupied", message.occupied, len(points))
        # Points without a place are usual, as holes of images: the table counts and tells them.
        named = {"stamp": message.stamp, "origin": message.origin}
        intake.check_finite(source, sequence, named)
        others = self._find_others(points, message, stamp, window)
        if others is not None:
            occupied = others if occupied is None else occupied & others
        try:
            intake.obstacles.update_cloud(
                source,
                stamp,
                points,
                message.origin,
                message.voxel,
                occupied=occupied,
                position_error=self._widen(message, window),
                accel=message.accel,
                speed=message.speed,
                frame=message.frame,
                snapshot=message.snapshot,
                limit=account.limits.obstacles,
            )
        except ArmguardError as error:
            intake.count_refused(error, source, sequence)

    def _check_size(self, message: CloudMessage, most: int) -> None:
        """Raise LimitError if a cloud has too many points, or none is taken here.

        How many voxels it makes is not known yet: the table counts them before it takes any.
        """
        points, problem = count_rows(message.points, 3), None
        if self._own_points is None:
            problem = "a cloud", "obstacles: clouds need [clouds] in the cell file"
        elif points > most:
            problem = f"one of {points} points", f"max_points, {most} at most"
        if problem is not None:
            raise LimitError("message", *problem, message.source, message.seq)

    def _widen(self, message: CloudMessage, window: float) -> float:
        """What points may be off by if their stamp may be too old by `window` [s], in [m]."""
        if not window > 0.0:
            return message.position_error
        accel, speed = self._intake.obstacles.bounds.find(["voxel"], *self._bounds)
        accel = accel if message.accel is None else message.accel
        speed = speed if message.speed is None else message.speed
        error, _ = widen(window, accel, speed, None, message.position_error, 0.0)
        return float(np.max(error))

    def _find_others(
        self, points: NDArray[np.float64], message: CloudMessage, stamp: float, window: float
    ) -> NDArray[np.bool_] | None:
        """Which points are not the arm's; None where it is not known where the arm was: all count.

        Args:
            points: Of the cloud, in [m]. Shape (n, 3).
            message: The cloud.
            stamp: When it was measured, in [s] of the monitor's time.
            window: What that may be off by, in [s].
        """
        own = self._own_points
        assert own is not None, "clouds are taken"
        if not len(points):
            return None
        problem = "no joint state has arrived; expected one, to remove the arm's own points"
        # A camera takes some time to hand over what it saw: the arm was elsewhere then.
        state = min(self._past, key=lambda one: abs(one.stamp - stamp), default=None)
        if state is not None:
            apart = abs(state.stamp - stamp) + window
            if apart <= own.time_error:
                try:
                    return own.find_others(points, state.q, message.frame, message.origin)
                except ArmguardError as error:
                    problem = str(error)
            else:
                problem = (
                    f"joint state is {apart:.3g} s away from the cloud, expected at most "
                    f"{own.time_error:.3g} s; the arm's points count as others"
                )
        self._intake.faults.add("arm not removed", message.source, message.seq, problem)
        return None
