"""Plays recordings of real people as a perception system would report them, with all faults.

Reads CSV as exported by Vicon's motion capture software. What the cameras did not see is not
published, and markers that were swapped jump as they did: filtering with hindsight would hide what
a monitor meets every day. Velocities come from past samples only, each with the error that this
implies.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.bodies import POINTS, publish_person
from armguard.lab.simulation.sources import ObstacleSink, SampledSource

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MARKER_ERROR = 0.002
"""What a tracked point may be off by, in [m]: ten times Vicon's own figure, for loose cloth."""

ACCEL, SPEED = 10.0, 2.0
"""Bounds that are published with a recording, in [m]/[s²] and [m]/[s]: velocity errors rest on
them."""

SETBACK = 0.4
"""[m]; see `place_recording`."""

_AXES = ("RX", "RY", "RZ", "TX", "TY", "TZ")
_UNITS = ("rad", "rad", "rad", "mm", "mm", "mm")
_HEADER_LINES = 5


class Recording(SampledSource):
    """A recorded person, from the first frame at time 0 to the last; then silence.

    A velocity is the difference over the last h seconds, with h the whole number of samples, none
    of them missing, that makes its error least: with the acceleration bound A and the position
    error δp, the error is A h / 2 + 2 δp / h. The first sample after a gap has velocity 0 with the
    speed bound as error.

    Args:
        path: A Vicon CSV file with the nine points of `bodies.POINTS`, in mm.
        placement: Of the recording's origin (z up) in the world, homogeneous. None: the identity.
            Shape (4, 4).

    Attributes:
        position: Of the tracked points in the world, NaN where one was not seen, in [m], in the
            order of `bodies.POINTS`. Shape (frames, 9, 3).
        velocity: Of these points, from past samples, in [m]/[s]. Shape (frames, 9, 3).
        velocity_error: What each velocity may be off by, in [m]/[s]. Shape (frames, 9).

    Raises:
        ArmguardError: The file cannot be read or is malformed; the message names file, line, column
            and value.
    """

    def __init__(self, path: str | Path, placement: ArrayLike | None = None) -> None:
        path = Path(path)
        rate, points = read_vicon_csv(path)
        super().__init__(path.stem, rate, (len(points) - 1) / rate)
        matrix = np.eye(4) if placement is None else np.asarray(placement)
        self.position: Array = points @ matrix[:3, :3].T + matrix[:3, 3]
        self.velocity, self.velocity_error = estimate_velocities(
            self.position, rate, ACCEL, SPEED, MARKER_ERROR
        )

    def _publish_sample(self, sink: ObstacleSink, index: int, stamp: float) -> None:
        publish_person(
            sink,
            self.name,
            stamp,
            self.position[index],
            self.velocity[index],
            self.velocity_error[index],
            position_error=MARKER_ERROR,
            accel=ACCEL,
            speed=SPEED,
        )


def place_recording(path: str | Path) -> Recording:
    """A recorded person beside an arm whose base is at the origin.

    People in recordings stood at a small table with the arm on it. Arms differ, and so would the
    people's places: here they stand `SETBACK` farther away, along -y.
    """
    placement = np.eye(4)
    placement[1, 3] = -SETBACK
    return Recording(path, placement=placement)


def estimate_velocities(
    position: Array, rate: float, accel: float, speed: float, position_error: float
) -> tuple[Array, Array]:
    """Velocities from past samples, with proved errors.

    The mean velocity over the last h seconds differs from the present one by at most A h / 2, and
    its two ends may be off by δp each.

    Args:
        position: NaN where a point was not seen, in [m]. Shape (frames, n, 3).
        rate: In [Hz].
        accel: Bound on accelerations, in [m]/[s²].
        speed: Bound on speeds, in [m]/[s]: the error of velocity 0, where nothing is better.
        position_error: In [m].

    Returns:
        Velocities, NaN where the point was not seen, in [m]/[s], and their errors. Shapes
        (frames, n, 3) and (frames, n).
    """
    seen: Flags = np.all(np.isfinite(position), axis=2)
    velocity = np.where(np.isnan(position), np.nan, 0.0)
    error = np.full(seen.shape, speed)

    def error_of(lag: int) -> float:
        return accel * lag / rate / 2.0 + 2.0 * position_error * rate / lag

    best = rate * 2.0 * math.sqrt(position_error / accel)
    longest = min(max(1, math.floor(best)), max(1, math.ceil(best)), key=error_of)
    unbroken = seen
    for lag in range(1, min(longest, len(position) - 1) + 1):
        unbroken = unbroken[1:] & seen[:-lag]
        if error_of(lag) < speed:  # and less than that of shorter lags
            rows, columns = np.nonzero(unbroken)
            rows += lag
            change = position[rows, columns] - position[rows - lag, columns]
            velocity[rows, columns] = change * rate / lag
            error[rows, columns] = error_of(lag)
    return velocity, error


