"""Follows the commands of a shield if the robot accepts whole trajectories.

Each motion is sent at once, to its rest. So the arm comes to rest on the proved path even if all
processes are silent after that, this driver included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.drivers.arm import TrajectoryArm
from armguard.drivers.moment import Moment
from armguard.drivers.motion import APPROACH, MotionConduct
from armguard.drivers.obedience import Obedience
from armguard.drivers.session import Session
from armguard.messages.command import SAME_PLACE, CommandMessage

Array = NDArray[np.float64]


class TrajectoryConduct(MotionConduct):
    """Sends the commands of one shield as trajectories; see `Conduct`."""

    def __init__(self, arm: TrajectoryArm, session: Session) -> None:
        super().__init__(arm, session)
        self._sender = arm
        self._obedience = Obedience(session.options.validity)

    def act(self, moment: Moment) -> None:
        """Follow a motion, start a new one, or brake, and show the verdict."""
        super().act(moment)
        cause = moment.hindrance or self._obedience.decide(moment.verdict, moment.now).cause
        self._sender.report(moment.verdict if cause in ("", "STOP") else None, cause)

    def _find_excess(self, q: Array, now: float) -> Array:
        """None: the robot follows its trajectory in a pause as well."""
        return np.zeros(len(q))

    def _take_up(self, command: CommandMessage, order: NDArray[np.intp], moment: Moment) -> None:
        before = self._followed
        super()._take_up(command, order, moment)
        was_moving = before is not None and moment.now < before.valid_until
        is_off = bool((np.abs(self._offset) > SAME_PLACE).any())
        if command.moving or was_moving or is_off:
            offset = self._offset if is_off else np.zeros(len(order))
            since = moment.now - command.stamp
            self._sender.send(command.stamp, *make_points(command, order, offset, since))


def make_points(
    command: CommandMessage, order: NDArray[np.intp], offset: Array, since: float
) -> tuple[Array, Array, Array]:
    """Times, positions and velocities of a motion, for an arm that may be off it.

    An offset shrinks at `APPROACH`, joint by joint. Points are added where it ends, so the error of
    the cubic between two points is at most its decrease between them.

    Args:
        command: The motion.
        order: Columns of the robot's joints in its rows. Shape (nv,).
        offset: How far from the motion the robot's joints are, in [rad]. Shape (nv,).
        since: From when on the offset shrinks, in [s] from the command's stamp.

    Returns:
        In [s] from the command's stamp, [rad] and [rad/s], in the robot's order. Shapes (k,),
        (k, nv), (k, nv).
    """
    samples = command.read()
    if not offset.any():
        return samples.times, samples.q[:, order], samples.v[:, order]
    ends = since + np.abs(offset) / APPROACH
    times = np.union1d(samples.times, ends[ends > 0.0])
    q, v, _ = command.at(command.stamp + times)
    gone = APPROACH * np.maximum(times - since, 0.0)[:, None]
    # At its own end an offset is nothing, whatever rounding leaves of it: the arm must rest there.
    is_left = gone < np.abs(offset) - SAME_PLACE * APPROACH
    rest = np.where(is_left, offset - np.clip(offset, -gone, gone), 0.0)
    slope = -APPROACH * np.sign(rest) * (times >= since)[:, None]
    return times, q[:, order] + rest, v[:, order] + slope
