"""The arm as a watch over pairs sees it: placed, bounded, and laid out for compiled code.

Pairs of link and obstacle that are not to be watched (a table that the arm stands on, say) are
named by `IgnoredPairs`.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.bounds.arm import ArmMotion
from armguard.contact.earliest import Certificate
from armguard.exceptions import ArmguardError
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_distance import HullDistance
from armguard.pairs.proof import prove_pair
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot

ADVANCES = 8
"""Steps of conservative advancement per evaluation, unless the user says otherwise; nearly every
pair has converged by then."""


class WatchedArm:
    """Kinematics, motion models, hull distances and the tick's numbers of one arm.

    Args:
        robot: The arm.
        obstacles: The table.
        ignored: Pairs that are not watched.
        margin: Distance that counts as contact already, [m].
        reaction_time: From a STOP to braking torque, [s].
        base_placement: Of the robot's base in the world; None: at the origin.
        with_joints: Whether joint and braking bounds are used.
        with_plans: Whether plans are judged.
        by_distance: Whether pairs are ranked by distance over closing speed.
        in_force: What joints keep to while the arm works, shared; None: the robot's limits.
        advances: Steps of conservative advancement per evaluation.

    Attributes:
        links: Names of the links, as of the revision below.
        revision: Of the robot.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        ignored: IgnoredPairs,
        margin: float,
        reaction_time: float,
        base_placement: pinocchio.SE3 | None,
        *,
        with_joints: bool,
        with_plans: bool,
        by_distance: bool,
        in_force: LimitsInForce | None = None,
        advances: int = ADVANCES,
    ) -> None:
        # What is attached meanwhile, in another thread, does not reach the copy.
        robot = copy.copy(robot)
        self.revision = robot.revision
        self.links = robot.links
        self.obstacles = obstacles
        self._ignored = ignored
        self.kinematics = Kinematics(robot, base_placement)
        self.motion = ArmMotion(
            robot,
            reaction_time,
            base_placement,
            with_joints=with_joints,
            with_plans=with_plans,
            in_force=in_force,
        )
        self.state = TickState(
            self.kinematics,
            self.motion,
            obstacles,
            margin=margin,
            advances=advances,
            by_distance=by_distance,
        )
        ignored.follow(robot)
        self.hull_distance = HullDistance(robot, self.kinematics)
        # Compiled now: joints beyond their limits must not wait for it in their tick.
        self.follow_limits(np.zeros(len(robot.joints)))

    def follow_limits(self, v: NDArray[np.float64]) -> bool:
        """Widen the bounds if joints are measured faster than the limits in force, (nv,).

        Returns:
            Whether a bound grew, so that nothing that was proved before holds.
        """
        return self.motion.isotropic.update(v)

    def watched_links(self, row: int) -> NDArray[np.bool_]:
        """Which links are watched against the obstacle in `row`. Shape (links,)."""
        return self._ignored.watched_links(self.obstacles.ids[row], self.obstacles.source_of(row))

    def names(self, pair: int) -> tuple[str, str]:
        """Of the link and the obstacle of a pair, row × links + link."""
        row, link = divmod(pair, len(self.links))
        return self.links[link], self.obstacles.ids[row]

    def prove(self, pair: int, sphere: int) -> tuple[Certificate, dict[str, Any]] | None:
        """A certificate of one pair in this tick and what it is about; see `prove_pair`."""
        return prove_pair(self.state, sphere, pair // len(self.links))


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
        self._links = robot.links
        if not isinstance(ignore, Iterable):
            raise ArmguardError("ignore", f"is {ignore!r}", expected="a list of pairs")
        self._entries = [_read_entry(entry, robot, sources) for entry in ignore]
        self._check_something_is_left()
        self.unmatched = list(
            dict.fromkeys(
                entry.ids
                for entry in self._entries
                if entry.source is None and not _fits_all(entry.ids)
            )
        )

    @property
    def entries(self) -> tuple[tuple[str, ...], ...]:
        """What was given: link and pattern, with the source where one was named."""
        return tuple(
            (one.link, one.ids) if one.source is None else (one.link, one.ids, one.source)
            for one in self._entries
        )

    def follow(self, robot: Robot) -> None:
        """Take the links that the robot has now; what names a detached one waits for its return."""
        self._links = robot.links

    def watched_links(self, obstacle: str, source: str = "") -> NDArray[np.bool_]:
        """Which links are watched against an obstacle. Shape (links,).

        Args:
            obstacle: Its id.
            source: Name of its source; empty for one that never moves.
        """
        if self.unmatched:
            self.unmatched = [ids for ids in self.unmatched if not fnmatchcase(obstacle, ids)]
        ignored = {
            entry.link
            for entry in self._entries
            if fnmatchcase(obstacle, entry.ids) and entry.source in (None, source)
        }
        return np.array([not ignored & {link, ANY} for link in self._links])

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

    def _check_something_is_left(self) -> None:
        """Refuse entries by which every link is ignored against every obstacle."""
        blind: set[str] = set()
        for entry in self._entries:
            if entry.source is None and _fits_all(entry.ids):
                blind.add(entry.link)
            if ANY in blind or blind >= set(self._links):
                raise ArmguardError(
                    f"ignore: {[entry.link, entry.ids]}",
                    "leaves nothing to watch: each link is ignored against every obstacle",
                    expected="a pattern of the ids that the link may touch",
                    remedy="name those obstacles, or the source that reports them as third element",
                )


def _fits_all(ids: str) -> bool:
    """Whether a pattern fits every id there can be; none is empty."""
    return set(ids) <= {"*", "?"} and "*" in ids and ids.count("?") <= 1


def _read_entry(entry: object, robot: Robot, sources: Sequence[str]) -> IgnoredPair:
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
    if link not in (ANY, *robot.links):
        raise ArmguardError(
            f"ignore: link {link!r}",
            "is not watched",
            expected=f'one of {", ".join(robot.links)} or "{ANY}"',
        )
    if source is not None and source not in sources:
        raise ArmguardError(
            f"ignore: source {source!r}",
            "is none of the obstacles' sources",
            expected=f"one of {', '.join(sources)}" if sources else "a source, and there is none",
            remedy="name it in Obstacles(sources=…)",
        )
    return IgnoredPair(link, ids, source)
