"""What a tick costs right beside people, parts and balls, where stopping is decided.

    python benchmarks/bench_near.py [--only person balls] [--ticks 2000] [--turns 3] [--wall]

A Panda swings slowly at 1 kHz (`scene/beside.py`); everything about it is measured at 100 Hz and
may move by 10 m/s² and 2 m/s. Times are in microseconds of one core: median, 99 % and the slowest
tick, over all turns; garbage is collected between turns. They are processor time of this thread,
so that what else the machine does counts as little as it can; `--wall` takes the clock's instead.
`evaluated` is the mean number of evaluations in a tick, and `most` that of the dearest one. Where
pieces are committed, a line of its own has what a `commit` takes.

`loop` is what a plain scalar loop takes in the same run, in turns with the monitor: the earliest
contact of each obstacle and each of the cover's finest spheres, both as free bodies, by the kernel
that the monitor uses itself; it knows of no tree, schedule or joint bounds, makes no stop decision,
and says nothing of how fast the arm may go on. ÷loop is its median over that of the line, so above
1 the monitor is the cheaper one. Levels are how many ticks were STOP, SLOW, AWARE and CLEAR.

Scenes with contact limits are the same as those without, pose by pose, and take turns with them.
Their ticks were to take 1.2 times as long at most.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from armguard.contact.advancement import row_contact_time
from armguard.contact.bodies import Ball, Bounds
from armguard.jit.kernels import kernel
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.pairs.contact_time import bounds_of
from armguard.pairs.scene import ADVANCES
from armguard.robot import Robot
from armguard.verdict import Level
from scene.beside import (
    PIECE,
    RATE,
    UPDATE_RATE,
    WITH_LIMITS,
    Setting,
    Swing,
    make_settings,
)
from scene.machine import _load, describe_machine

COMMIT_EVERY = 50  # ticks
COLUMNS = ("median", "p99", "max", "evaluated", "most", "loop", "÷loop")
TARGETS = {  # median and 99 % of ticks, [µs]; evaluations
    "person at 1.1 m": (40, 100, 60),
    "commit": (None, 300, None),
    "3 people, 20 parts": (120, None, None),
    "1,000 near balls": (60, 200, None),
}


@kernel
def loop_over_all(handle: Any, now: float, age: float) -> float:
    """Earliest contact in [s] of all obstacles and finest spheres, one pair after the other."""
    scene = handle.content
    bodies, arm, tree = scene.bodies, scene.arm, scene.tree
    earliest = np.inf
    for row in range(scene.marks.alive.shape[0]):
        if not scene.marks.alive[row]:
            continue
        for node in range(tree.radius.shape[0]):
            if tree.first_child[node] >= 0:
                continue
            distance = tree.radius[node] + arm.position_error[node]
            distance += bodies.radius[row] + bodies.position_error[row]
            sphere = Ball(
                arm.centers[node, 0], arm.centers[node, 1], arm.centers[node, 2],
                arm.velocities[node, 0], arm.velocities[node, 1], arm.velocities[node, 2],
                Bounds(arm.accel[node], arm.speed[node], arm.velocity_error[node], age),
            )  # fmt: skip
            found = row_contact_time(
                sphere, bodies.points, bodies.velocities, row, bodies.point_count[row],
                bounds_of(bodies, row, now - bodies.stamp[row]), distance, ADVANCES, None,
            )  # fmt: skip
            earliest = min(earliest, found)
    return earliest


class Run:
    """One scene, its monitor, and what its ticks took."""

    def __init__(self, name: str, setting: Setting, swing: Swing, clock: Callable[[], int]) -> None:
        self.name, self._setting, self._swing, self._clock = name, setting, swing, clock
        self.tick = 0
        self.obstacles = Obstacles(sources=[], regions=setting.regions)
        self._monitor = Monitor(swing.robot, self.obstacles, rate=RATE, **setting.settings)
        self.forget()

    def forget(self) -> None:
        """Start counting anew."""
        self.steps: list[int] = []
        self.commits: list[int] = []
        self.loops: list[int] = []
        self.evaluated: list[int] = []
        self.levels = dict.fromkeys(Level, 0)
        self.refused: set[str] = set()

    def take(self, ticks: int) -> None:
        """Let so many ticks pass."""
        clock, monitor, swing = self._clock, self._monitor, self._swing
        every = round(RATE / UPDATE_RATE)
        gc.collect()
        gc.disable()
        try:
            for _ in range(ticks):
                now = self.tick / RATE
                if self.tick % every == 0:
                    for some in self._setting.crowd:
                        some.publish(self.obstacles, now)
                q, v = swing.sample(now)
                begin = clock()
                verdict = monitor.step(now, q, v)
                self.steps.append(clock() - begin)
                self.evaluated.append(verdict.evaluated)
                self.levels[verdict.level] += 1
                self._tell_plan(now)
                self.tick += 1
        finally:
            gc.enable()

    def take_loop(self, ticks: int) -> None:
        """Let the loop do so many ticks on what there is now."""
        clock, arm = self._clock, self._monitor._scheduler.arm
        now = (self.tick - 1) / RATE
        q, v = self._swing.sample(now)
        for _ in range(ticks):
            begin = clock()
            arm.kinematics.compute(q, v)
            loop_over_all(arm.state.handle, now, 0.0)
            self.loops.append(clock() - begin)

    def _tell_plan(self, now: float) -> None:
        monitor, swing = self._monitor, self._swing
        if not self._setting.commits or self.tick % COMMIT_EVERY:
            return
        plan = monitor.with_stop(swing.plan(now, PIECE))
        begin = self._clock()
        answer = monitor.commit(plan)
        self.commits.append(self._clock() - begin)
        self.refused |= {str(reason) for reason in answer.reasons}


def print_run(run: Run) -> None:
    """One line for a scene, and one for its commits."""
    loop = float(np.median(run.loops)) / 1e3
    for name, spent in ((run.name, run.steps), ("commit", run.commits)):
        if not spent:
            continue
        times = np.array(spent) / 1e3
        cells = [np.median(times), np.quantile(times, 0.99), times.max()]
        cells += [np.mean(run.evaluated), max(run.evaluated)] if spent is run.steps else ["", ""]
        cells += [loop, loop / cells[0]]
        line = "".join(f"{cell if cell == '' else _format(cell):>11}" for cell in cells)
        wanted = TARGETS.get(name)
        targets = "" if wanted is None else " / ".join("–" if x is None else f"{x}" for x in wanted)
        levels = " ".join(str(count) for count in run.levels.values()) if spent is run.steps else ""
        print(f"{name:<34}{line}   {levels:<22}{targets}", flush=True)
    for reason in sorted(run.refused):
        print(f"    a plan was not taken: {reason}")


def print_price_of_limits(without: Run, limited: Run | None = None) -> None:
    """What ticks with contact limits take, in shares of those without at equal poses."""
    if limited is None:
        return
    shares = [
        np.quantile(limited.steps, share) / np.quantile(without.steps, share)
        for share in (0.5, 0.99)
    ]
    print(f"    with contact limits ÷ without: median {shares[0]:.2f}, 99 % {shares[1]:.2f}")


def _format(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def main(arguments: list[str] | None = None) -> list[Run]:
    """Print the table, and return what it was made of."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", help="scenes whose names contain one of these")
    parser.add_argument("--ticks", type=int, default=2000, help="that count, in a turn")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--warm", type=int, default=500, help="ticks before the first turn")
    parser.add_argument("--wall", action="store_true", help="time by the clock on the wall")
    options = parser.parse_args(arguments)
    clock = time.perf_counter_ns if options.wall else time.thread_time_ns
    print(describe_machine())
    swing = Swing(Robot.load("panda"))
    title = "".join(f"{column:>11}" for column in COLUMNS)
    print(f"{'[µs]':<34}{title}   {'STOP SLOW AWARE CLEAR':<22}targets")
    runs = []
    scenes: dict[str, list[Run]] = {}
    for name, setting in make_settings(swing).items():
        if options.only and not any(word in name for word in options.only):
            continue
        alike = scenes.setdefault(name.removesuffix(WITH_LIMITS), [])
        alike.append(Run(name, setting, swing, clock))
    for alike in scenes.values():
        for run in alike:
            run.take(options.warm)
            run.take_loop(3)
            run.forget()
        for _ in range(options.turns):
            for run in alike:
                run.take(options.ticks)
                run.take_loop(10)
        for run in alike:
            print_run(run)
        print_price_of_limits(*alike)
        runs += alike
    print(f"load in the end {_load()}")
    return runs


if __name__ == "__main__":
    main()
