"""Measures costs and results of each schedule of the paper for growing numbers of pairs.

All schedules are shown one world at a time, tick by tick, beside the contact times of all pairs.
Costs are counted, evaluations and comparisons, as well as timed: counts are the same on every
machine, and it is on them that an order of growth is judged.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.lab.paper.world import World
from armguard.lab.study_facts import Tell
from armguard.scheduling.paper.daa import DaaSchedule, SortLaw
from armguard.scheduling.paper.full import FullSchedule
from armguard.scheduling.paper.partition import PartitionLaw, make_partition
from armguard.settings.schedule import Schedule

PERIODS = (0.05, 0.001)
"""Of the paper's experiment, and of armguard's default, in [s]."""

BALLS = (3, 5, 8, 15, 25, 46, 78, 142, 246, 448)
"""Of the worlds: 3 to 100,128 pairs."""

STOP_TIME = 0.25
"""Contact times up to this have to be noticed, in [s]."""

MOST_TICKS, MOST_EVALUATIONS = 4000, 30_000_000
"""Of a world: ticks, and evaluations of all pairs, whichever comes first."""

MOST_COMPARED = 2_000_000
"""Comparisons of a schedule that are counted in one world; its later ticks are like those."""

DAA: tuple[tuple[str, PartitionLaw, SortLaw], ...] = (
    ("daa, powers", "powers", "partial"),
    ("daa, Fibonacci", "fibonacci", "partial"),
    ("daa, powers, total sort", "powers", "total"),
)
"""Its variants: name, partition, and what is sorted in a tick."""

FULL, DISTANCE = "full-DAA", "full-DF"
"""The paper's two references."""


class Row(NamedTuple):
    """One schedule in one world. Means are over the ticks after the first, which sorts all."""

    period: float
    """[s]."""
    balls: int
    pairs: int
    ticks: int
    rounds: float
    """How often the last bucket came round meanwhile; 1 a tick where all pairs are due."""
    schedule: str
    evaluations: float
    """In a tick, of pairs whose turn it is."""
    comparisons: float
    """In a tick, by the sort."""
    tick: float
    """Processor time of evaluating, sorting and naming the first, in the median, in [µs]."""
    flagged: float
    """Share of the pairs that are to be watched out of turn."""
    agreement: float
    """Share of the ticks in which no pair has a smaller contact time than the one named first."""
    rank_p50: float
    """Place of the pair named first in the true order, in the median; 1 is right."""
    rank_max: float
    alarms: int
    """How often a pair's contact time fell to the stop time or below."""
    late_p50: float
    """From then until its turn, in ticks; as long as it lasted where its turn did not come."""
    late_max: float
    unseen: int
    """Of these, how many had gone before the pair's turn came."""
    unwatched: int
    """Ticks of pairs within the stop time that were neither in turn nor flagged: must be 0."""


