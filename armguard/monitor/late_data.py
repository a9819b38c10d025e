"""Finds whether a low level rests on data that are older than usual.

An older state gives wider bounds, so contact times are shorter, and a pause of a camera alone can
cause a STOP. So the age of each source's data is followed. If a level is low and data are older
than usual, the tick is evaluated once more with data of their usual age. This answer is for people;
it never changes the verdict.
"""

from __future__ import annotations

import bisect
import math

from armguard.jit.arrays import IntArray
from armguard.monitor.second_look import NearPairs, SecondLook
from armguard.obstacles.obstacles import Obstacles
from armguard.scheduling.scheduler import Tick
from armguard.settings.settings import Settings
from armguard.verdict import Level, Reason, ReasonKind

SAMPLING = 0.01
"""Interval at which all ages are sampled, in [s]."""
GOLDEN_RATIO = 0.5 * (math.sqrt(5.0) - 1.0)
"""Its multiples spread evenly between two whole numbers. So samples of ages come at all phases of
a regular source, whatever its rate, and at the same instants in a replay."""
SAMPLES = 1000
"""Number of stored ages of each source: those of 10 s."""
FEWEST_SAMPLES = 50
"""Number of ages from which on the usual age is known."""
UNUSUAL, UPPER_SHARE, UNUSUAL_UPPER = 2.0, 0.75, 1.5
"""Data are late that are older than so many times the median, and than so many times the age below
which that share of ages lies. Between two messages age rises from the latency to the latency and a
period. That is twice the median where there is no latency; the second limit then leaves an eighth
of a period for jitter, and for the grid of ticks."""
SHORTEST, PER_OCTAVE, BINS = 1e-4, 8, 160
"""Ages are counted in bins: from 0.1 ms on, 8 for each doubling, up to 100 s. In [s]."""
LOOK_INTERVAL = 0.2
"""Between two looks at what fresh data would give, while the level is the same and the same sources
are late, in [s]. A look takes as long as to evaluate all that is near."""

JOINT_STATES = "joint states"


class UsualAge:
    """The median age of a source's data over the last 10 s.

    Args:
        latency: Configured age of the data at arrival, in [s].
        period: Configured time between two messages, in [s]; None: the usual age is unknown until
            there are enough samples.

    Attributes:
        median: Median in [s], precise to 10 %; None while it is unknown.
        latest_usual: Age above which data are late, in [s]; infinite while it is unknown.
    """

    def __init__(self, latency: float = 0.0, period: float | None = None) -> None:
        self.median: float | None = None
        self.latest_usual = math.inf
        if period is not None:
            self._set(latency + 0.5 * period, latency + UPPER_SHARE * period)
        self._sorted, self._ring = bytearray(), bytearray(SAMPLES)
        self._count = 0

    def add(self, age: float) -> None:
        """Add one age, in [s]; NaN counts as the longest."""
        place = BINS - 1
        if age <= SHORTEST:
            place = 0
        elif age < math.inf:
            place = min(int(PER_OCTAVE * math.log2(age / SHORTEST)) + 1, BINS - 1)
        index = self._count % SAMPLES
        if self._count >= SAMPLES:
            del self._sorted[bisect.bisect_left(self._sorted, self._ring[index])]
        self._ring[index] = place
        bisect.insort(self._sorted, place)
        self._count += 1
        if self._count >= FEWEST_SAMPLES:
            self._set(self._find_quantile(0.5), self._find_quantile(UPPER_SHARE))

    def _set(self, median: float, upper: float) -> None:
        self.median = median
        self.latest_usual = max(UNUSUAL * median, UNUSUAL_UPPER * upper)

    def _find_quantile(self, share: float) -> float:
        """The age below which a share of the samples lies, in [s]."""
        place = self._sorted[math.ceil(share * len(self._sorted)) - 1]
        return SHORTEST * 2.0 ** ((place - 0.5) / PER_OCTAVE) if place else SHORTEST

    def find_lateness(self, age: float) -> float:
        """How much an age exceeds the usual one, in [s]; 0 if it is not late."""
        if not age > self.latest_usual or self.median is None:
            return 0.0
        return age - self.median


