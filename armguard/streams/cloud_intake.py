"""Clouds of points: without the arm's own points, handed to the table in the monitor's time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.messages.incoming import CloudMessage, MessageError, to_cloud, to_mask
from armguard.obstacles.clouds import VoxelCountError
from armguard.streams.intake import Intake
from armguard.streams.joint_intake import JointState
from armguard.streams.limits import LimitError
from armguard.streams.source_accounts import SourceAccounts
from armguard.streams.stamp_clocks import MONOTONIC, StampClock
from armguard.streams.widening import widen


class OwnPoints(NamedTuple):
    """How points of clouds that are the arm's are told from others."""

    find_others: Callable[[NDArray[np.float64], NDArray[np.float64], str], NDArray[np.bool_]]
    """Which of some points of shape (n, 3), in [m], are not the arm's; given its joint positions,
    in the order of the watched joints, and the name of the points' frame."""
    time_error: float
    """How far apart in time joint state and cloud may be for that, in [s]."""


class CloudIntake:
    """Takes clouds.

    Args:
        intake: The table, where faults are counted, and times.
        accounts: What sources may send.
        clocks: How sources stamp; those not named here, with the monotonic clock.
        bounds: Acceleration and speed of voxels that bring none and that no pattern of the table's
            fits, in [m/s²] and [m/s]; for sources without a clock.
        own_points: How points that are the arm's are told from others; None: no clouds are taken.
        past: Joint states of the last second or so.
    """

    def __init__(
        self,
        intake: Intake,
        accounts: SourceAccounts,
        clocks: Mapping[str, StampClock],
        bounds: tuple[float, float],
        own_points: OwnPoints | None,
        past: Iterable[JointState],
    ) -> None:
        self._intake = intake
        self._accounts = accounts
        self._clocks = clocks
        self._bounds = bounds
        self._own_points = own_points
        self._past = past
        if own_points is not None:
            intake.obstacles.prepare_clouds()

    def take(self, message: CloudMessage) -> None:
        """Tell the table of a cloud; what cannot be used is counted."""
        intake, source, sequence = self._intake, message.source, message.seq
        self._accounts.check_cloud(message, are_taken=self._own_points is not None)
        clock = self._clocks.get(source, MONOTONIC)
        stamp, gap = intake.times.translate(message.stamp, clock)
        window = clock.error + gap
        try:
            points = to_cloud("points", message.points)
            occupied = None
            if message.occupied is not None:
                occupied = to_mask("occupied", message.occupied, len(points))
        except MessageError as error:
            intake.tell_verdict(MessageError(error.field, error.value, error.expected, source))
            intake.faults.add("malformed", source, sequence, str(error))
            return
        named = {"stamp": message.stamp, "origin": message.origin, "points": points}
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
                limit=self._accounts.limits_of(source).obstacles,
            )
        except ArmguardError as error:
            kind = LimitError.kind if isinstance(error, VoxelCountError) else "refused"
            intake.faults.add(kind, source, sequence, str(error))

    def _widen(self, message: CloudMessage, window: float) -> float:
        """What points may be off by if their stamp may be too old by `window` [s], in [m]."""
        if not window > 0.0:
            return message.position_error
        fields: dict[str, Any] = {
            "position_error": message.position_error,
            "velocity_error": 0.0,
            "velocity": None,
            "accel": message.accel,
            "speed": message.speed,
        }
        widen(fields, window, *self._intake.obstacles.bounds.find(["voxel"], *self._bounds))
        return float(np.max(fields["position_error"]))

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
        problem = "no joint state has come; expected one, to tell the arm's points from others"
        # A camera takes some time to hand over what it saw: the arm was elsewhere then.
        state = min(self._past, key=lambda one: abs(one.stamp - stamp), default=None)
        if state is not None:
            apart = abs(state.stamp - stamp) + window
            if apart <= own.time_error:
                try:
                    return own.find_others(points, state.q, message.frame)
                except ArmguardError as error:
                    problem = str(error)
            else:
                problem = (
                    f"joint state is {apart:.3g} s away from the cloud, expected at most "
                    f"{own.time_error:.3g} s; the arm's points count as others"
                )
        self._intake.faults.add("arm not taken out", message.source, message.seq, problem)
        return None
