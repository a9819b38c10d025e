"""How well each schedule keeps aware of the most imminent pair, as pairs grow in number.

    python benchmarks/bench_awareness.py [--pairs 60000] [--only deadline powers] [--ticks 3000] …

A Panda at work (`scene/crowds.py`) amid balls that walk in circles about a hall, each measured at
100 Hz; ticks at 1 kHz. All schedules see the same ticks: `full` evaluates every pair; `daa` comes
with both laws of partition and both sorts; `deadline` is the monitor's own. Contact times are those
of the library's compiled evaluation, joint bounds and all. Pairs that `daa` flags are counted, not
measured exactly: that takes a call from Python for each of them in every tick, and nearly all of
60,000 pairs are flagged. So what is shown of `daa` is the schedule alone.

All of it takes ten minutes or so, most of them for 60,000 pairs; `--pairs 6000` takes a few.

Before anything counts, as many ticks pass as the longest bucket takes to come round; after what
counts, schedules go on until they have noticed all they had to. Columns:

- pair: share of ticks in which the pair that a schedule puts first has the least contact time of
  all pairs (equal times count as agreement). obstacle: the same for the obstacle alone, since
  `deadline` does not tell links apart while the reach of the whole arm is enough. off: how much
  later than the least one the contact time of the obstacle named is, 99 % of ticks, in [ms].
- late: when another pair becomes the most imminent, how long until the schedule next evaluates it:
  median and longest, in [ms]. What was not noticed at all is marked with > and counted.
- answer: the earliest end of all certificates, over the least contact time of that tick: median;
  below 0 where certificates have ended.
- flagged: pairs that may come too near before their next visit (eq. 10), mean and most.
- complete: share of ticks in which each pair's certificate is in force or it was evaluated in that
  tick (eq. 11): where it is not, the schedule cannot notice in time without help; and the most
  pairs out of certificates in one tick.
- evaluated: kernel evaluations, mean of a tick.
- tick: choosing, evaluating and sorting, median and 99 % in [µs], on one core. Arm and bounds are
  laid out once for all schedules of pairs, and not counted there; for `deadline` they are. `full`
  is spared its sort, since the least contact time needs none.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from armguard.obstacles import Obstacles
from armguard.pairs.arm import WatchedArm
from armguard.pairs.ignored import IgnoredPairs
from armguard.robot import Robot
from armguard.scheduling import DaaSchedule, FullSchedule
from armguard.scheduling.paper.partition import make_partition
from armguard.scheduling.scheduler import Tick
from scene.crowds import RATE, Work, publish
from scene.lookouts import SETTINGS, Deadline, Full, PairSchedule, Walkers
from scene.machine import describe_machine

LADDER = (60, 600, 6_000, 60_000)  # pairs
EQUAL = 1.0 + 1e-9  # contact times within this factor are equal
COLUMNS = (
    "pair %", "obstacle %", "off p99", "late med", "late max", "answer", "flagged", "most",
    "complete %", "expired", "evaluated", "tick", "p99",
)  # fmt: skip


class Score:
    """What one schedule made of the ticks that count."""

    def __init__(self) -> None:
        self.pair_agreed, self.obstacle_agreed, self.off, self.answers = [], [], [], []
        self.least = math.inf
        self.flagged, self.expired = [], []
        self.evaluations, self.durations = [], []
        self.delays: list[int] = []
        self.waiting: list[tuple[int, int]] = []
        """Pairs that became the most imminent and were not evaluated since, and when that was."""

    def judge(self, contestant, times, spent: int, duration: int) -> None:
        """Hold an answer against all contact times (obstacles, links) of its tick."""
        least, (row, link) = times.min(), divmod(contestant.name(), times.shape[1])
        soonest = times[row].min()
        self.least = min(self.least, float(least))
        self.pair_agreed.append(times[row, link] <= least * EQUAL)
        self.obstacle_agreed.append(soonest <= least * EQUAL)
        self.off.append(soonest - least)
        self.answers.append(contestant.find_earliest() / least if least > 0.0 else math.nan)
        self.flagged.append(contestant.count_flagged())
        self.expired.append(contestant.count_expired())
        self.evaluations.append(spent)
        self.durations.append(duration / 1e3)

    def notice(self, contestant) -> None:
        """Settle which pairs were evaluated since they became the most imminent."""
        still = []
        for pair, since in self.waiting:
            seen = contestant.last_look(pair)
            if seen >= since:
                self.delays.append(seen - since)
            else:
                still.append((pair, since))
        self.waiting = still

    def figures(self, last_tick: int) -> list[str]:
        """One cell for each of `COLUMNS`."""
        unnoticed = [last_tick - since for _, since in self.waiting]
        delays = np.array(self.delays + unnoticed, dtype=float) * (1e3 / RATE)
        middle, longest = ("–", "–")
        if len(delays):
            middle, longest = f"{np.median(delays):,.0f}", f"{delays.max():,.0f}"
        if unnoticed:
            longest = f">{longest} ({len(unnoticed)})"
        numbers = (
            np.mean(self.flagged), np.max(self.flagged),
            100.0 * np.mean(np.array(self.expired) == 0), np.max(self.expired),
            np.mean(self.evaluations), np.median(self.durations),
            np.quantile(self.durations, 0.99),
        )  # fmt: skip
        return [
            _format(100.0 * np.mean(self.pair_agreed)),
            _format(100.0 * np.mean(self.obstacle_agreed)),
            _format(1e3 * np.quantile(self.off, 0.99)),
            middle,
            longest,
            _format(np.median(self.answers)),
            *map(_format, numbers),
        ]


def _format(value: float) -> str:
    if not abs(value) < 999.5:
        return f"{value:,.0f}"
    return f"{value:.4g}" if value >= 10.0 else f"{value:.3g}"


class Trial:
    """One number of balls, and all schedules at once.

    Args:
        work: What the arm does; as many ticks of it as are ever needed.
        count: Balls.
        options: Of the command line.
    """

    def __init__(self, work: Work, count: int, options) -> None:
        self._work = work
        self._walkers = Walkers(count, options.nearest, options.seed)
        self._obstacles = obstacles = Obstacles(sources=["crowd"])
        ignored = IgnoredPairs((), work.robot)

        def make_arm(robot: Robot) -> WatchedArm:
            return WatchedArm(robot, obstacles, ignored, SETTINGS)

        self._arm = arm = make_arm(work.robot)
        pairs = count * len(arm.links)
        self._full = Full(FullSchedule(), arm, pairs)
        contestants = {
            f"daa, {law}, {sort}": PairSchedule(DaaSchedule(1.0 / RATE, law, sort), arm, pairs)
            for law in ("powers", "fibonacci")
            for sort in ("partial", "total")
        }
        contestants["deadline"] = Deadline(work.robot, obstacles, make_arm)
        self._contestants = {
            name: contestant
            for name, contestant in contestants.items()
            if not options.only or any(word in name for word in options.only)
        }
        self.scores = {name: Score() for name in ("full", *self._contestants)}
        self._leader = -1
        self.changes = 0
        self._number = -1

    @property
    def is_settled(self) -> bool:
        """Whether every schedule has evaluated all that it had to notice."""
        return not any(score.waiting for score in self.scores.values())

    def pass_tick(self, *, counts: bool) -> None:
        """Let one tick pass, whether it counts or only keeps the schedules going."""
        tick = self._begin()
        if counts:
            self._look(self._full, "full", tick, counts=True)
            self._follow_leader(tick.number)
        for name, contestant in self._contestants.items():
            self._look(contestant, name, tick, counts=counts)

    def _begin(self) -> Tick:
        """Take in what is measured, and place the arm for all schedules of pairs."""
        self._number = number = self._number + 1
        now, work, state = number / RATE, self._work, self._arm.state
        q, v, stop_time = work.q[number], work.v[number], float(work.stop_time[number])
        names, position, velocity = self._walkers.measure(number)
        if names:
            publish(self._obstacles, names, now, position, velocity)
        refinement_threshold = (stop_time + SETTINGS.aware_margin) / SETTINGS.fresh_share
        self._arm.kinematics.place(q)
        state.now, state.arm_age = now, 0.0
        state.refinement_threshold = refinement_threshold
        state.sphere_time.fill(np.inf)
        state.view_table()
        state.prepare_arm(q, v)
        return Tick(number, now, now, q, v, 0.0, stop_time, refinement_threshold)

    def _look(self, contestant, name: str, tick: Tick, *, counts: bool) -> None:
        begin = time.perf_counter_ns()
        spent = contestant.step(tick)
        duration = time.perf_counter_ns() - begin
        contestant.record(tick)
        score = self.scores[name]
        if counts:
            times = self._full.times.reshape(-1, len(self._arm.links))
            score.judge(contestant, times, spent, duration)
        if score.waiting:
            score.notice(contestant)

    def _follow_leader(self, number: int) -> None:
        """See whether another pair is the most imminent now: each contestant has to notice it."""
        times = self._full.times
        if self._leader >= 0 and times[self._leader] <= times.min() * EQUAL:
            return
        if self._leader >= 0:
            self.changes += 1
            for score in self.scores.values():
                score.waiting.append((int(times.argmin()), number))
            self.scores["full"].notice(self._full)
        self._leader = int(times.argmin())


def find_longest_round(pairs: int) -> int:
    """Ticks in which every bucket that so many pairs fill comes round, by either law."""
    rounds = [1]
    for law in ("powers", "fibonacci"):
        partition = make_partition(law)
        rounds += partition.sizes[partition.bases <= pairs].tolist()
    return max(rounds)


def compare(robot: Robot, count: int, options) -> Trial:
    """Run and print one number of balls."""
    pairs = count * len(robot.links)
    longest = find_longest_round(pairs)
    counted = max(1, min(options.ticks, round(options.pair_ticks / pairs)))
    work = Work(robot, 2 * longest + counted, options.speed)
    trial = Trial(work, count, options)
    for counts, ticks in ((False, longest), (True, counted)):
        for _ in range(ticks):
            trial.pass_tick(counts=counts)
    drained = 0
    while drained < longest and not trial.is_settled:
        trial.pass_tick(counts=False)
        drained += 1
    least = 1e3 * trial.scores["full"].least
    print(
        f"\n{pairs:,} pairs ({len(robot.links)} links, {count:,} balls), {counted:,} ticks; "
        f"another pair became the most imminent {trial.changes:,} times; "
        f"least contact time {least:.0f} ms; longest round {longest:,} ticks"
    )
    print(" " * 24 + "".join(f"{title:>12}" for title in COLUMNS))
    for name, score in trial.scores.items():
        cells = score.figures(longest + counted + drained - 1)
        print(f"{name:<24}" + "".join(f"{cell:>12}" for cell in cells), flush=True)
    return trial


def main(arguments: list[str] | None = None) -> None:
    """Print a table for each number of pairs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=LADDER[-1], help="at most so many")
    parser.add_argument("--only", nargs="+", help="schedules whose names contain one of these")
    parser.add_argument("--ticks", type=int, default=10_000, help="that count, at most")
    parser.add_argument("--pair-ticks", type=float, default=1.5e8, help="that count, at most")
    parser.add_argument("--speed", type=float, default=0.3, help="share of the joints' limits")
    parser.add_argument("--nearest", type=float, default=1.2, help="of balls, from the axis, [m]")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    robot = Robot.load("panda")
    print(describe_machine())
    for pairs in LADDER:
        if pairs <= options.pairs:
            compare(robot, max(1, round(pairs / len(robot.links))), options)


if __name__ == "__main__":
    main()
