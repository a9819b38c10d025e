"""Arms that are prepared in advance, so that attaching a body does not delay a tick.

Preparing an arm takes some 100 ms, mostly for bounds that hold in all postures. They do not depend
on the tick, so they are computed before a body is attached, and kept after it is detached, since it
may be attached again.
"""

from __future__ import annotations

from collections.abc import Callable

from armguard.pairs.arm import WatchedArm
from armguard.robot.robot import Robot

MOST = 16
"""Arms that are kept; of more, the one that was put by first is forgotten."""


class Layouts:
    """Arms for what a robot may come to be.

    Args:
        make_arm: Lays out an arm.
    """

    def __init__(self, make_arm: Callable[[Robot], WatchedArm]) -> None:
        self._make_arm = make_arm
        self._kept: list[WatchedArm] = []

    def prepare(self, robot: Robot) -> WatchedArm:
        """The arm for a robot as it may come to be, laid out now unless it was."""
        for arm in self._kept:
            if arm.fits(robot):
                return arm
        arm = self._make_arm(robot)
        self.keep(arm)
        return arm

    def keep(self, arm: WatchedArm) -> None:
        """Put an arm by that may be needed again."""
        self._kept = [*self._kept, arm][-MOST:]

    def find(self, robot: Robot) -> tuple[WatchedArm, bool]:
        """The arm for a robot as it is, and whether it was laid out ahead."""
        for arm in self._kept:
            if arm.fits(robot):
                self._kept = [one for one in self._kept if one is not arm]
                arm.take_over(robot)
                return arm, True
        return self._make_arm(robot), False
