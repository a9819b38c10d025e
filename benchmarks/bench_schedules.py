"""What a tick costs: armguard's schedules, a sweep over all pairs, and what users pick today.

    python benchmarks/bench_schedules.py [--obstacles 10 1000] [--only deadline sweep] [--ticks 300]
    …
    python benchmarks/bench_schedules.py --nearest 0 1.2 --obstacles 10 1000 10000

The second line has far and near scenes side by side; docs/performance.md shows it.

A Panda works slowly amid balls that wander about a hall (`scene/crowds.py`); every contestant
(`scene/rivals.py`) sees the same joint states at 1 kHz and the same balls, each measured at 100 Hz,
or at 1 Hz where there are 100,000. No ball comes so near that even the crudest bound would stop the
arm, unless `--nearest` says how near they come to its base's axis. A contestant that says STOP is
marked, since stopping the arm is easy.

`sweep, spheres` evaluates all pairs of a ball and one of the cover's finest spheres in every tick,
with a vectorised bound, and the exact time only where that beats the best so far. `sweep,
bounds` does so with one ball around each link instead; `sweep, reach` (and `reach32`, in single
precision) rules out most balls by what the arm cannot leave. ÷ is a sweep's median over that of the
line.

Contestants take turns of so many ticks, again and again, so that whatever else the machine does
falls on each of them. Times are processor time of this thread, or with `--wall` as they pass on the
wall, in microseconds: the median over turns of each turn's median and 99 % of its ticks, and the
slowest of all ticks. `update` is the median of taking in what was measured in that tick, which is
timed apart. Garbage is collected before a turn and not
during it, the first ticks of a turn are not counted, nor are those before the first turn, in which
the schedules spread their load. A slow contestant takes fewer ticks, from the beginning. Memory is
what the process grew by, from making a contestant to its first tick, for each obstacle.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import math
import os
import time
from pathlib import Path

import numpy as np

from armguard.robot import Robot
from scene.crowds import RATE, Crowd, UnavailableError, Work
from scene.machine import _load, describe_machine
from scene.rivals import CONTESTANTS

MANY = 100_000
UPDATE_RATE, UPDATE_RATE_OF_MANY = 100.0, 1.0  # [Hz]
LEAD_IN = 100  # ticks at the beginning of a turn that do not count: then caches hold what is used
TARGETS = {  # of "deadline, joint": median and 99 % of its ticks, [µs]
    10: (4.0, None),
    1_000: (8.0, 25.0),
    10_000: (40.0, 120.0),
    100_000: (400.0, None),
}
CHEAPER = {1_000: 20.0, 10_000: 40.0}  # than "sweep, spheres", at least
MEASURABLE = 1_000  # obstacles from which on the growth of the process says anything
SWEEPS = ("spheres", "bounds", "reach")  # that medians are set in relation to
COLUMNS = ("update", "median", "p99", "max", *(f"÷{sweep}" for sweep in SWEEPS))
COLUMNS += ("evaluated", "B/obst", "ticks")


class Run:
    """One contestant and what it took."""

    def __init__(self, name: str, make, arguments, work: Work, crowd: Crowd, clock) -> None:
        self.name, self._work, self._crowd, self._clock = name, work, crowd, clock
        self._tick = 0
        self.turns: list[tuple[float, float, float]] = []
        self.slowest, self.ticks, self.stops = 0.0, 0, 0
        self.evaluations, self.earliest = [], math.inf
        _trim()
        before = read_memory()
        self._contestant = make(work, crowd.count, *arguments)
        self._take(1, math.inf)
        _trim()
        self.memory = (read_memory() - before) / crowd.count

    def warm(self, ticks: int, patience: float) -> None:
        """Take ticks that do not count, for so many seconds at most."""
        self._take(ticks, patience)

    def take_turn(self, ticks: int, patience: float) -> None:
        """Take ticks that count, for so many seconds at most."""
        gc.collect()
        gc.disable()
        try:
            updates, steps, answers = self._take(LEAD_IN + ticks, patience)
        finally:
            gc.enable()
        first = min(LEAD_IN, len(steps) // 2)
        steps, answers = np.array(steps[first:]) / 1e3, answers[first:]
        self.turns.append(
            (np.median(updates[first:]) / 1e3, np.median(steps), np.quantile(steps, 0.99))
        )
        self.slowest = max(self.slowest, steps.max())
        self.ticks += len(steps)
        self.stops += sum(not answer.go for answer in answers)
        self.evaluations += [answer.evaluations for answer in answers]
        self.earliest = min(self.earliest, *(answer.time for answer in answers))

    def figures(self) -> tuple[float, float, float]:
        """Medians over turns: of updates, of ticks, and of the 99 % of ticks, in [µs]."""
        return tuple(np.median(self.turns, axis=0))

    def _take(self, ticks: int, patience: float):
        """Durations in [ns] of updates and steps, and answers."""
        work, crowd, contestant = self._work, self._crowd, self._contestant
        updates, steps, answers = [], [], []
        clock = self._clock
        end = time.monotonic() + patience
        for _ in range(ticks):
            tick, self._tick = self._tick, self._tick + 1
            rows, names, position, velocity = crowd.measure(tick)
            stamp, q, v = tick / RATE, work.q[tick], work.v[tick]
            stop_time = float(work.stop_time[tick])
            begin = clock()
            contestant.update(rows, names, stamp, position, velocity)
            middle = clock()
            contestant.step(stamp, q, v, stop_time)
            after = clock()
            updates.append(middle - begin)
            steps.append(after - middle)
            answers.append(contestant.read())
            if time.monotonic() > end:
                break
        return updates, steps, answers


def read_memory() -> int:
    """Resident memory of this process, in [bytes]; 0 where the system does not tell."""
    path = Path("/proc/self/statm")
    if not path.exists():
        return 0
    return int(path.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _trim() -> None:
    """Give back what is not in use, so that the next contestant does not grow into it unseen."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def make_runs(count: int, work: Work, crowd: Crowd, options) -> list[Run]:
    """All that take part; what does not is printed with its reason."""
    runs = []
    clock = time.perf_counter_ns if options.wall else time.thread_time_ns
    for name, _, most, make, arguments in CONTESTANTS:
        if options.only and not any(word in name for word in options.only):
            continue
        if count > most and not options.unlimited:
            print(f"{name}: left out above {most:,} obstacles")
            continue
        try:
            runs.append(Run(name, make, arguments, work, crowd, clock))
        except UnavailableError as reason:
            print(f"{name}: not available: {reason}")
    return runs


