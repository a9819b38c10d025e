"""Covers of other fineness, each fitted when a setting first asks for it."""

from __future__ import annotations

from armguard.cover.cover import Cover
from armguard.exceptions import CoverError
from armguard.lab.tradeoff.ladder import Setting, takes_long
from armguard.robot.robot import Robot


class Covers:
    """The covers that the settings of a study ask for.

    Args:
        robot: Whose links.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._fitted: dict[float, Cover] = {}

    def choose(self, setting: Setting) -> Cover:
        """The cover of a setting.

        Raises:
            CoverError: It could not be fitted, or has no such level.
        """
        cover = self._robot.cover
        for rung in setting.rungs:
            if takes_long(rung, self._robot.cover):
                raise CoverError(
                    str(rung),
                    "would take many minutes to fit",
                    remedy="`armguard cover --protrusion` makes it, and a cell file names it",
                )
            if rung.protrusion is not None:
                if rung.protrusion not in self._fitted:
                    self._fitted[rung.protrusion] = Cover.fit(
                        self._robot, protrusion=rung.protrusion
                    )
                cover = self._fitted[rung.protrusion]
            if rung.level is not None:
                cover = cover.cut(rung.level)
        return cover
