"""Where an arm's joints are among the names of a message."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armguard.streams.messages import PACKED, JointsMessage, MessageError, to_values


class JointOrder:
    """Where an arm's joints are among the names of a message.

    Args:
        joints: Names of the joints, in the order of `q` and `v`.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._names: list[str] | None = None
        self._order: NDArray[np.int64] = np.zeros(0, np.int64)
        self._places = self._order

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
            self._order = np.array([names.index(joint) for joint in self._joints], np.int64)
            self._places = np.stack((self._order, self._order + len(names)))
            self._names = names
        return self._order

    def read(self, message: JointsMessage) -> NDArray[np.float64]:
        """Positions and velocities of a joint state, in [rad] or [m] and per [s]. Shape (2, nv).

        Raises:
            MessageError: A joint is missing or named twice, or numbers of values do not fit.
        """
        names, q, v = message.names, message.q, message.v
        self.find(names)
        count = len(names)
        if isinstance(q, bytes) and isinstance(v, bytes) and len(q) == len(v) == 8 * count:
            # In one go: what NumPy does at every call costs more than what it does here.
            values = np.frombuffer(q + v, PACKED)
        else:
            values = np.concatenate((to_values("q", q, count), to_values("v", v, count)))
        return values[self._places]
