"""The compiled rule that accepts or refuses samples of obstacles.

It works on rows of the table, without names. Refused samples are kept in addition to the accepted
state, since each may be true (`possible_states`). Track confirmation chooses the accepted track. If
several consecutive refused samples agree with each other and are newer than the accepted track,
they replace it. The replaced track stays possible, as a refused sample does. Of two samples, the
older one determines what the newer one may be, whichever arrived first. A late sample that agrees
changes nothing; one that disagrees is refused.

A sample that contradicts the accepted state slightly may come from a body that broke its bounds.
Then 1.5 times the observed values count as its bounds for a while.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import (
    ACCEPTANCE_SLACK,
    ALLOWED,
    SHAPE,
    SUM_ROUNDING,
    VELOCITY_BY_ACCEL,
)
from armguard.obstacles.broken_bounds import (
    BROKEN_FACTOR,
    MAXIMUM_ACCEL,
    MAXIMUM_SPEED,
    begin_break,
    count_as_moved,
    count_bounds,
    has_moved,
    measure_bounds,
)
from armguard.obstacles.consistency import (
    body_allows,
    clearly_allows,
    find_broken_bound,
    find_square_limit,
)
from armguard.obstacles.message import HAS_REGIONS, Frames, MessageHead
from armguard.obstacles.possible_states import (
    drop_state,
    drop_undecided,
    let_stand,
    let_undecided_stand,
    lose_sight,
)
from armguard.obstacles.record import Record
from armguard.obstacles.reference_states import allows_reference_state
from armguard.obstacles.regions import NO_REGION
from armguard.obstacles.spread import follow_spread
from armguard.obstacles.table import MOST_REFUSED, States, Told, copy_state, note_row

CONFIRMING_SAMPLES = 5
"""Number of consecutive samples that confirm another track if they agree with each other."""

REJOINED_WITHIN = 0.05
"""After a longer pause, in [s], a sample that may follow a refused one says little about it."""

TOLD_FOR = 0.2
"""How long, in [s], bounds that were told of a body count in deciding whether its samples agree, at
the least: a source may narrow them while messages are under way. That is leniency in what is
refused, never in what is proved: each certificate is tested by the bounds that it rests on."""

RESOLUTION = 1e-9
"""What positions and velocities are off by at the least, in [m] and [m/s]: numbers that a source
has summed up step by step are off by rounding, though it calls them exact. Smaller errors become
this large, so that what is accepted is also reckoned with."""

LARGEST = sys.float_info.max

TAKEN = 0
"""Codes 1 to 5 are those of `consistency.body_allows`; these are the rule's own."""
LATE = 10
TRACK_CHANGED = 12
TOO_FAST = 13
TOO_FAR = 14
NOT_FINITE = 20
"""Plus the number of the field; so are NEGATIVE and TOO_LARGE."""
NEGATIVE = 30
TOO_LARGE = 40
FIELDS = ("position", "velocity", "radius", "accel", "speed", "position_error", "velocity_error")


@kernel
def _move_to_world(sample: States, frames: Frames, frame: int) -> None:
    rotation, translation = frames.rotation, frames.translation
    for k in range(sample.point_count[0]):
        x, y, z = sample.points[0, k, 0], sample.points[0, k, 1], sample.points[0, k, 2]
        u, v, w = (
            sample.velocities[0, k, 0],
            sample.velocities[0, k, 1],
            sample.velocities[0, k, 2],
        )
        for axis in range(3):
            a, b, c = rotation[frame, axis, 0], rotation[frame, axis, 1], rotation[frame, axis, 2]
            sample.points[0, k, axis] = translation[frame, axis] + a * x + b * y + c * z
            sample.velocities[0, k, axis] = a * u + b * v + c * w


