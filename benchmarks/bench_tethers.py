"""What a tick costs beside people whose parts are tethered, against the same people without.

    python benchmarks/bench_tethers.py [--ticks 2000] [--turns 3]

A Panda swings slowly at 1 kHz beside people of nine balls each (`scene/beside.py`), who are
measured at 100 Hz. In half of the scenes each elbow and hand is hidden for 0.2 s again and again.
Times are processor time of this thread in microseconds: median, 99 % and mean; both kinds of a
scene take turns. ÷ is that of the tethered ones over that of the others: at most 2 was wanted.
Levels are how many ticks were STOP, SLOW, AWARE and CLEAR.
"""

from __future__ import annotations

import argparse
import gc
import time

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.verdict import Level
from scene.beside import ACCEL, RATE, SPEED, STANDING, UPDATE_RATE, Person, Swing
from scene.machine import describe_machine

TETHERED = ((0, 1), (1, 2), (1, 3), (1, 4), (3, 5), (4, 6), (5, 7), (6, 8))
"""Parts of a person, by their numbers in `STANDING`."""
LONGER = 1.1
"""Tethers over distances of parts."""
HIDEABLE, HIDDEN, EVERY = (5, 6, 7, 8), 0.2, 0.5
"""Which parts are hidden, for how long, and how often, in [s]."""
RADIUS = 0.08


class Run:
    """One scene, and what its ticks took."""

    def __init__(self, people: list[Person], swing: Swing, *, hides: bool, tethers: bool) -> None:
        self._people, self._swing, self._hides = people, swing, hides
        self._tick = 0
        self._obstacles = Obstacles(accel=ACCEL, speed=SPEED)
        places = np.array(STANDING)
        for person in people if tethers else ():
            for one, other in TETHERED:
                length = LONGER * float(np.linalg.norm(places[one] - places[other]))
                a, b = f"{person.name}/{one}", f"{person.name}/{other}"
                self._obstacles.tether(a, b, length, "this scene")
        self._monitor = Monitor(
            swing.robot, self._obstacles, rate=RATE, operating="published", source_timeout=1.0
        )
        self.forget()

    def forget(self) -> None:
        """Start counting anew."""
        self.steps: list[int] = []
        self.evaluated: list[int] = []
        self.levels = dict.fromkeys(Level, 0)

    def take(self, ticks: int) -> None:
        """Let so many ticks pass."""
        gc.collect()
        gc.disable()
        try:
            for _ in range(ticks):
                now = self._tick / RATE
                if self._tick % round(RATE / UPDATE_RATE) == 0:
                    self._publish(now)
                q, v = self._swing.sample(now)
                begin = time.thread_time_ns()
                verdict = self._monitor.step(now, q, v)
                self.steps.append(time.thread_time_ns() - begin)
                self.evaluated.append(verdict.evaluated)
                self.levels[verdict.level] += 1
                self._tick += 1
        finally:
            gc.enable()

    def _publish(self, now: float) -> None:
        for number, person in enumerate(self._people):
            points, pace = person.find_points(now)
            seen = [
                part
                for part in range(len(points))
                if not (self._hides and part in HIDEABLE and _is_hidden(now, number + part))
            ]
            self._obstacles.update(
                [f"{person.name}/{part}" for part in seen], now, points[seen],
                np.tile(pace, (len(seen), 1)), radius=RADIUS, position_error=0.01,
                velocity_error=0.05,
            )  # fmt: skip


def _is_hidden(now: float, number: int) -> bool:
    """Whether a part with this number is hidden at a time in [s]; each begins at another one."""
    return 0.0 < (now + 0.17 * number) % EVERY < HIDDEN and now > EVERY


def main(arguments: list[str] | None = None) -> list[Run]:
    """Print the table, and return what it was made of."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=2000, help="that count, in a turn")
    parser.add_argument("--turns", type=int, default=3)
    options = parser.parse_args(arguments)
    print(describe_machine())
    swing = Swing(Robot.load("panda"))
    around = [Person(f"person{k}", 1.2 + 0.2 * k, bearing) for k, bearing in enumerate((0, 2, 4))]
    scenes = {"person at 1.1 m": [Person("person", 1.1, -np.pi / 2.0)], "3 people": around}
    title = "".join(f"{one:>11}" for one in ("median", "p99", "mean", "evaluated", "most"))
    print(f"{'[µs]':<36}{title}   STOP SLOW AWARE CLEAR")
    runs = []
    for name, people in scenes.items():
        for hides in (False, True):
            pair = [Run(people, swing, hides=hides, tethers=ties) for ties in (False, True)]
            for run in pair:
                run.take(600)
                run.forget()
            for _ in range(options.turns):
                for run in pair:
                    run.take(options.ticks)
            rows = []
            for run, kind in zip(pair, ("", ", tethered"), strict=True):
                times = np.array(run.steps) / 1e3
                rows.append([np.median(times), np.quantile(times, 0.99), np.mean(times)])
                rows[-1] += [np.mean(run.evaluated), max(run.evaluated)]
                told = name + (", parts hidden" if hides else "") + kind
                cells = "".join(f"{cell:>11.3g}" for cell in rows[-1])
                print(f"{told:<36}{cells}   {' '.join(map(str, run.levels.values()))}", flush=True)
            shares = "".join(f"{b / a:>11.2f}" for a, b in zip(*rows, strict=True))
            print(f"{'    ÷':<36}{shares}")
            runs += pair
    return runs


if __name__ == "__main__":
    main()
