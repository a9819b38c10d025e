"""The arrays of the obstacle table.

A struct of arrays, one stable slot (row) for each obstacle, so that compiled loops read it as it
is. Beside its last accepted state each row keeps the samples that were refused lately, since each
may be true (`possible_states`). Rows whose states changed are listed, so that a scheduler evaluates
those alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.handle import pack
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.layout import make_records
from armguard.obstacles.broken_bounds import BODY_LIMITS, Breaks, make_breaks
from armguard.obstacles.spread import Spreads, forget_spread, make_spreads, resize_spreads
from armguard.obstacles.tethers import make_tethers, resize_tethers

MAXIMUM_POINTS = 8
MAXIMUM_ROWS = 2**18
"""Greatest number of rows. With all rows and refused states in use, this takes some 300 MB for
balls and 1.2 GB for boxes. An obstacle without a row is a lasting fault."""

TETHERS = 64
"""Tethers between rows for which there is room at first."""

MOST_REFUSED = 4
"""Greatest number of refused states in addition to the accepted one. After a further one that
agrees with none of them, the obstacle could be anywhere."""


class States(NamedTuple):
    """Measured states of bodies: hulls of up to eight points, rounded by a radius.

    There is room for as many points (`width`) as the body with the most has, in powers of two.
    """

    points: FloatArray
    """[m]. Shape (rows, width, 3)."""
    velocities: FloatArray
    """[m/s]. Shape (rows, width, 3)."""
    point_count: IntArray
    """Points in use. Shape (rows,)."""
    radius: FloatArray
    """[m]. Shape (rows,)."""
    accel: FloatArray
    """Bound on acceleration, [m/s²]. Shape (rows,)."""
    speed: FloatArray
    """Bound on speed, [m/s]. Shape (rows,)."""
    position_error: FloatArray
    """[m]. Shape (rows,)."""
    velocity_error: FloatArray
    """[m/s]. Shape (rows,)."""
    stamp: FloatArray
    """[s]. Shape (rows,)."""


class Marks(NamedTuple):
    """What is known about each row beside its states."""

    alive: BoolArray
    """In use. Shape (rows,)."""
    static: BoolArray
    """Never ages: it never moves, or it is an entrance, which has a speed. Shape (rows,)."""
    has_state: BoolArray
    """An accepted state exists. Shape (rows,)."""
    refused: BoolArray
    """Samples of it were refused and may be true. Shape (rows,)."""
    unknown: BoolArray
    """Some of those are unusable, so that it could be anywhere. Shape (rows,)."""
    touched: BoolArray
    """A link touches it, as is permitted, so that its motion is not its own. Shape (rows,)."""
    refused_count: IntArray
    """Refused states that can be, at most `MOST_REFUSED`. Shape (rows,)."""
    revision: IntArray
    """Goes up whenever what is known of it changes, a refused sample too. Shape (rows,)."""
    owner: IntArray
    """Number of the source that it belongs to. Shape (rows,)."""
    confirmations: IntArray
    """Consecutive samples beside the accepted track that confirm another one. Shape (rows,)."""
    regions: IntArray
    """Set of the regions of a body that were stated of it, see `regions`. Shape (rows,)."""
    person: IntArray
    """Stands for the person that it would be a part of, by its source and id. Shape (rows,)."""


class Refusals(NamedTuple):
    """Until when refused samples are possible; inf where no tick has seen them yet."""

    until: FloatArray
    """Of each refused state, [s]. Shape (rows × MOST_REFUSED,)."""
    covers_from: FloatArray
    """From when on a refused state covers all samples in its place, [s]; -inf: always. Alike."""
    is_undecided: BoolArray
    """Whether a state is of a body that may have broken its bounds. Alike."""
    unknown_until: FloatArray
    """Of what cannot be reckoned with, [s]. Shape (rows,)."""


class Told(NamedTuple):
    """The largest bounds that were told of each body lately; see `acceptance.TOLD_FOR`."""

    accel: FloatArray
    """Since `since`, [m/s²]. Shape (rows,)."""
    speed: FloatArray
    """Since `since`, [m/s]. Shape (rows,)."""
    accel_before: FloatArray
    """In the time of equal length before, [m/s²]. Shape (rows,)."""
    speed_before: FloatArray
    """In the time of equal length before, [m/s]. Shape (rows,)."""
    since: FloatArray
    """Stamp of a sample, [s]. Shape (rows,)."""


class ChangedRows(NamedTuple):
    """Rows that changed by more than their reference states allow, and were not read since."""

    changed: IntArray
    """Those rows, each once, in the order of their first change. Shape (rows,)."""
    is_changed: BoolArray
    """Whether a row is among them. Shape (rows,)."""
    changed_count: IntArray
    """How many entries of `changed` are in use. Shape (1,)."""


class Rows(NamedTuple):
    """All arrays of a table, as compiled code is handed them."""

    accepted: States
    """Accepted states."""
    refused: States
    """Refused ones that may be true, `MOST_REFUSED` places for each row; see `possible_states`."""
    candidates: States
    """Last refused samples, which may come to confirm another track."""
    marks: Marks
    refusals: Refusals
    told: Told
    breaks: Breaks
    body_limits: FloatArray
    """What no body does, by speed in [m/s] and by acceleration in [m/s²]. Shape (2,)."""
    changed_rows: ChangedRows
    reference_states: States
    """States that certificates rest on; without points where there are none."""
    spreads: Spreads


class ObstacleTable:
    """Rows of obstacles; the arrays are replaced by larger ones when rows or points need room.

    The fields of `States`, `Marks` and `ChangedRows` are attributes (`table.points`, `table.alive`,
    `table.changed`, …). All arrays together, as `Rows`, cross to compiled code as `table.handle`.
    """

    points: FloatArray
    velocities: FloatArray
    point_count: IntArray
    radius: FloatArray
    accel: FloatArray
    speed: FloatArray
    position_error: FloatArray
    velocity_error: FloatArray
    stamp: FloatArray
    alive: BoolArray
    static: BoolArray
    has_state: BoolArray
    refused: BoolArray
    unknown: BoolArray
    touched: BoolArray
    refused_count: IntArray
    revision: IntArray
    owner: IntArray
    confirmations: IntArray
    regions: IntArray
    person: IntArray
    changed: IntArray
    is_changed: BoolArray
    changed_count: IntArray
    handle: Any

    def __init__(self, capacity: int = 64) -> None:
        self.body_limits = np.array(BODY_LIMITS)
        self._free: list[int] = []
        nothing = np.zeros(0, dtype=np.int64)
        self.changed_rows = ChangedRows(
            nothing, np.zeros(0, dtype=bool), np.zeros(1, dtype=np.int64)
        )
        self.marks = Marks(*([np.zeros(0, dtype=bool)] * 6), *([np.zeros(0, dtype=np.int64)] * 6))
        self.refusals = Refusals(np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool), np.zeros(0))
        self._told = Told(*([np.zeros(0)] * 5))
        self.breaks = make_breaks()
        self.accepted = make_states(0)
        self.reference_states = make_states(0)
        """States that certificates rest on; without points where there are none."""
        self.changes = 0
        """Goes up after rows came or went, arrays were replaced, or a scheduler began to watch."""
        self.refused_states = make_states(0)
        """Refused samples that may be true, `MOST_REFUSED` places for each row."""
        self.candidates = make_states(0)
        self.spreads = make_spreads(2, 1)
        self.tethers = make_tethers(0, TETHERS)
        self._grow(capacity)
        # Both compile what they run.
        note_row(self.changed_rows, 0)
        forget_spread(self.spreads, 0)
        clear_changed_rows(self.changed_rows)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "handle"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        # Copied arrays lie each by itself, which is another type for compiled code.
        self._resize(len(self.alive), self.points.shape[1])

    def take_row(self, owner: int) -> int:
        """A row for a new obstacle of this source, without a state; -1 if there is no room."""
        if not self._free:
            capacity = len(self.alive)
            if capacity >= MAXIMUM_ROWS:
                return -1
            self._grow(2 * capacity)
        row = self._free.pop()
        for mark in (self.static, self.has_state, self.refused, self.unknown, self.touched):
            mark[row] = False
        self.alive[row] = True
        self.owner[row] = owner
        forget_spread(self.spreads, row)
        self.confirmations[row] = self.refused_count[row] = self.regions[row] = 0
        self._told.since[row] = self.breaks.until[row] = -np.inf
        self.breaks.further[row] = 0
        self.point_count[row] = 1
        self.reference_states.point_count[row] = 0
        self.revision[row] += 1
        note_row(self.changed_rows, row)
        return row

    def free_row(self, row: int) -> None:
        """Gives a row back."""
        self.alive[row] = self.has_state[row] = self.refused[row] = self.unknown[row] = False
        self.refused_count[row] = 0
        forget_spread(self.spreads, row)
        self._free.append(row)
        note_row(self.changed_rows, row)

    @property
    def is_compact(self) -> bool:
        """Whether rows are taken in order, as if none had ever been given back."""
        used = int(np.count_nonzero(self.alive))
        return self._free == list(range(len(self.alive) - 1, used - 1, -1))

    def place_static(self, row: int, points: FloatArray, radius: float) -> None:
        """Lets a row stand still for ever: points in [m] of shape (k, 3), radius in [m]."""
        self.widen(len(points))
        for array in self.accepted:
            array[row] = 0
        self.points[row, : len(points)] = points
        self.point_count[row] = len(points)
        self.radius[row] = radius
        self.static[row] = self.has_state[row] = True
        note_row(self.changed_rows, row)

    def place_entrance(
        self, row: int, points: FloatArray, radius: float, accel: float, speed: float
    ) -> None:
        """Lets bodies come out of a row at any moment: as `place_static`, in [m]/[s]² and [m]/[s].

        Their velocities may be any up to their speed, as of a body whose velocity is unknown.
        """
        self.place_static(row, points, radius)
        self.accel[row] = accel
        self.speed[row] = self.velocity_error[row] = speed

    def widen(self, points: int) -> None:
        """Makes room for bodies of so many points, at most `MAXIMUM_POINTS`."""
        width = 1 << (points - 1).bit_length()
        if width > self.points.shape[1]:
            self._resize(len(self.alive), width)

    def make_room_for_tethers(self, count: int) -> None:
        """Makes room for so many tethers between rows."""
        room = len(self.tethers.length)
        if count > room:
            self.tethers = resize_tethers(self.tethers, len(self.alive), max(count, 2 * room))
            self._resize(len(self.alive), self.points.shape[1])

    def _grow(self, capacity: int) -> None:
        first = len(self.marks.alive)
        self._free.extend(range(capacity - 1, first - 1, -1))
        self.marks = Marks(*(extend_rows(array, capacity) for array in self.marks))
        self._told = Told(*(extend_rows(array, capacity) for array in self._told))
        self.breaks = Breaks(*(extend_rows(array, capacity) for array in self.breaks))
        self.refusals = Refusals(
            extend_rows(self.refusals.until, capacity * MOST_REFUSED),
            extend_rows(self.refusals.covers_from, capacity * MOST_REFUSED),
            extend_rows(self.refusals.is_undecided, capacity * MOST_REFUSED),
            extend_rows(self.refusals.unknown_until, capacity),
        )
        changed, is_changed, changed_count = self.changed_rows
        self.changed_rows = ChangedRows(
            extend_rows(changed, capacity), extend_rows(is_changed, capacity), changed_count.copy()
        )
        self._resize(capacity, self.accepted.points.shape[1])

    def _resize(self, capacity: int, width: int) -> None:
        self.accepted = resize_states(self.accepted, capacity, width)
        self.reference_states = resize_states(self.reference_states, capacity, width)
        # Most rows never have a refused sample: what is not written takes no memory.
        aside = np.flatnonzero(self.marks.refused | (self.marks.confirmations > 0))
        self.candidates = resize_states(self.candidates, capacity, width, aside)
        places = (aside[:, None] * MOST_REFUSED + np.arange(MOST_REFUSED)).ravel()
        self.refused_states = resize_states(
            self.refused_states, capacity * MOST_REFUSED, width, places
        )
        self.spreads = resize_spreads(self.spreads, capacity, width)
        self.tethers = resize_tethers(self.tethers, capacity, len(self.tethers.length))
        for group in (self.accepted, self.marks, self.changed_rows):
            for name, array in group._asdict().items():
                setattr(self, name, array)
        self.handle = pack(
            Rows(
                self.accepted,
                self.refused_states,
                self.candidates,
                self.marks,
                self.refusals,
                self._told,
                self.breaks,
                self.body_limits,
                self.changed_rows,
                self.reference_states,
                self.spreads,
            )
        )
        self.changes += 1


@merged_kernel
def note_row(changed_rows: ChangedRows, row: int) -> None:
    """Enter a row among those that changed."""
    if not changed_rows.is_changed[row]:
        changed_rows.is_changed[row] = True
        changed_rows.changed[changed_rows.changed_count[0]] = row
        changed_rows.changed_count[0] += 1


@kernel
def clear_changed_rows(changed_rows: ChangedRows) -> None:
    """Let no row count as changed; takes as long as there are changed ones."""
    for i in range(changed_rows.changed_count[0]):
        changed_rows.is_changed[changed_rows.changed[i]] = False
    changed_rows.changed_count[0] = 0


@kernel
def copy_state(states: States, row: int, copied: States, place: int) -> None:
    """Copy one state to a place among others, which have room for as many points or more."""
    count = states.point_count[row]
    for k in range(count):
        for axis in range(3):
            copied.points[place, k, axis] = states.points[row, k, axis]
            copied.velocities[place, k, axis] = states.velocities[row, k, axis]
    copied.point_count[place] = count
    copied.radius[place] = states.radius[row]
    copied.accel[place] = states.accel[row]
    copied.speed[place] = states.speed[row]
    copied.position_error[place] = states.position_error[row]
    copied.velocity_error[place] = states.velocity_error[row]
    copied.stamp[place] = states.stamp[row]


def make_states(rows: int, width: int = 1) -> States:
    """Room for so many states of at most `width` points; as yet, they have none."""
    fields: dict[str, tuple[type, tuple[int, ...]]] = dict.fromkeys(States._fields, (float, ()))
    fields |= {"points": (float, (width, 3)), "velocities": (float, (width, 3))}
    return States(*make_records(rows, **(fields | {"point_count": (int, ())})))


def resize_states(states: States, rows: int, width: int, kept: IntArray | None = None) -> States:
    """The states with more rows, or room for more points.

    Args:
        states: What is copied.
        rows: How many there are to be, at least as many as there are.
        width: Points that each has room for, at least as many as now.
        kept: Rows whose states matter; None: all. The others become states without points.
    """
    resized = make_states(rows, width)
    known = slice(len(states.stamp)) if kept is None else kept
    for before, after in zip(states, resized, strict=True):
        if before.ndim > 1:
            after[known, : before.shape[1]] = before[known]
        else:
            after[known] = before[known]
    return resized


def extend_rows(array: NDArray[Any], rows: int) -> NDArray[Any]:
    """The array with more rows, of zeros; what is not written to takes no memory."""
    longer = np.zeros((rows, *array.shape[1:]), dtype=array.dtype)
    longer[: len(array)] = array
    return longer
