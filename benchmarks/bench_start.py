"""What a start costs: the first one, which compiles, and one that finds everything compiled.

    python benchmarks/bench_start.py --kernels 10

starts processes one after another, each of which makes a monitor of a Panda with all defaults,
takes in ten obstacles and steps once. The first has an empty folder for its kernels, the others
what the first one left. All of this is done with the fast path of compilation (see
`armguard/jit/kernels.py`), and again without it, `plain`. Each process then moves arm and
obstacles for a moment, and all must give the same verdicts to the bit.

Times are the process's own, imports included: processor time on all cores, and wall time, which
other load stretches. `compiled` counts kernels. Beside each of the dearest functions, Numba's own
among them, stands what it took without those that were compiled on its behalf. `reference` is what
the same machine needs for a known quantity of work, in one thread of plain Python: how fast
processors are differs more than how much there is to compile.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from typing import Any

import numpy as np

from scene.machine import describe_machine

SQUARES = 50_000_000
TICKS = 1000
Q = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


def processor_time() -> float:
    """Of this process so far, in [s]."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def start(schedule: str) -> dict[str, Any]:
    """Come to a first verdict in this process; what that took."""
    from numba.core import event

    kernels: dict[str, float] = defaultdict(float)
    counts: dict[str, int] = defaultdict(int)
    # Of each compilation under way: when it began, and what others took meanwhile.
    running: list[list[float]] = []

    class Listener(event.Listener):
        def on_start(self, _: Any) -> None:
            running.append([processor_time(), 0.0])

        def on_end(self, what: Any) -> None:
            began, others = running.pop()
            duration = processor_time() - began
            function = what.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__name__}"
            kernels[name] += duration - others
            counts[name] += 1
            if running:
                running[-1][1] += duration

    event.register("numba:compile", Listener())
    import armguard
    from armguard.jit.progress import compilation

    imported = processor_time()
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(armguard.Robot.load("panda"), obstacles, schedule=schedule)
    ids = [f"ball {number}" for number in range(10)]
    positions = [[1.2 + 0.1 * number, 0.0, 0.5] for number in range(10)]
    obstacles.update(ids, 0.0, positions, radius=0.1)
    verdict = monitor.step(0.0, Q, [0.0] * 7)
    assert verdict.evaluated > 0
    processor, compiled = processor_time(), compilation.count
    digest = hashlib.sha256(repr(verdict).encode())
    for tick in range(1, TICKS):
        now = 0.001 * tick
        swing = 0.1 * (1.0 - np.cos(3.0 * now))
        if tick % 10 == 0:
            obstacles.update(ids, now, np.subtract(positions, [swing, 0.0, 0.0]), radius=0.1)
        verdict = monitor.step(now, np.add(Q, swing), np.full(7, 0.3 * np.sin(3.0 * now)))
        digest.update(repr(verdict).encode())
    dearest = sorted(kernels, key=lambda name: -kernels[name])
    return {
        "processor": processor,
        "imports": imported,
        "compiled": compiled,
        "verdicts": digest.hexdigest()[:8],
        "kernels": [(kernels[name], counts[name], name) for name in dearest],
    }


def sum_squares() -> float:
    """Processor time of a sum of squares, in [s]."""
    began = processor_time()
    sum(number * number for number in range(SQUARES))
    return processor_time() - began


def measure(schedule: str, folder: str, jit: str) -> dict[str, Any]:
    """Start a process with this folder for its kernels."""
    choice = "plain" if jit == "plain" else ""
    environment = {**os.environ, "NUMBA_CACHE_DIR": folder, "ARMGUARD_JIT": choice}
    began = time.perf_counter()
    told = subprocess.run(
        [sys.executable, __file__, "--schedule", schedule, "--in-this-process"],
        env=environment, stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    found: dict[str, Any] = json.loads(told.stdout)
    return {**found, "wall": time.perf_counter() - began}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--schedule", default="deadline")
    parser.add_argument("--warm", type=int, default=3, help="how many starts after the first")
    parser.add_argument("--kernels", type=int, default=10, help="how many of the dearest to print")
    parser.add_argument("--in-this-process", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.in_this_process:
        print(json.dumps(start(arguments.schedule)))
        return
    print(describe_machine())
    print(f"reference: the sum of {SQUARES:,} squares takes {sum_squares():.2f} s")
    print(
        f"{'start':12} {'processor':>10} {'wall':>8} {'imports':>8} {'compiled':>9} {'verdicts':>9}"
    )
    kernels, verdicts = [], set()
    for jit in ("fast", "plain"):
        with tempfile.TemporaryDirectory() as folder:
            for number in range(1 + arguments.warm):
                found = measure(arguments.schedule, folder, jit)
                kernels = kernels or found["kernels"]
                verdicts.add(found["verdicts"])
                print(
                    f"{jit:5} {'first' if number == 0 else 'warm':6} {found['processor']:8.2f} s"
                    f" {found['wall']:6.2f} s {found['imports']:6.2f} s {found['compiled']:9d}"
                    f" {found['verdicts']:>9}"
                )
    for duration, count, name in kernels[: arguments.kernels]:
        print(f"{duration:8.2f} s {count:3d} {name}")
    if len(verdicts) > 1:
        raise SystemExit("the verdicts differ")


if __name__ == "__main__":
    main()