@merged_kernel
def _is_flawless(sample: States, speed_is_error: bool, extent: float) -> bool:
    """Whether `_find_flaw` certainly finds nothing, tested without square roots."""
    accel, speed = sample.accel[0], sample.speed[0]
    velocity_error = sample.velocity_error[0]
    if not (
        0.0 <= sample.radius[0] < math.inf
        and 0.0 <= sample.position_error[0] < math.inf
        and (0.0 <= velocity_error < math.inf or (speed_is_error and velocity_error == math.inf))
        and (0.0 <= accel <= MAXIMUM_ACCEL or accel == math.inf)
        and (0.0 <= speed <= MAXIMUM_SPEED or speed == math.inf)
    ):
        return False
    limit, reach = find_square_limit(speed + velocity_error), min(extent, LARGEST)
    for k in range(sample.point_count[0]):
        square = 0.0
        for axis in range(3):
            if not abs(sample.points[0, k, axis]) <= reach:
                return False
            square += sample.velocities[0, k, axis] ** 2
        if not square < limit:
            return False
    return True


@kernel
def _find_flaw(sample: States, speed_is_error: bool, extent: float) -> tuple[int, float]:
    """Code and value of the first unusable field; TAKEN if all are usable."""
    for field, value, may_be_infinite in (
        (2, sample.radius[0], False),
        (3, sample.accel[0], True),
        (4, sample.speed[0], True),
        (5, sample.position_error[0], False),
        (6, sample.velocity_error[0], speed_is_error),
    ):
        if not (abs(value) < math.inf or (may_be_infinite and value == math.inf)):
            return NOT_FINITE + field, value
        if not value >= 0.0:
            return NEGATIVE + field, value
    if MAXIMUM_ACCEL < sample.accel[0] < math.inf:
        return TOO_LARGE + 3, sample.accel[0]
    if MAXIMUM_SPEED < sample.speed[0] < math.inf:
        return TOO_LARGE + 4, sample.speed[0]
    top_speed = sample.speed[0] + sample.velocity_error[0]
    largest = 0.0
    for k in range(sample.point_count[0]):
        square = 0.0
        for axis in range(3):
            position = sample.points[0, k, axis]
            velocity = sample.velocities[0, k, axis]
            if not abs(position) < math.inf:
                return NOT_FINITE, position
            if not abs(velocity) < math.inf:
                return NOT_FINITE + 1, velocity
            if not abs(position) <= extent:
                return TOO_FAR, position
            square += velocity * velocity
        largest = max(largest, square)
    fastest = math.sqrt(largest)
    if not (fastest < math.inf and fastest <= top_speed * (1.0 + ACCEPTANCE_SLACK)):
        return TOO_FAST, fastest
    return TAKEN, 0.0


@merged_kernel
def _write(states: States, row: int, sample: States) -> None:
    """Replace a state by the sample; where it has no points there are zeros."""
    count = sample.point_count[0]
    for k in range(count, states.points.shape[1]):
        for axis in range(3):
            states.points[row, k, axis] = states.velocities[row, k, axis] = 0.0
    for k in range(count):
        for axis in range(3):
            states.points[row, k, axis] = sample.points[0, k, axis]
            states.velocities[row, k, axis] = sample.velocities[0, k, axis]
    states.point_count[row] = count
    states.radius[row] = sample.radius[0]
    states.accel[row] = sample.accel[0]
    states.speed[row] = sample.speed[0]
    states.position_error[row] = sample.position_error[0]
    states.velocity_error[row] = sample.velocity_error[0]
    states.stamp[row] = sample.stamp[0]


