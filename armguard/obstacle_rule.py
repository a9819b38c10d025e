"""The compiled rule that takes or refuses samples of obstacles.

It knows no names: it sees rows of the table, numbers, and the number of the source that speaks.
What it refuses it keeps beside the accepted state, for both may be true; several refused samples
in a row that agree with each other become the accepted track.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armguard.anchors import allows_anchor
from armguard.compilation import kernel
from armguard.obstacle_table import Marks, Samples, States, note_row
from armguard.plausibility import (
    ALLOWED,
    SHAPE,
    SLACK,
    VELOCITY_BY_ACCEL,
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
TOO_FAST = 13
NOT_FINITE = 20
"""Plus the number of the field; NEGATIVE alike."""
NEGATIVE = 30
FIELDS = ("position", "velocity", "radius", "accel", "speed", "position_error", "velocity_error")


@kernel
def _move_to_world(samples: Samples, i: int, rotation: FloatArray, translation: FloatArray) -> None:
    moved = np.empty((2, 3))
    for k in range(samples.points.shape[1]):
        for axis in range(3):
            moved[0, axis] = translation[axis]
            moved[1, axis] = 0.0
            for other in range(3):
                moved[0, axis] += rotation[axis, other] * samples.points[i, k, other]
                moved[1, axis] += rotation[axis, other] * samples.velocities[i, k, other]
        for axis in range(3):
            samples.points[i, k, axis] = moved[0, axis]
            samples.velocities[i, k, axis] = moved[1, axis]


@kernel
def _find_scalar_flaw(field: int, value: float, may_be_infinite: bool) -> int:
    if not (abs(value) < math.inf or (may_be_infinite and value == math.inf)):
        return NOT_FINITE + field
    if not value >= 0.0:
        return NEGATIVE + field
    return TAKEN


@kernel
def _find_flaw(samples: Samples, i: int, speed_is_error: bool) -> tuple[int, float]:
    """Code and value of the first field that cannot be used as it is; TAKEN if all can."""
    flaw = _find_scalar_flaw(2, samples.radius[i], False)
    if flaw != TAKEN:
        return flaw, samples.radius[i]
    flaw = _find_scalar_flaw(3, samples.accel[i], True)
    if flaw != TAKEN:
        return flaw, samples.accel[i]
    flaw = _find_scalar_flaw(4, samples.speed[i], True)
    if flaw != TAKEN:
        return flaw, samples.speed[i]
    flaw = _find_scalar_flaw(5, samples.position_error[i], False)
    if flaw != TAKEN:
        return flaw, samples.position_error[i]
    flaw = _find_scalar_flaw(6, samples.velocity_error[i], speed_is_error)
    if flaw != TAKEN:
        return flaw, samples.velocity_error[i]
    top_speed = samples.speed[i] + samples.velocity_error[i]
    fastest = 0.0
    for k in range(samples.points.shape[1]):
        square = 0.0
        for axis in range(3):
            position = samples.points[i, k, axis]
            velocity = samples.velocities[i, k, axis]
            if not abs(position) < math.inf:
                return NOT_FINITE, position
            if not abs(velocity) < math.inf:
                return NOT_FINITE + 1, velocity
            square += velocity * velocity
        fastest = max(fastest, math.sqrt(square))
    if not (fastest < math.inf and fastest <= top_speed * (1.0 + SLACK)):
        return TOO_FAST, fastest
    return TAKEN, 0.0


@kernel
def _write(states: States, row: int, samples: Samples, i: int, stamp: float) -> None:
    count = samples.points.shape[1]
    states.points[row] = 0.0
    states.velocities[row] = 0.0
    for k in range(count):
        for axis in range(3):
            states.points[row, k, axis] = samples.points[i, k, axis]
            states.velocities[row, k, axis] = samples.velocities[i, k, axis]
    states.point_count[row] = count
    states.radius[row] = samples.radius[i]
    states.accel[row] = samples.accel[i]
    states.speed[row] = samples.speed[i]
    states.position_error[row] = samples.position_error[i]
    states.velocity_error[row] = samples.velocity_error[i]
    states.stamp[row] = stamp


@kernel
def _widen(states: States, row: int, samples: Samples, i: int) -> bool:
    """Take the larger of two descriptions that agree and have the same stamp; whether it grew."""
    grew = False
    for known, told in (
        (states.radius, samples.radius),
        (states.accel, samples.accel),
        (states.speed, samples.speed),
        (states.position_error, samples.position_error),
        (states.velocity_error, samples.velocity_error),
    ):
        if told[i] > known[row]:
            known[row] = told[i]
            grew = True
    return grew


@kernel
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


@kernel
def _largest_step(before: FloatArray, after: FloatArray) -> float:
    largest = 0.0
    for k in range(min(before.shape[0], after.shape[0])):
        square = 0.0
        for axis in range(3):
            square += (after[k, axis] - before[k, axis]) ** 2
        largest = max(largest, math.sqrt(square))
    return largest


@kernel
def _set_aside(
    accepted: States,
    refused: States,
    marks: Marks,
    row: int,
    samples: Samples,
    i: int,
    stamp: float,
    code: int,
    value: float,
) -> tuple[int, float]:
    """Keep a sample beside the accepted state, unless it makes another track believable.

    Returns:
        Its final code, and the value that a fault would show.
    """
    if code >= NOT_FINITE or code in (TOO_FAST, FOREIGN):
        marks.streak[row] = 0
        marks.refused[row] = True
        marks.refused_finite[row] = code < NOT_FINITE
        _write(refused, row, samples, i, stamp)
        return code, value
    known = marks.streak[row] > 0
    follows = known and _allows(refused, row, samples, i, stamp) == ALLOWED
    if follows and stamp > refused.stamp[row]:
        marks.streak[row] += 1
        _write(refused, row, samples, i, stamp)
    elif not follows and not (known and marks.refused[row] and code == LATE):
        # A late message must not hide a track that is about to be believed.
        marks.streak[row] = 1
        _write(refused, row, samples, i, stamp)
    if code == VELOCITY_BY_ACCEL:
        value = _largest_step(accepted.velocities[row], samples.velocities[i])
    elif code == SHAPE:
        value = float(samples.points.shape[1])
    else:
        value = _largest_step(accepted.points[row], samples.points[i])
    if marks.streak[row] >= TRACK_SAMPLES:
        code = TRACK_CHANGED
    elif code != LATE:
        marks.refused[row] = True
        marks.refused_finite[row] = True
    return code, value


@kernel
def take_samples(
    handle: Any,
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
        handle: On the table's `Rows`; written. News are whatever anchors do not allow for.
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
    table = handle.content
    accepted, refused, marks = table.accepted, table.refused, table.marks
    news, anchors = table.news, table.anchors
    taken = 0
    for i in range(rows.shape[0]):
        if rows[i] < 0:
            continue
        if not in_world:
            _move_to_world(samples, i, rotation, translation)
            samples.position_error[i] += frame_error
        row = rows[i]
        code, value = _find_flaw(samples, i, speed_is_error)
        if code == TAKEN and marks.owner[row] != source:
            code = FOREIGN
        elif code == TAKEN and marks.has_state[row]:
            code = _allows(accepted, row, samples, i, stamp)
            if code == ALLOWED and not stamp > accepted.stamp[row]:
                code = LATE
                if stamp == accepted.stamp[row] and _widen(accepted, row, samples, i):
                    marks.revision[row] += 1
                    note_row(news, row)
        if code != TAKEN:
            code, value = _set_aside(accepted, refused, marks, row, samples, i, stamp, code, value)
        # A late sample that agrees is no news, unless it became the refused one that counts.
        is_news = marks.refused[row] if code == LATE else True
        codes[i] = code
        values[i] = value
        if code == TAKEN and not marks.refused[row]:
            _write(accepted, row, samples, i, stamp)
            marks.has_state[row] = True
            marks.streak[row] = 0
            marks.revision[row] += 1
            taken += 1
            allowed, grown = allows_anchor(accepted, anchors, row, row)
            is_news = grown or not allowed
        elif code in (TAKEN, TRACK_CHANGED):
            _write(accepted, row, samples, i, stamp)
            marks.has_state[row] = True
            marks.refused[row] = False
            marks.streak[row] = 0
            marks.revision[row] += 1
            taken += 1
        if is_news:
            note_row(news, row)
    return taken