def read_vicon_csv(path: Path) -> tuple[float, Array]:
    """The rate in [Hz] and the tracked points in [m], NaN where not seen. Shape (frames, 9, 3).

    Raises:
        ArmguardError: The file cannot be read or is malformed.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ArmguardError(str(path), f"cannot be read: {error}") from error
    lines = text.split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise ArmguardError(str(path), "is empty", expected="motion capture exported as CSV")
    rows = [line.split(",") for line in lines]
    rate, bodies = _check_header(path, rows)
    if len(rows) == _HEADER_LINES:
        raise _bad(path, _HEADER_LINES, "is the last line", "a line for each frame after it")
    width = 2 + len(_AXES) * len(bodies)
    frames = np.empty((len(rows) - _HEADER_LINES, len(bodies), 3))
    first = rows[_HEADER_LINES][0]
    if not first.isdecimal():
        raise _bad(path, _HEADER_LINES + 1, f"has {first!r} for Frame", "a whole number")
    for index, row in enumerate(rows[_HEADER_LINES:]):
        line = _HEADER_LINES + 1 + index
        if len(row) != width:
            raise _bad(path, line, f"has {len(row)} cells", f"{width}")
        if row[0] != str(int(first) + index):
            raise _bad(path, line, f"is frame {row[0]}", f"frame {int(first) + index}")
        for number, body in enumerate(bodies):
            start = 2 + number * len(_AXES)
            frames[index, number] = _read_point(path, line, body, row[start : start + len(_AXES)])
    order = [bodies.index(point) for point in POINTS]
    return rate, 1e-3 * frames[:, order]


def _check_header(path: Path, rows: list[list[str]]) -> tuple[float, list[str]]:
    """Rate in [Hz], and the bodies in the order of their columns.

    The third line has names above every sixth column from the third on, as in
    `Global Angle hip:hip`.
    """
    if rows[0] != ["Objects"]:
        raise _bad(path, 1, f"is {','.join(rows[0])[:40]!r}", "the header 'Objects'")
    if len(rows) < _HEADER_LINES:
        raise _bad(path, len(rows) + 1, "is missing", "a header of five lines")
    rate = _read_number(",".join(rows[1]))
    if not (0.0 < rate < math.inf):
        raise _bad(path, 2, f"is {','.join(rows[1])[:40]!r}", "the rate in Hz")
    named = {column: cell.rpartition(":")[2] for column, cell in enumerate(rows[2], 1) if cell}
    bodies = list(named.values())
    if sorted(bodies) != sorted(POINTS):
        raise _bad(path, 3, f"names {', '.join(bodies)}", f"once each: {', '.join(POINTS)}")
    if list(named) != [3 + len(_AXES) * place for place in range(len(bodies))]:
        raise _bad(path, 3, f"has names in columns {list(named)}", "every sixth, from 3 on")
    wanted = {
        4: ["Frame", "Sub Frame", *_AXES * len(bodies)],
        5: ["", "", *_UNITS * len(bodies)],
    }
    for line, cells in wanted.items():
        found = rows[line - 1]
        for column, (got, want) in enumerate(itertools.zip_longest(found, cells), start=1):
            if got != want:
                raise _bad(path, line, f"has {got!r} in column {column}", repr(want))
    return rate, bodies


def _read_point(path: Path, line: int, body: str, cells: list[str]) -> list[float]:
    """Translation in [mm], NaN where the six cells are empty."""
    if not any(cells):
        return [math.nan] * 3
    values = []
    for axis, cell in zip(_AXES, cells, strict=True):
        value = _read_number(cell)
        if not math.isfinite(value):
            raise _bad(
                path,
                line,
                f"has {cell!r} for {body} {axis}",
                "a finite number, or six empty cells for a hidden body",
            )
        values.append(value)
    return values[3:]


def _read_number(cell: str) -> float:
    """A number, NaN where it is none; Python by itself would take 1_000 as well."""
    try:
        return math.nan if "_" in cell else float(cell)
    except ValueError:
        return math.nan


def _bad(path: Path, line: int, problem: str, expected: str) -> ArmguardError:
    return ArmguardError(f"{path}: line {line}", problem, expected=expected)
