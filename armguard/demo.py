"""`armguard demo`: a simulated Panda at work, people and balls about it, and the monitor beside it.

Arm and obstacles are simulated in steps of exactly one period, so that the same seed gives the same
verdicts on any machine; the ticks are paced by the clock, and those that come late are counted.
"""

from __future__ import annotations

import gc
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from armguard.clock import MonotonicClock
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.simulation import (
    ObstacleSource,
    ProceduralPerson,
    Recording,
    SimulatedArm,
    WanderingBalls,
    keeps_within,
    random_trajectory,
)
from armguard.simulation.person import DURATIONS
from armguard.verdict import Level, Verdict

RATE = 1000.0
"""Ticks a second."""

REFRESH = 0.25
"""Between two drawings of the table, in [s]; drawing costs a few late ticks."""

SPEED_FRACTION = 0.3
"""Share of its velocity limits that the arm works at."""

WORKSPACE = ((-0.6, -0.25, 0.02), (1.0, 1.0, 1.5))
"""Where the arm works, in [m]: above its table, not on the side that people come from."""

WORK_CYCLE = 30.0
"""Until the arm's motion repeats, at least, in [s]."""

COLORS = {Level.STOP: "red", Level.SLOW: "yellow", Level.AWARE: "cyan", Level.CLEAR: "green"}


class Tally:
    """What the summary counts; its size is fixed at the start.

    Args:
        ticks: At most so many will be counted.
    """

    def __init__(self, ticks: int) -> None:
        self.ticks = 0
        self.stops = 0
        self.late = 0
        self.incomplete = 0
        self.min_contact_time = float("inf")
        self.levels = dict.fromkeys(Level, 0)
        self._level: Level | None = None
        self._tick_us = np.zeros(ticks, dtype=np.float32)

    def __len__(self) -> int:
        return len(self._tick_us)

    def count(self, verdict: Verdict, tick_us: float) -> None:
        """Add one tick that took `tick_us` microseconds."""
        if verdict.level is Level.STOP and self._level is not Level.STOP:
            self.stops += 1
        self._level = verdict.level
        self.levels[verdict.level] += 1
        self.incomplete += not verdict.complete
        self.min_contact_time = min(self.min_contact_time, verdict.contact_time)
        self._tick_us[self.ticks] = tick_us
        self.ticks += 1

    def percentiles(self) -> dict[str, float]:
        """Time of a tick in microseconds; zeros before the first."""
        spent = self._tick_us[: self.ticks] if self.ticks else np.zeros(1)
        p50, p99 = np.percentile(spent, [50, 99])
        return {"p50": float(p50), "p99": float(p99), "max": float(spent.max())}

    def summary(self, faults: int) -> dict[str, Any]:
        """The object that `--json` prints; a contact time that never was finite is null."""
        finite = np.isfinite(self.min_contact_time)
        return {
            "ticks": self.ticks,
            "stops": self.stops,
            "levels": {level.name: count for level, count in self.levels.items()},
            "min_contact_time": self.min_contact_time if finite else None,
            "tick_us": {name: round(value, 1) for name, value in self.percentiles().items()},
            "late": self.late,
            "incomplete": self.incomplete,
            "faults": faults,
        }


def run_demo(
    *,
    duration: float = 20.0,
    person: Path | None = None,
    obstacle_count: int = 0,
    schedule: str = "full",
    seed: int = 0,
    as_json: bool = False,
) -> int:
    """Run the demo and print its summary.

    Args:
        duration: How long, in [s]; a recording may end it sooner.
        person: Vicon CSV of a person; None: a simulated one.
        obstacle_count: Wandering balls besides.
        schedule: Name of the monitor's schedule.
        seed: Of all motions.
        as_json: Print one JSON object instead of tables.

    Returns:
        The process's exit code.

    Raises:
        ArmguardError: If an argument is out of range or the recording cannot be read.
    """
    _check_arguments(duration, obstacle_count)
    console = Console(stderr=as_json)
    sources = _make_sources(duration, person, obstacle_count, seed)
    duration = min(duration, *(source.duration for source in sources))
    with console.status("compiling the kernels (once; kept for next time)"):
        robot = Robot.load("panda")
        obstacles = Obstacles(sources=[source.name for source in sources])
        monitor = Monitor(robot, obstacles, rate=RATE, schedule=schedule)
        arm = SimulatedArm(
            random_trajectory(
                robot,
                seed,
                WORK_CYCLE,
                speed_fraction=SPEED_FRACTION,
                accept=keeps_within(robot, *WORKSPACE),
            )
        )
    tally = Tally(int(duration * RATE) + 1)
    try:
        _supervise(monitor, arm, sources, tally, console, live=not as_json)
    except KeyboardInterrupt:
        console.print("interrupted")
    summary = tally.summary(monitor.faults)
    if as_json:
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
    else:
        console.print(_draw_summary(summary))
    return 0


