"""A look at what is due: the compiled tick of the watch over obstacles.

An obstacle is the unit that falls due: all watched links are looked at together, since the soonest
of them decides when it must be looked at again, and one record of the obstacle is what all of its
certificates rest on. A tick takes out of the wheel what is due, the most urgent first, and puts
each back for the time by which it could matter to a stop, or look stale.

A look starts with what the whole arm cannot leave; most obstacles are done with then. Otherwise
links follow in the order of their imminence, so that most of them need no closer look.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import inlined_kernel, kernel
from armguard.obstacles.reference_states import allows_reference_state, expire, keep_reference_state
from armguard.obstacles.table import clear_news
from armguard.pairs.contact_time import arm_reach_time, is_known, link_time, pair_time, root_time
from armguard.pairs.scene import REACH, UNKNOWN, Scene, prepare_arm
from armguard.robot.joint_acceptance import Guard
from armguard.scheduling.certificates import (
    ACTIVE,
    BROKEN,
    LOOKS,
    PREPARED,
    SPENT,
    STALE,
    UNPLACED,
    Book,
    first_link,
    void,
)
from armguard.scheduling.timing_wheel import (
    NOBODY,
    TURNING,
    WAITING,
    is_idle,
    most_urgent,
    put_off,
    turn,
)
from armguard.scheduling.tournament import find_least, set_value

RECENT = 4096
"""Looks over which their price is averaged."""

CROWD = 64
"""Evaluations in a tick beyond which, once contact is certain, other obstacles wait."""


@inlined_kernel
def _read_news(scene: Scene, book: Book) -> int:
    """Let rows be due whose certificates their news have overtaken; how many there are."""
    overtaken = broken = 0
    for i in range(book.news.changed_count[0]):
        row = book.news.changed[i]
        if not book.watched[row].any():
            continue
        overtaken += 1
        if scene.marks.static[row] and not scene.marks.refused[row]:
            # One that never moves is news when it comes, and then it is due already.
            continue
        allowed, _ = allows_reference_state(scene.bodies, book.reference_states, row, row)
        if not allowed and scene.marks.has_state[row]:
            book.broken[broken] = row
            broken += 1
        void(book, row)
    book.numbers[BROKEN] = broken
    clear_news(book.news)
    return overtaken


@inlined_kernel
def _look_at_links(
    scene: Scene,
    book: Book,
    row: int,
    now: float,
    time: float,
    arm_age: float,
    refinement_threshold: float,
    lower_bound: float,
) -> tuple[float, int]:
    """Look at all watched links of one obstacle: soonest contact time in [s], and evaluations."""
    links = book.watched.shape[1]
    evaluations = 0
    best = np.inf
    if scene.marks.refused[row]:
        for each in range(links):
            if not book.watched[row, each]:
                continue
            found, node, bound, spent = pair_time(
                scene, each, row, now, arm_age, lower_bound, refinement_threshold, best
            )
            evaluations += spent
            best = min(best, found)
            book.pair_expiry[row, each] = expire(time, found)
            book.pair_sphere[row, each] = node
            book.pair_bound[row, each] = bound
        return best, evaluations
    age = 0.0 if scene.marks.static[row] else now - scene.bodies.stamp[row]
    # What is known at a glance, links in the order of it: later ones seldom need a closer look.
    for each in range(links):
        if book.watched[row, each]:
            glance, bound, spent = root_time(scene, each, row, arm_age, age, lower_bound)
            evaluations += spent
            scene.link_time[each] = glance
            scene.link_bound[each] = bound
    for _ in range(links):
        link: Any = np.int64(-1)
        for other in range(links):
            left = scene.link_time[other] >= 0.0 and book.watched[row, other]
            if left and (link < 0 or scene.link_time[other] < scene.link_time[link]):
                link = other
        if link < 0:
            break
        found, bound = scene.link_time[link], scene.link_bound[link]
        node = scene.tree.root[link]
        scene.link_time[link] = -1.0
        if found < best and found < refinement_threshold:
            found, node, bound, spent = link_time(
                scene,
                link,
                row,
                scene.bodies,
                arm_age,
                age,
                found,
                bound,
                refinement_threshold,
                best,
            )
            evaluations += spent
        best = min(best, found)
        book.pair_expiry[row, link] = expire(time, found)
        book.pair_sphere[row, link] = node
        book.pair_bound[row, link] = bound
    return best, evaluations


@inlined_kernel
def _look_at(
    scene: Scene,
    book: Book,
    row: int,
    q: FloatArray,
    v: FloatArray,
    placed: bool,
    now: float,
    time: float,
    tick: int,
    arm_age: float,
    refinement_threshold: float,
) -> tuple[float, int]:
    """Look at one obstacle: its soonest contact time in [s], and evaluations.

    The time is NaN, and nothing is entered, where the arm must be placed first.
    """
    best, evaluations = 0.0, 0
    bound = UNKNOWN
    if is_known(scene, row):
        best, evaluations = arm_reach_time(scene, row, now)
        bound = REACH
        if best < refinement_threshold:
            if not placed:
                return np.nan, evaluations
            if book.numbers[PREPARED] != tick:
                prepare_arm(scene, q, v, arm_age)
                book.numbers[PREPARED] = tick
            best, spent = _look_at_links(
                scene, book, row, now, time, arm_age, refinement_threshold, best
            )
            set_value(book.soonest, row, expire(time, best))
            return best, evaluations + spent
    expiry = expire(time, best)
    for link in range(book.watched.shape[1]):
        book.pair_expiry[row, link] = expiry
        book.pair_sphere[row, link] = scene.tree.root[link]
        book.pair_bound[row, link] = bound
    set_value(book.soonest, row, expiry)
    return best, evaluations


@inlined_kernel
def time_to_spare(
    scene: Scene, v: FloatArray, contact_time: float, arm_age: float, horizon: float
) -> float:
    """Time in [s] in which a contact time cannot matter to a stop, the arm's speeding up included.

    Too long a time would cost false stops, never safety: what counts is the end of certificates.
    """
    limits = scene.limits
    spare = np.inf
    for j in range(v.shape[0]):
        top, accel, braking = limits.velocity[j], limits.acceleration[j], limits.braking[j]
        speed = abs(v[j]) + 3.0 * limits.velocity_error[j]
        speed += accel * (max(arm_age, 0.0) + horizon)
        stop = horizon + min(top, speed) / braking
        at_most = contact_time - horizon - top / braking
        spare = min(spare, max(at_most, (contact_time - stop) / (1.0 + accel / braking)))
    return spare


class Watching(NamedTuple):
    """All that a tick's look reads and writes."""

    scene: Scene
    book: Book
    guard: Guard
    """What joint states are compared with; holds the positions and velocities believed last."""
    horizon: float
    """Period plus latency plus reaction time, in [s]."""
    max_staleness: float
    """How stale an answer may look, as a fraction of itself."""
    aware_margin: float
    """Beyond the stopping time, in [s]: what could be touched within is looked at closer."""
    period: float
    """Of ticks, in [s]."""
    budget: int
    """Evaluations in a tick after which nothing further is begun."""


