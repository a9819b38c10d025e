"""`Obstacles`: states, ages, errors and bounds of obstacles by id, as their sources report them.

Perception writes to `Obstacles`, and the monitor reads it. Plausible rows are accepted. Implausible
rows are refused without an exception, and leave faults for the next step. Obstacles that are not
seen stay, and their possible region grows with their bounds. The arrays are in `table`, the rule
that accepts or refuses samples in `acceptance`, and the monitor's queries in `register`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ObstacleError
from armguard.jit import numerics
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import machine_code
from armguard.messages.batch import Field, ObstacleBatch
from armguard.messages.events import (
    DroppedPoints,
    MalformedCall,
    PromiseBroken,
    StaticObstacle,
    TetherEnded,
    TetherStated,
)
from armguard.messages.incoming import RemoveMessage
from armguard.obstacles import acceptance as rule
from armguard.obstacles.arguments import (
    is_writable,
    read_bound,
    read_field,
    read_ids,
    read_points,
    read_regions,
    read_time,
    show,
)
from armguard.obstacles.broken_bounds import BODY_LIMITS, MAXIMUM_ACCEL, MAXIMUM_SPEED
from armguard.obstacles.clouds import (
    CloudReader,
    check_names,
    enclosing_radius,
    find_key,
    read_edge,
    read_mask,
    read_rays,
)
from armguard.obstacles.faults import Fault, FaultKind
from armguard.obstacles.frame_history import FrameHistory
from armguard.obstacles.frames import Frame
from armguard.obstacles.message import HAS_REGIONS, MessageHead, MessageMemory
from armguard.obstacles.pattern_bounds import PatternBounds
from armguard.obstacles.pattern_regions import PatternRegions
from armguard.obstacles.register import NO_ROWS, ObstacleRegister, ResolvedIds
from armguard.obstacles.sources import NO_SOURCE, Source, SourceState
from armguard.obstacles.tethers import MOST_STATED, MOST_TETHERS, Tether

__all__ = ["Fault", "FaultKind", "Frame", "Obstacles", "Source"]

WORLD = "world"

MESSAGES_REMEMBERED = 16
"""Lists of ids that are remembered of each source: one may measure so many groups in turn. All are
forgotten once there are more."""

WRONG_FRAME = 50
"""Beside the rule's codes: of a sample in a frame that has contradicted its body's state."""

_KINDS = {
    numerics.POSITION_BY_ACCEL: (FaultKind.BEYOND_ACCEL, "position"),
    numerics.POSITION_BY_SPEED: (FaultKind.BEYOND_SPEED, "position"),
    numerics.VELOCITY_BY_ACCEL: (FaultKind.BEYOND_ACCEL, "velocity"),
    numerics.VELOCITY_BY_SPEED: (FaultKind.BEYOND_SPEED, "velocity"),
    numerics.SHAPE: (FaultKind.SHAPE_CHANGED, "position"),
    rule.TOO_FAST: (FaultKind.BEYOND_SPEED, "velocity"),
    rule.TOO_FAR: (FaultKind.BEYOND_EXTENT, "position"),
    rule.TRACK_CHANGED: (FaultKind.TRACK_CHANGED, "position"),
    WRONG_FRAME: (FaultKind.WRONG_FRAME, "frame"),
}
for _field, _name in enumerate(rule.FIELDS):
    _KINDS[rule.NOT_FINITE + _field] = (FaultKind.NOT_FINITE, _name)
    _KINDS[rule.NEGATIVE + _field] = (FaultKind.NEGATIVE, _name)
    _KINDS[rule.TOO_LARGE + _field] = (FaultKind.BOUND_TOO_LARGE, _name)


class ObstacleSettings(NamedTuple):
    """Settings of a table of obstacles."""

    accel: float
    """Where a message gives none and no pattern fits, in [m]/[s]²."""
    speed: float
    """Where a message gives none and no pattern fits, in [m]/[s]."""
    sources: tuple[Source, ...] | None
    """Those that were named; None: sources are to come, of which none was."""
    frames: dict[str, Frame]
    extent: float
    """[m]."""
    bounds: tuple[tuple[str, float, float], ...]
    """Pattern of ids, acceleration and speed."""
    regions: dict[str, str]
    """Region of a body by pattern of ids."""
    body_limits: tuple[float, float]
    """What no part of a body does, by speed in [m]/[s] and by acceleration in [m]/[s]²."""


class ObstacleCountError(ObstacleError):
    """A message would give its source more obstacles than its limit."""


class Obstacles(ObstacleRegister):
    """The table of obstacles, to which sources and applications write.

    Only the thread of its monitor may use it. Another thread must send its measurements to this
    thread, by a queue or a stream. This thread then writes them to the table between two steps.
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
        regions: Mapping[str, str] | None = None,
        body_limits: tuple[float, float] = BODY_LIMITS,
    ) -> None:
        """Makes an empty table.

        The defaults, 10 m/s² and 2 m/s, cover the head, the trunk and the shoulders of people at
        work. In recordings, 0.01 % of the trunk's clean samples exceeded them, and none of the
        others'. The defaults do not cover arms: 0.9 % of the elbows' samples and 4.3 % of the
        hands' samples exceed 10 m/s², and 2.0 % of the hands' samples exceed 2 m/s
        (docs/people.md). `armguard.people` has bounds for each part of a body. The defaults also do
        not cover objects that are thrown, fall or are driven.

        Args:
            accel: Bound on acceleration if a message gives none and no pattern matches, in
                [m]/[s]^2; at most 1000, or inf for no bound.
            speed: Bound on speed if a message gives none and no pattern matches, in [m]/[s]; at
                most 100, or inf for no bound.
            sources: Sources that must send: the level is STOP while one of them is silent. None:
                unknown, and STOP until any source sends. An empty list states that there are no
                sources.
            frames: Frames that messages can name, by name; "world" always exists.
            extent: Greatest magnitude of a coordinate of an obstacle in the world, in [m]. Larger
                ones are refused, since they must be in a wrong unit or frame.
            bounds: Patterns of ids, as in `fnmatch`, each with acceleration and speed of those ids
                if their message gives none; the first matching pattern counts.
            regions: Region of a body by pattern of ids, as in `fnmatch`, one of
                `armguard.body_regions`; for contact limits. If several patterns match an id, or its
                message states another region, the strictest of their limits counts.
            body_limits: Speed in [m]/[s] and acceleration in [m]/[s]^2 that no part of a body
                exceeds. A sample beyond them is an error of measurement; one within them may come
                from a body that broke its bounds (docs/people.md). Larger bounds of an obstacle
                replace them.

        Raises:
            ObstacleError: A bound, a limit, a pattern, a region, the extent, a source or a frame is
                malformed.
        """
        super().__init__(() if sources is None else sources)
        self.expects_sources = sources is None
        self.bounds = PatternBounds(accel, speed, bounds)
        """Of obstacles whose messages give none."""
        self.regions = PatternRegions(regions)
        """Of obstacles, beside what their messages state."""
        self._extent = read_bound("extent", extent, math.inf, "m")
        try:
            most_speed, most_accel = body_limits
        except (TypeError, ValueError):
            raise ObstacleError(
                "body_limits", f"is {show(body_limits)}", expected="a speed and an acceleration"
            ) from None
        self.table.body_limits[0] = read_bound("body_limits", most_speed, math.inf, "m/s")
        self.table.body_limits[1] = read_bound("body_limits", most_accel, math.inf, "m/s²")
        for name, place in (frames or {}).items():
            if not isinstance(name, str) or not name:
                raise ObstacleError("frames", f"holds {show(name)}", expected="names")
            if not is_writable(name):
                raise ObstacleError(
                    "frames", f"holds {show(name)}", expected="text that UTF-8 can hold"
                )
            if not isinstance(place, Frame):
                raise ObstacleError(f"frame {name!r}", f"is {show(place)}", expected="a Frame")
        world = Frame(np.eye(3), np.zeros(3))
        places = {WORLD: world} | dict(frames or {}) | {WORLD: world}
        self._frames = {name: number for number, name in enumerate(places)}
        self._frame_history = FrameHistory()
        self._memory = MessageMemory(list(places.values()))
        self._clouds: CloudReader | None = None
        self.takes_voxels = False
        """Whether messages may name voxels, as messages of recorded clouds do."""
        self._bind()

    def __getstate__(self) -> dict[str, object]:
        left_out = ("_take_samples", "journal")
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._bind()

    @property
    def settings(self) -> ObstacleSettings:
        """The settings of the table, including sources that have sent since."""
        accel, speed = self.bounds.others
        frames = {}
        placed = self._memory.data.frames
        for name, number in self._frames.items():
            if name != WORLD:
                rotation = placed.rotation[number].copy()
                frames[name] = frame = Frame(
                    rotation, placed.translation[number], float(placed.position_error[number])
                )
                # As it is: what has been made orthonormal would change if that were done again.
                frame.rotation = rotation
        sources = None
        if not self.expects_sources:
            sources = tuple(state.source for state in self._sources.states)
        return ObstacleSettings(
            accel,
            speed,
            sources,
            frames,
            self._extent,
            self.bounds.patterns,
            self.regions.patterns,
            (float(self.table.body_limits[0]), float(self.table.body_limits[1])),
        )

    def _bind(self) -> None:
        """Have compiled what takes samples."""
        head = MessageHead(1, 0.0, self._extent, 0, True, 0, 0.0, 0.0, 0.0, 0.0, 0.0)
        handles = self.table.handle, self._memory.handle
        self._take_samples = machine_code(rule.take_samples, *handles, NO_ROWS, head)

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
        region: str | Sequence[str] | None = None,
    ) -> None:
        """Processes a message of a source; a message without ids is a heartbeat.

        Rows with values that are not finite, negative or beyond their bounds are refused, and leave
        a fault. A field can be one number for all obstacles, or one for each.

        Args:
            ids: Names of the obstacles, unique within their source. Names such as "voxel 3 -2 14"
                are reserved for voxels of clouds. Length n.
            stamp: Time of measurement, in [s].
            position: Centres of balls, or up to eight points whose hull is the obstacle, in [m].
                Shape (n, 3) or (n, k, 3).
            velocity: Velocities of these points, in [m]/[s]; None: unknown, which counts as 0 with
                an error of `speed`. Shape as of `position`.
            radius: Radius around the points' hull, in [m]; required. Shape () or (n,).
            accel: Bound on acceleration, in [m]/[s]^2; None: the table's for each id. Shape () or
                (n,).
            speed: Bound on speed, in [m]/[s]; None: the table's for each id. Shape () or (n,).
            position_error: Greatest error of positions, in [m]. Shape () or (n,).
            velocity_error: Greatest error of velocities, in [m]/[s]. Shape () or (n,).
            source: Name of the source; from now on its silence is a STOP.
            frame: Frame of the coordinates, one of the table's.
            snapshot: Whether the message shows all that the source sees: absent ids are removed.
            region: Region of a body, one of `armguard.body_regions`: one for all, or one for each,
                "" for no region; None: the table's for each id. For contact limits: an obstacle
                without a region may never be touched. Every stated region counts until the obstacle
                is removed, so an obstacle that changes its region has the strictest of the limits.

        Raises:
            ObstacleError: The call is malformed; nothing of it is taken, and a fault is left.
        """
        try:
            names = ids if type(ids) is list else read_ids(ids)
            count = len(names)
            points = read_points("position", position, count)
            velocities = None if velocity is None else read_points("velocity", velocity, count)
            # A loop over these, or a call for each, takes as long as most of what follows.
            if radius is not None and type(radius) is not float:
                radius = read_field("radius", radius, count)
            if accel is not None and type(accel) is not float:
                accel = read_field("accel", accel, count)
            if speed is not None and type(speed) is not float:
                speed = read_field("speed", speed, count)
            if type(position_error) is not float:
                position_error = read_field("position_error", position_error, count)
            if type(velocity_error) is not float:
                velocity_error = read_field("velocity_error", velocity_error, count)
        except ObstacleError as error:
            raise self._leave_malformed(error, source, stamp) from None
        # A named tuple's own constructor takes twice as long.
        self.take(
            tuple.__new__(
                ObstacleBatch,
                (
                    names,
                    stamp,
                    points,
                    velocities,
                    radius,
                    accel,
                    speed,
                    position_error,
                    velocity_error,
                    source,
                    frame,
                    snapshot,
                    region,
                ),
            )
        )

    def take(self, batch: ObstacleBatch, limit: int | None = None, gone: int = 0) -> bool:
        """Processes a message of a source as `update` does, with numbers that are already read.

        Args:
            batch: The message. Its arrays have the shapes of `ObstacleBatch`, and can be
                overwritten after the call. All other fields are checked here.
            limit: Greatest number of obstacles of the source after a message that adds some; None:
                no limit except the table's size.
            gone: Number of its present obstacles that are about to be removed.

        Returns:
            Whether each sample was accepted without an exception; the others have left faults.

        Raises:
            ObstacleError: The message is malformed; nothing of it is taken, and a fault is left.
        """
        (
            ids,
            stamp,
            points,
            velocities,
            radius,
            accel,
            speed,
            position_error,
            velocity_error,
            source,
            frame,
            snapshot,
            region,
        ) = batch
        known = self._sources.find(source) if isinstance(source, str) else None
        resolved = None if known is None else self._recall(ids, known.index)
        try:
            if resolved is None:
                names = read_ids(ids)
                if not self.takes_voxels:
                    check_names(names)
                bounds = self.bounds.find(names)
                resolved = ResolvedIds(names, None, *bounds, self.regions.find(names))
            time = stamp
            if not (type(time) is float and -math.inf < time < math.inf):
                time = read_time("stamp", stamp)
            if known is None:
                self._check_source(source)
            number = self._find_frame(frame)
            if snapshot is not False and not isinstance(snapshot, (bool, np.bool_)):
                raise ObstacleError("snapshot", f"is {show(snapshot)}", expected="True or False")
            names, rows, usual_accel, usual_speed, by_pattern = resolved
            told: int | IntArray | None = by_pattern
            if names and radius is None:
                raise ObstacleError("radius", "is missing", expected="a radius in [m]")
            if region is not None:
                stated = read_regions(region, len(names))
                told = stated if told is None else told | stated
            if limit is not None:
                self._check_count(source, names, limit, gone, snapshot=bool(snapshot))
            numbers = self._read_samples(
                points,
                velocities,
                0.0 if radius is None else radius,
                usual_accel if accel is None else accel,
                usual_speed if speed is None else speed,
                position_error,
                velocity_error,
            )
            if told is not None:
                self._memory.data.regions[: len(names)] = told
                numbers = numbers[0] + HAS_REGIONS, *numbers[1:]
        except ObstacleError as error:
            raise self._leave_malformed(error, source, stamp) from None
        if self.journal is not None:
            self.journal.note_update(batch._replace(ids=names, stamp=time, snapshot=bool(snapshot)))
        late = known is not None and time < known.newest
        state = self._sources.hear(source, time)
        if snapshot and not late:
            self._unplaced.forget(state.index)
        if rows is None:
            rows = self._find_rows(resolved, time, state)
        points_each = self._memory.points_each
        if points_each > 1:
            self.table.widen(points_each)
        wrong: list[int] = []
        is_usual = self._frame_history.is_usual(state.index, number)
        if not is_usual:
            wrong = self._frame_history.find_wrong(
                state.index,
                number,
                rows,
                self._rows_of(state.index).values(),
                self.table.has_state,
            )
            self._memory.data.points[wrong] = math.nan
        taken, exceptions, any_refused = self._take_samples(
            self.table.handle,
            self._memory.handle,
            rows,
            # A named tuple's own constructor takes twice as long.
            tuple.__new__(
                MessageHead,
                (points_each, time, self._extent, number, velocities is not None, *numbers),
            ),
        )
        if not is_usual:
            codes = self._memory.data.codes[: len(names)]
            codes[wrong] = WRONG_FRAME
            self._frame_history.note(state.index, number, rows, codes)
        if taken and time > self._newest:
            self._newest = time
        if self._unbelieved:
            self._newcomers |= self._unbelieved.intersection(rows.tolist())
        # A sample that is taken may set aside what a certificate rests on.
        self._any_refused = self._any_refused or any_refused
        refused = 0
        if exceptions:
            refused = self._tell_exceptions(names, time, source, frame)
        self._sources.count(state, time, len(names), refused)
        if snapshot:
            self._remove_absent(rows, time, state, late)
        return not exceptions

    def update_cloud(
        self,
        source: str,
        stamp: float,
        points: ArrayLike,
        origin: ArrayLike,
        voxel: float = 0.05,
        *,
        occupied: ArrayLike | None = None,
        position_error: float = 0.0,
        accel: float | None = None,
        speed: float | None = None,
        frame: str = WORLD,
        snapshot: bool = False,
        limit: int | None = None,
    ) -> None:
        """Processes a point cloud of a depth sensor; a cloud without points is a heartbeat.

        Each voxel with a point in it is an obstacle such as "voxel 3 -2 14": a ball around a cube
        of a lattice that is fixed in the world, with a radius of sqrt(3)/2 of its edge and an
        unknown velocity. A voxel that no longer has points may be hidden, so it stays and grows
        with its age. It is removed, however far it has grown, if rays of one cloud passed through
        its cube, by the rule in `clouds`, or by `snapshot`. Space behind visible surfaces is not
        observed: if a person can hide there, it must be stated with `add_entrance`. A source sends
        clouds, or obstacles by `update`; it must not use both with snapshots.

        Points that are not finite, or beyond the table's extent, are dropped, and a fault gives
        their number. If more than half of the points within one second are unusable, the source is
        not believed.

        Args:
            source: Name of the source; from now on its silence is a STOP.
            stamp: Time of measurement, in [s].
            points: End points of rays, in [m]. Shape (n, 3).
            origin: Origin of the rays, the camera's centre, in [m] in the same frame. Shape (3,).
            voxel: Edge of the voxels, in [m], the same in all clouds of a source.
            occupied: Points that become obstacles, such as those that `CloudFilter` and a
                background filter have not removed. The rays of the other points still show empty
                space. None: all. Bool, shape (n,).
            position_error: Greatest error of points, including half the distance between
                neighbouring rays at their end, in [m].
            accel: Bound on acceleration, in [m/s²]; None: the table's for the id "voxel".
            speed: Bound on speed, in [m/s]; None: the table's for the id "voxel".
            frame: Frame of the coordinates, one of the table's.
            snapshot: Whether this cloud shows all that the source sees: its other obstacles are
                removed.
            limit: Greatest number of obstacles of the source after a cloud that adds some, without
                those that its rays clear. A cloud that adds none is always accepted, since it may
                clear some. None: no limit except the table's size.

        Raises:
            ObstacleError: The call is malformed or exceeds the limit; it changes nothing, and a
                fault is left.
        """
        try:
            self._check_source(source)
            number = self._find_frame(frame)
            time = read_time("stamp", stamp)
            ends, begin = read_rays(points, origin)
            mask = read_mask(occupied, len(ends))
            error = read_bound("position_error", position_error, self._extent, "m")
            clouds = self._open_clouds()
            edge = read_edge(voxel, clouds.edges.get(source), source)
            placed = self._memory.data.frames
            error += float(placed.position_error[number])
            known = (float(np.max(bound)) for bound in self.bounds.find(["voxel"]))
            names, centers, dropped = clouds.read(
                ends,
                mask,
                begin,
                placed.rotation[number],
                placed.translation[number],
                edge,
                self._extent,
            )
            gone: list[str] = []
            if not snapshot:
                gone = clouds.find_empty(self._list_unseen(source, names, time), edge, error)
            rate, pace = (
                usual if value is None else read_field(name, value, len(names))
                for name, value, usual in zip(
                    ("accel", "speed"), (accel, speed), known, strict=True
                )
            )
        except ObstacleError as error_found:
            raise self._leave_malformed(error_found, source, stamp) from None
        takes_voxels, self.takes_voxels = self.takes_voxels, True
        try:
            size = enclosing_radius(edge)
            numbers = size, rate, pace, error, 0.0
            # What a voxel belongs to is not known.
            of_all = source, WORLD, snapshot, ""
            self.take(
                ObstacleBatch(names, time, centers, None, *numbers, *of_all),
                limit,
                len(gone),
            )
        finally:
            self.takes_voxels = takes_voxels
        clouds.edges[source] = edge
        state = self._sources.find(source)
        if len(ends) or (state is not None and state.points.is_disbelieved):
            # One without points ends what was wrong more than a second ago.
            self.count_points(source, time, len(ends), dropped)
        if gone:
            self.remove(gone, time, source)

    def _check_count(
        self, source: str, names: list[str], limit: int, gone: int, *, snapshot: bool
    ) -> None:
        """Raise ObstacleCountError if a message takes its source beyond a number of obstacles.

        One that adds none is always taken.
        """
        known = self.count_of(source)
        if len(names) + (0 if snapshot else known) <= limit:
            return
        # Those that the table has already are looked up only where that decides.
        together = self.count_of(source, names)
        count = len(names) if snapshot else together - gone
        if together > known and count > limit:
            raise ObstacleCountError(
                "message",
                f"one by which {source!r} has {count} obstacles; "
                f"expected max_obstacles, {limit} at most",
            )

    def prepare_clouds(self) -> None:
        """Compiles the kernels for clouds, so that the first cloud takes no longer than others."""
        self._open_clouds()

    def _open_clouds(self) -> CloudReader:
        """The reader of clouds; made at its first use."""
        if self._clouds is None:
            self._clouds = CloudReader()
        return self._clouds

    def _list_unseen(self, source: str, seen: list[str], time: float) -> list[str]:
        """Ids of a source that a message at a time in [s] does not show, and that are older."""
        state = self._sources.find(source)
        rows = {} if state is None else self._rows_of(state.index)
        table, unseen = self.table, rows.keys() - set(seen)
        return [
            name
            for name in sorted(unseen)
            if table.has_state[rows[name]]
            and not table.refused[rows[name]]
            and table.stamp[rows[name]] < time
        ]

    def count_points(self, source: str, stamp: float, points: int, dropped: int) -> None:
        """Counts the points of a cloud, and leaves a fault if some could not be used.

        Args:
            source: Whose cloud it was; one that has spoken.
            stamp: Of the cloud, in [s].
            points: How many it had.
            dropped: How many of them were left out.
        """
        self._note(DroppedPoints(source=source, stamp=stamp, points=points, dropped=dropped))
        state = self._sources.find(source)
        if state is not None:
            self._sources.count_points(state, stamp, points, dropped)
        if not dropped:
            return
        found = f"without {dropped} of {points} points"
        self._faults.leave(FaultKind.POINTS_DROPPED, source, "", "cloud", found, stamp)

    def _read_samples(
        self,
        points: FloatArray,
        velocities: FloatArray | None,
        radius: Field,
        accel: ArrayLike,
        speed: ArrayLike,
        position_error: Field,
        velocity_error: Field,
    ) -> tuple[Any, ...]:
        """Reads the samples of a message into the memory of messages.

        Returns:
            The last values of `MessageHead`, from `each` on.
        """
        memory, count = self._memory, len(points)
        if velocities is not None and velocities.shape != points.shape:
            # One point each can be told in two ways.
            points, velocities = (array.reshape(count, -1, 3) for array in (points, velocities))
            if velocities.shape != points.shape:
                found = f"has shape {velocities.shape}"
                raise ObstacleError("velocity", found, expected=f"{points.shape} as position")
        memory.take_points(points, velocities)
        # A set of their types takes three times as long.
        if (
            type(radius) is type(accel) is type(speed) is float
            and type(position_error) is type(velocity_error) is float
        ):
            return 0, radius, accel, speed, position_error, velocity_error
        each, values = 0, []
        for i, value in enumerate((radius, accel, speed, position_error, velocity_error)):
            if type(value) is not float:
                memory.fields[i][:count] = value
                each += 1 << i
            values.append(value if type(value) is float else math.nan)
        return each, *values

    def _recall(self, ids: Sequence[str], owner: int) -> ResolvedIds | None:
        """The stored result for the same ids in the same order, from an earlier message."""
        known = self._resolved.get(owner)
        if not known or type(ids) is not list or not ids or type(ids[0]) is not str:
            return None
        # Those of the last cloud may be named where voxels are taken alone.
        resolved = known.get((len(ids), ids[0], self.takes_voxels))
        try:
            # What is no string might call itself equal to one, or be unable to tell.
            "".join(ids)
        except TypeError:
            return None
        return resolved if resolved is not None and resolved.names == ids else None

    def _find_rows(self, resolved: ResolvedIds, time: float, state: SourceState) -> IntArray:
        """Rows of a message's obstacles, including new ones; -1 if one may not be added.

        The result is stored for the next such message if all were added.
        """
        names = resolved.names
        places = list(map(self._rows_of(state.index).get, names, repeat(-1)))
        have_all_come = -1 not in places
        if not have_all_come:
            for i, name in enumerate(names):
                places[i] = self._admit(name, time, state) if places[i] < 0 else places[i]
            have_all_come = -1 not in places
        rows = np.array(places, dtype=np.int64)
        if names and have_all_come:
            known = self._resolved.setdefault(state.index, {})
            if len(known) >= MESSAGES_REMEMBERED:
                known.clear()
            known[len(names), names[0], self.takes_voxels] = resolved._replace(rows=rows)
        return rows

    def _tell_exceptions(self, names: list[str], time: float, source: str, frame: str) -> int:
        """Leaves a fault for each exceptional sample; returns the number of refused samples."""
        refused = 0
        codes, values = self._memory.data.codes[: len(names)], self._memory.data.values
        places = codes.nonzero()[0]
        found = places.tolist(), codes[places].tolist(), values[places].tolist()
        for i, code, value in zip(*found, strict=True):
            if code == rule.LATE:
                self.late_count += 1
            else:
                kind, field = _KINDS[code]
                refused += code != rule.TRACK_CHANGED
                found_there = frame if code == WRONG_FRAME else value
                self._faults.leave(kind, source, names[i], field, found_there, time)
        return refused

    def add_static(self, id: str, position: ArrayLike, radius: float) -> None:
        """Adds a static: an obstacle that never moves and never ages.

        Args:
            id: Its name, unique among statics and entrances.
            position: Its centre, or up to eight points whose hull it is, in [m]. Shape (3,) or
                (k, 3).
            radius: Around the hull, in [m].

        Raises:
            ObstacleError: An argument is malformed, or the id is in use; a fault is left.
        """
        try:
            name, points, size = self._read_place("static obstacle", id, position, radius)
            row = self._take_place(name)
        except ObstacleError as error:
            raise self._leave_malformed(error, "", math.nan) from None
        self._note(StaticObstacle(id=name, position=points.tobytes(), radius=size))
        self.table.place_static(row, points, size)

    def add_entrance(
        self,
        id: str,
        position: ArrayLike,
        radius: float,
        detection_time: float,
        speed: float | None = None,
        accel: float | None = None,
    ) -> None:
        """Adds an entrance: a region where an unreported body can appear at any moment.

        Doors are entrances, and so are the edges of a camera's view and the far side of a pillar.
        armguard assumes that bodies which no source reports do not exist, except here. At every
        tick, an unreported body may be anywhere in the region, or may have left it for at most
        `detection_time`, at any velocity up to its bound on speed. So the region is enlarged once,
        by speed times `detection_time`. An entrance never ages, no source reports it, no snapshot
        removes it, and it counts again in every tick.

        The contact time is that of a body that moves at its bound on speed from the beginning. A
        body that is first at rest in the region arrives no sooner, whatever its acceleration. So
        the bound on acceleration has no effect on contact times; the table only stores it.

        Args:
            id: Its name, unique among obstacles that stand still and entrances; verdicts name it.
            position: Its centre, or up to eight points whose hull it is, in [m]. Shape (3,) or
                (k, 3).
            radius: Radius around the hull, in [m]. The region must contain the whole unseen body,
                including its hands.
            detection_time: The longest time from leaving the region until a source has reported
                the body, in [s]: period of the source, missed messages and latency together.
            speed: Bound on the speed of the body, in [m]/[s], finite and above 0; None: the table's
                for this id.
            accel: Bound on the acceleration of the body, in [m]/[s]^2; None: the table's for this
                id.

        Raises:
            ObstacleError: An argument is malformed, or the id is in use; a fault is left.
        """
        try:
            name, points, size = self._read_place("entrance", id, position, radius)
            known_accel, known_speed = self.bounds.find([name])
            rate = float(np.max(known_accel)) if accel is None else accel
            pace = float(np.max(known_speed)) if speed is None else speed
            rate = read_bound("accel", rate, MAXIMUM_ACCEL, "m/s²")
            pace = read_bound("speed", pace, MAXIMUM_SPEED, "m/s")
            if not 0.0 < pace < math.inf:
                raise ObstacleError(
                    f"entrance {name!r}",
                    f"has a speed of {pace} m/s",
                    expected="a finite speed above 0: without a bound, contact is always possible",
                )
            delay = read_time("detection_time", detection_time)
            if not delay >= 0.0:
                raise ObstacleError(
                    "detection_time", f"is {delay}", expected="a time of at least 0 in [s]"
                )
            if delay > 0.0:
                # One without delay, as that of a recording, stays to the bit.
                size = (size + pace * delay) * (1.0 + numerics.TERM_ROUNDING)
            if not size <= self._extent:
                raise ObstacleError(
                    f"entrance {name!r}",
                    f"is {size:.4g} m wide after {delay:g} s at {pace:g} m/s",
                    expected=f"a region within the extent of {self._extent:g} m",
                )
            row = self._take_place(name)
        except ObstacleError as error:
            raise self._leave_malformed(error, "", math.nan) from None
        place = StaticObstacle(
            id=name, position=points.tobytes(), radius=size, speed=pace, accel=rate
        )
        self._note(place)
        self.table.place_entrance(row, points, size, rate, pace)

    def tether(self, a: str, b: str, length: float, source: str) -> None:
        """States a tether: two obstacles are never far apart, such as an elbow and its shoulder.

        From the next step on, no centre point of either obstacle is farther than the length from
        the hull of the other's centre points. So an obstacle that is not seen is near the other
        one. Its contact time is the later one of two: by its own last state, and by the other's
        state. This is a premise of all verdicts that use it. If both obstacles are seen and are
        farther apart, the tether is broken: verdicts name it, and it is not used until both have
        agreed with it for `rise_delay`.

        The obstacles need not exist yet. A tether applies to each source that reports both ids, and
        not to statics. If a tether is stated again, the last length counts.

        Args:
            a: Id of one obstacle.
            b: Id of the other one.
            length: In [m], at least 0.
            source: Where the length comes from, in words, such as "measured" or a publication.

        Raises:
            ObstacleError: An argument is malformed, both ids are the same, one of them would have
                more than 6 tethers, or there would be more than 1024 of them; a fault is left.
        """
        try:
            pair = self._read_tethered(a, b)
            distance = math.nan
            if isinstance(length, (int, float, np.floating, np.integer)):
                distance = math.nan if isinstance(length, bool) else float(length)
            if not 0.0 <= distance <= self._extent:
                expected = f"a length from 0 to {self._extent:g} m, the extent of the table"
                raise ObstacleError("length", f"is {show(length)}", expected=expected)
            if not isinstance(source, str) or not source.strip() or not is_writable(source):
                expected = "where the length comes from, in words"
                raise ObstacleError("source", f"is {show(source)}", expected=expected)
            if pair not in self._tethers:
                self._check_tethers(a, b)
        except ObstacleError as error:
            raise self._leave_malformed(error, "", math.nan) from None
        tether = Tether(str(a), str(b), distance, str(source))
        if self._tethers.get(pair) != tether:
            self._note(TetherStated(a=tether.a, b=tether.b, length=distance, source=tether.source))
            self._tether(pair, tether)

    def untether(self, a: str, b: str) -> None:
        """Ends a tether from the next step on; no effect if there is none.

        Args:
            a: Id of one obstacle.
            b: Id of the other one.

        Raises:
            ObstacleError: An id is malformed, or both are the same; a fault is left.
        """
        try:
            pair = self._read_tethered(a, b)
        except ObstacleError as error:
            raise self._leave_malformed(error, "", math.nan) from None
        if pair in self._tethers:
            self._note(TetherEnded(a=str(a), b=str(b)))
            self._tether(pair, None)

    def _read_tethered(self, a: object, b: object) -> frozenset[str]:
        """The ids of two obstacles."""
        for name, value in (("a", a), ("b", b)):
            if not isinstance(value, str) or not value or not is_writable(value):
                raise ObstacleError(name, f"is {show(value)}", expected="an id")
        if a == b:
            raise ObstacleError("b", f"is {show(b)}, as a is", expected="another id")
        return frozenset((str(a), str(b)))

    def _check_tethers(self, a: str, b: str) -> None:
        """Raise ObstacleError if another tether of two obstacles would exceed a limit."""
        for name in (a, b):
            count = sum(name in pair for pair in self._tethers)
            if count >= MOST_TETHERS:
                raise ObstacleError(
                    f"id {name!r}", f"has {count} tethers", expected=f"{MOST_TETHERS} at most"
                )
        if len(self._tethers) >= MOST_STATED:
            raise ObstacleError(
                "tethers", f"are {len(self._tethers)} already", expected=f"{MOST_STATED} at most"
            )

    def _read_place(
        self, what: str, id: str, position: ArrayLike, radius: float
    ) -> tuple[str, FloatArray, float]:
        """Name, points in [m] and radius in [m] of a static or an entrance."""
        (name,) = read_ids([id])
        if name in self._rows_of(NO_SOURCE):
            raise ObstacleError(f"id {name!r}", "is in the table already")
        points = read_points("position", [position], 1).reshape(-1, 3)
        (size,) = np.atleast_1d(read_field("radius", radius, 1)).tolist()
        if not (np.isfinite(points).all() and 0.0 <= size < math.inf):
            raise ObstacleError(
                f"{what} {name!r}",
                f"is at {points.tolist()} with radius {size}",
                expected="finite numbers and a radius of at least 0",
            )
        if not max(np.abs(points).max(), size) <= self._extent:
            raise ObstacleError(
                f"{what} {name!r}",
                f"is at {points.tolist()} with radius {size}",
                expected=f"metres, within the extent of {self._extent:g} m",
                remedy="Obstacles(extent=…) allows for more",
            )
        return name, points, float(size)

    def _take_place(self, name: str) -> int:
        """Row for a static or an entrance."""
        row = self._take_row(name, NO_SOURCE, -math.inf)
        if row < 0:
            raise ObstacleError(f"id {name!r}", "finds no room in the table")
        return row

    def remove(
        self, ids: Sequence[str], stamp: float | None = None, source: str | None = None
    ) -> None:
        """Removes obstacles; messages with earlier stamps never restore them.

        Ids that are unknown, belong to another source or have a newer state are unchanged, and
        leave a fault.

        Args:
            ids: Names of the obstacles.
            stamp: Time of the removal, in [s]; None: now, whatever their stamps.
            source: Name of the source that removes them; None: the application itself, which can
                remove obstacles of all sources.

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
        self._note(RemoveMessage(names, math.nan if time is None else time, source or ""))
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

    def judge_newcomers(self, now: float) -> None:
        """Judges once whether each new obstacle is believable at `now` in [s].

        An obstacle is not believable without an accepted state, or with one so old that the body
        can have crossed the whole extent since. Such a state shows that a body exists, but not
        where.
        """
        if not self._newcomers:
            return
        table, rows = self.table, np.array(list(self._newcomers), dtype=np.int64)
        with np.errstate(all="ignore"):  # what overflows is too far
            reach = np.minimum(table.speed[rows], MAXIMUM_SPEED) * (now - table.stamp[rows])
        is_believable = table.has_state[rows] & (reach <= self._extent)
        self._unbelieved.difference_update(rows[is_believable].tolist())
        self._unbelieved.update(rows[~is_believable].tolist())
        self._newcomers.clear()

    def forget_unbelieved(self, now: float, default_timeout: float) -> None:
        """Drops obstacles and sources that no message may ever end, at a reset; faults name them.

        It drops obstacles without any believable state so far. If sources are named, it also drops
        unnamed silent sources without obstacles: their silence no longer counts until they send
        again. Obstacles that were believable once stay, and so do other arms.

        Args:
            now: Time of the last tick, in [s].
            default_timeout: Silence that a source may keep, in [s].
        """
        for row in sorted(self._unbelieved - self._newcomers):
            name, source = self.ids[row], self.source_of(row)
            found = f"of {source}, of which nothing was ever believable"
            self._faults.leave(FaultKind.FORGOTTEN, source, name, "obstacle", found, now)
            self._release(row, None)
        if self.expects_sources:
            return
        for name, _ in self._sources.silent(now, default_timeout):
            state = self._sources.find(name)
            if state is not None and not (state.is_named or self._rows_of(state.index)):
                self._sources.forget(state)
                found = "that was not named, and is silent"
                self._faults.leave(FaultKind.FORGOTTEN, name, "", "source", found, now)

    def _check_source(self, source: object) -> None:
        if not isinstance(source, str) or not source:
            raise ObstacleError("source", f"is {show(source)}", expected="a name")
        if self._sources.find(source) is None and not is_writable(source):
            raise ObstacleError("source", f"is {show(source)}", expected="text that UTF-8 can hold")
        self._sources.check_room(source)

    def _find_frame(self, frame: object) -> int:
        """Number of a frame."""
        number = self._frames.get(frame) if isinstance(frame, str) else None
        if number is None:
            raise ObstacleError(
                "frame", f"{show(frame)} is unknown", expected=f"one of {sorted(self._frames)}"
            )
        return number

    def _leave_malformed(
        self, error: ObstacleError, source: object, stamp: object
    ) -> ObstacleError:
        name = source if isinstance(source, str) and is_writable(source) else ""
        time = float(stamp) if isinstance(stamp, (float, np.floating)) else math.nan
        self.leave_malformed(name, error.offender, error.problem, time)
        return error

    def leave_malformed(self, source: str, offender: str, problem: str, stamp: float) -> None:
        """Leaves the fault of a call that was found malformed elsewhere.

        Args:
            source: Name of the caller; empty if unknown.
            offender: What was at fault.
            problem: What was wrong with it.
            stamp: Of the call, in [s]; NaN where it had none.
        """
        call = MalformedCall(source=source, offender=offender, problem=problem, stamp=stamp)
        self._note(call)
        self._faults.leave(FaultKind.MALFORMED, source, "", offender, problem, stamp)

    def leave_broken(self, source: str, joint: str, problem: str, stamp: float) -> None:
        """Leaves the fault of another arm that broke its stated limits or its plan.

        Args:
            source: Name of the arm.
            joint: The joint that broke it.
            problem: The violation and its amount.
            stamp: Of the joint state that shows it, in [s].
        """
        self._note(PromiseBroken(source=source, joint=joint, problem=problem, stamp=stamp))
        self._faults.leave(FaultKind.PROMISE_BROKEN, source, "", joint, problem, stamp)

    def _admit(self, name: str, time: float, state: SourceState) -> int:
        """Row for an id that is not in the table; -1 if it may not be added."""
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
        # Cameras that see the same surface name the same voxels, and are meant to.
        if find_key(name) is not None:
            return row
        for other, rows in self._rows.items():
            if other != state.index and name in rows:
                value = self.source_of(rows[name]) or "a static obstacle"
                self._faults.leave(FaultKind.SHARED_ID, source, name, "id", value, time)
                break
        return row

    def _remove_absent(self, rows: IntArray, time: float, state: SourceState, late: bool) -> None:
        """Removes obstacles that a snapshot does not show, unless they have a newer state."""
        if len(rows) == len(self._rows_of(state.index)) and not (rows < 0).any():
            # It shows all that there is.
            return
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
