"""The compiled rule that takes or refuses samples of obstacles.

It knows no names: it sees rows of the table, numbers, and the number of the source that speaks.
What it refuses it keeps beside the accepted state, for both may be true; several refused samples
in a row that agree with each other become the accepted track.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from armguard.obstacle_table import Marks, Samples, States
from armguard.plausibility import (
    ALLOWED,
    SHAPE,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
    body_allows,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TRACK_SAMPLES = 5
"""So many consecutive samples that agree with each other make another track believable."""

TAKEN = 0
"""Codes 1 to 5 are those of `plausibility.body_allows`; these are the rule's own."""
LATE = 10
FOREIGN = 11
TRACK_CHANGED = 12
NOT_FINITE = 20
"""Plus the number of the field; NEGATIVE alike."""
NEGATIVE = 30
FIELDS = ("position", "velocity", "radius", "accel", "speed", "position_error", "velocity_error")


@njit(error_model="numpy", cache=True)
def _move_to_world(
    samples: Samples, sample: int, rotation: FloatArray, translation: FloatArray
) -> None:
    for k in range(samples.points.shape[1]):
        for vectors, offset in ((samples.points, 1.0), (samples.velocities, 0.0)):
            x, y, z = vectors[sample, k]
            for axis in range(3):
                turned = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
                vectors[sample, k, axis] = turned + offset * translation[axis]


@njit(error_model="numpy", cache=True)
def _find_flaw(samples: Samples, i: int, speed_is_error: bool) -> tuple[int, float]:
    """Code and value of the first field that cannot be used as it is; TAKEN if all can."""
    for field, vectors in ((0, samples.points), (1, samples.velocities)):
        for value in vectors[i].flat:
            if not abs(value) < math.inf:
                return NOT_FINITE + field, value
    for field, value, top in (
        (2, samples.radius[i], math.inf),
        (3, samples.accel[i], 0.0),
        (4, samples.speed[i], 0.0),
        (5, samples.position_error[i], math.inf),
        (6, samples.velocity_error[i], 0.0 if speed_is_error else math.inf),
    ):
        # A limit of 0 marks the fields that may be infinite.
        if not (value < top or (top == 0.0 and value <= math.inf)):
            return NOT_FINITE + field, value
        if not value >= 0.0:
            return NEGATIVE + field, value
    top_speed = samples.speed[i] + samples.velocity_error[i]
    for k in range(samples.points.shape[1]):
        x, y, z = samples.velocities[i, k]
        rate = math.sqrt(x * x + y * y + z * z)
        if not (rate < math.inf and rate <= top_speed * (1.0 + 1e-15)):
            return VELOCITY_BY_SPEED, rate
    return TAKEN, 0.0


@njit(error_model="numpy", cache=True)
def _write(states: States, row: int, samples: Samples, i: int, stamp: float) -> None:
    count = samples.points.shape[1]
    states.points[row, :count] = samples.points[i]
    states.velocities[row, :count] = samples.velocities[i]
    states.point_count[row] = count
    states.radius[row] = samples.radius[i]
    states.accel[row] = samples.accel[i]
    states.speed[row] = samples.speed[i]
    states.position_error[row] = samples.position_error[i]
    states.velocity_error[row] = samples.velocity_error[i]
    states.stamp[row] = stamp


@njit(error_model="numpy", cache=True)
def _allows(states: States, row: int, samples: Samples, i: int, stamp: float) -> int:
    """`body_allows` between a stored state and a sample.

    A larger radius is a change of description, which a source may make at any time; it says
    nothing against the motion.
    """
    return body_allows(
        states.points[row],
        states.velocities[row],
        states.point_count[row],
        states.radius[row],
        states.accel[row],
        states.speed[row],
        states.position_error[row],
        states.velocity_error[row],
        states.stamp[row],
        samples.points[i],
        samples.velocities[i],
        samples.points.shape[1],
        min(samples.radius[i], states.radius[row]),
        samples.position_error[i],
        samples.velocity_error[i],
        stamp,
    )