@kernel
def _keep_surer(sample: States, accepted: States, row: int, accel: float) -> None:
    """Replace values of a newer sample that are less precise than the accepted state still is.

    Both hold within their errors, so the truth lies in what both allow. After a time h a velocity
    is within dv + A h of v, and a point within dp + (dv + A h / 2) h of x + v h, with the errors dp
    and dv of the accepted state. Whichever error is smaller counts, of velocities and of points by
    themselves. The sample's bounds hold from its stamp on.

    A sample with another radius may describe the body by other points. One with a smaller radius
    says nothing against the larger body of before, of which all counts that is known, or nothing:
    it does if that body is within less room around its points, and its velocities are surer. A
    larger radius is taken as the sample has it, for the body may have grown.

    Args:
        sample: Written.
        accepted: Accepted states.
        row: Of the body.
        accel: What its acceleration was at most in between, in [m/s²].
    """
    radius = accepted.radius[row]
    if not (accel < math.inf and sample.radius[0] <= radius):
        return
    before, stamp = accepted.stamp[row], sample.stamp[0]
    elapsed = stamp - before
    duration = elapsed + ACCEPTANCE_SLACK * (abs(before) + abs(stamp))
    change = accel * duration
    velocity_error = accepted.velocity_error[row]
    position_error = accepted.position_error[row] + (velocity_error + 0.5 * change) * duration
    size = 0.0
    for k in range(sample.point_count[0]):
        for axis in range(3):
            moved = accepted.velocities[row, k, axis] * duration
            size = max(size, abs(accepted.points[row, k, axis]) + abs(moved))
    position_error += SUM_ROUNDING * (position_error + size)
    velocity_error = (velocity_error + change) * (1.0 + SUM_ROUNDING)
    is_closer = position_error + radius < sample.position_error[0] + sample.radius[0]
    is_surer = velocity_error < sample.velocity_error[0]
    if sample.radius[0] < radius:
        is_closer = is_surer = is_closer and is_surer
    if is_closer:
        sample.position_error[0], sample.radius[0] = position_error, radius
        for k in range(sample.point_count[0]):
            for axis in range(3):
                moved = accepted.velocities[row, k, axis] * elapsed
                sample.points[0, k, axis] = accepted.points[row, k, axis] + moved
    if is_surer:
        sample.velocity_error[0] = velocity_error
        for k in range(sample.point_count[0]):
            for axis in range(3):
                sample.velocities[0, k, axis] = accepted.velocities[row, k, axis]


@kernel
def _widen(states: States, row: int, sample: States) -> bool:
    """Use the larger of two agreeing descriptions with the same stamp; returns whether it grew."""
    grew = False
    for known, told in (
        (states.radius, sample.radius),
        (states.accel, sample.accel),
        (states.speed, sample.speed),
        (states.position_error, sample.position_error),
        (states.velocity_error, sample.velocity_error),
    ):
        if told[0] > known[row]:
            known[row] = told[0]
            grew = True
    return grew


@kernel
def _agrees(states: States, row: int, sample: States, accel: float, speed: float) -> int:
    """`body_allows` between a stored state and a sample, the older of which is record 0.

    A larger radius is a change of description, which a source may make at any time; it says
    nothing against the motion.

    Args:
        states: Where the stored state stands.
        row: Its row.
        sample: The sample, in the first place.
        accel: Bound on acceleration recently stated for this body, in [m/s²].
        speed: Bound on speed recently stated for this body, in [m/s].
    """
    stored, told = Record(states, row, 0.0, 0.0, 0.0), Record(sample, 0, 0.0, 0.0, 0.0)
    older, newer = (stored, told) if sample.stamp[0] >= states.stamp[row] else (told, stored)
    accel = max(accel, older.states.accel[older.row])
    speed = max(speed, older.states.speed[older.row])
    largest = older.states.radius[older.row]
    radius = min(largest, newer.states.radius[newer.row])
    return find_broken_bound(
        Record(older.states, older.row, largest, accel, speed),
        Record(newer.states, newer.row, radius, accel, speed),
    )


@merged_kernel
def _remember_bounds(told: Told, row: int, sample: States) -> None:
    """Store a sample's bounds, which count for the next `TOLD_FOR` seconds."""
    stamp = sample.stamp[0]
    elapsed = stamp - told.since[row]
    if not elapsed <= TOLD_FOR:
        recent = elapsed <= 2.0 * TOLD_FOR
        told.accel_before[row] = told.accel[row] if recent else 0.0
        told.speed_before[row] = told.speed[row] if recent else 0.0
        told.accel[row] = told.speed[row] = 0.0
        told.since[row] = stamp
    told.accel[row] = max(told.accel[row], sample.accel[0])
    told.speed[row] = max(told.speed[row], sample.speed[0])


