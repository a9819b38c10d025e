"""The possible states of an obstacle: its accepted state and those of refused samples.

A refused sample contradicts the accepted state: one of the two is wrong, and it is unknown which.
Until this is decided, each is bounded by itself, with its own errors, bounds and age, and proofs
about an obstacle must hold for all of them. This module alone defines these states; all other code
reads them through `possible_states` and `state_at`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.record import Record
from armguard.obstacles.table import MOST_REFUSED, Marks, Refusals, States, copy_state, note_row

COVERING = 3.0
"""So many times its own errors a sample may make those of a refused state while there is room for
another one beside it."""

GROWTH, MOST_GROWTH = 4.0, 1e12
"""Factor by which that rises, again and again, where there is no room; and how far. The smallest
errors are then beyond the extent of any table."""


@kernel
def possible_states(marks: Marks, row: int) -> range:
    """Numbers of a row's states that may be true, for `state_at`; 0 is the accepted one.

    Empty where nothing is known. A row without refused samples has the accepted one alone.
    """
    return range(0 if marks.has_state[row] else 1, 1 + marks.refused_count[row])


@kernel
def state_at(
    accepted: States, refused: States, marks: Marks, row: int, number: int, now: float
) -> tuple[States, int, float]:
    """Where one of a row's states stands: arrays, place in them, and its age in [s] at `now`."""
    bodies = refused if number > 0 else accepted
    place = row * MOST_REFUSED + number - 1 if number > 0 else row
    age = 0.0 if marks.static[row] and number == 0 else now - bodies.stamp[place]
    return bodies, place, age


@kernel
def is_known(marks: Marks, row: int) -> bool:
    """Whether an obstacle has any usable state; otherwise it could be anywhere."""
    return not marks.unknown[row] and (marks.has_state[row] or marks.refused_count[row] > 0)


def list_states(
    accepted: States, refused: States, marks: Marks, row: int, now: float
) -> list[tuple[States, int, float]]:
    """The same of all states of a row that may be true, for code that is not compiled.

    Empty where the obstacle could be anywhere.
    """
    if not is_known.py_func(marks, row):
        return []
    return [
        state_at.py_func(accepted, refused, marks, row, number, now)
        for number in possible_states.py_func(marks, row)
    ]


@kernel
def forget_expired(handle: Any, now: float, lasting: float) -> bool:
    """Drop the refused samples that have been possible for `lasting` seconds.

    Counted from the tick that saw them first, which is this one where they are new: their own
    stamps may be late, ahead or wrong. A row without an accepted state keeps them, for nothing else
    is known of it; so what is given up can only make contact times later. A clock that was set back
    lets none last longer than from now on.

    A state that samples of later stamps share covers what becomes of them from these stamps on.
    Where these are yet to come it is widened by what the two can drift apart in that time.

    Args:
        handle: On the table's `Rows`; written.
        now: Time of the tick, in [s].
        lasting: How long refused samples are possible, in [s].

    Returns:
        Whether there are any left.
    """
    marks, refused, refusals = handle.content.marks, handle.content.refused, handle.content.refusals
    left = False
    for row in range(marks.refused.shape[0]):
        if not marks.refused[row]:
            continue
        latest = now + lasting
        if marks.unknown[row]:
            refusals.unknown_until[row] = min(refusals.unknown_until[row], latest)
            if marks.has_state[row] and not now <= refusals.unknown_until[row]:
                marks.unknown[row] = False
        number = 0
        while number < marks.refused_count[row]:
            place = row * MOST_REFUSED + number
            refusals.until[place] = min(refusals.until[place], latest)
            if marks.has_state[row] and not now <= refusals.until[place]:
                drop_state(marks, refused, refusals, row, place)
                continue
            ahead = refusals.covers_from[place] - now
            if ahead > 0.0:
                if refused.speed[place] == np.inf:
                    lose_sight(marks, refusals, row)
                else:
                    refused.position_error[place] += 2.0 * refused.speed[place] * ahead
                refusals.covers_from[place] = now
            number += 1
        marks.refused[row] = marks.unknown[row] or marks.refused_count[row] > 0
        left = left or marks.refused[row]
    return left


