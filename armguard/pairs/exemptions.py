"""Exemptions for wanted contact: pairs that are not watched until a time, or in a zone.

A pair is left out of a tick only where no contact in it could be unwanted before the arm rests: one
that is told to stop by the next verdict, in `horizon` seconds at the latest. Contact is wanted
before the exemption's time and, where it has a zone, in this. So a pair is left out of a tick at
`now` only if

- `now + horizon` is no later than that time, and
- the obstacle certainly stays in the zone from `now` to `now + horizon`, whatever it does within
  its bounds; where the arm touches it is then in the zone as well (`zone`).

Proof that a stop is in time. Let the arm touch such an obstacle, unwanted, at a time t: past the
time of the exemption, or where part of the obstacle is outside the zone. In any tick that left the
pair out, t was later than `now + horizon`. So in the first tick after the last one that did, an arm
that is told to stop rests before t; from that tick on the pair is watched as though it had never
been left out, none of its certificates being older, and the rule of all pairs holds: a tick that is
no STOP proves that a STOP in the next one is in time.

So a pair is watched again before the exemption's time: by as long as the arm takes to rest. An arm
whose stop nothing is known of has no horizon, and no pair is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import BoolArray, IntArray
from armguard.jit.numerics import TIME_ROUNDING
from armguard.messages.incoming import IgnoreMessage
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.ignored import ANY, IgnoredPair, IgnoredPairs
from armguard.pairs.zone import Zone, find_staying, read_zone

MOST = 64
"""Exemptions at once: each is asked about in every tick."""

_NO_ROWS: IntArray = np.zeros(0, dtype=np.int64)


class Exemption(NamedTuple):
    """One requested exemption."""

    number: int
    """By which it is ended; they count from 1."""
    pair: IgnoredPair
    until: float
    """When contact is not wanted any more, in [s] of the monitor's clock; inf: the zone decides."""
    zone: Zone | None
    """Where it is wanted; None: anywhere."""

    def __str__(self) -> str:
        link = "any link" if self.pair.link == ANY else self.pair.link
        ids = (
            self.pair.ids if self.pair.source is None else f"{self.pair.ids} of {self.pair.source}"
        )
        return f"{link} and {ids}"

    def to_message(self) -> IgnoreMessage:
        """The message that asks for it, without a token."""
        link, ids, source = self.pair
        return IgnoreMessage(
            self.number,
            "",
            link,
            ids,
            source,
            None if self.until == math.inf else self.until,
            None if self.zone is None else self.zone.points.tobytes(),
        )


class State(NamedTuple):
    """What an exemption does in a tick."""

    exemption: Exemption
    left_out: int
    """How many obstacles it leaves out."""
    detail: str
    """That, and why not others, in words."""


class Change(NamedTuple):
    """What was different in a tick from the one before."""

    rows: IntArray
    """Of obstacles whose pairs are others now. Shape (r,)."""
    ended: tuple[Exemption, ...]
    """Exemptions that are over."""
    lines: tuple[str, ...]
    """The same for people."""


NO_CHANGE = Change(_NO_ROWS, (), ())


class _Entry:
    """An exemption, and the obstacles that it is about."""

    def __init__(self, exemption: Exemption) -> None:
        self.exemption = exemption
        self.known: dict[int, tuple[str, str]] = {}
        """Id and source by row, of those that it fits."""
        self.rows = _NO_ROWS
        self.left_out: BoolArray = np.zeros(0, dtype=bool)
        """Whether each of these rows is. Shape (r,)."""
        self.grounds = False, False
        """Whether it is known how the arm stops, and that it rests before the exemption's time."""
        self.was_matched = not exemption.pair.is_unmatched_until_seen
        self.state = State(exemption, 0, "")