def print_table(count: int, runs: list[Run], *, has_targets: bool) -> None:
    """One line for each contestant."""
    median = {run.name: run.figures()[1] for run in runs}
    print(f"{f'{count:,} obstacles':<22}" + "".join(f"{title:>11}" for title in COLUMNS), end="")
    print("   earliest    answer")
    for run in runs:
        update, middle, high = run.figures()
        cells = [_format(value) for value in (update, middle, high, run.slowest)]
        for sweep in SWEEPS:
            swept = median.get(f"sweep, {sweep}", math.nan)
            cells.append(_format(swept / middle))
        cells.append(_format(float(np.mean(run.evaluations))))
        cells.append(f"{run.memory:,.0f}" if count >= MEASURABLE else "–")
        cells.append(f"{run.ticks:,}")
        answer = "GO" if run.stops == 0 else f"STOP in {run.stops} ticks"
        print(f"{run.name:<22}" + "".join(f"{cell:>11}" for cell in cells), end="")
        print(f"{_format(run.earliest):>11}    {answer}")
    if has_targets and count in TARGETS and "deadline, joint" in median:
        wanted, high = TARGETS[count]
        text = f"targets of deadline, joint: median {wanted:g}"
        text += f", p99 {high:g}" if high else ""
        text += f", ÷spheres {CHEAPER[count]:g}" if count in CHEAPER else ""
        print(text)


def _format(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:,.0f}" if value >= 1000.0 else f"{value:.3g}"


def compare(count: int, nearest: float, options) -> None:
    """Run and print one number of obstacles, so near to the base's axis, in [m]; 0: far away."""
    interval = 1.0 / (UPDATE_RATE if count < MANY else UPDATE_RATE_OF_MANY)
    ticks = 1 + options.warm + options.turns * (LEAD_IN + options.ticks)
    work = Work(Robot.load("panda"), ticks, options.speed)
    crowd = Crowd(count, nearest or work.find_clearance(interval), 1.0 / interval)
    print(
        f"\narm at up to {100.0 * options.speed:g} % of its speed limits, stops within "
        f"{work.stop_time.max():.3f} s; no ball nearer than {crowd.nearest:.2f} m, each "
        f"measured once in {crowd.group_count} ticks; load {_load()}"
    )
    runs = make_runs(count, work, crowd, options)
    for run in runs:
        run.warm(options.warm, options.patience)
    for turn in range(options.turns):
        shift = turn % max(len(runs), 1)
        for run in runs[shift:] + runs[:shift]:
            run.take_turn(options.ticks, options.patience)
    print_table(count, runs, has_targets=not nearest)


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--obstacles", type=int, nargs="+", default=[10, 100, 1000, 10_000, MANY])
    parser.add_argument("--only", nargs="+", help="contestants whose names contain one of these")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--ticks", type=int, default=400, help="that count, in a turn")
    parser.add_argument("--warm", type=int, default=2000, help="ticks before the first turn")
    parser.add_argument("--patience", type=float, default=4.0, help="seconds for a turn")
    parser.add_argument("--speed", type=float, default=0.1, help="share of the joints' limits")
    parser.add_argument(
        "--nearest",
        type=float,
        nargs="+",
        default=[0.0],
        help="of balls to the base's axis, [m]; 0: so far away that all say GO",
    )
    parser.add_argument("--wall", action="store_true", help="times as they pass on the wall")
    parser.add_argument("--unlimited", action="store_true", help="whatever the time it takes")
    options = parser.parse_args(arguments)
    print(describe_machine())
    print("asked for: " + "; ".join(f"{name}: {asked}" for name, asked, *_ in CONTESTANTS))
    for count in options.obstacles:
        for nearest in options.nearest:
            compare(count, nearest, options)
    print(f"\nload in the end {_load()}")


if __name__ == "__main__":
    main()
