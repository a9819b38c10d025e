"""Covers of other fineness, fitted once for each geometry and kept for the next study."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from armguard.cover.cover import Cover
from armguard.exceptions import CoverError
from armguard.lab.tradeoff.ladder import Setting, takes_long
from armguard.robot.robot import Robot


def cache_directory() -> Path:
    """Where fitted covers are kept: `$XDG_CACHE_HOME/armguard/covers`, or below `~/.cache`."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    return Path(root) / "armguard" / "covers"


def fit_cover(robot: Robot, protrusion: float, directory: Path | None = None) -> Cover:
    """A cover whose spheres stick out by no more, from the cache if it was fitted before.

    What comes from the cache is proved again: a file there is worth no more than any other.

    Args:
        robot: Whose links.
        protrusion: [m].
        directory: Of the cache; None: the user's.

    Raises:
        CoverError: No cover could be proved.
    """
    digests = "".join(robot.cover.digest(link) for link in robot.links)
    key = hashlib.sha256(f"{digests} {protrusion!r}".encode()).hexdigest()[:16]
    file = (directory or cache_directory()) / f"{robot.name}-{1e3 * protrusion:g}mm-{key}.json"
    if file.is_file():
        with contextlib.suppress(CoverError):
            cover = Cover.load(file)
            cover.prove(robot, str(file))
            return cover
    cover = Cover.fit(robot, protrusion=protrusion)
    with contextlib.suppress(OSError):  # without a cache it is fitted again the next time
        file.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(dir=file.parent)
        os.close(descriptor)
        cover.save(name)
        Path(name).replace(file)
    return cover


class Covers:
    """The covers that the settings of a study ask for, made when they are first asked for.

    Args:
        robot: Whose links.
        fit: What fits one; `fit_cover` unless it is another.
    """

    def __init__(self, robot: Robot, fit: Callable[[Robot, float], Cover] = fit_cover) -> None:
        self._robot, self._fit = robot, fit
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
                    self._fitted[rung.protrusion] = self._fit(self._robot, rung.protrusion)
                cover = self._fitted[rung.protrusion]
            if rung.level is not None:
                cover = cover.cut(rung.level)
        return cover
