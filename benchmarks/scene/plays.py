"""One arm beside one recorded person: judged by many rules at once, or obeying one of them."""

from __future__ import annotations

from collections import Counter, deque
from typing import Any, NamedTuple

import numpy as np

from scene.clearance import Leaves
from scene.recorded_people import RADII, People
from scene.stop_rules import HELD, LATENCY, Moment, Oracle, Rule
from scene.touches import Log, TouchLog
from scene.working_arm import WorkingArm

RISE_DELAY = 0.3
"""How long a rule holds a STOP that it does not hold by itself, in [s]."""

CLOSE_STEPS = 10
"""In which an arm that may touch somebody is followed from tick to tick."""

LISTEN, BEGIN = 0.1, 0.5
"""When rules begin to judge an arm that rests, and when it sets off and counting begins, in [s]."""


class Judged(NamedTuple):
    """What became of one rule beside one recording, of an arm that goes on whatever is said."""

    ticks: int
    stopped: int
    needed: int
    """Ticks in which the rule that knows the future says STOP by itself, not for a tick before."""
    missed: int
    """Those of them without a STOP, for a body that was in view and had kept its bounds."""
    hidden: int
    """Such ticks for a body that was hidden: its way is drawn straight through the gap."""
    beyond: int
    """Such ticks for a body that broke its bounds shortly before."""
    hits: int
    """Contacts of this arm, which obeys nobody."""
    progress: float
    """Along its path, in [s]."""
    prices: np.ndarray
    """Of judgements: what each took, in [s]. Shape (ticks,)."""
    blocked: int
    """Ticks in which a body is inside the arm's cover."""
    stopped_blocked: int
    """Those of them with a STOP."""
    causes: Counter[str]
    """Of the other STOPs of a monitor: how many ticks by cause."""


class Obeyed(NamedTuple):
    """What became of one rule beside one recording, of an arm that obeys it."""

    ticks: int
    stopped: int
    stops: int
    """How often it was told to stop."""
    missed: int
    """Contacts while it moved, with a body that was in view and had kept its bounds."""
    hidden: int
    """Such contacts with a body that was hidden."""
    beyond: int
    """Such contacts with a body that broke its bounds shortly before."""
    progress: float
    """Along its path, in [s]."""
    blocked: int
    """Ticks in which a body is inside the arm's cover."""
    stopped_blocked: int
    """Those of them with a STOP."""
    touches: tuple[Any, ...]
    """Of an arm that obeys contact limits, `Touch`; beside people who yield, `Press`."""


class Holder:
    """A verdict that falls at once and rises after `rise_delay` seconds without a STOP."""

    def __init__(self, rise_delay: float = RISE_DELAY) -> None:
        self.stops = True
        self._rise_delay = rise_delay
        self._last = -np.inf

    def update(self, now: float, safe: bool) -> bool:
        """Take a judgement; whether this tick says STOP."""
        if not safe:
            self._last = now
        self.stops = not safe or now - self._last < self._rise_delay
        return self.stops


class Brakes:
    """Carries verdicts to the arm: a GO after the latency, a STOP after all that delays it."""

    def __init__(self, arm: WorkingArm, delay: float) -> None:
        self._arm, self._delay = arm, delay
        self._due: deque[tuple[float, bool]] = deque()
        self._go = self._told = False

    def tell(self, now: float, stop: bool) -> None:
        """Send a verdict."""
        if stop == self._told:
            self._due.append((now + (self._delay if stop else LATENCY), not stop))
            self._told = not stop

    def run(
        self,
        now: float,
        period: float,
        speed_limit: np.ndarray | float = np.inf,
    ) -> None:
        """Let the arm move until the next tick, within a limit that `WorkingArm.step` knows."""
        while self._due and self._due[0][0] < now + period - 1e-9:
            when, go = self._due.popleft()
            if when > now:
                self._arm.step(when - now, self._go, speed_limit)
                period -= when - now
                now = when
            self._go = go
        self._arm.step(period, self._go, speed_limit)


class Contacts:
    """Which contacts begin in a tick, of an arm that moves."""

    def __init__(self) -> None:
        self._touching = np.zeros(len(RADII), dtype=bool)

    def begun(self, moment: Moment) -> np.ndarray:
        """Flags. Shape (bodies,)."""
        touching = (moment.gaps <= 0.0) & (not moment.arm.rests)
        new: np.ndarray = touching & ~self._touching
        self._touching = touching
        return new