@njit(error_model="numpy", cache=True)
def _largest_step(before: FloatArray, after: FloatArray) -> float:
    largest = 0.0
    for k in range(min(before.shape[0], after.shape[0])):
        square = 0.0
        for axis in range(3):
            square += (after[k, axis] - before[k, axis]) ** 2
        largest = max(largest, math.sqrt(square))
    return largest


@njit(error_model="numpy", cache=True)
def _take(
    accepted: States,
    refused: States,
    marks: Marks,
    row: int,
    samples: Samples,
    i: int,
    stamp: float,
    source: int,
    speed_is_error: bool,
) -> tuple[int, float]:
    """Judge one sample of one row: its code, and the value that a fault would show."""
    flaw, value = _find_flaw(samples, i, speed_is_error)
    if flaw != TAKEN or marks.owner[row] != source:
        marks.refused[row] = True
        marks.refused_finite[row] = flaw in (TAKEN, VELOCITY_BY_SPEED)
        marks.streak[row] = 0
        _write(refused, row, samples, i, stamp)
        return (FOREIGN, 0.0) if flaw == TAKEN else (flaw, value)
    code = ALLOWED
    takes = True
    if marks.has_state[row]:
        code = _allows(accepted, row, samples, i, stamp)
        takes = code == ALLOWED and stamp > accepted.stamp[row]
    if not takes:
        known = marks.streak[row] > 0
        follows = known and _allows(refused, row, samples, i, stamp) == ALLOWED
        if follows and stamp > refused.stamp[row]:
            marks.streak[row] += 1
            _write(refused, row, samples, i, stamp)
        elif not follows and not (known and marks.refused[row] and code == ALLOWED):
            # A late message must not hide a track that is about to be believed.
            marks.streak[row] = 1
            _write(refused, row, samples, i, stamp)
        if marks.streak[row] < TRACK_SAMPLES:
            if code == ALLOWED:
                return LATE, 0.0
            marks.refused[row] = True
            marks.refused_finite[row] = True
            if code == SHAPE:
                return code, float(samples.points.shape[1])
            if code == VELOCITY_BY_ACCEL:
                return code, _largest_step(accepted.velocities[row], samples.velocities[i])
            return code, _largest_step(accepted.points[row], samples.points[i])
        code = TRACK_CHANGED
        value = _largest_step(accepted.points[row], samples.points[i])
    _write(accepted, row, samples, i, stamp)
    marks.has_state[row] = True
    marks.refused[row] = False
    marks.streak[row] = 0
    marks.revision[row] += 1
    return code, value


@njit(error_model="numpy", cache=True)
def take_samples(
    accepted: States,
    refused: States,
    marks: Marks,
    rows: IntArray,
    samples: Samples,
    stamp: float,
    source: int,
    speed_is_error: bool,
    rotation: FloatArray,
    translation: FloatArray,
    frame_error: float,
    in_world: bool,
    codes: IntArray,
    values: FloatArray,
) -> int:
    """Take or refuse the samples of one call.

    Args:
        accepted: The table's accepted states; written.
        refused: The table's refused samples; written.
        marks: The table's marks; written.
        rows: Row of each sample, -1 to leave it alone. Shape (n,).
        samples: The samples; moved to the world frame in place.
        stamp: Of all of them, in [s].
        source: Number of the source that speaks.
        speed_is_error: Whether velocities were not measured, so that an error of inf is no flaw.
        rotation: R_WF of the samples' frame. Shape (3, 3).
        translation: p_WF, in [m]. Shape (3,).
        frame_error: What the frame may be off by, in [m].
        in_world: Whether the samples are in the world frame already.
        codes: Filled with TAKEN, or why not; left alone where the row is -1. Shape (n,).
        values: Filled with what a fault would show. Shape (n,).

    Returns:
        How many samples were accepted.
    """
    taken = 0
    for i in range(rows.shape[0]):
        if rows[i] < 0:
            continue
        if not in_world:
            _move_to_world(samples, i, rotation, translation)
            samples.position_error[i] += frame_error
        codes[i], values[i] = _take(
            accepted, refused, marks, rows[i], samples, i, stamp, source, speed_is_error
        )
        if codes[i] == TAKEN or codes[i] == TRACK_CHANGED:
            taken += 1
    return taken