class Exemptions:
    """Pairs that are not watched for the time being.

    Args:
        obstacles: The table.
        ignored: The pairs that are never watched, whose rules are kept.
    """

    def __init__(self, obstacles: Obstacles, ignored: IgnoredPairs) -> None:
        self._obstacles = obstacles
        self._ignored = ignored
        self._entries: list[_Entry] = []
        self._ended: list[Exemption] = []
        """Those that ended since the last tick, which has to be told."""
        self._in_force: dict[int, frozenset[str]] = {}
        """Links that are left out, by row."""
        self._changes = -1
        self._is_new = False
        self.count = 0
        """How many there were so far."""
        self.states: tuple[State, ...] = ()
        """What each does, as of the last tick."""
        # Compiled here, on nothing.
        find_staying(
            obstacles.table.handle,
            np.zeros((0, 4)),
            _NO_ROWS,
            0.0,
            0.0,
            np.zeros(0, dtype=bool),
        )

    @property
    def is_idle(self) -> bool:
        """Whether there is nothing for a tick to do."""
        return not (self._entries or self._in_force or self._ended)

    @property
    def listed(self) -> tuple[Exemption, ...]:
        """Those that have not ended."""
        return tuple(entry.exemption for entry in self._entries)

    @property
    def unmatched(self) -> list[str]:
        """Patterns that have fitted no obstacle so far, and name no source."""
        return [one.exemption.pair.ids for one in self._entries if not one.was_matched]

    def add(
        self,
        link: object,
        ids: object,
        source: object = None,
        *,
        until: object = None,
        zone: object = None,
        now: float = -math.inf,
    ) -> Exemption:
        """Begin an exemption, with the next tick.

        Args:
            link: Name of a link; "*" is any.
            ids: Pattern of obstacle ids.
            source: Whose obstacles alone are meant; None: those of all sources, and statics.
            until: When contact is not wanted any more, in [s]; None: the zone decides.
            zone: Corners of the region where it is wanted, in [m]; None: anywhere.
            now: Time of the last tick, in [s].

        Raises:
            ArmguardError: Something of this is unusable; nothing has changed.
        """
        if until is None and zone is None:
            raise ArmguardError(
                "exemption",
                "has neither a time nor a zone",
                expected="until=… in [s], zone=…, or both",
                remedy="what is never to be watched is named in Monitor(ignore=…)",
            )
        if len(self._entries) >= MOST:
            raise ArmguardError(
                "exemption", f"is one more than {MOST}", expected="others to be ended before it"
            )
        time = math.inf if until is None else _read_time(until, now)
        region = None if zone is None else read_zone(zone)
        entry = (link, ids) if source is None else (link, ids, source)
        # One with a zone leaves all there is to watch outside of it.
        others = [one.exemption.pair for one in self._entries if one.exemption.zone is None]
        pair = self._ignored.read_further(
            entry, self._obstacles.source_names, others if region is None else None
        )
        self.count += 1
        added = _Entry(Exemption(self.count, pair, time, region))
        self._entries.append(added)
        ids_of_rows = self._obstacles.ids
        for row in np.flatnonzero(self._obstacles.table.alive).tolist():
            _match(added, row, ids_of_rows[row], self._obstacles.source_of(row))
        self._is_new = True
        return added.exemption

    def end(self, number: object) -> None:
        """End an exemption, with the next tick; harmless if it has ended.

        Raises:
            ArmguardError: There never was one of this number.
        """
        is_number = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
        if not (is_number and 1 <= number <= self.count):  # type: ignore[operator]  # a number
            raise ArmguardError(
                f"exemption {number!r}",
                "does not exist",
                expected=f"one of 1 to {self.count}" if self.count else "the number of one",
            )
        self._drop([one for one in self._entries if one.exemption.number == number])

    def reset(self) -> None:
        """End those that have a time: what comes now may be of another clock.

        All rows are inserted anew after it, so none is left out before the next tick says so.
        """
        self._drop([one for one in self._entries if one.exemption.until < math.inf])
        self.suspend()

    def suspend(self) -> IntArray:
        """Leave nothing out until the next tick; rows whose pairs are others now. Shape (r,)."""
        rows = self._find_alive(self._in_force)
        self._in_force = {}
        self._is_new = True
        return rows

    def leave_out(self, row: int, watched: NDArray[np.bool_], links: Iterable[str]) -> BoolArray:
        """Which of the watched links are watched against an obstacle for the time being.

        Called for each row that comes into use, which is when it is matched.

        Args:
            row: Of the obstacle.
            watched: Whether each link would be. Shape (links,).
            links: Their names.
        """
        if self._entries:
            name, source = self._obstacles.ids[row], self._obstacles.source_of(row)
            for entry in self._entries:
                _match(entry, row, name, source)
        left_out = self._in_force.get(row)
        if not left_out:
            return watched
        return watched & np.array([not left_out & {link, ANY} for link in links])

    def update(self, now: float, horizon: float) -> Change:
        """Decide, after the table's rows were followed, what is left out of a tick.

        Args:
            now: Time of the tick, in [s].
            horizon: Time by which the arm is at rest after a STOP by the next verdict, in [s]; inf
                if unknown.
        """
        over = [entry for entry in self._entries if not now < entry.exemption.until]
        self._drop(over)
        # A row that was given back, and perhaps taken again, is told by this number.
        is_changed = self._is_new or self._changes != self._obstacles.table.changes
        if is_changed:
            self._changes, self._is_new = self._obstacles.table.changes, False
            for entry in self._entries:
                self._follow_rows(entry)
        lines = [f"no longer exempt: {one}" for one in self._ended]
        for entry in self._entries:
            before, grounds, count = entry.left_out, entry.grounds, entry.state.left_out
            until = entry.exemption.until
            entry.grounds = horizon < math.inf, _rests_before(until, now, horizon)
            entry.left_out = self._find_left_out(entry, now, horizon)
            if is_changed or grounds != entry.grounds or not np.array_equal(before, entry.left_out):
                is_changed = True
                entry.state = _describe(entry)
                if (entry.state.left_out > 0) is not (count > 0):
                    word = "not watched" if entry.state.left_out else "watched again"
                    lines.append(f"{word}: {entry.exemption} ({entry.state.detail})")
        ended, self._ended = tuple(self._ended), []
        if not (is_changed or ended):
            return NO_CHANGE
        self.states = tuple(entry.state for entry in self._entries)
        in_force: dict[int, frozenset[str]] = {}
        for entry in self._entries:
            for row in entry.rows[entry.left_out].tolist():
                in_force[row] = in_force.get(row, frozenset()) | {entry.exemption.pair.link}
        before_this, self._in_force = self._in_force, in_force
        rows = self._find_alive(
            row
            for row in sorted({*before_this, *in_force})
            if before_this.get(row) != in_force.get(row)
        )
        return Change(rows, ended, tuple(lines))

    def _drop(self, entries: list[_Entry]) -> None:
        if entries:
            self._ended += [entry.exemption for entry in entries]
            self._entries = [entry for entry in self._entries if entry not in entries]
            self._is_new = True

    def _find_alive(self, rows: Iterable[int]) -> IntArray:
        alive = self._obstacles.table.alive
        return np.array([row for row in rows if alive[row]], dtype=np.int64)

    def _follow_rows(self, entry: _Entry) -> None:
        """Forget rows that have another occupant, or none."""
        ids, source_of = self._obstacles.ids, self._obstacles.source_of
        entry.known = {
            row: one
            for row, one in entry.known.items()
            if (ids[row], source_of(row)) == one and self._obstacles.table.alive[row]
        }
        entry.rows = np.array(sorted(entry.known), dtype=np.int64)

    def _find_left_out(self, entry: _Entry, now: float, horizon: float) -> BoolArray:
        left_out = np.zeros(len(entry.rows), dtype=bool)
        if not all(entry.grounds):
            return left_out
        if entry.exemption.zone is None:
            left_out[:] = True
        else:
            table, faces = self._obstacles.table.handle, entry.exemption.zone.faces
            find_staying(table, faces, entry.rows, now, horizon, left_out)
        return left_out


