"""Which pairs of link and obstacle nobody is to watch: a table that the arm stands on, say."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.robot import Robot

ANY = "*"


class IgnoredPairs:
    """Pairs to ignore, as (link, pattern of obstacle ids); the link "*" is any.

    Args:
        ignore: Such pairs.
        robot: Whose links they name.

    Raises:
        ArmguardError: A link that is not watched, or no pair of strings.
    """

    def __init__(self, ignore: Iterable[tuple[str, str]], robot: Robot) -> None:
        self._links = robot.links
        if not isinstance(ignore, Iterable):
            raise ArmguardError("ignore", f"is {ignore!r}", expected="a list of pairs")
        self._patterns = [_read_pair(pair, robot) for pair in ignore]

    def follow(self, robot: Robot) -> None:
        """Take the links that the robot has now; what names a detached one waits for its return."""
        self._links = robot.links

    def watched_links(self, obstacle: str) -> NDArray[np.bool_]:
        """Which links are watched against the obstacle of this id. Shape (links,)."""
        ignored = {link for link, ids in self._patterns if fnmatchcase(obstacle, ids)}
        return np.array([not ignored & {link, ANY} for link in self._links])


def _read_pair(pair: object, robot: Robot) -> tuple[str, str]:
    if not (
        isinstance(pair, (tuple, list))
        and len(pair) == 2
        and all(isinstance(part, str) for part in pair)
    ):
        raise ArmguardError(
            "ignore", f"holds {pair!r}", expected="pairs of a link and a pattern of obstacle ids"
        )
    link, ids = pair
    if link not in (ANY, *robot.links):
        raise ArmguardError(
            f"ignore: link {link!r}",
            "is not watched",
            expected=f'one of {", ".join(robot.links)} or "{ANY}"',
        )
    return link, ids