@inlined_kernel
def tick_of(time: float, period: float) -> int:
    """Number of the tick at a time, to the nearest: those of a loop are never quite on time."""
    return int(time / period + 0.5)


@inlined_kernel
def count_lost(numbers: IntArray, wheel_numbers: IntArray) -> int:
    """How many watched rows are neither in the wheel nor waiting: nobody would look at them."""
    lost: int = abs(numbers[ACTIVE] - wheel_numbers[WAITING] - wheel_numbers[TURNING])
    return lost


@kernel
def _find_first(
    numbers: IntArray, tournament: FloatArray, watched: NDArray[np.bool_], pair_expiry: FloatArray
) -> tuple[int, int, float]:
    """Row and link whose certificate ends first, and that end; NOBODY where nothing is watched."""
    if numbers[ACTIVE] == 0:
        return NOBODY, 0, np.inf
    row = find_least(tournament)
    while not watched[row].any():
        # Rows that nobody watches never end either.
        row += 1
    return row, first_link(watched, pair_expiry, row), tournament[1]


@kernel
def look(
    handle: Any,
    placed: bool,
    spent_before: int,
    now: float,
    time: float,
    tick: int,
    arm_age: float,
    refinement_threshold: float,
) -> tuple[int, int, float, int, int, int]:
    """One tick: look at what is due, as far as the budget goes.

    Where contact is certain already, what still waits is not overdue: the arm stops in any case,
    and goes on only when all of it has been looked at.

    Args:
        handle: On a `Watching`.
        placed: Whether Pinocchio has placed the arm for this tick.
        spent_before: Evaluations of this tick before the arm was placed.
        now: Time of the tick on the obstacles' clock, in [s].
        time: The same since the monitor's epoch.
        tick: Number of the tick.
        arm_age: Age of the joint state, in [s].
        refinement_threshold: What could be touched before this, in [s], is looked at closer.

    Returns:
        Row whose certificate ends first (NOBODY without any, UNPLACED where the arm must be placed
        before the look can go on), its link, the end in [s] since the epoch, obstacles overdue,
        evaluations, and rows that news have overtaken.
    """
    book = handle.content.book
    clock = tick_of(time, handle.content.period)
    if book.news.changed_count[0] == 0 and is_idle(book.wheel, clock):
        turn(book.wheel, clock)
        row, link, expiry = _find_first(book.numbers, book.soonest, book.watched, book.pair_expiry)
        lost = count_lost(book.numbers, book.wheel.numbers)
        return row, link, expiry, lost, spent_before, 0
    found: tuple[int, int, float, int, int, int] = _look(
        handle, placed, spent_before, now, time, tick, arm_age, refinement_threshold
    )
    return found


