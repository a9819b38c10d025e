"""Pairs of link and obstacle that are not watched, such as a table on which the arm stands.

They are ignored for the whole life of a monitor; `exemptions` are temporary.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.robot.robot import Robot

ANY = "*"

MOST_NAMED = 5
"""Ids of obstacles that are named beside a pattern that fits none of them."""


class IgnoredPair(NamedTuple):
    """One entry: links and obstacles that are not watched against each other."""

    link: str
    """Name of a link; "*" is any."""
    ids: str
    """Pattern of obstacle ids."""
    source: str | None
    """Whose obstacles alone are meant; None: those of all sources, and what never moves."""

    def fits(self, obstacle: str, source: str) -> bool:
        """Whether it means an obstacle of a source, whose name is empty where nothing moves it."""
        return fnmatchcase(obstacle, self.ids) and self.source in (None, source)

    @property
    def is_unmatched_until_seen(self) -> bool:
        """Whether it is most likely a mistake as long as no obstacle was seen that it fits."""
        return self.source is None and not _fits_all(self.ids)


class IgnoredPairs:
    """Pairs to ignore, as (link, pattern of obstacle ids) or (link, pattern, source).

    A pattern without a source that fits no obstacle is most likely misspelt, and what it was meant
    for is watched, or worse, not what is ignored: `unmatched` names it until an obstacle was seen
    that it fits. Obstacles that come later are acknowledged by naming the source that reports them;
    then theirs alone are ignored.

    Args:
        ignore: Such entries; the link "*" is any.
        robot: Whose links they name.
        sources: Names of the obstacles' sources.

    Attributes:
        unmatched: Patterns that have fitted no obstacle so far, and name no source.

    Raises:
        ArmguardError: An entry is malformed, names a link that is not watched or a source that does
            not exist, or leaves no pair that could ever be watched.
    """

    def __init__(
        self, ignore: Iterable[Sequence[str]], robot: Robot, sources: Sequence[str] = ()
    ) -> None:
        self._robot = robot
        if not isinstance(ignore, Iterable):
            raise ArmguardError("ignore", f"is {ignore!r}", expected="a list of pairs")
        self._entries = [self._read_entry(entry, sources) for entry in ignore]
        self._check_something_is_left(self._entries)
        self.unmatched = list(
            dict.fromkeys(entry.ids for entry in self._entries if entry.is_unmatched_until_seen)
        )

    @property
    def entries(self) -> tuple[tuple[str, ...], ...]:
        """What was given: link and pattern, with the source where one was named."""
        return tuple(
            (one.link, one.ids) if one.source is None else (one.link, one.ids, one.source)
            for one in self._entries
        )

    def watched_links(
        self, obstacle: str, source: str = "", links: Sequence[str] | None = None
    ) -> NDArray[np.bool_]:
        """Which links are watched against an obstacle. Shape (links,).

        What names a link that is detached waits for its return.

        Args:
            obstacle: Its id.
            source: Name of its source; empty for one that never moves.
            links: Of the arm, as it is laid out; None: those that the robot has now.
        """
        if self.unmatched:
            self.unmatched = [ids for ids in self.unmatched if not fnmatchcase(obstacle, ids)]
        ignored = {entry.link for entry in self._entries if entry.fits(obstacle, source)}
        links = self._robot.links if links is None else links
        return np.array([not ignored & {link, ANY} for link in links])

    def read_further(
        self, entry: object, sources: Sequence[str], others: Iterable[IgnoredPair] | None
    ) -> IgnoredPair:
        """One more entry, by the rules of the first ones, that is not kept.

        Args:
            entry: As in `ignore`.
            sources: Names of the obstacles' sources.
            others: Further ones, with which it must leave something to watch; None: it leaves
                enough by itself.

        Raises:
            ArmguardError: As for `ignore`.
        """
        read = self._read_entry(entry, sources)
        if others is not None:
            self._check_something_is_left([*self._entries, *others, read])
        return read

    def describe_unmatched(self, ids: Iterable[str]) -> str:
        """What to say of patterns that have fitted no obstacle.

        Args:
            ids: Of the obstacles that there are; empty ones do not count.
        """
        named: list[str] = []
        for name in ids:
            if name and len(named) == MOST_NAMED:
                named.append("…")
                break
            if name:
                named.append(name)
        there = f"there are {', '.join(named)}" if named else "there are no obstacles"
        return f"{there}; correct it, or name the source that will report it as third element"

    def _check_something_is_left(self, entries: Iterable[IgnoredPair]) -> None:
        """Refuse entries by which every link is ignored against every obstacle."""
        blind: set[str] = set()
        for entry in entries:
            if entry.source is None and _fits_all(entry.ids):
                blind.add(entry.link)
            if ANY in blind or blind >= set(self._robot.links):
                raise ArmguardError(
                    f"ignore: {[entry.link, entry.ids]}",
                    "leaves nothing to watch: each link is ignored against every obstacle",
                    expected="a pattern of the ids that the link may touch",
                    remedy="name those obstacles, or the source that reports them as third element",
                )

    def _read_entry(self, entry: object, sources: Sequence[str]) -> IgnoredPair:
        if not (
            isinstance(entry, (tuple, list))
            and len(entry) in (2, 3)
            and all(isinstance(part, str) for part in entry)
        ):
            raise ArmguardError(
                "ignore",
                f"holds {entry!r}",
                expected="pairs of a link and a pattern of obstacle ids, perhaps with a source",
            )
        link, ids, source = (*entry, None)[:3]
        if link not in (ANY, *self._robot.links):
            raise ArmguardError(
                f"ignore: link {link!r}",
                "is not watched",
                expected=f'one of {", ".join(self._robot.links)} or "{ANY}"',
            )
        if source is not None and source not in sources:
            raise ArmguardError(
                f"ignore: source {source!r}",
                "is none of the obstacles' sources",
                expected=f"one of {', '.join(sources)}"
                if sources
                else "a source, and there is none",
                remedy="name it in Obstacles(sources=…)",
            )
        return IgnoredPair(link, ids, source)


def _fits_all(ids: str) -> bool:
    """Whether a pattern fits every id there can be; none is empty."""
    return set(ids) <= {"*", "?"} and "*" in ids and ids.count("?") <= 1