@kernel
def _largest_step(before: FloatArray, after: FloatArray, count: int) -> float:
    largest = 0.0
    for k in range(min(before.shape[0], count)):
        square = 0.0
        for axis in range(3):
            square += (after[k, axis] - before[k, axis]) ** 2
        largest = max(largest, math.sqrt(square))
    return largest


@kernel
def _find_told_bounds(told: Told, row: int, sample: States) -> tuple[float, float]:
    """The largest bounds that a sample or recent samples state, in [m/s²] and [m/s]."""
    accel = max(told.accel[row], told.accel_before[row], sample.accel[0])
    speed = max(told.speed[row], told.speed_before[row], sample.speed[0])
    return accel, speed


@kernel
def _can_move_so(accel: float, speed: float, most_accel: float, most_speed: float) -> bool:
    """Whether a body can move so, in [m/s²] and [m/s]; inf: unknown."""
    return max(accel, speed) < math.inf and accel <= most_accel and speed <= most_speed


@kernel
def _note_break(handle: Any, row: int, sample: States) -> None:
    """Mark a refused sample as undecided if a body could have moved so since the sample before it.

    The sample before it is the last refused one, or else the accepted one. A body that the arm
    pushes is excluded: its motion says nothing about its own bounds.
    """
    table = handle.content
    breaks, marks, limits = table.breaks, table.marks, table.body_limits
    accepted, candidates = table.accepted, table.candidates
    if marks.touched[row]:
        return
    accel, speed = _find_told_bounds(table.told, row, sample)
    most_accel, most_speed = max(accel, limits[1]), max(speed, limits[0])
    if marks.confirmations[row] > 0:
        seen_accel, seen_speed = measure_bounds(candidates, row, sample)
        if _can_move_so(seen_accel, seen_speed, most_accel, most_speed):
            if seen_accel > accel or seen_speed > speed:
                begin_break(breaks, row, candidates, row, sample, accel, speed)
            return
    if marks.has_state[row] and not marks.static[row]:
        seen_accel, seen_speed = measure_bounds(accepted, row, sample)
        is_possible = _can_move_so(seen_accel, seen_speed, most_accel, most_speed)
        if is_possible and (seen_accel > accel or seen_speed > speed):
            begin_break(breaks, row, accepted, row, sample, accel, speed)


@kernel
def _decide_break(handle: Any, row: int, sample: States) -> None:
    """Use one of the samples that decide whether a body really moved when it broke its bounds.

    If it did, its wider bounds count for this sample and for later ones for a while. In both cases
    the states that only represented this possibility are dropped.
    """
    table = handle.content
    breaks, marks, refusals = table.breaks, table.marks, table.refusals
    breaks.latest[row] = sample.stamp[0]
    breaks.further[row] -= 1
    if breaks.further[row] > 0:
        return
    if has_moved(breaks, row, sample):
        stamp = sample.stamp[0]
        count_as_moved(breaks, row, stamp, breaks.accel[row], breaks.speed[row])
        count_bounds(sample, breaks.moved_accel[row], breaks.moved_speed[row])
    if drop_undecided(marks, table.refused, refusals, row):
        marks.revision[row] += 1
        note_row(table.changed_rows, row)


@kernel
def _count_slow_break(handle: Any, row: int, sample: States) -> bool:
    """Count what an accepted sample shows beyond its reference state, if a body can move so.

    Returns:
        Whether it may have broken its bounds, in steps that each kept them within the errors.
    """
    table = handle.content
    if table.marks.touched[row]:
        return True
    breaks, accepted, limits = table.breaks, table.accepted, table.body_limits
    accel, speed = _find_told_bounds(table.told, row, sample)
    seen_accel, seen_speed = measure_bounds(table.reference_states, row, sample)
    if not _can_move_so(seen_accel, seen_speed, max(accel, limits[1]), max(speed, limits[0])):
        return False
    seen_accel = BROKEN_FACTOR * seen_accel if seen_accel > accel else 0.0
    seen_speed = BROKEN_FACTOR * seen_speed if seen_speed > speed else 0.0
    count_as_moved(breaks, row, sample.stamp[0], seen_accel, seen_speed)
    count_bounds(sample, breaks.moved_accel[row], breaks.moved_speed[row])
    accepted.accel[row], accepted.speed[row] = sample.accel[0], sample.speed[0]
    return True


