"""Plans in the order of an arm's joints and in the monitor's time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import MessageError, PlanMessage, to_rows, to_values
from armguard.streams.arm_names import ArmNames
from armguard.streams.intake import Intake
from armguard.streams.joint_order import JointOrder
from armguard.streams.requests import PlanRequest
from armguard.streams.stamp_clocks import HELD_UP, StampClock


class PlanReader:
    """Reads plans.

    Args:
        intake: Where faults are counted, and times.
        arms: The arms of the cell.
        clock: How joint states are stamped, and so plans.
    """

    def __init__(self, intake: Intake, arms: ArmNames, clock: StampClock) -> None:
        self._intake = intake
        self._arms = arms
        # Joint states may be measured before their stamps; a plan says where the arm will be.
        self._clock = clock._replace(latency=0.0)

    def read(self, message: PlanMessage, joints: JointOrder) -> PlanRequest:
        """A plan in the order of an arm's joints; what cannot be read is said, and counted.

        Args:
            message: The plan.
            joints: Of the arm that it is about; unless it is shared, that is the watched one.
        """
        names, count = message.names, len(message.names)
        try:
            if message.ask != "share" and message.arm != self._arms.watched:
                raise self._arms.refuse(message)
            order = joints.find(names)
            size = len(message.times)
            size = size // 8 if isinstance(message.times, bytes) else size
            times = to_values("times", message.times, size)
            q = to_rows("q", message.q, size, count)[:, order]
            v = to_rows("v", message.v, size, count)[:, order]
            fields = {"tracking_error": _read_errors(message, "tracking_error", order)}
            if message.velocity_tracking_error is not None:
                field = "velocity_tracking_error"
                fields[field] = _read_errors(message, field, order)
        except MessageError as error:
            self._intake.faults.add("malformed", "plans", message.number, str(error))
            return PlanRequest(message.ask, message.number, str(error))
        stamp, gap = self.translate(message.stamp)
        problem = ""
        if not gap <= HELD_UP:
            problem = self._intake.count_hold_up(gap, "plans", message.number)
        return PlanRequest(message.ask, message.number, problem, stamp, times, q, v, **fields)

    def translate(self, stamp: float) -> tuple[float, float]:
        """A time to come, which no latency has made old; as `StampTimes.translate`."""
        return self._intake.times.translate(stamp, self._clock)


def _read_errors(message: PlanMessage, field: str, order: NDArray[np.int64]) -> NDArray[np.float64]:
    """One tracking error a watched joint, whether there is one for all or one for each."""
    values, count = getattr(message, field), len(message.names)
    if isinstance(values, float):
        return np.full(len(order), values)
    return to_values(field, values, count)[order]
