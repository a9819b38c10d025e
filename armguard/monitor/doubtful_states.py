"""Finds whether a low level rests on doubtful states: wider bounds, refused samples, hidden bodies.

A body that broke its bounds counts with wider ones. A refused sample counts in addition to the
accepted state. A body that is not seen can be in a growing region. Each can stop an arm although no
body is near. So if a level is low, the tick is evaluated once more without them, and a reason names
what made the difference. This answer is for people; it never changes the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from armguard.jit.handle import machine_code
from armguard.jit.kernels import kernel
from armguard.monitor.late_data import LOOK_INTERVAL, LateData
from armguard.monitor.second_look import NearPairs, SecondLook
from armguard.obstacles.broken_bounds import BROKEN_FACTOR
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.table import MOST_REFUSED
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.verdict import Level, Reason, ReasonKind

KINDS = (ReasonKind.WIDENED_BOUNDS, ReasonKind.REFUSED_ALTERNATIVE, ReasonKind.HIDDEN)
MOST_NAMED = 3
"""Greatest number of bodies that are named for each kind."""

Doubts = dict[ReasonKind, list[int]]
"""Rows of near obstacles with a doubt, by its kind."""


@kernel
def sum_up_doubts(handle: Any, now: float, usual: float) -> int:
    """A hash of the bodies that are in doubt; 0 if none is.

    Args:
        handle: Handle on the table's `Rows`.
        now: Time of the tick on the obstacles' clock, in [s].
        usual: Age from which an unseen body may be hidden, in [s].
    """
    table = handle.content
    accepted, marks, breaks = table.accepted, table.marks, table.breaks
    total = 0
    for row in range(marks.alive.shape[0]):
        if marks.alive[row] and marks.has_state[row] and not marks.static[row]:
            stamp = accepted.stamp[row]
            is_wide = breaks.further[row] > 0 or stamp <= breaks.until[row]
            kinds = is_wide + 2 * marks.refused[row] + 4 * (now - stamp > usual)
            total += kinds * (8 * row + 1)
    return total


class DoubtfulStates:
    """Reports which doubts about near bodies alone have lowered a level.

    Args:
        obstacles: The table.
        scheduler: Knows the pairs.
        look_again: Evaluates near pairs once more.
        late_data: Provides the usual ages of data.
    """

    def __init__(
        self,
        obstacles: Obstacles,
        scheduler: Scheduler,
        look_again: SecondLook,
        late_data: LateData,
    ) -> None:
        self._obstacles = obstacles
        self._scheduler = scheduler
        self._look_again = look_again
        self._late_data = late_data
        self._sum_up = machine_code(sum_up_doubts, obstacles.table.handle, 0.0, math.inf)
        self.reset()

    def reset(self) -> None:
        """Restart; the clock may start anew."""
        self._asked: tuple[Level, int] | None = None
        self._asked_at = -math.inf
        self._told: list[tuple[ReasonKind, int, str]] = []

    def explain(self, tick: Tick, level: Level) -> list[Reason]:
        """Reasons that name the doubts without which the level of a tick would be higher.

        If no kind of doubt makes the difference by itself, but all together do, all are named. The
        answer is computed again after `LOOK_INTERVAL`, when the level changes, or when there are
        doubts about other bodies.

        Args:
            tick: The tick.
            level: Its level by contact times alone, below CLEAR.
        """
        table, ids = self._obstacles.table, self._obstacles.ids
        known = self._sum_up(table.handle, tick.now, self._late_data.find_shortest_usual())
        if known == 0:
            return []
        asked = level, known
        if asked != self._asked or not 0.0 <= tick.now - self._asked_at < LOOK_INTERVAL:
            self._asked, self._asked_at = asked, tick.now
            near = self._look_again.find_near(tick)
            doubts = self._find_doubts(near, tick.now)
            matter = self._find_matter(tick, level, near, doubts) if doubts else ()
            self._told = [
                (kind, row, ids[row]) for kind in matter for row in doubts[kind][:MOST_NAMED]
            ]
        return [
            Reason(kind, name, self._describe(kind, row, tick.now))
            for kind, row, name in self._told
            if ids[row] == name and kind in self._find_kinds(row, tick.now)
        ]

    def _find_doubts(self, near: NearPairs, now: float) -> Doubts:
        doubts = Doubts()
        for row in near.rows.tolist():
            for kind in self._find_kinds(row, now):
                doubts.setdefault(kind, []).append(row)
        return doubts

    def _find_kinds(self, row: int, now: float) -> list[ReasonKind]:
        """The kinds of doubt about a body."""
        table, kinds = self._obstacles.table, []
        if table.has_state[row] and not table.static[row]:
            if table.breaks.further[row] > 0 or table.stamp[row] <= table.breaks.until[row]:
                kinds.append(ReasonKind.WIDENED_BOUNDS)
            if table.refused[row]:
                kinds.append(ReasonKind.REFUSED_ALTERNATIVE)
            if self._late_data.find_hidden(row, now) > 0.0:
                kinds.append(ReasonKind.HIDDEN)
        return kinds

    def _find_matter(
        self, tick: Tick, level: Level, near: NearPairs, doubts: Doubts
    ) -> tuple[ReasonKind, ...]:
        """Kinds of doubt that have lowered the level, each by itself or all together."""
        if near.rest < math.inf and not self._look_again.grade_rest(tick, near) > level:
            return ()

        def is_higher(kinds: tuple[ReasonKind, ...]) -> bool:
            with self._without({kind: doubts[kind] for kind in kinds}, tick.now):
                return self._look_again.grade(tick, near.pairs) > level

        kinds = tuple(kind for kind in KINDS if kind in doubts)
        alone = tuple(kind for kind in kinds if is_higher((kind,)))
        return alone or (kinds if len(kinds) > 1 and is_higher(kinds) else ())

    @contextmanager
    def _without(self, doubts: Doubts, now: float) -> Iterator[None]:
        """Context without doubts of these kinds; restores all afterwards."""
        table = self._obstacles.table
        accepted, refused, marks = table.accepted, table.refused_states, table.marks
        arrays = (
            accepted.accel, accepted.speed, accepted.stamp, refused.accel, refused.speed,
            marks.refused_count, marks.unknown,
        )  # fmt: skip
        saved: list[tuple[int, int, float]] = []

        def put(which: int, place: int, value: float) -> None:
            saved.append((which, place, arrays[which][place]))
            arrays[which][place] = value

        try:
            for row in doubts.get(ReasonKind.WIDENED_BOUNDS, ()):
                accel, speed = table.breaks.stated_accel[row], table.breaks.stated_speed[row]
                put(0, row, min(accepted.accel[row], accel))
                put(1, row, min(accepted.speed[row], speed))
                for place in range(row * MOST_REFUSED, row * MOST_REFUSED + MOST_REFUSED):
                    put(3, place, min(refused.accel[place], accel))
                    put(4, place, min(refused.speed[place], speed))
            for row in doubts.get(ReasonKind.REFUSED_ALTERNATIVE, ()):
                put(5, row, 0)
                put(6, row, False)
            for row in doubts.get(ReasonKind.HIDDEN, ()):
                put(2, row, now - self._late_data.find_usual(row))
            yield
        finally:
            for which, place, value in reversed(saved):
                arrays[which][place] = value

    def _describe(self, kind: ReasonKind, row: int, now: float) -> str:
        table = self._obstacles.table
        if kind is ReasonKind.HIDDEN:
            hidden = now - table.stamp[row]
            away = self._measure_distance(row)
            return f"hidden for {hidden:.2f} s; last seen {away:.2f} m away"
        if kind is ReasonKind.REFUSED_ALTERNATIVE:
            if table.unknown[row]:
                return "a sample without usable values was refused; the body could be anywhere"
            place = row * MOST_REFUSED + int(table.refused_count[row]) - 1
            refused, count = table.refused_states, int(table.point_count[row])
            count = min(count, int(refused.point_count[place]))
            apart = table.points[row, :count] - refused.points[place, :count]
            far = float(np.linalg.norm(apart, axis=1).max())
            since = now - refused.stamp[place]
            return f"a sample of {since:.2f} s ago was refused, {far:.2f} m off; it may be true"
        breaks = table.breaks
        since = now - breaks.stamp[row]
        if breaks.further[row] > 0:
            counts = _describe_bounds(breaks.accel[row], breaks.speed[row], 1.0)
            seen = _describe_bounds(breaks.accel[row], breaks.speed[row], BROKEN_FACTOR)
            rest = f"until {breaks.further[row]} more samples have come"
            return f"may have broken its bounds ({seen}); counts with {counts} {rest}"
        counts = _describe_bounds(breaks.moved_accel[row], breaks.moved_speed[row], 1.0)
        seen = _describe_bounds(breaks.moved_accel[row], breaks.moved_speed[row], BROKEN_FACTOR)
        rest = f"for another {max(breaks.until[row] - now, 0.0):.2f} s"
        return f"broke its bounds {since:.2f} s ago ({seen}); counts with {counts} {rest}"

    def _measure_distance(self, row: int) -> float:
        """Distance from the arm's spheres to the last seen points of a body, in [m]."""
        table, arm = self._obstacles.table, self._scheduler.arm
        points = table.points[row, : table.point_count[row]]
        leaves = arm.state.tree.first_child < 0
        centers, radius = arm.state.arm.centers[leaves], arm.state.tree.radius[leaves]
        apart = np.linalg.norm(centers[:, None] - points[None], axis=2).min(axis=1)
        return max(float((apart - radius).min()) - float(table.radius[row]), 0.0)


def _describe_bounds(accel: float, speed: float, factor: float) -> str:
    """The bounds that are not 0, divided by a factor, in words."""
    words = [f"{accel / factor:.3g} m/s²"] if accel > 0.0 else []
    return ", ".join(words + ([f"{speed / factor:.2g} m/s"] if speed > 0.0 else []))