def _supervise(
    monitor: Monitor,
    arm: SimulatedArm,
    sources: list[ObstacleSource],
    tally: Tally,
    console: Console,
    *,
    live: bool,
) -> None:
    """Tick until the tally is full, one period apart."""
    with Live(console=console, auto_refresh=False, transient=True) as display:
        scale = 1.0
        drawn = -REFRESH
        gc.collect()
        gc.freeze()
        clock = MonotonicClock()
        while tally.ticks < len(tally):
            now = tally.ticks * monitor.period
            clock.sleep_until(now)
            tally.late += clock.now() > now + monitor.period
            for source in sources:
                source.publish(monitor.obstacles, now)
            q, v = arm.step(monitor.period, scale)
            begin = time.perf_counter_ns()
            verdict = monitor.step(now, q, v)
            tally.count(verdict, (time.perf_counter_ns() - begin) * 1e-3)
            scale = verdict.speed_scale
            if live and now >= drawn + REFRESH:
                display.update(_draw_tick(verdict, tally), refresh=True)
                drawn = now


def _make_sources(
    duration: float, person: Path | None, obstacle_count: int, seed: int
) -> list[ObstacleSource]:
    sources: list[ObstacleSource] = []
    if person is None:
        shortest, longest = DURATIONS
        sources.append(ProceduralPerson(seed, min(max(duration, shortest), longest)))
    else:
        sources.append(Recording(person))
    if obstacle_count:
        sources.append(WanderingBalls(obstacle_count, seed, clearance=1.5))
    return sources


def _check_arguments(duration: float, obstacle_count: int) -> None:
    if not 0.0 < duration < float("inf"):
        raise ArmguardError("--duration", f"is {duration}", expected="seconds above 0")
    if not obstacle_count >= 0:
        raise ArmguardError("--obstacles", f"is {obstacle_count}", expected="at least 0")


def _draw_tick(verdict: Verdict, tally: Tally) -> Table:
    """The live table."""
    spent = tally.percentiles()
    table = Table(title=f"armguard demo, {verdict.stamp:.1f} s", show_header=False)
    table.add_row("level", f"[{COLORS[verdict.level]}]{verdict.level.name}[/]")
    table.add_row("contact possible in", f"{verdict.contact_time:.3f} s")
    table.add_row("stop time", f"{verdict.stop_time:.3f} s")
    table.add_row("pair", f"{verdict.link} and {verdict.obstacle}")
    table.add_row("evaluations", str(verdict.evaluated))
    table.add_row("tick p50 / p99", f"{spent['p50']:.0f} / {spent['p99']:.0f} µs")
    table.add_row("why", escape("; ".join(str(reason) for reason in verdict.reasons[:3])))
    return table


def _draw_summary(summary: dict[str, Any]) -> Table:
    """The table at the end."""
    table = Table(title="armguard demo: summary", show_header=False)
    ticks = max(summary["ticks"], 1)
    spent = summary["tick_us"]
    soonest = summary["min_contact_time"]
    table.add_row("ticks", f"{summary['ticks']} ({summary['late']} late)")
    for name, count in summary["levels"].items():
        color = COLORS[Level[name]]
        table.add_row(f"[{color}]{name}[/]", f"{100.0 * count / ticks:.1f} % of the time")
    table.add_row("stops", str(summary["stops"]))
    table.add_row("soonest contact", "never" if soonest is None else f"{soonest:.3f} s")
    table.add_row(
        "tick p50 / p99 / max",
        f"{spent['p50']:.0f} / {spent['p99']:.0f} / {spent['max']:.0f} µs",
    )
    table.add_row("incomplete ticks", str(summary["incomplete"]))
    table.add_row("faults", str(summary["faults"]))
    return table