@kernel
def drop_state(marks: Marks, refused: States, refusals: Refusals, row: int, place: int) -> None:
    """Drop one refused state of a row; the last one takes its place."""
    marks.refused_count[row] -= 1
    marks.refused[row] = marks.unknown[row] or marks.refused_count[row] > 0
    last = row * MOST_REFUSED + marks.refused_count[row]
    copy_state(refused, last, refused, place)
    refusals.until[place] = refusals.until[last]
    refusals.covers_from[place] = refusals.covers_from[last]
    refusals.is_undecided[place] = refusals.is_undecided[last]


@kernel
def drop_undecided(marks: Marks, refused: States, refusals: Refusals, row: int) -> bool:
    """Drop states of a body that may have broken its bounds; returns whether any was dropped."""
    for place in range(row * MOST_REFUSED, row * MOST_REFUSED + marks.refused_count[row]):
        if refusals.is_undecided[place]:
            drop_state(marks, refused, refusals, row, place)
            return True
    return False


@kernel
def find_place(marks: Marks, refusals: Refusals, row: int) -> int:
    """Place for another refused state of a row; -1 where there is none: it could be anywhere."""
    marks.refused[row] = True
    if marks.refused_count[row] >= MOST_REFUSED:
        lose_sight(marks, refusals, row)
        return -1
    place: int = row * MOST_REFUSED + marks.refused_count[row]
    marks.refused_count[row] += 1
    refusals.until[place] = np.inf
    refusals.covers_from[place] = -np.inf
    refusals.is_undecided[place] = False
    return place


@kernel
def lose_sight(marks: Marks, refusals: Refusals, row: int) -> None:
    """Let an obstacle be anywhere, because a sample of it is unusable."""
    marks.refused[row] = marks.unknown[row] = True
    refusals.unknown_until[row] = np.inf


@kernel
def let_stand(
    marks: Marks, refused: States, refusals: Refusals, row: int, states: States, at: int
) -> None:
    """Let a state of a row be possible: in a place of its own, or within the bounds of another.

    Where there is no place left, the one that needs the least for it grows until it covers both.

    Args:
        marks: Written, as the next two are.
        refused: Refused states.
        refusals: What is kept of them.
        row: Of the body.
        states: Where the state stands.
        at: Its place there.
    """
    record = Record(states, at, states.radius[at], states.accel[at], states.speed[at])
    is_full = marks.refused_count[row] >= MOST_REFUSED
    most = COVERING
    while most <= MOST_GROWTH:
        for place in range(row * MOST_REFUSED, row * MOST_REFUSED + marks.refused_count[row]):
            if not refusals.is_undecided[place] and widen_to_cover(refused, place, record, most):
                # As long as if it had come now.
                refusals.until[place] = np.inf
                refusals.covers_from[place] = max(refusals.covers_from[place], states.stamp[at])
                return
        if not is_full:
            break
        most *= GROWTH
    place = find_place(marks, refusals, row)
    if place >= 0:
        copy_state(states, at, refused, place)


@kernel
def let_undecided_stand(
    marks: Marks, refused: States, refusals: Refusals, row: int, sample: States
) -> None:
    """Let a sample be possible with wider bounds, in place of the one before it that was so."""
    drop_undecided(marks, refused, refusals, row)
    if marks.refused_count[row] >= MOST_REFUSED:
        let_stand(marks, refused, refusals, row, sample, 0)
        return
    place = find_place(marks, refusals, row)
    copy_state(sample, 0, refused, place)
    refusals.is_undecided[place] = True