@kernel
def _drop_rejoined(handle: Any, row: int, sample: States, accel: float, speed: float) -> None:
    """Drop refused states that are consistent with a sample which will be the accepted one.

    If one of them were the accepted state, the sample would replace it as well. After a long pause,
    bounds allow so much that consistency means little. A state that covers several samples stays: a
    sample consistent with it need not be consistent with each of them.

    Args:
        handle: On the table's `Rows`; written.
        row: Of the body.
        sample: The sample, as it was sent.
        accel: Bound on acceleration that is stated, in [m/s²].
        speed: Bound on speed that is stated, in [m/s].
    """
    table = handle.content
    marks, refused, refusals = table.marks, table.refused, table.refusals
    told = Record(sample, 0, 0.0, accel, speed)
    number = 0
    while number < marks.refused_count[row]:
        place = row * MOST_REFUSED + number
        elapsed = sample.stamp[0] - refused.stamp[place]
        before = Record(refused, place, 0.0, accel, speed)
        is_single = refusals.covers_from[place] == -math.inf
        is_next = is_single and 0.0 < elapsed <= REJOINED_WITHIN
        if is_next and body_allows(before, told) == ALLOWED:
            drop_state(marks, refused, refusals, row, place)
            note_row(table.changed_rows, row)
        else:
            number += 1


@kernel
def _set_aside(handle: Any, row: int, sample: States, code: int, value: float) -> tuple[int, float]:
    """Store a sample in addition to the accepted state, unless it confirms another track.

    Returns:
        Its final code, and the value that a fault would show.
    """
    table = handle.content
    accepted, candidates, marks = table.accepted, table.candidates, table.marks
    if code > TOO_FAST:
        marks.confirmations[row] = 0
        lose_sight(marks, table.refusals, row)
        return code, value
    breaks, stamp = table.breaks, sample.stamp[0]
    late = not stamp > accepted.stamp[row]
    if code != SHAPE:
        _note_break(handle, row, sample)
    is_undecided = breaks.further[row] > 0 and code != SHAPE
    is_believable = value <= sample.speed[0] + sample.velocity_error[0]
    if code == TOO_FAST and not (is_undecided or is_believable):
        # Nothing says that a body moved so.
        marks.confirmations[row] = 0
        if value <= table.body_limits[0]:
            count_bounds(sample, 0.0, BROKEN_FACTOR * value)
        let_stand(marks, table.refused, table.refusals, row, sample, 0)
        return code, value
    accel, speed = sample.accel[0], sample.speed[0]
    if is_undecided:
        accel, speed = max(accel, breaks.accel[row]), max(speed, breaks.speed[row])
    # A candidate track grows by samples that follow its last one, and begins anew with others.
    known = marks.confirmations[row] > 0
    follows = known and _agrees(candidates, row, sample, accel, speed) == ALLOWED
    is_next = bool(0)
    if follows and stamp > candidates.stamp[row]:
        marks.confirmations[row] += 1
        is_next = True
    elif not follows and not (known and late):
        # A late message must not hide a track that is about to be confirmed.
        marks.confirmations[row] = 1
        is_next = True
    # What a fault shows: how far the sample is off the accepted state.
    if code == VELOCITY_BY_ACCEL:
        value = _largest_step(accepted.velocities[row], sample.velocities[0], sample.point_count[0])
    elif code == SHAPE:
        value = float(sample.point_count[0])
    elif code != TOO_FAST:
        value = _largest_step(accepted.points[row], sample.points[0], sample.point_count[0])
    if marks.confirmations[row] >= CONFIRMING_SAMPLES and not late:
        # What was believed until now may be true all the same.
        _drop_rejoined(handle, row, sample, accel, speed)
        let_stand(marks, table.refused, table.refusals, row, accepted, row)
        return TRACK_CHANGED, value
    let_stand(marks, table.refused, table.refusals, row, sample, 0)
    if is_undecided:
        count_bounds(sample, accel, speed)
    if is_next:
        copy_state(sample, 0, candidates, row)
    if is_undecided and is_next:
        # The sample as that of a body that breaks its bounds, in place of the one before it.
        let_undecided_stand(marks, table.refused, table.refusals, row, sample)
    return code, value


