"""Where an arm's joints are among the names of a message."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armguard.streams.messages import JointsMessage, MessageError, to_values


class JointOrder:
    """Where an arm's joints are among the names of a message.

    Args:
        joints: Names of the joints, in the order of `q` and `v`.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._names: list[str] | None = None
        self._order: NDArray[np.int64] = np.zeros(0, np.int64)

    def find(self, names: list[str]) -> NDArray[np.int64]:
        """Where each joint is in `names`; remembered, since senders keep their order. (nv,).

        Raises:
            MessageError: A joint is missing, or named twice.
        """
        if names != self._names:
            missing = [joint for joint in self._joints if names.count(joint) != 1]
            if missing:
                found = "named twice" if missing[0] in names else "missing"
                raise MessageError("names", f"without {missing[0]!r} ({found})", "each joint once")
            self._order = np.array([names.index(joint) for joint in self._joints])
            self._names = names
        return self._order

    def read(self, message: JointsMessage) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions and velocities of a joint state, in [rad] or [m] and per [s]. Shapes (nv,).

        Raises:
            MessageError: A joint is missing or named twice, or numbers of values do not fit.
        """
        order, count = self.find(message.names), len(message.names)
        q = to_values("q", message.q, count)[order]
        return q, to_values("v", message.v, count)[order]