class Stage:
    """Plays cases, one after the other, on one clock that never goes back.

    Args:
        robot: The arm.
        period: Of ticks, in [s].
    """

    def __init__(self, robot: Any, period: float) -> None:
        self._leaves = Leaves(robot)
        self._period = period
        self._clock = 0.0

    def judge(
        self, people: People, arm: WorkingArm, rules: list[Rule], seconds: float
    ) -> list[Judged]:
        """Let all rules judge an arm that goes on whatever they say; by rule.

        Of rules that are shown clean data, ticks shortly after a broken bound do not count. A rule
        misses a STOP if it does not say so in a tick in which an oracle with the same brakes
        and delays says that it is the last one that is in time.
        """
        brakes, contacts = Brakes(arm, 0.0), Contacts()
        holders = [Holder(0.0 if rule.holds else RISE_DELAY) for rule in rules]
        oracles = [rule for rule in rules if isinstance(rule, Oracle)]
        count = np.zeros((len(rules), 8), dtype=int)
        causes = [Counter[str]() for _ in rules]
        prices: list[list[float]] = [[] for _ in rules]
        hits = 0
        for moment in self._moments(people, arm, rules, seconds):
            counts = moment.counts
            frame, says, kept = people.frame(moment.since), [], []
            is_blocked = bool(moment.gaps.min() <= 0.0)
            for k, (rule, holder) in enumerate(zip(rules, holders, strict=True)):
                is_safe = rule.judge(moment)
                says.append(holder.update(moment.now, is_safe))
                broke = people.streams[rule.setting.bounds, rule.clean].broke[frame]
                kept.append(counts and not (rule.clean and broke.any()))
                count[k, :2] += kept[k], kept[k] and says[k]
                if is_blocked:
                    count[k, 6:] += kept[k], kept[k] and says[k]
                elif rule.cause and kept[k] and says[k]:
                    causes[k][HELD if is_safe and rule.clean else rule.cause] += 1
                if counts:
                    prices[k].append(rule.price)
            for oracle in oracles:
                if oracle.touched is None:
                    continue
                for k, rule in enumerate(rules):
                    if kept[k] and _is_answerable(rule, oracle):
                        count[k, 2] += 1
                        if not says[k]:
                            count[k, 3 + _find_doubt(moment, rule, *oracle.touched)] += 1
            if counts:
                hits += int(contacts.begun(moment).sum())
            brakes.tell(moment.now, not counts)
            brakes.run(moment.now, self._period)
        return [
            Judged(*row[:6], hits, arm.progress, np.array(price), *row[6:], cause)
            for row, price, cause in zip(count.tolist(), prices, causes, strict=True)
        ]

    def obey(
        self,
        people: People,
        arm: WorkingArm,
        rule: Rule,
        seconds: float,
        *,
        by_scale: bool,
        log: Log | None = None,
    ) -> Obeyed:
        """Let an arm obey one rule, and by wish keep to the speed that it allows.

        Args:
            people: Beside whom it works.
            arm: At the beginning of its trajectory.
            rule: What it obeys.
            seconds: How long, in [s].
            by_scale: Whether it keeps to the speed.
            log: What follows touches; None: with contact limits a `TouchLog`.
        """
        arm.brakes = rule.brakes
        brakes, contacts = Brakes(arm, rule.delay), Contacts()
        holder = Holder(0.0 if rule.holds or rule.goes_at_once else RISE_DELAY)
        if log is None and rule.limits is not None:
            log = TouchLog(rule.limits)
        ticks = stopped = stops = blocked = stopped_blocked = 0
        met = [0, 0, 0]
        for moment in self._moments(people, arm, [rule], seconds):
            before = holder.stops
            stop = holder.update(moment.now, rule.judge(moment))
            if moment.counts:
                ticks += 1
                stopped += stop
                stops += stop and not before
                is_blocked = bool(moment.gaps.min() <= 0.0)
                blocked += is_blocked
                stopped_blocked += is_blocked and stop
                for body in np.flatnonzero(contacts.begun(moment)):
                    met[_find_doubt(moment, rule, int(body), 0.0)] += 1
            brakes.tell(moment.now, stop or not moment.counts)
            speed_limit = rule.speed_limit if by_scale else np.inf
            if log is None:
                brakes.run(moment.now, self._period, speed_limit)
            else:
                self._run_closely(moment, brakes, rule, speed_limit, log)
        touches = () if log is None else log.touches
        counts = ticks, stopped, stops, *met
        return Obeyed(*counts, arm.progress, blocked, stopped_blocked, touches)

    def _run_closely(
        self,
        moment: Moment,
        brakes: Brakes,
        rule: Rule,
        speed_limit: np.ndarray | float,
        log: Log,
    ) -> None:
        """Let the arm move until the next tick, and follow what it touches meanwhile."""
        people, leaves, dt = moment.people, self._leaves, self._period / CLOSE_STEPS
        stream = people.streams[rule.setting.bounds, rule.clean]
        for step in range(CLOSE_STEPS):
            brakes.run(moment.now + step * dt, dt, speed_limit)
            since = moment.since + (step + 1) * dt
            people.advance(since, dt, moment.arm)
            leaves.place(*moment.arm.measured)
            frame = min(people.frame(since) + 1, len(people.ends) - 1)
            broken = stream.broke[frame] | people.is_filled[frame]
            log.follow(since, dt, leaves, people.ends_at(since), broken)

    def _moments(  # type: ignore[no-untyped-def]
        self, people: People, arm: WorkingArm, rules: list[Rule], seconds: float
    ):
        begin, period = self._clock, self._period
        people.reset()
        for rule in rules:
            rule.begin(people, begin)
        duration = min((len(people.ends) - 1) / people.rate, seconds + BEGIN)
        for tick in range(round(LISTEN / period), int(duration / period)):
            since = tick * period
            self._leaves.place(*arm.measured)
            gaps = self._leaves.gaps(people.ends_at(since), RADII)
            yield Moment(begin + since, since, arm, self._leaves, gaps, people, since >= BEGIN)
        self._clock = begin + round(duration) + 10.0


def _is_answerable(rule: Rule, oracle: Oracle) -> bool:
    """Whether a rule's STOP takes as long as that of an oracle, with the same brakes."""
    delays = rule.timing.period + rule.delay, oracle.timing.period + oracle.delay
    return delays[0] == delays[1] and rule.brakes.payload == oracle.brakes.payload


def _find_doubt(moment: Moment, rule: Rule, body: int, until: float) -> int:
    """2: a body broke its bounds shortly before a contact; 1: it was hidden then; 0: neither."""
    people = moment.people
    first, last = people.frame(moment.since), people.frame(moment.since + until)
    broke = people.streams[rule.setting.bounds, rule.clean].broke
    if broke[first : last + 1, body].any():
        return 2
    return int(people.is_filled[last, body])
