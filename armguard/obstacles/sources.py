"""Sources of obstacle states: the last message of each, and times of removals of ids.

A source is required if it is named so, and every source is required after its first message: the
silence of a source that used to see people does not mean that the cell is empty.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal

from armguard.exceptions import ObstacleError
from armguard.obstacles.arguments import is_writable

MAXIMUM_SOURCES = 256
MAXIMUM_TOMBSTONES = 4096
NO_SOURCE = -1
"""Index of the owner of static obstacles."""

_LATEST = 1e300
"""Latest tenth of a second that is told from others: dividing a finite stamp may overflow."""

FEWEST_REFUSED = 5
"""Rows refused, or points dropped, within a second without which a source is believed, however few
others there are."""


@dataclass(frozen=True, slots=True)
class Source:
    """A source: a process that reports obstacles.

    Attributes:
        name: As in the `source` of its messages.
        timeout: Longest permitted silence, in [s]; None: the monitor's default.
        required: Whether silence before its first message is a STOP.
        on_refusal: Effect of a refused sample. "bound": the sample may be true, and counts with its
            bounds. "stop": STOP as long as it may be true.
        latency: Age of its data at arrival, in [s]. With `rate` it gives the usual age at the
            start, so that verdicts can name late data. It has no other effect.
        rate: Nominal rate of its messages, in [Hz]; None: unknown.
    """

    name: str
    timeout: float | None = None
    required: bool = True
    on_refusal: Literal["bound", "stop"] = "bound"
    latency: float = 0.0
    rate: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ObstacleError("source name", f"is {self.name!r}", expected="a non-empty string")
        if not is_writable(self.name):
            raise ObstacleError(
                "source name", f"is {self.name!r}", expected="text that UTF-8 can hold"
            )
        if self.timeout is not None and not 0.0 < self.timeout < math.inf:
            raise ObstacleError(
                f"source {self.name!r}",
                f"has a timeout of {self.timeout}",
                expected="a finite time above 0 in [s], or None",
            )
        if self.on_refusal not in ("bound", "stop"):
            raise ObstacleError(
                f"source {self.name!r}",
                f"has on_refusal {self.on_refusal!r}",
                expected='"bound" or "stop"',
            )
        if not 0.0 <= self.latency < math.inf:
            raise ObstacleError(
                f"source {self.name!r}",
                f"has a latency of {self.latency}",
                expected="a finite time in [s], at least 0",
            )
        if self.rate is not None and not 0.0 < self.rate < math.inf:
            raise ObstacleError(
                f"source {self.name!r}",
                f"has a rate of {self.rate}",
                expected="a finite rate above 0 in [Hz], or None",
            )


class RefusalCount:
    """How many rows of a source came in the last second of its stamps, and how many were refused.

    Counted by tenths of a second. Late rows count with the newest ones.

    Attributes:
        is_disbelieved: Whether more than half were refused, and at least `FEWEST_REFUSED`.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Restart, because the stamps so far were wrong."""
        self.is_disbelieved = False
        self._tenth, self._place = -math.inf, 0
        self._rows, self._refused = [0] * 10, [0] * 10
        self._all_rows = self._all_refused = 0

    def add(self, stamp: float, rows: int, refused: int) -> None:
        """Take in a message of so many rows, stamped in [s]."""
        tenth = stamp // 0.1
        if tenth > self._tenth:
            tenth = min(tenth, _LATEST)
            # What has stood in the places of the tenths since the last one is over.
            for before in range(int(min(tenth - self._tenth, 10.0))):
                place = int((tenth - before) % 10.0)
                self._rows[place] = self._refused[place] = 0
            self._tenth, self._place = tenth, int(tenth % 10.0)
            self._all_rows, self._all_refused = sum(self._rows), sum(self._refused)
        self._rows[self._place] += rows
        self._all_rows += rows
        if refused:
            self._refused[self._place] += refused
            self._all_refused += refused
        found = self._all_refused
        self.is_disbelieved = found >= FEWEST_REFUSED and 2 * found > self._all_rows

    @property
    def counts(self) -> tuple[int, int]:
        """How many were refused, and how many came."""
        return self._all_refused, self._all_rows


@dataclass(slots=True)
class SourceState:
    """State of a source.

    Attributes:
        source: As it was named, or as it introduced itself.
        index: Its number, in order of appearance.
        is_named: Whether it was named before its first message.
        heard: Whether it has ever sent a message.
        stamp: Of the last message received, in [s]; -inf before the first.
        newest: Latest of all such stamps, unless that was found to be ahead of the clock, in [s]:
            a late message does not make its source look silent.
        recent: How many of its rows were refused lately.
        points: How many points of its clouds could not be used lately.
        messages: How many have come so far.
    """

    source: Source
    index: int
    is_named: bool = False
    heard: bool = False
    stamp: float = -math.inf
    newest: float = -math.inf
    recent: RefusalCount = field(default_factory=RefusalCount)
    messages: int = 0
    points: RefusalCount = field(default_factory=RefusalCount)

    def describe_refusals(self) -> str:
        """How much was refused lately, in words."""
        if self.recent.is_disbelieved:
            refused, rows = self.recent.counts
            return f"{refused} of {rows} rows of a second were refused"
        refused, points = self.points.counts
        return f"{refused} of {points} points of a second could not be used"

    @property
    def required(self) -> bool:
        """Whether its silence counts."""
        return self.heard or self.source.required


class Sources:
    """All sources that were named or have sent, in order of appearance.

    Attributes:
        states: Of each of them.
        newest: Latest stamp of any message, in [s].
        unsettled: Whether `quiet_until` may be earlier than when it was asked last.
        any_disbelieved: Whether there is a source of which most rows were refused lately.
    """

    def __init__(self, sources: Iterable[str | Source]) -> None:
        self.newest = -math.inf
        self.unsettled = True
        self.any_disbelieved = False
        self.states: list[SourceState] = []
        self._by_name: dict[str, SourceState] = {}
        for item in sources:
            source = item if isinstance(item, Source) else Source(item)
            if source.name in self._by_name:
                raise ObstacleError(f"source {source.name!r}", "is named twice")
            self._add(source).is_named = True

    def find(self, name: str) -> SourceState | None:
        """State of a source; None if it was neither named nor has sent."""
        return self._by_name.get(name)

    def hear(self, name: str, stamp: float) -> SourceState:
        """Notes a message with this stamp, of a source known or new."""
        state = self._by_name.get(name) or self._add(Source(name))
        if not state.heard:
            self.unsettled = True
        if stamp > self.newest:
            self.newest = stamp
        if stamp > state.newest:
            state.newest = stamp
        state.heard = True
        state.messages += 1
        state.stamp = stamp
        return state

    def count(self, state: SourceState, stamp: float, rows: int, refused: int) -> None:
        """Note how many rows of a message were refused."""
        before = state.recent.is_disbelieved
        state.recent.add(stamp, rows, refused)
        if before or state.recent.is_disbelieved:
            self.any_disbelieved = bool(self.disbelieved())

    def count_points(self, state: SourceState, stamp: float, points: int, dropped: int) -> None:
        """Note how many points of a cloud could not be used; apart from rows, which are fewer."""
        before = state.points.is_disbelieved
        state.points.add(stamp, points, dropped)
        if before or state.points.is_disbelieved:
            self.any_disbelieved = bool(self.disbelieved())

    def check_room(self, name: str) -> None:
        """Raises where a new source of this name would be one too many."""
        if name not in self._by_name and len(self.states) >= MAXIMUM_SOURCES:
            raise ObstacleError(
                "source", f"{name!r} is one too many", expected=f"at most {MAXIMUM_SOURCES}"
            )

    def forget(self, state: SourceState) -> None:
        """Let an unnamed source count as one that has never sent, until it sends again."""
        state.source = replace(state.source, required=False)
        state.heard = False
        state.stamp = state.newest = -math.inf
        # What was refused of it is over as well: no newer message would tell.
        state.recent.restart()
        state.points.restart()
        self.any_disbelieved = bool(self.disbelieved())
        self.unsettled = True

    def silent(self, now: float, default_timeout: float) -> list[tuple[str, str]]:
        """Required sources that never sent or exceed their timeout, with their silence."""
        found = []
        for state in self.states:
            if state.required:
                timeout = state.source.timeout
                timeout = default_timeout if timeout is None else timeout
                if not now - state.newest <= timeout:
                    found.append((state.source.name, self._describe_silence(state, now, timeout)))
        return found

    def _describe_silence(self, state: SourceState, now: float, timeout: float) -> str:
        """How long a source has been silent, and which unnamed sources send, in words."""
        if state.heard:
            return f"newest stamp {now - state.newest:.3g} s old, expected at most {timeout:g} s"
        strangers = [repr(one.source.name) for one in self.states if one.heard and not one.is_named]
        told = f"nothing received, expected a message every {timeout:g} s or sooner"
        if strangers:
            told += f"; {', '.join(strangers[:3])} sends data, but was not named: a misspelling?"
        return told

    def disbelieved(self) -> list[SourceState]:
        """Sources with mostly refused rows or unusable points lately."""
        return [
            state
            for state in self.states
            if state.recent.is_disbelieved or state.points.is_disbelieved
        ]

    def quiet_until(self, default_timeout: float) -> float:
        """Time at which the first required source times out, in [s]."""
        self.unsettled = False
        ends = [
            state.newest
            + (default_timeout if state.source.timeout is None else state.source.timeout)
            for state in self.states
            if state.required
        ]
        return min(ends, default=math.inf)

    def ahead(self, now: float, tolerance: float) -> list[tuple[str, float]]:
        """Sources stamped more than `tolerance` [s] ahead of `now`, and by how much, in [s].

        A message with a stamp so far ahead counts as received now; otherwise its source could be
        silent for as long unnoticed.
        """
        for state in self.states:
            if not state.newest - now <= tolerance:
                state.newest = now
                state.recent.restart()
                state.points.restart()
                self.unsettled = True
        self.newest = max((state.stamp for state in self.states), default=-math.inf)
        self.any_disbelieved = bool(self.disbelieved())
        return [
            (state.source.name, state.stamp - now)
            for state in self.states
            if state.heard and not state.stamp - now <= tolerance
        ]

    def _add(self, source: Source) -> SourceState:
        state = SourceState(source, len(self.states))
        self.states.append(state)
        self._by_name[source.name] = state
        return state


class Tombstones:
    """When ids were removed, so that an older message does not revive them.

    Memory is bounded: the oldest tombstones are given up, and from then on their source may not
    introduce ids with stamps from before those removals.

    Attributes:
        newest: Latest stamp of any removal, in [s].
    """

    def __init__(self) -> None:
        self.newest = -math.inf
        self._stones: OrderedDict[tuple[int, str], float] = OrderedDict()
        self._floors: dict[int, float] = {}

    def add(self, name: str, stamp: float, source: int) -> None:
        """Notes that `name` of the source with this number was removed, at `stamp` [s]."""
        key = source, name
        stamp = max(stamp, self._stones.pop(key, stamp))
        self._stones[key] = stamp
        self.newest = max(self.newest, stamp)
        if len(self._stones) > MAXIMUM_TOMBSTONES:
            (owner, _), given_up = self._stones.popitem(last=False)
            self._floors[owner] = max(self._floors.get(owner, -math.inf), given_up)

    def covers(self, name: str, source: int, stamp: float) -> bool:
        """Whether `name` of this source was removed after `stamp`, in [s].

        What is told of the moment of a removal counts: an obstacle that is there is not gone.
        """
        return not stamp >= self._stones.get((source, name), -math.inf)

    def below_floor(self, source: int, stamp: float) -> bool:
        """Whether a source may no longer introduce ids at `stamp` [s]."""
        return bool(self._floors) and not stamp >= self._floors.get(source, -math.inf)

    def lift(self, name: str, source: int) -> None:
        """Forgets the tombstone of an id that has come back."""
        self._stones.pop((source, name), None)

    def limit(self, now: float) -> None:
        """Lets no tombstone lie ahead of `now` [s]: its stamp was wrong, and would hide an id."""
        for key, stamp in self._stones.items():
            self._stones[key] = min(stamp, now)
        for source, floor in self._floors.items():
            self._floors[source] = min(floor, now)
        self.newest = now
