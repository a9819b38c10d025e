"""Obstacles as their sources report them: states, ages, errors and bounds, by id.

`Obstacles` is what perception talks to and the monitor reads. Good rows are taken, implausible
ones refused without an exception and left as faults for the next step; obstacles that are not
seen stay, and grow with their bounds. The arrays are in `table`, the rule that takes or
refuses a sample in `acceptance`, what the monitor asks in `register`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import repeat

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ObstacleError
from armguard.jit import numerics
from armguard.jit.arrays import IntArray
from armguard.jit.handle import machine_code
from armguard.obstacles import acceptance as rule
from armguard.obstacles.arguments import (
    read_bound,
    read_field,
    read_ids,
    read_points,
    read_samples,
    read_time,
    show,
)
from armguard.obstacles.faults import Fault, FaultKind
from armguard.obstacles.frames import Frame
from armguard.obstacles.journal import ObstacleSettings
from armguard.obstacles.pattern_bounds import PatternBounds
from armguard.obstacles.register import NO_ROWS, ObstacleRegister
from armguard.obstacles.sources import NO_SOURCE, Source, SourceState
from armguard.obstacles.table import Samples

__all__ = ["Fault", "FaultKind", "Frame", "Obstacles", "Source"]

WORLD = "world"

_KINDS = {
    numerics.POSITION_BY_ACCEL: (FaultKind.BEYOND_ACCEL, "position"),
    numerics.POSITION_BY_SPEED: (FaultKind.BEYOND_SPEED, "position"),
    numerics.VELOCITY_BY_ACCEL: (FaultKind.BEYOND_ACCEL, "velocity"),
    numerics.VELOCITY_BY_SPEED: (FaultKind.BEYOND_SPEED, "velocity"),
    numerics.SHAPE: (FaultKind.SHAPE_CHANGED, "position"),
    rule.TOO_FAST: (FaultKind.BEYOND_SPEED, "velocity"),
    rule.TOO_FAR: (FaultKind.BEYOND_EXTENT, "position"),
    rule.TRACK_CHANGED: (FaultKind.TRACK_CHANGED, "position"),
}
for _field, _name in enumerate(rule.FIELDS):
    _KINDS[rule.NOT_FINITE + _field] = (FaultKind.NOT_FINITE, _name)
    _KINDS[rule.NEGATIVE + _field] = (FaultKind.NEGATIVE, _name)
    _KINDS[rule.TOO_LARGE + _field] = (FaultKind.BOUND_TOO_LARGE, _name)


class Obstacles(ObstacleRegister):
    """The table of obstacles, as sources and applications write to it.

    It belongs to the thread of the monitor that watches it. Another thread hands over what it has
    measured, by a queue or a stream, and this one writes it to the table between two steps.
    """

    def __init__(
        self,
        accel: float = 10.0,
        speed: float = 2.0,
        sources: Iterable[str | Source] | None = None,
        *,
        frames: Mapping[str, Frame] | None = None,
        extent: float = 100.0,
        bounds: Iterable[tuple[str, float, float]] = (),
    ) -> None:
        """Makes an empty table.

        The defaults, 10 m/s² and 2 m/s, cover the head, the trunk and the shoulders of people at
        work: of recorded ones 0.01 % of the trunk's clean samples broke them and none of the
        others'. They do not cover arms, of which 0.9 % of elbows' and 4.3 % of hands' samples are
        beyond 10 m/s², and 2.0 % of hands' beyond 2 m/s (docs/people.md): `armguard.people` has
        bounds for each part of a body. Nor do they cover what is thrown, falls or is driven.

        Args:
            accel: Bound on acceleration where a message gives none and no pattern fits, in
                [m]/[s]^2, at most 1000 or inf for none.
            speed: Bound on speed where a message gives none and no pattern fits, in [m]/[s], at
                most 100 or inf for none.
            sources: Those that must be heard: while one is not, the monitor says STOP. None: not
                known yet, and STOP until one is heard. An empty list says that there is none.
            frames: By name, those that messages may refer to; "world" is always there.
            extent: How far from the world's origin a coordinate of an obstacle may be, in [m]; what
                is farther is in another unit, or in another frame, and is refused.
            bounds: Patterns of ids, as in `fnmatch`, each with the acceleration and the speed of
                those ids where their message gives none; the first pattern that fits counts.

        Raises:
            ObstacleError: A bound, a pattern, the extent, a source or a frame is malformed.
        """
        super().__init__(() if sources is None else sources)
        self.expects_sources = sources is None
        self.bounds = PatternBounds(accel, speed, bounds)
        """Of obstacles whose messages give none."""
        self._extent = read_bound("extent", extent, math.inf, "m")
        for name, place in (frames or {}).items():
            if not isinstance(place, Frame):
                raise ObstacleError(f"frame {name!r}", f"is {show(place)}", expected="a Frame")
        world = Frame(np.eye(3), np.zeros(3))
        self._frames = {
            # Arrays of the one kind that compiled code is made for, whatever becomes of the frames.
            name: (place.rotation.copy(), place.translation.copy(), float(place.position_error))
            for name, place in {**(frames or {}), WORLD: world}.items()
        }
        self._bind()

    def __getstate__(self) -> dict[str, object]:
        left_out = ("_take_samples", "journal")
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._bind()

    @property
    def settings(self) -> ObstacleSettings:
        """What the table was made with, and the sources that it has heard of since."""
        accel, speed = self.bounds.others
        frames = {}
        for name, (rotation, translation, position_error) in self._frames.items():
            if name != WORLD:
                # As it is: what has been made orthonormal would change if that were done again.
                frames[name] = frame = Frame(rotation, translation, position_error)
                frame.rotation = rotation.copy()
        sources = None
        if not self.expects_sources:
            sources = tuple(state.source for state in self._sources.states)
        return ObstacleSettings(accel, speed, sources, frames, self._extent, self.bounds.patterns)

    def _bind(self) -> None:
        """Have compiled what takes samples."""
        nothing = read_samples(0, (), None, 0.0, 0.0, 0.0, 0.0, 0.0)
        message = NO_ROWS, nothing, 0.0, self._extent, True, *self._frames[WORLD], True
        self._take_samples = machine_code(
            rule.take_samples, self.table.handle, *message, NO_ROWS, np.zeros(0)
        )

    def update(
        self,
        ids: Sequence[str],
        stamp: float,
        position: ArrayLike = (),
        velocity: ArrayLike | None = None,
        radius: ArrayLike | None = None,
        accel: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        position_error: ArrayLike = 0.0,
        velocity_error: ArrayLike = 0.0,
        source: str = "default",
        frame: str = WORLD,
        snapshot: bool = False,
    ) -> None:
        """Takes a message of a source; without ids it is a heartbeat.

        Rows that are not finite, negative or beyond their bounds are refused and leave a fault.
        Fields may be one number for all obstacles or one for each.

        Args:
            ids: Names of the obstacles, unique within their source. Length n.
            stamp: When they were measured, in [s].
            position: Balls' centres, or up to eight points whose hull each obstacle is, in [m].
                Shape (n, 3) or (n, k, 3).
            velocity: Theirs, in [m]/[s]; None: unknown, that is 0 with an error of `speed`. Shape
                as of `position`.
            radius: Around the hull, in [m]; required. Shape () or (n,).
            accel: Bound on acceleration, in [m]/[s]^2; None: the table's for each id. Shape () or
                (n,).
            speed: Bound on speed, in [m]/[s]; None: the table's for each id. Shape () or (n,).
            position_error: What positions may be off by, in [m]. Shape () or (n,).
            velocity_error: What velocities may be off by, in [m]/[s]. Shape () or (n,).
            source: Name of the source that speaks; required from then on.
            frame: In which frame, one of the table's.
            snapshot: Whether this source sees the whole cell: its absent ids are removed.

        Raises:
            ObstacleError: The call is malformed; nothing of it is taken, and a fault is left.
        """
        try:
            names = read_ids(ids)
            time = read_time("stamp", stamp)
            self._check_source(source)
            self._check_frame(frame)
            if not isinstance(snapshot, (bool, np.bool_)):
                raise ObstacleError("snapshot", f"is {show(snapshot)}", expected="True or False")
            if names and radius is None:
                raise ObstacleError("radius", "is missing", expected="a radius in [m]")
            known_accel, known_speed = self.bounds.find(names)
            samples = read_samples(
                len(names),
                position,
                velocity,
                0.0 if radius is None else radius,
                known_accel if accel is None else accel,
                known_speed if speed is None else speed,
                position_error,
                velocity_error,
            )
        except ObstacleError as error:
            raise self._leave_malformed(error, source, stamp) from None
        if self.journal is not None:
            self.journal.note_update(
                names,
                time,
                samples,
                has_velocity=velocity is not None,
                has_accel=accel is not None,
                has_speed=speed is not None,
                source=source,
                frame=frame,
                snapshot=bool(snapshot),
            )
        known = self._sources.find(source)
        late = known is not None and time < known.newest
        state = self._sources.hear(source, time)
        if snapshot and not late:
            self._unplaced.forget(state.index)
        places = list(map(self._rows_of(state.index).get, names, repeat(-1)))
        if -1 in places:
            for i, name in enumerate(names):
                places[i] = self._admit(name, time, state) if places[i] < 0 else places[i]
        rows = np.array(places, dtype=np.int64)
        codes, values = self._run_rule(rows, samples, time, frame, velocity is None)
        refused = 0
        for i in codes.nonzero()[0].tolist():
            if codes[i] == rule.LATE:
                self.late_count += 1
            else:
                kind, field = _KINDS[int(codes[i])]
                refused += codes[i] != rule.TRACK_CHANGED
                self._faults.leave(kind, source, names[i], field, float(values[i]), time)
        self._sources.count(state, time, len(names), refused)
        if snapshot:
            self._remove_absent(rows, time, state, late)

    def add_static(self, id: str, position: ArrayLike, radius: float) -> None:
        """Adds an obstacle that stands still for ever and never ages.

        Args:
            id: Its name, unique among obstacles that stand still.
            position: Its centre, or up to eight points whose hull it is, in [m]. Shape (3,) or
                (k, 3).
            radius: Around the hull, in [m].

        Raises:
            ObstacleError: Something of this is malformed, or the id is taken; a fault is left.
        """
        try:
            (name,) = read_ids([id])
            if name in self._rows_of(NO_SOURCE):
                raise ObstacleError(f"id {name!r}", "is in the table already")
            points = read_points("position", [position], 1)[0]
            (size,) = read_field("radius", radius, 1)
            if not (np.isfinite(points).all() and 0.0 <= size < math.inf):
                raise ObstacleError(
                    f"static obstacle {name!r}",
                    f"is at {points.tolist()} with radius {size}",
                    expected="finite numbers and a radius of at least 0",
                )
            if not max(np.abs(points).max(), size) <= self._extent:
                raise ObstacleError(
                    f"static obstacle {name!r}",
                    f"is at {points.tolist()} with radius {size}",
                    expected=f"metres, within the extent of {self._extent:g} m",
                    remedy="Obstacles(extent=…) allows for more",
                )
            row = self._take_row(name, NO_SOURCE, -math.inf)
            if row < 0:
                raise ObstacleError(f"id {name!r}", "finds no room in the table")
        except ObstacleError as error:
            raise self._leave_malformed(error, "", math.nan) from None
        if self.journal is not None:
            self.journal.note_static(name, points, float(size))
        self.table.place_static(row, points, size)

    def remove(
        self, ids: Sequence[str], stamp: float | None = None, source: str | None = None
    ) -> None:
        """Removes obstacles; messages from before the removal never bring them back.

        Ids that are unknown, belong to another source or have a newer state stay as they are and
        leave a fault.

        Args:
            ids: Names of the obstacles.
            stamp: From when they are gone, in [s]; None: now, whatever their stamps.
            source: Name of the source that says so; None: the application itself, which may remove
                obstacles of all sources.

        Raises:
            ObstacleError: The call is malformed; nothing is removed, and a fault is left.
        """
        try:
            names = read_ids(ids)
            time = None if stamp is None else read_time("stamp", stamp)
            if source is not None:
                self._check_source(source)
        except ObstacleError as error:
            raise self._leave_malformed(error, source, stamp) from None
        if self.journal is not None:
            self.journal.note_removal(names, time, source)
        state = None if source is None else self._sources.find(source)
        if source is not None and time is not None:
            state = self._sources.hear(source, time)
        for name in names:
            if source is None:
                # The application itself removes all obstacles of this name, whatever their sources.
                owners = [owner for owner, rows in self._rows.items() if name in rows]
            else:
                owners = [] if state is None else [state.index]
            self._remove_one(name, time, owners, source)

    def _check_source(self, source: object) -> None:
        if not isinstance(source, str) or not source:
            raise ObstacleError("source", f"is {show(source)}", expected="a name")
        self._sources.check_room(source)

    def _check_frame(self, frame: object) -> None:
        if not isinstance(frame, str) or frame not in self._frames:
            raise ObstacleError(
                "frame", f"{show(frame)} is unknown", expected=f"one of {sorted(self._frames)}"
            )

    def _leave_malformed(
        self, error: ObstacleError, source: object, stamp: object
    ) -> ObstacleError:
        name = source if isinstance(source, str) else ""
        time = float(stamp) if isinstance(stamp, (float, np.floating)) else math.nan
        self.leave_malformed(name, error.offender, error.problem, time)
        return error

    def leave_malformed(self, source: str, offender: str, problem: str, stamp: float) -> None:
        """Leaves the fault of a malformed call: for those that made it out to be one elsewhere.

        Args:
            source: Who made it; empty where that is not known.
            offender: What was at fault.
            problem: What was wrong with it.
            stamp: Of the call, in [s]; NaN where it had none.
        """
        if self.journal is not None:
            self.journal.note_malformed(source, offender, problem, stamp)
        self._faults.leave(FaultKind.MALFORMED, source, "", offender, problem, stamp)

    def _run_rule(
        self,
        rows: IntArray,
        samples: Samples,
        time: float,
        frame: str,
        speed_is_error: bool,
    ) -> tuple[IntArray, NDArray[np.float64]]:
        codes = np.zeros(len(rows), dtype=np.int64)
        values = np.zeros(len(rows))
        place = self._frames[frame]
        self.table.widen(samples.points.shape[1])
        taken = self._take_samples(
            self.table.handle,
            rows,
            samples,
            time,
            self._extent,
            speed_is_error,
            *place,
            frame == WORLD,
            codes,
            values,
        )
        if taken:
            self._newest = max(self._newest, time)
        # A sample that is taken may set aside what a certificate rests on.
        self._any_refused = self._any_refused or bool(self.table.refused[rows].any())
        return codes, values

    def _admit(self, name: str, time: float, state: SourceState) -> int:
        """Row for an id that is not in the table; -1 if it may not come in."""
        if self._tombstones.covers(name, state.index, time):
            self.late_count += 1
            return -1
        source = state.source.name
        if self._tombstones.below_floor(state.index, time):
            self._faults.leave(FaultKind.LATE, source, name, "stamp", time, time)
            return -1
        row = self._take_row(name, state.index, time)
        if row < 0:
            self._faults.leave(FaultKind.TABLE_FULL, source, name, "id", name, time)
            return row
        self._tombstones.lift(name, state.index)
        for other, rows in self._rows.items():
            if other != state.index and name in rows:
                value = self.source_of(rows[name]) or "a static obstacle"
                self._faults.leave(FaultKind.SHARED_ID, source, name, "id", value, time)
                break
        return row

    def _remove_absent(self, rows: IntArray, time: float, state: SourceState, late: bool) -> None:
        """Removes what a snapshot does not show, unless something newer is known of it."""
        table = self.table
        gone = table.alive & (table.owner == state.index)
        gone[rows[rows >= 0]] = False
        gone &= ~table.has_state | (table.stamp <= time)
        if late:
            # What was refused since may be true.
            gone &= table.has_state & ~table.refused
        for row in np.flatnonzero(gone):
            self._release(int(row), time)

    def _remove_one(
        self, name: str, time: float | None, owners: list[int], source: str | None
    ) -> None:
        """Removes an id of the sources with these numbers; see `remove`."""
        speaker = source or ""
        stamp = math.nan if time is None else time
        rows = [row for owner in owners if (row := self._rows_of(owner).get(name, -1)) >= 0]
        if not rows:
            if time is not None and source is not None:
                for owner in owners:
                    # Its last states may still be under way.
                    self._tombstones.add(name, time, owner)
            whose = None if source is None else (owners or [NO_SOURCE])[0]
            if not self._unplaced.discard(name, whose, time):
                self._faults.leave(FaultKind.UNKNOWN_ID, speaker, name, "id", name, stamp)
        for row in rows:
            newest = self._newest_of(row)
            if time is not None and not time >= newest:
                self._faults.leave(FaultKind.STALE_REMOVAL, speaker, name, "stamp", newest, stamp)
            else:
                self._release(row, time)
