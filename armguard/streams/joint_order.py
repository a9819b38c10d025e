"""Where an arm's joints are among the names of a message."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import PACKED, JointsMessage, MessageError, to_values


class JointOrder:
    """Where an arm's joints are among the names of a message.

    Args:
        joints: Names of the joints, in the order of `q` and `v`.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._names: list[str] | None = None
        self._order: NDArray[np.int64] = np.zeros(0, np.int64)
        self._is_own_order = False

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
            self._is_own_order = names == self._joints
            self._names = names
        return self._order

    def read(self, message: JointsMessage) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions and velocities of a joint state, in [rad] or [m] and per [s]. Shapes (nv,).

        Raises:
            MessageError: A joint is missing or named twice, or numbers of values do not fit.
        """
        names, q, v = message.names, message.q, message.v
        order = self._order if names == self._names else self.find(names)
        if self._is_own_order and isinstance(q, bytes) and isinstance(v, bytes):
            size = 8 * len(names)
            if len(q) == size == len(v):
                # Most senders write them so, and every call of NumPy costs as much as all else.
                return np.frombuffer(bytearray(q), PACKED), np.frombuffer(bytearray(v), PACKED)
        count = len(names)
        return to_values("q", q, count)[order], to_values("v", v, count)[order]