def _describe(entry: _Entry) -> State:
    """What an exemption does, by what was found for it."""
    exemption, fitting = entry.exemption, len(entry.rows)
    count = int(np.count_nonzero(entry.left_out))
    is_known, rests = entry.grounds
    if not fitting:
        detail = "no matching obstacle exists"
    elif not is_known:
        detail = "watched: the arm's stop time is unknown, or it may be on a plan"
    elif not rests:
        detail = f"watched: the arm might not rest before {exemption.until:.3f} s"
    else:
        some = "1 obstacle" if fitting == 1 else f"{fitting} obstacles"
        detail = f"{count} of {some}"
        detail += "" if exemption.zone is None else " in its zone"
        detail += "" if exemption.until == math.inf else f" until {exemption.until:.3f} s"
        if count < fitting:
            detail += "; what may leave the zone before the arm rests is watched"
    return State(exemption, count, detail)


def _match(entry: _Entry, row: int, name: str, source: str) -> None:
    """Note whether an exemption is about the obstacle that a row has now."""
    if entry.exemption.pair.fits(name, source):
        entry.known[row] = name, source
        entry.was_matched = True
    else:
        entry.known.pop(row, None)


def _rests_before(until: float, now: float, horizon: float) -> bool:
    """Whether an arm is at rest before a time after a STOP by the next verdict."""
    return horizon < math.inf and (now + horizon + TIME_ROUNDING * (abs(now) + horizon) <= until)


def _read_time(until: object, now: float) -> float:
    is_number = isinstance(until, (int, float, np.integer, np.floating))
    time = float(until) if is_number and not isinstance(until, bool) else math.nan  # type: ignore[arg-type]  # a number
    if not now < time < math.inf:
        since = f", later than {now:.3f} s" if math.isfinite(now) and now > -1e300 else ""
        raise ArmguardError(
            "until",
            f"is {until!r}",
            expected=f"a finite time in [s] of the monitor's clock{since}",
        )
    return time