class LateData:
    """Follows the ages of data, and computes the level with data of their usual age.

    Args:
        obstacles: The table.
        look_again: Evaluates what is near once more.
        settings: Of the monitor.

    Attributes:
        sample_at: Time of the next sampling of ages, in [s].
    """

    def __init__(
        self,
        obstacles: Obstacles,
        look_again: SecondLook,
        settings: Settings,
    ) -> None:
        self._obstacles = obstacles
        self._look_again = look_again
        # Until samples tell, joint states may come a tick late, and one in each tick.
        self._joint_age = UsualAge(settings.period, settings.period)
        self._source_ages: list[UsualAge] = []
        self._sample_number = 0
        self._latest_usual_joints = math.inf
        self.reset()

    def reset(self) -> None:
        """Restart, since the clock may start anew; usual ages are kept."""
        self._slot = self.sample_at = self._asked_at = self._calm_until = -math.inf
        self._asked: tuple[Level, bool, tuple[int, ...]] | None = None
        self._fresh: Level | None = Level.STOP
        self._owners: list[int] = []
        self._lateness: dict[str, float] = {}

    def follow(self, tick: Tick) -> None:
        """Sample the ages of a tick that is not before `sample_at`."""
        # One instant in each slot; after a pause slots begin anew.
        slot = self._slot + SAMPLING
        self._slot = slot if tick.now < slot + SAMPLING else tick.now
        self._sample_number += 1
        self.sample_at = self._slot + SAMPLING * (self._sample_number * GOLDEN_RATIO % 1.0)
        self._calm_until = -math.inf
        self._joint_age.add(tick.arm_age)
        sources = self._obstacles.source_states
        while len(self._source_ages) < len(sources):
            source = sources[len(self._source_ages)].source
            period = None if source.rate is None else 1.0 / source.rate
            self._source_ages.append(UsualAge(source.latency, period))
        for state, ages in zip(sources, self._source_ages, strict=True):
            if state.heard:
                ages.add(tick.now - state.newest)

    def explain(self, tick: Tick, level: Level) -> list[Reason]:
        """Reasons that name late data, if these alone have lowered the level of a tick.

        If too many pairs are near to compute that, the reasons say so. The level with fresh data is
        computed again after `LOOK_INTERVAL`, when the level changes, or when other sources are
        late.

        Args:
            tick: The tick.
            level: What it earns by itself, below CLEAR, for nothing but contact times.
        """
        if tick.now < self._calm_until and not tick.arm_age > self._latest_usual_joints:
            return []
        arm_late = self._joint_age.find_lateness(tick.arm_age)
        sources = self._find_late_sources(tick.now)
        if not (arm_late > 0.0 or sources):
            self._calm_until = self._find_calm(tick.now)
            self._latest_usual_joints = self._joint_age.latest_usual
            return []
        asked = level, arm_late > 0.0, tuple(sources)
        if asked != self._asked or not tick.now - self._asked_at < LOOK_INTERVAL:
            self._asked, self._asked_at = asked, tick.now
            self._fresh, self._owners = self._look(tick, level, arm_late, sources)
            self._lateness = {}
        fresh = self._fresh
        if fresh is not None and not fresh > level:
            return []
        ages = {JOINT_STATES: (tick.arm_age, arm_late)} if arm_late > 0.0 else {}
        for owner in self._owners:
            age = tick.now - self._obstacles.source_states[owner].newest
            ages[sources[owner]] = age, self._source_ages[owner].find_lateness(age)
        # Of data that are less late than at the look it is not known that they make a difference.
        if any(lateness < self._lateness.get(name, 0.0) for name, (_, lateness) in ages.items()):
            return []
        self._lateness = self._lateness or {name: late for name, (_, late) in ages.items()}
        kind = ReasonKind.LATE_DATA_UNKNOWN
        told = "too many pairs are near to compute the level with fresh data"
        if fresh is not None:
            kind, told = ReasonKind.LATE_DATA, f"with fresh data: {fresh.name}"
        return [
            Reason(
                kind,
                name,
                f"{1e3 * age:.0f} ms old, usually {1e3 * (age - lateness):.0f} ms; {told}",
            )
            for name, (age, lateness) in ages.items()
        ]

    def _look(
        self, tick: Tick, level: Level, arm_late: float, sources: dict[int, str]
    ) -> tuple[Level | None, list[int]]:
        """The level with fresh data, and the numbers of the late sources that matter.

        It is `level` if no late data matter. It is None if it is unknown, because pairs that are
        not evaluated again could lower it as far.
        """
        near = self._look_again.find_near(tick)
        late = self._find_late_rows(near.rows, tick.now, sources)
        if not (len(near.pairs) and (arm_late > 0.0 or late)):
            return level, []
        owner = self._obstacles.table.owner
        owners = sorted({int(owner[row]) for row in late})
        fresh = self._grade(tick, near, arm_late, late)
        if fresh > level and near.rest < math.inf:
            rest = self._look_again.grade_rest(tick, near)
            return (min(fresh, rest) if rest > level else None), owners
        return fresh, owners

    def find_hidden(self, row: int, now: float) -> float:
        """How long a body was not seen, in [s], if that is unusual for its source; else 0."""
        table = self._obstacles.table
        owner, age = int(table.owner[row]), now - float(table.accepted.stamp[row])
        if owner >= len(self._source_ages) or not age > self._source_ages[owner].latest_usual:
            return 0.0
        # What is as old as all that its source has sent is late, and not hidden.
        return age if self._obstacles.source_states[owner].newest > table.stamp[row] else 0.0

    def find_shortest_usual(self) -> float:
        """The shortest usual age of all sources, in [s]; inf without any source."""
        return min((ages.latest_usual for ages in self._source_ages), default=math.inf)

    def find_usual(self, row: int) -> float:
        """The usual age of data of a body's source, in [s]."""
        return self._source_ages[int(self._obstacles.table.owner[row])].median or 0.0

    def _find_late_sources(self, now: float) -> dict[int, str]:
        """Sources whose newest data are older than usual, by number."""
        return {
            state.index: state.source.name
            for state, ages in zip(self._obstacles.source_states, self._source_ages, strict=False)
            if state.heard and ages.find_lateness(now - state.newest) > 0.0
        }

    def _find_calm(self, now: float) -> float:
        """Time until which no source can become late, in [s]: only new data lower ages."""
        return min(
            (
                state.newest + ages.latest_usual
                for state, ages in zip(
                    self._obstacles.source_states, self._source_ages, strict=False
                )
                if state.heard
            ),
            default=now,
        )

    def _find_late_rows(self, rows: IntArray, now: float, late: dict[int, str]) -> dict[int, float]:
        """How much states of late sources are older than usual, in [s], by row."""
        table = self._obstacles.table
        found = {}
        for row in rows.tolist():
            owner = int(table.owner[row])
            if owner in late and table.marks.has_state[row] and not table.marks.static[row]:
                age = now - float(table.accepted.stamp[row])
                found[row] = self._source_ages[owner].find_lateness(age)
        return {row: lateness for row, lateness in found.items() if lateness > 0.0}

    def _grade(self, tick: Tick, near: NearPairs, arm_late: float, late: dict[int, float]) -> Level:
        """The level with data of their usual ages."""
        stamps = self._obstacles.table.accepted.stamp
        known = {row: float(stamps[row]) for row in late}
        try:
            for row, lateness in late.items():
                stamps[row] += lateness
            return self._look_again.grade(tick, near.pairs, arm_late)
        finally:
            for row, stamp in known.items():
                stamps[row] = stamp
