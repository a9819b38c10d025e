"""The register of obstacle ids, and the monitor's view of the obstacle table.

It answers the queries of every tick without reading each row: the row of each id and source, silent
sources, refused samples, and added and removed rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ObstacleError
from armguard.jit.arrays import IntArray
from armguard.messages.events import FaultsTaken
from armguard.messages.incoming import Message
from armguard.messages.journal import Journal
from armguard.obstacles.faults import Fault, FaultQueue, Unplaced
from armguard.obstacles.possible_states import distrust, forget_expired, list_states
from armguard.obstacles.sources import NO_SOURCE, Source, Sources, SourceState, Tombstones
from armguard.obstacles.spread import describe_spread
from armguard.obstacles.table import ObstacleTable
from armguard.obstacles.tethers import TORN, Tether, Tie, tie

NO_ROWS: IntArray = np.zeros(0, dtype=np.int64)

SPREADS_TOLD = 8
"""Bodies with errors larger than stated that are named at once."""


class ResolvedIds(NamedTuple):
    """The ids of a message, and what follows from them alone."""

    names: list[str]
    rows: IntArray | None
    """Shape (n,); None: not found yet."""
    accel: ArrayLike
    """Bounds where the message has none, in [m/s²]. Shape () or (n,)."""
    speed: ArrayLike
    """Bounds where the message has none, in [m/s]. Shape () or (n,)."""
    regions: IntArray | None
    """Sets of regions by pattern, beside what the message states; None: no patterns. Shape (n,)."""


class ObstacleRegister:
    """Obstacles by id, row and source.

    Attributes:
        table: The arrays, by row; see `ObstacleTable`.
        ids: Id of each row; empty where the row is free.
        late_count: Number of late samples that were ignored.
        expects_sources: Whether unnamed sources are expected.
        watcher: Number of the scheduler that follows the rows; see `start_watching`.
        journal: Receives each call that changes the table; None: no journal. Copies have none.
    """

    journal: Journal | None = None

    def __init__(self, sources: Iterable[str | Source]) -> None:
        if isinstance(sources, str):
            raise ObstacleError("sources", f"is the string {sources!r}", expected="a list of names")
        self.table = ObstacleTable()
        self.ids: list[str] = [""] * len(self.table.alive)
        self.late_count = 0
        self.expects_sources = False
        self.watcher = 0
        self._sources = Sources(sources)
        self._rows: dict[int, dict[str, int]] = {NO_SOURCE: {}}
        self._resolved: dict[int, dict[tuple[int, str, bool], ResolvedIds]] = {}
        """By source, then by length, first id and whether voxels were taken: ids of its last
        messages with a row for each. Those of a source are void when one of its rows goes."""
        self._tombstones = Tombstones()
        self._faults = FaultQueue()
        self._unplaced = Unplaced()
        self._added: set[int] = set()
        self._removed: set[int] = set()
        self._newest = -math.inf
        self._any_refused = False
        self._newcomers: set[int] = set()
        """Rows of sources of which the next tick finds whether what is known is believable."""
        self._unbelieved: set[int] = set()
        """Rows of which nothing was believable in any tick so far."""
        self._tethers: dict[frozenset[str], Tether] = {}
        """By both ids."""
        self._tethered: frozenset[str] = frozenset()
        self._tied: list[tuple[Tether, int]] = []
        """Tethers between rows by their numbers, each with the number of its source."""
        self._broken: dict[tuple[Tether, int], tuple[float, float]] = {}
        """What was found of tethers that are broken, those included of which a row is gone."""
        self.is_tethered = False
        """Whether any rows are tethered: quicker to tell than all else that ticks ask of that."""
        self.has_new_tethers = False
        """Whether `tie_rows` has to be called: tethers or tethered rows came or went."""
        # Compiled here, on a row that has no state.
        distrust(self.table.handle, 0)
        forget_expired(self.table.handle, 0.0, 0.0)

    def __repr__(self) -> str:
        sources = ", ".join(self.source_names) or "no source"
        return f"{type(self).__name__}({len(self)} obstacles, {sources})"

    def __len__(self) -> int:
        return sum(map(len, self._rows.values()))

    def row(self, id: str, source: str | None = None) -> int:
        """Row of an obstacle; -1 if it is not in the table.

        Args:
            id: Its name.
            source: Source of the obstacle; "" for a static; None: any, statics and earlier sources
                first.
        """
        for rows in self._rows.values():
            if id in rows and source in (None, self.source_of(rows[id])):
                return rows[id]
        return -1

    def _rows_of(self, owner: int) -> dict[str, int]:
        """Rows by id of the source with this number."""
        rows = self._rows.get(owner)
        if rows is None:
            rows = self._rows[owner] = {}
        return rows

    def source_of(self, row: int) -> str:
        """Name of the source that a row belongs to; empty for a static obstacle."""
        owner = int(self.table.owner[row])
        return "" if owner == NO_SOURCE else self._sources.states[owner].source.name

    def count_of(self, source: str, also: Iterable[str] = ()) -> int:
        """Number of obstacles of a source, or the number including these ids."""
        state = self._sources.find(source)
        rows = {} if state is None else self._rows.get(state.index, {})
        return len(rows) + len(set(also).difference(rows))

    @property
    def tethers(self) -> tuple[Tether, ...]:
        """The stated tethers, in the order in which they were first stated."""
        return tuple(self._tethers.values())

    def _tether(self, pair: frozenset[str], tether: Tether | None) -> None:
        """State a tether between two ids, or end it; taken in by the next `tie_rows`."""
        if tether is None:
            del self._tethers[pair]
        else:
            self._tethers[pair] = tether
        self._tethered = frozenset().union(*self._tethers)
        self.has_new_tethers = True
        self.table.changes += 1

    def tie_rows(self) -> None:
        """Takes in which rows are tethered, after tethers or tethered obstacles came or went."""
        self.has_new_tethers = False
        tethers = self.table.tethers
        for number, one in enumerate(self._tied):
            self._broken.pop(one, None)
            if tethers.is_broken[number]:
                found = float(tethers.excess[number]), float(tethers.agrees_since[number])
                self._broken[one] = found
        stated = set(self._tethers.values())
        self._broken = {one: found for one, found in self._broken.items() if one[0] in stated}
        self._tied, ties = [], []
        for tether in self._tethers.values():
            for owner, rows in self._rows.items():
                if owner != NO_SOURCE and tether.a in rows and tether.b in rows:
                    one = tether, owner
                    self._tied.append(one)
                    ties.append(
                        Tie(rows[tether.a], rows[tether.b], tether.length, self._broken.get(one))
                    )
        self.table.make_room_for_tethers(len(ties))
        tie(self.table.tethers, ties, self.table.revision)
        self.is_tethered = bool(ties)

    @property
    def has_broken_tethers(self) -> bool:
        """Whether `describe_broken_tethers` would name any; quick, for every tick."""
        return self.table.tethers.numbers.item(TORN) > 0

    def describe_broken_tethers(self) -> list[tuple[str, str]]:
        """Tethers that the states of both obstacles contradict, with what was found in words."""
        tethers, told = self.table.tethers, []
        for number, (tether, _) in enumerate(self._tied):
            if tethers.is_broken[number]:
                found = f"{1e3 * tethers.excess[number]:.0f} mm"
                words = f"{found} farther apart than {tether.length:g} m ({tether.source})"
                told.append((f"{tether.a} and {tether.b}", words))
        return told

    def start_watching(self) -> int:
        """Counts every row in use as added, for a new watcher, and returns its number.

        Drained rows are not reported again: only the newest watcher gets all rows.
        """
        self.watcher += 1
        self._removed.clear()
        self._added = {row for rows in self._rows.values() for row in rows.values()}
        self.table.changes += 1
        return self.watcher

    @property
    def has_membership_changes(self) -> bool:
        """Whether `drain_membership` would name any row."""
        return bool(self._added or self._removed)

    def drain_membership(self) -> tuple[IntArray, IntArray]:
        """Rows that came into use and rows that lost their occupant since the last call.

        A row can be in both: it was given back and taken again. Shapes (a,) and (r,), ascending.
        """
        if not self._added and not self._removed:
            return NO_ROWS, NO_ROWS
        added = np.array(sorted(self._added), dtype=np.int64)
        removed = np.array(sorted(self._removed), dtype=np.int64)
        self._added.clear()
        self._removed.clear()
        return added, removed

    def membership_changes(self) -> IntArray:
        """Rows whose occupants came or went since `drain_membership` was called. Shape (c,)."""
        return np.array([*self._added, *self._removed], dtype=np.int64)

    def refused_rows(self) -> IntArray:
        """Rows of which refused samples may be true. Shape (r,)."""
        return np.flatnonzero(self.table.refused) if self._any_refused else NO_ROWS

    def forget_refused(self, now: float, lasting: float) -> None:
        """Drops refused samples that have been possible for long enough.

        Args:
            now: Time of the tick, in [s].
            lasting: How long they are possible, in [s]; see `possible_states.forget_expired`.
        """
        if self._any_refused:
            self._any_refused = forget_expired(self.table.handle, now, lasting)

    def rows_ahead(self, now: float, tolerance: float) -> IntArray:
        """Rows whose accepted stamp is more than `tolerance` [s] ahead of `now`. Shape (r,)."""
        if self._newest - now <= tolerance:
            return NO_ROWS
        table = self.table
        moving = table.alive & table.has_state & ~table.static
        self._newest = float(np.max(table.stamp, where=moving, initial=-math.inf))
        return np.flatnonzero(moving & ~(table.stamp - now <= tolerance))

    def distrust(self, row: int) -> None:
        """Turns a row's accepted state into a refused sample."""
        distrust(self.table.handle, int(row))
        self._any_refused = bool(self.table.refused.any())

    @property
    def source_states(self) -> list[SourceState]:
        """The state of each source, by its number; for observers."""
        return self._sources.states

    @property
    def source_names(self) -> list[str]:
        """Sources that were named or have sent, in order of appearance."""
        return [state.source.name for state in self._sources.states]

    @property
    def has_sources(self) -> bool:
        """Whether any source was named or has sent."""
        return bool(self._sources.states)

    @property
    def heard_sources(self) -> list[tuple[str, int, float, float | None]]:
        """Name of each source, its number of messages, newest stamp [s] and timeout [s].

        The stamp is -inf before the first message; without a timeout the monitor's own counts.
        """
        return [
            (state.source.name, state.messages, state.newest, state.source.timeout)
            for state in self._sources.states
        ]

    def silent_sources(self, now: float, default_timeout: float) -> list[str]:
        """Required sources that are silent for longer than their timeout, in [s]."""
        return [name for name, _ in self._sources.silent(now, default_timeout)]

    def describe_silent_sources(self, now: float, default_timeout: float) -> list[tuple[str, str]]:
        """The same, each with its silence in words."""
        return self._sources.silent(now, default_timeout)

    def ahead_sources(self, now: float, tolerance: float) -> list[tuple[str, float]]:
        """Sources whose last stamp is more than `tolerance` [s] ahead of `now`, and by how much.

        Removals with stamps so far ahead count as made now; otherwise they would hide their ids for
        ever.
        """
        if not self._tombstones.newest - now <= tolerance:
            self._tombstones.limit(now)
        return self._sources.ahead(now, tolerance)

    def quiet_until(self, default_timeout: float) -> float:
        """Earliest time at which a source can time out, in [s]."""
        return self._sources.quiet_until(default_timeout)

    def is_quiet(self, now: float, tolerance: float) -> bool:
        """Whether there is no fault at `now` in [s], apart from silence; quick, for every tick.

        No refused sample is possible, no obstacle is new, and `is_settled` is true.
        """
        return not (self._any_refused or self._newcomers) and self.is_settled(now, tolerance)

    def is_settled(self, now: float, tolerance: float) -> bool:
        """Whether there is nothing to report in a tick at `now` in [s].

        No faults to take, nothing unplaced, no source disbelieved, no stamp more than `tolerance`
        [s] ahead, and `quiet_until` as it was when asked last, or later.
        """
        sources = self._sources
        return (
            not (
                self._faults.waiting
                or sources.unsettled
                or sources.any_disbelieved
                or self._unplaced.some
            )
            and sources.newest - now <= tolerance
            and self._newest - now <= tolerance
            and self._tombstones.newest - now <= tolerance
        )

    def stops_on_refusal(self, row: int) -> bool:
        """Whether the source of a row requires a STOP for a refused sample."""
        owner = int(self.table.owner[row])
        return owner != NO_SOURCE and self._sources.states[owner].source.on_refusal == "stop"

    def disbelieved_sources(self) -> list[tuple[str, str]]:
        """Names of sources with mostly refused rows lately, with the figures in words."""
        if not self._sources.any_disbelieved:
            return []
        return [(one.source.name, one.describe_refusals()) for one in self._sources.disbelieved()]

    @property
    def has_wide_spreads(self) -> bool:
        """Whether `describe_spreads` would name any row; quick, for every tick."""
        return self.table.spreads.wide_count.item() > 0

    def describe_spreads(self) -> list[tuple[str, str]]:
        """Ids whose samples have larger errors than stated, with the figures in words.

        See `spread` for the method; at most `SPREADS_TOLD` are named.
        """
        spreads, told = self.table.spreads, []
        for row in np.flatnonzero(spreads.is_wide)[:SPREADS_TOLD].tolist():
            words = describe_spread(spreads, row, self.ids[row])
            told.append((self.ids[row], f"{self.source_of(row)}: {words}"))
        return told

    @property
    def is_untouched(self) -> bool:
        """Whether the table has received only statics, in rows in order."""
        table = self.table
        return (
            not any(state.heard for state in self._sources.states)
            and self.fault_count == 0
            and self._tombstones.newest == -math.inf
            and bool(table.static[table.alive].all())
            and table.is_compact
        )

    def unplaced(self) -> list[str]:
        """Reported obstacles without room in the table."""
        return self._unplaced.names()

    def take_faults(self) -> list[Fault]:
        """The faults since the last call, oldest first."""
        self._note(FaultsTaken())
        return self._faults.take()

    def _note(self, message: Message) -> None:
        """Give a message to the journal, if there is one."""
        if self.journal is not None:
            self.journal.note_message(message)

    def take_dropped_faults(self) -> int:
        """Number of faults that were dropped since the last call, because there were too many."""
        return self._faults.take_dropped()

    @property
    def fault_count(self) -> int:
        """Faults since construction, taken or not."""
        return self._faults.count

    def is_entrance(self, row: int) -> bool:
        """Whether a row is an entrance."""
        table = self.table
        return bool(table.static[row] and table.has_state[row] and table.speed[row] > 0.0)

    @property
    def entrance_rows(self) -> IntArray:
        """Rows of entrances. Shape (r,)."""
        table = self.table
        return np.flatnonzero(table.alive & table.static & (table.speed > 0.0))

    def _take_row(self, name: str, owner: int, stamp: float) -> int:
        """A row for an obstacle first seen at `stamp` [s]; -1 if there is no room."""
        row = self.table.take_row(owner)
        if row < 0:
            self._unplaced.add(name, owner, stamp)
            return row
        self._unplaced.discard(name, owner)
        self.ids.extend([""] * (len(self.table.alive) - len(self.ids)))
        self.ids[row] = name
        # Of one person are obstacles of one source whose ids are alike up to the last "/". An id
        # without one says of no other obstacle that it is the same person's.
        person, _, _ = name.rpartition("/")
        self.table.marks.person[row] = hash((owner, person or (name,)))
        self._rows_of(owner)[name] = row
        self._added.add(row)
        self.has_new_tethers = self.has_new_tethers or name in self._tethered
        if owner != NO_SOURCE:
            self._newcomers.add(row)
        self.table.changes += 1
        return row

    def _newest_of(self, row: int) -> float:
        """Latest stamp of what may be true of a row, in [s]; -inf of one that stands still.

        Of one that could be anywhere that of its source: what else was said of it is not kept. Nor
        does a stamp count that was found to be ahead of the clock, for nothing would be newer.
        """
        table = self.table
        if table.static[row]:
            return -math.inf
        stamps = [
            float(states.stamp[place])
            for states, place, _ in list_states(
                table.accepted, table.refused_states, table.marks, row, 0.0
            )
        ]
        newest = self._sources.states[int(table.owner[row])].newest
        return min(max(stamps, default=newest), newest)

    def _release(self, row: int, time: float | None) -> None:
        table = self.table
        owner = int(table.owner[row])
        name = self.ids[row]
        if owner != NO_SOURCE:
            if time is None:
                time = self._sources.states[owner].newest
                if table.has_state[row]:
                    time = max(time, float(table.stamp[row]))
            self._tombstones.add(name, time, owner)
        table.free_row(row)
        self.has_new_tethers = self.has_new_tethers or name in self._tethered
        del self._rows[owner][name]
        self._resolved.pop(owner, None)
        self.ids[row] = ""
        self._newcomers.discard(row)
        self._unbelieved.discard(row)
        # A row that came and went between two steps of the monitor was never there for it.
        if row in self._added:
            self._added.discard(row)
        else:
            self._removed.add(row)
        table.changes += 1
        if self._any_refused:
            self._any_refused = bool(table.refused.any())