@kernel
def _make_exception(
    handle: Any, row: int, sample: States, code: int, value: float
) -> tuple[int, float]:
    """Process a sample that is not simply accepted.

    Returns:
        Its final code, and the value that a fault would show.
    """
    table = handle.content
    accepted, marks, told = table.accepted, table.marks, table.told
    if code == LATE:
        # It changes nothing, unless it describes the very moment of the accepted state.
        is_changed = sample.stamp[0] == accepted.stamp[row] and _widen(accepted, row, sample)
    else:
        # Confirm: it is set aside, or completes another track, and then replaces what was accepted.
        code, value = _set_aside(handle, row, sample, code, value)
        is_changed = True
    if code == TRACK_CHANGED:
        _write(accepted, row, sample)
        marks.has_state[row] = True
        marks.confirmations[row] = 0
    if code in (LATE, TRACK_CHANGED):
        _remember_bounds(told, row, sample)
    if is_changed:
        marks.revision[row] += 1
        note_row(table.changed_rows, row)
    return code, value


@kernel
def take_samples(
    handle: Any,
    message: Any,
    rows: IntArray,
    head: MessageHead,
) -> tuple[int, int, bool]:
    """Accept or refuse the samples of one message.

    Args:
        handle: On the table's `Rows`; written. A row is noted as changed where its
            reference state does not allow for what was written, and where it may be another part of
            a body than was stated before.
        message: On `MessageData`: the samples. Its codes are filled with TAKEN, or why not, and its
            values with what a fault would show.
        rows: Row of each sample, -1 to leave it alone. Shape (n,).
        head: What is said of the whole message.

    Returns:
        How many samples were accepted, how many have another code than TAKEN, and whether of any
        row a refused sample may be true.
    """
    table, data = handle.content, message.content
    points_each, stamp, extent, frame, is_velocity_known = head[:5]
    each, common_radius, common_accel, common_speed, position_error, velocity_error = head[5:]
    accepted, marks, told, breaks = table.accepted, table.marks, table.told, table.breaks
    changed_rows, reference_states = table.changed_rows, table.reference_states
    count = rows.shape[0]
    # One after the other they are copied to where all rules read them, and moved to the world.
    sample = data.sample
    sample.point_count[0] = points_each
    sample.stamp[0] = stamp
    taken = exceptions = 0
    any_refused = False
    for i in range(count):
        row = rows[i]
        if row < 0:
            data.codes[i] = TAKEN
            continue
        # Whatever becomes of the sample, it says which part of a body the row may be.
        regions = data.regions[i] if each & HAS_REGIONS else NO_REGION
        if regions == 0:
            regions = NO_REGION
        has_new_region = (marks.regions[row] | regions) != marks.regions[row]
        if has_new_region:
            marks.regions[row] |= regions
        for k in range(points_each):
            for axis in range(3):
                sample.points[0, k, axis] = data.points[i, k, axis]
                velocity = data.velocities[i, k, axis] if is_velocity_known else 0.0
                sample.velocities[0, k, axis] = velocity
        sample.radius[0] = data.radius[i] if each & 1 else common_radius
        sample.accel[0] = data.accel[i] if each & 2 else common_accel
        sample.speed[0] = data.speed[i] if each & 4 else common_speed
        sample.position_error[0] = data.position_error[i] if each & 8 else position_error
        if not is_velocity_known:
            sample.velocity_error[0] = sample.speed[0]
        else:
            sample.velocity_error[0] = data.velocity_error[i] if each & 16 else velocity_error
        if frame > 0:
            _move_to_world(sample, data.frames, frame)
            sample.position_error[0] += data.frames.position_error[frame]
        # Read: values that cannot be used at all, and errors below what numbers resolve.
        stated_accel, stated_speed = sample.accel[0], sample.speed[0]
        if stamp <= breaks.until[row]:
            breaks.stated_accel[row], breaks.stated_speed[row] = stated_accel, stated_speed
            count_bounds(sample, breaks.moved_accel[row], breaks.moved_speed[row])
        code, value = TAKEN, 0.0
        if not _is_flawless(sample, not is_velocity_known, extent):
            code, value = _find_flaw(sample, not is_velocity_known, extent)
        if code in (TAKEN, TOO_FAST):
            sample.position_error[0] = max(sample.position_error[0], RESOLUTION)
            sample.velocity_error[0] = max(sample.velocity_error[0], RESOLUTION)
            radius, speed = sample.radius[0], sample.speed[0]
            follow_spread(table.spreads, row, Record(sample, 0, radius, stated_accel, speed))
        # Gate: does it agree with the accepted state, by all bounds that were told lately? By these
        # what that says more exactly holds beside the sample.
        is_vaguer, between = bool(0), math.inf
        if code == TAKEN and marks.has_state[row]:
            told_accel = max(told.accel[row], told.accel_before[row])
            told_speed = max(told.speed[row], told.speed_before[row])
            accel = max(told_accel, accepted.accel[row])
            speed = max(told_speed, accepted.speed[row])
            before = Record(accepted, row, accepted.radius[row], accel, speed)
            radius = min(sample.radius[0], accepted.radius[row])
            after = Record(sample, 0, radius, accel, speed)
            if not (stamp > accepted.stamp[row] and clearly_allows(before, after)):
                code = _agrees(accepted, row, sample, told_accel, told_speed)
                if code == ALLOWED and not stamp > accepted.stamp[row]:
                    code = LATE
            is_vaguer = (
                sample.velocity_error[0] > accepted.velocity_error[row]
                or sample.position_error[0] > accepted.position_error[row]
            )
            between = max(accel, sample.accel[0])
        if (
            breaks.further[row] > 0
            and stamp > breaks.latest[row]
            and (code < SHAPE or code == TOO_FAST)
            and breaks.point_index[row] < points_each
        ):
            _decide_break(handle, row, sample)
        if code != TAKEN:
            code, value = _make_exception(handle, row, sample, code, value)
            if has_new_region:
                marks.revision[row] += 1
                note_row(changed_rows, row)
            data.codes[i], data.values[i] = code, value
            exceptions += 1
            taken += code == TRACK_CHANGED
            any_refused = any_refused or marks.refused[row]
            continue
        data.codes[i] = TAKEN
        # The row has changed, unless its reference state allows for what was told: the sample
        # itself, not what the accepted state makes of a vaguer one.
        allowed, grown = allows_reference_state(sample, reference_states, 0, row)
        if marks.refused[row]:
            _drop_rejoined(handle, row, sample, stated_accel, stated_speed)
        if allowed and is_vaguer:
            _keep_surer(sample, accepted, row, between)
        # Write: what agrees replaces the accepted state.
        _write(accepted, row, sample)
        marks.has_state[row] = True
        marks.confirmations[row] = 0
        marks.revision[row] += 1
        taken += 1
        # Each step agreed with the one before, but all of them not with what was promised. What
        # that rests on is set aside once; it stands until the change has been read.
        if (
            not allowed
            and not _count_slow_break(handle, row, sample)
            and not changed_rows.is_changed[row]
        ):
            let_stand(marks, table.refused, table.refusals, row, reference_states, row)
        _remember_bounds(told, row, sample)
        if grown or not allowed or has_new_region:
            note_row(changed_rows, row)
        any_refused = any_refused or marks.refused[row]
    return taken, exceptions, any_refused