@kernel
def distrust(handle: Any, row: int) -> None:
    """Turn a row's accepted state, if it has one and moves, into a refused sample."""
    table = handle.content
    marks = table.marks
    if not marks.has_state[row] or marks.static[row]:
        return
    let_stand(marks, table.refused, table.refusals, row, table.accepted, row)
    marks.has_state[row] = False
    marks.confirmations[row] = 0
    marks.revision[row] += 1
    note_row(table.changed_rows, row)


@kernel
def widen_to_cover(refused: States, place: int, sample: Record, most: float) -> bool:
    """Widen a refused state until it covers a later sample's future too; whether that was done.

    Its future begins at its stamp; see `forget_expired` for the time before.

    Then one of the few places does for both. A free body's furthest displacement along a direction
    is u h + A h²/2 less (u + A h - V)² / 2A where it reaches its top speed V, u being the velocity
    along it, within its error. So the state covers all that can become of the sample if, with h the
    time between them, |v1 - v0| + dv1 <= A h + dv0 and |x1 - x0 - v0 h| + dp1 + loss <= dv0 h +
    A h²/2 + dp0, where `loss` is the greatest of what is lost to the top speed. Its errors grow to
    what that needs, but only up to some multiple of the sample's own.

    Args:
        refused: Refused states; written.
        place: Of the state.
        sample: The sample; its bound on speed is the one that holds, whatever was measured.
        most: That multiple. Two samples of one track never need more than `COVERING`.
    """
    states, row, radius, accel, speed = sample
    count, stamp = states.point_count[row], states.stamp[row]
    position_error, velocity_error = states.position_error[row], states.velocity_error[row]
    elapsed = stamp - refused.stamp[place]
    if count != refused.point_count[place] or not 0.0 <= elapsed < np.inf:
        return False
    # A body with wider bounds, and of the larger radius, does all that both can.
    accel = max(accel, refused.accel[place])
    speed = max(speed, refused.speed[place])
    error, rate_error = refused.position_error[place], refused.velocity_error[place]
    fastest = 0.0
    gained = np.inf if accel == np.inf else accel * elapsed
    for k in range(count):
        change = fast = 0.0
        for axis in range(3):
            v0 = refused.velocities[place, k, axis]
            change += (states.velocities[row, k, axis] - v0) ** 2
            fast += v0 * v0
        fastest = max(fastest, math.sqrt(fast))
        rate_error = max(rate_error, math.sqrt(change) + velocity_error - gained)
    # One that was faster than its bound may be so still, and its bound is what was measured then.
    speed = max(speed, fastest + rate_error) if fastest > speed + rate_error else speed
    quickest = fastest + rate_error
    if speed == np.inf:
        lost = 0.0
    elif accel == np.inf:
        lost = np.inf
    elif quickest >= speed:
        lost = (quickest - speed) * elapsed + 0.5 * accel * elapsed * elapsed
    elif accel > 0.0:
        beyond = max(0.0, quickest + accel * elapsed - speed)
        lost = beyond * beyond / (2.0 * accel)
    else:
        lost = 0.0
    for k in range(count):
        stray = step = length = 0.0
        for axis in range(3):
            moved = states.points[row, k, axis] - refused.points[place, k, axis]
            length += abs(states.points[row, k, axis]) + abs(refused.points[place, k, axis])
            step += moved * moved
            stray += (moved - refused.velocities[place, k, axis] * elapsed) ** 2
        if lost == np.inf:
            needed = math.sqrt(step) + position_error - speed * elapsed
        else:
            reach = rate_error * elapsed + 0.5 * accel * elapsed * elapsed
            needed = math.sqrt(stray) + position_error + lost - reach
        error = max(error, needed + SUM_ROUNDING * (length + abs(needed)))
    if not (
        error <= max(refused.position_error[place], most * position_error)
        and rate_error <= max(refused.velocity_error[place], most * velocity_error)
    ):
        return False
    refused.position_error[place] = error
    refused.velocity_error[place] = rate_error
    refused.accel[place] = accel
    refused.speed[place] = speed
    refused.radius[place] = max(radius, refused.radius[place])
    return True