def measure_claims(
    periods: Sequence[float], balls: Sequence[int], most_evaluations: int, seed: int, tell: Tell
) -> Iterator[list[Row]]:
    """Go through the worlds, the smallest first; the rows of each.

    Args:
        periods: Of ticks, in [s].
        balls: Of the worlds.
        most_evaluations: Of all pairs of a world.
        seed: Of all motions.
        tell: Is told how far it is.
    """
    worlds = [(period, count) for count in balls for period in periods]
    prices = [min(count**2 * MOST_TICKS, 2.0 * most_evaluations) for _, count in worlds]
    shares = np.cumsum([0.0, *prices])
    for (period, count), begin, end in zip(worlds, shares[:-1], shares[1:], strict=True):
        world = World(count, period, seed)
        ticks = max(10, min(MOST_TICKS, most_evaluations // world.pairs))
        contestants = _make_contestants(world)
        for tick in range(ticks + 1):
            done = (begin + (end - begin) * tick / ticks) / shares[-1]
            tell(f"{world.pairs:,} pairs every {1e3 * period:g} ms", done)
            _tick(world, contestants)
            world.step()
        yield [one.summarise(count, ticks) for one in contestants]


class _Contestant:
    """One schedule at work in a world, and what is counted of it."""

    def __init__(self, name: str, schedule: Schedule, world: World) -> None:
        self.name, self.schedule, self._world = name, schedule, world
        pairs = world.pairs
        self.schedule.insert(np.arange(pairs))
        self._ticks = 0
        self._spent: list[float] = []
        self._evaluations = self._agreed = self._unwatched = self._flagged = 0
        self._ranks: list[int] = []
        self._comparisons, self._compared = 0, 0
        self._expiry = np.zeros(pairs)
        self._was_near = np.zeros(pairs, dtype=bool)
        self._begun: IntArray = np.full(pairs, -1, dtype=np.int64)
        self._late: list[int] = []
        self._unseen = 0

    def tick(self, measure: Callable[[IntArray], FloatArray], exact: FloatArray) -> None:
        """Let it have a tick, and compare what it names with the contact times of all pairs."""
        schedule, is_first = self.schedule, self._ticks == 0
        is_total = isinstance(schedule, DaaSchedule) and schedule.sort == "total"
        before = schedule.ranking() if is_total else None
        begin = time.thread_time_ns()
        due = schedule.due()
        values = measure(due)
        schedule.settle(values, STOP_TIME)
        ranking = schedule.ranking() if isinstance(schedule, FullSchedule) else None
        spent = 1e-3 * (time.thread_time_ns() - begin)
        named = int((schedule.ranking() if ranking is None else ranking)[0])
        self._ticks += 1
        if before is not None:
            self._expiry[due] = self._ticks * self._world.period + values
        self._watch(due, exact, is_first)
        if is_first:
            return
        self._spent.append(spent)
        self._evaluations += due.size
        self._flagged += schedule.flagged().size
        rank = int(np.count_nonzero(exact < exact[named])) + 1
        self._ranks.append(rank)
        self._agreed += rank == 1
        if self._comparisons < MOST_COMPARED:
            self._comparisons += count_comparisons(
                values if before is None else self._expiry[before]
            )
            self._compared += 1

    def _watch(self, due: IntArray, exact: FloatArray, is_first: bool) -> None:
        """Note which pairs fell to the stop time, and how long each waited for its turn."""
        in_turn = np.zeros(exact.size, dtype=bool)
        in_turn[due] = True
        is_near = exact <= STOP_TIME
        watched = in_turn.copy()
        watched[self.schedule.flagged()] = True
        self._unwatched += int(np.count_nonzero(is_near & ~watched))
        # What is near at the start has been near nobody knows how long.
        new = np.zeros_like(is_near) if is_first else is_near & ~self._was_near
        self._was_near = is_near
        self._begun[new] = self._ticks
        waiting = self._begun >= 0
        self._end(np.flatnonzero(waiting & in_turn), is_seen=True)
        self._end(np.flatnonzero(waiting & ~in_turn & ~is_near), is_seen=False)

    def _end(self, pairs: IntArray, *, is_seen: bool) -> None:
        self._late += (self._ticks - self._begun[pairs]).tolist()
        self._begun[pairs] = -1
        self._unseen += 0 if is_seen else pairs.size

    def summarise(self, balls: int, ticks: int) -> Row:
        """What was found."""
        self._end(np.flatnonzero(self._begun >= 0), is_seen=False)
        pairs = self._world.pairs
        return Row(
            self._world.period,
            balls,
            pairs,
            ticks,
            ticks / self._count_last_bucket(pairs),
            self.name,
            self._evaluations / ticks,
            self._comparisons / self._compared,
            float(np.median(self._spent)),
            self._flagged / ticks / pairs,
            self._agreed / ticks,
            float(np.median(self._ranks)),
            float(max(self._ranks)),
            len(self._late),
            float(np.median(self._late)) if self._late else math.nan,
            float(max(self._late)) if self._late else math.nan,
            self._unseen,
            self._unwatched,
        )

    def _count_last_bucket(self, pairs: int) -> int:
        """Ticks in which the last bucket comes round."""
        if not isinstance(self.schedule, DaaSchedule):
            return 1
        partition = make_partition(self.schedule.law)
        return int(partition.sizes[np.searchsorted(partition.bases, pairs, side="right") - 1])


def _make_contestants(world: World) -> list[_Contestant]:
    schedules: list[tuple[str, Schedule]] = [
        *((name, DaaSchedule(world.period, law, sort)) for name, law, sort in DAA),
        (FULL, FullSchedule()),
        (DISTANCE, FullSchedule()),
    ]
    return [_Contestant(name, schedule, world) for name, schedule in schedules]


def _tick(world: World, contestants: Sequence[_Contestant]) -> None:
    exact = world.compute_contact_times()
    for one in contestants:
        if one.name == FULL:
            one.tick(lambda due: world.compute_contact_times(), exact)
        elif one.name == DISTANCE:
            one.tick(lambda due: world.compute_distances(), exact)
        else:
            one.tick(world.compute_contact_times, exact)


class _Counting:
    """A number that counts how often it is compared."""

    __slots__ = ("value",)
    comparisons = 0

    def __init__(self, value: float) -> None:
        self.value = value

    def __lt__(self, other: Any) -> bool:
        _Counting.comparisons += 1
        return bool(self.value < other.value)


def count_comparisons(values: NDArray[np.float64]) -> int:
    """Comparisons by which a merge sort (Python's) sorts values. Shape (n,)."""
    _Counting.comparisons = 0
    sorted(map(_Counting, values.tolist()))
    return _Counting.comparisons


def compute_claim(pairs: int) -> float:
    """L log2 L with L = ⌊log2 pairs⌋ + 1 buckets: the paper's O(log N log log N) in numbers."""
    buckets = math.floor(math.log2(pairs)) + 1
    return buckets * math.log2(buckets)