@kernel
def _look(
    handle: Any,
    placed: bool,
    spent_before: int,
    now: float,
    time: float,
    tick: int,
    arm_age: float,
    refinement_threshold: float,
) -> tuple[int, int, float, int, int, int]:
    """`look` where there is something to be done: all arrays are taken in hand."""
    watching = handle.content
    scene, book, q, v = watching.scene, watching.book, watching.guard.q, watching.guard.v
    horizon, max_staleness = watching.horizon, watching.max_staleness
    period, budget = watching.period, watching.budget
    wheel = book.wheel
    overtaken = _read_news(scene, book)
    clock = tick_of(time, period)
    turn(wheel, clock)
    evaluated = spent_before
    certain = False
    while evaluated < budget and not (certain and evaluated > CROWD):
        row = most_urgent(wheel)
        if row == NOBODY:
            break
        contact_time, spent = _look_at(
            scene, book, row, q, v, placed, now, time, tick, arm_age, refinement_threshold
        )
        evaluated += spent
        if math.isnan(contact_time):
            return UNPLACED, 0, 0.0, 0, evaluated, overtaken
        book.evaluated_at[row] = time
        book.numbers[LOOKS] += 1
        book.numbers[SPENT] += spent
        keep_reference_state(scene.bodies, book.reference_states, scene.marks, row, row)
        spare = time_to_spare(scene, v, contact_time, arm_age, horizon)
        if scene.marks.refused[row] or not is_known(scene, row):
            spare = 0.0
        wait = min(spare, max_staleness * contact_time)
        certain = certain or contact_time <= period
        due = clock + (int(min(wait / period, 1e9)) if wait > 0.0 else 0)
        put_off(wheel, row, due, time + spare)
    if book.numbers[LOOKS] > RECENT:
        book.numbers[LOOKS] //= 2
        book.numbers[SPENT] //= 2
    overdue = 0
    for place in range(wheel.numbers[WAITING]):
        if not wheel.deadline[wheel.heap[place]] < time:
            book.numbers[STALE] += 1
        elif not certain:
            overdue += 1
    overdue += count_lost(book.numbers, wheel.numbers)
    row, link, expiry = _find_first(book.numbers, book.soonest, book.watched, book.pair_expiry)
    return row, link, expiry, overdue, evaluated, overtaken
