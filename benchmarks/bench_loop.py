"""What a tick of the loop spends on draining, stepping and publishing, in the demo's own scene.

    python benchmarks/bench_loop.py --rounds 5 --seconds 10
    python benchmarks/bench_loop.py --trees . ../base

The cell file is that of `armguard demo`, and so are the processes beside the loop: perception, and
an arm that obeys the verdicts, over ipc sockets. The loop is `armguard run` in a process of its
own. Several trees of sources are measured in turn, a round at a time, so that whatever else the
machine does falls on all of them; the processes beside the loop always run the sources of this
benchmark. Each tree is a folder that holds the package `armguard`.

Printed are medians over the rounds of p50, p99 and maximum, in microseconds by the wall clock, and
for each tree after the first the medians of its ratios to the first one in the same round.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

PARTS = {
    "drain": ("armguard.streams.edge", "Edge", "drain"),
    "step": ("armguard.monitor.monitor", "Monitor", "step"),
    "publish": ("armguard.streams.nodes", "VerdictPublisher", "publish"),
}
"""Where the parts of a tick are, in every tree that can be measured."""

OUTSIDE = "drain + publish"
WARMING = 2.0
"""[s] after the first tick that are not measured."""

OBSTACLES, JOINTS, VERDICTS = "obstacles", "joints", "verdicts"


class Timed:
    """Calls of one method, and how long each took."""

    def __init__(self, module: str, owner: str, name: str) -> None:
        self.begin: list[int] = []
        self.took: list[int] = []
        holder = getattr(importlib.import_module(module), owner)
        method, now = getattr(holder, name), time.perf_counter_ns

        def call(*arguments):
            begin = now()
            result = method(*arguments)
            self.took.append(now() - begin)
            self.begin.append(begin)
            return result

        setattr(holder, name, call)

    def select(self, after: int) -> np.ndarray:
        """Durations of calls that began after a time in [ns], in [µs]."""
        return 1e-3 * np.array(self.took)[np.array(self.begin) > after]


def run_loop(folder: Path, seconds: float) -> None:
    """Run the loop in this process, and write its figures into the folder."""
    # From the tree that is measured.
    from armguard.app.cli import main as run

    parts = {name: Timed(*place) for name, place in PARTS.items()}
    command = ["run", str(folder / "cell.toml"), "--quiet", "--json", "--no-realtime"]
    for name in (OBSTACLES, JOINTS, VERDICTS):
        command += [f"--{name}", f"ipc://{folder}/{name}"]
    run([*command, "--duration", str(WARMING + seconds)])
    # The step is not called before the first joint state.
    after = parts["step"].begin[0] + int(1e9 * WARMING)
    times = {name: part.select(after) for name, part in parts.items()}
    ticks = min(map(len, times.values()))
    times[OUTSIDE] = times["drain"][:ticks] + times["publish"][:ticks]
    figures = {name: summarise(part) for name, part in times.items()}
    (folder / "figures.json").write_text(json.dumps(figures), encoding="utf-8")


def summarise(times: np.ndarray) -> list[float]:
    """Median, p99 and maximum, in [µs]."""
    return [float(np.median(times)), float(np.quantile(times, 0.99)), float(times.max())]


def measure(tree: Path, seconds: float, seed: int) -> dict[str, list[float]]:
    """Figures of one run with the sources of a tree."""
    from armguard.lab.demo import nodes
    from armguard.lab.demo.launcher import write_cell
    from armguard.lab.simulation.processes import start_device

    with contextlib.ExitStack() as resources:
        folder = Path(resources.enter_context(tempfile.TemporaryDirectory(prefix="armguard-")))
        places = {name: f"ipc://{folder}/{name}" for name in (OBSTACLES, JOINTS, VERDICTS)}
        sources = nodes.make_sources(60.0, "", 0, seed)
        cell = write_cell("panda", sources, "deadline")
        (folder / "cell.toml").write_text(cell, encoding="utf-8")
        errors = resources.enter_context((folder / "log").open("ab"))
        devices = (
            nodes.Perception(
                obstacles=places[OBSTACLES],
                verdicts=places[VERDICTS],
                duration=60.0,
                seed=seed,
                person="",
                balls=0,
            ),
            nodes.RobotNode(
                joints=places[JOINTS], verdicts=places[VERDICTS], seed=seed, robot="panda"
            ),
        )
        for device in devices:
            process = resources.enter_context(start_device(device, errors))
            resources.callback(process.terminate)
        subprocess.run(
            [sys.executable, __file__, "--loop", str(folder), "--seconds", str(seconds)],
            env=os.environ | {"PYTHONPATH": str(tree.resolve())},
            stdout=subprocess.DEVNULL,
            check=True,
        )
        figures: dict[str, list[float]] = json.loads((folder / "figures.json").read_text())
        return figures


def main(arguments: list[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trees", type=Path, nargs="+", default=[Path(__file__).parents[1]])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run, that count")
    parser.add_argument("--loop", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.loop is not None:
        run_loop(options.loop, options.seconds)
        return
    from scene.machine import describe_machine

    print(describe_machine())
    names = (*PARTS, OUTSIDE)
    figures = np.zeros((options.rounds, len(options.trees), len(names), 3))
    for turn in range(options.rounds):
        order = range(len(options.trees))
        for number in reversed(order) if turn % 2 else order:
            found = measure(options.trees[number], options.seconds, turn)
            figures[turn, number] = [found[name] for name in names]
    titles = "".join(f"{title:>10}" for title in ("p50", "p99", "max"))
    for number, tree in enumerate(options.trees):
        print(f"\n{tree!s:<16}{titles}")
        ratios = np.median(figures[:, number] / figures[:, 0], axis=0)
        middle = np.median(figures[:, number], axis=0)
        for name, row, ratio in zip(names, middle, ratios, strict=True):
            cells = "".join(f"{value:>10.1f}" for value in row)
            against = "" if number == 0 else "".join(f"  ×{value:.2f}" for value in ratio)
            print(f"{name:<16}{cells}{against}")


if __name__ == "__main__":
    main()
