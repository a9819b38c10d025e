"""Obstacles that could be touched soon: which they are, and whether the arm rests before.

Asked where a contact time alone would stop the arm, or hold down its speed.
"""

from __future__ import annotations

import sys
from typing import Any

from armguard.jit.arrays import IntArray
from armguard.jit.kernels import kernel
from armguard.pairs.contact_time import RESTS, UNDECIDED, rests_in_time
from armguard.pairs.scene import prepare_arm
from armguard.scheduling.certificates import PREPARED
from armguard.scheduling.timing_wheel import NOBODY
from armguard.scheduling.tournament import find_below

LATEST = sys.float_info.max
"""Latest time that is asked for: what nobody watches has no end, nor has what never moves near."""


@kernel
def find_unsafe(
    handle: Any,
    now: float,
    time: float,
    tick: int,
    arm_age: float,
    stop_time: float,
    culprit: int,
    budget: int,
    rows: IntArray,
) -> tuple[int, int, int, int]:
    """The first pair that might touch before the arm rests, by the scene's table of braking.

    Only what could be touched within `stop_time` is looked at. Where the budget is spent, the
    obstacle at hand counts as unsafe.

    Args:
        handle: On what a look is handed, `deadline_evaluations.Watching`.
        now: Time of the tick on the obstacles' clock, in [s].
        time: The same since the monitor's epoch.
        tick: Number of the tick.
        arm_age: Age of the joint state, in [s].
        stop_time: When the table of braking ends, in [s].
        culprit: Row to look at first if it is as near: who was unsafe lately likely is again.
        budget: Evaluations that may be spent.
        rows: Room to work in, for all rows of the obstacle table.

    Returns:
        Row and link, NOBODY if the arm surely rests before it touches anything; evaluations, and
        how many obstacles were not decided about when the budget was spent, 0 if it was not.
    """
    scene, book = handle.content.scene, handle.content.book
    if book.numbers[PREPARED] != tick:
        prepare_arm(scene, handle.content.guard.q, handle.content.guard.v, arm_age)
        book.numbers[PREPARED] = tick
    latest = time + stop_time
    count = find_below(book.soonest, min(latest, LATEST), rows)
    for i in range(count):
        if rows[i] == culprit:
            rows[0], rows[i] = rows[i], rows[0]
    evaluations = 0
    for i in range(count):
        row = rows[i]
        for link in range(book.watched.shape[1]):
            if not book.watched[row, link] or book.pair_expiry[row, link] > latest:
                continue
            answer, spent = rests_in_time(scene, link, row, now, budget - evaluations)
            evaluations += spent
            if answer != RESTS:
                return row, link, evaluations, count - i if answer == UNDECIDED else 0
    return NOBODY, NOBODY, evaluations, 0


@kernel
def find_near(handle: Any, latest: float, rows: IntArray) -> int:
    """Fill `rows`, which has room for all, with those whose certificates end by `latest`."""
    count: int = find_below(handle.content.book.soonest, min(latest, LATEST), rows)
    return count
