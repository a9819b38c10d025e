"""What it takes to attach a held part in a running loop, and to take it off again.

    python benchmarks/bench_attach.py --cycles 300

A Panda at rest among some obstacles grasps a box and puts it down, again and again: the calls
between two steps, and the step that takes each in, beside a usual step. First as `attach` does it,
then with what `Robot.prepare` and `Monitor.prepare` made ahead. Processor time of this thread, so
that other load on the machine counts little, and garbage is collected in between.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable

import coal
import numpy as np

from armguard import Monitor, Obstacles, Robot
from scene.machine import describe_machine

Q = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
STILL = np.zeros(7)
PERIOD = 1e-3


def measure(work: Callable[[], object]) -> float:
    """Processor time that some work takes, in [ms]."""
    begin = time.thread_time_ns()
    work()
    return 1e-6 * (time.thread_time_ns() - begin)


def show(name: str, durations: list[float]) -> None:
    """Print the spread of durations, in [ms]."""
    p50, p99 = np.percentile(durations, [50.0, 99.0])
    print(f"{name:34} {p50:9.3f} {p99:9.3f} {max(durations):9.3f}")


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=300)
    parser.add_argument("--obstacles", type=int, default=10)
    options = parser.parse_args()
    robot, obstacles = Robot.load("panda"), Obstacles(sources=[])
    for number in range(options.obstacles):
        angle = 2.0 * np.pi * number / options.obstacles
        place = [1.5 * np.cos(angle), 1.5 * np.sin(angle), 0.5]
        obstacles.add_static(f"body {number}", place, 0.1)
    monitor = Monitor(robot, obstacles)
    ticks = 0

    def step() -> None:
        nonlocal ticks
        ticks += 1
        monitor.step(ticks * PERIOD, Q, STILL)

    box = coal.Box(0.06, 0.06, 0.12)
    print(describe_machine())
    print(f"{'[ms] of processor time':34} {'p50':>9} {'p99':>9} {'max':>9}")
    for _ in range(2):  # the first time it compiles what fits covers
        fitting = measure(lambda: robot.prepare("box", "panda_hand", box))
    show("Robot.prepare", [fitting])
    part = robot.prepare("box", "panda_hand", box)
    fresh = []
    for number in range(8):
        # By another name each time it is another body.
        other = robot.prepare(f"box {number}", "panda_hand", box)
        robot.attach_prepared(other)
        fresh.append(measure(step))
        robot.detach(f"box {number}")
        step()
    show("step after attach", fresh)
    show("Monitor.prepare", [measure(lambda: monitor.prepare(part))])
    calls, taken, off, usual = [], [], [], []
    gc.disable()
    for _ in range(options.cycles):
        gc.collect()
        calls.append(measure(lambda: robot.attach_prepared(part)))
        taken.append(measure(step))
        usual.append(measure(step))
        robot.detach("box")
        off.append(measure(step))
        step()
    show("attach_prepared", calls)
    show("step after attach_prepared", taken)
    show("step after detach", off)
    show("usual step", usual)


if __name__ == "__main__":
    main()
