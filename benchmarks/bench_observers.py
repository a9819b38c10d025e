"""What observers cost the loop: a view, a reader that never reads, a recorder, a stopped recorder.

One monitor runs at its rate in the same scene throughout; the cases take turns of a few seconds, so
that whatever else the machine does falls on all of them. Times are in microseconds, and beside them
the ratio to "no view": frames are published, and no view reads them. In the case "no feed" one tick
in thirty is spared the making of a frame. The cases "recorder" and "hung recorder" have no feed
either, so they are to be compared with "no feed".

    python benchmarks/bench_observers.py --rounds 5 --seconds 4
"""

import argparse
import os
import signal
import tempfile
import time
from pathlib import Path

import numpy as np
import zmq

from armguard.app.cell import Cell
from armguard.app.loop import RateLoop
from armguard.app.view_feed import MonitorFeed
from armguard.clock import MonotonicClock
from armguard.recording import Recorder
from armguard.simulation import ProceduralPerson
from armguard.streams import Edge, FaultLog, VerdictPublisher
from armguard.streams.messages import JointsMessage, encode
from armguard.view import FramePublisher, launch

CELL = '[robot]\nname = "panda"\n[sources.person]\n'
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
CASES = (
    "no feed",
    "no view",
    "view",
    "hung view",
    "killed view",
    "reader that never reads",
    "recorder",
    "hung recorder",
)
WITH_VIEW = CASES[2:5]


class Resting:
    """An input without a socket: a resting arm, and a person who stands at it."""

    def __init__(self, clock, obstacles, names, offset):
        self.ended = False
        self._clock, self._obstacles, self._names = clock, obstacles, names
        self._offset = offset
        self._person = ProceduralPerson(0, 20.0)
        self._waiting = False
        self._next = 0.0

    def receive(self):
        """One joint state a tick; the person at 100 Hz."""
        self._waiting = not self._waiting
        if not self._waiting:
            return None
        now = self._clock.now()
        if now >= self._next:
            self._next = now + 0.01
            position, _ = self._person.sample(10.0)
            names = [f"point{number}" for number in range(len(position))]
            self._obstacles.update(
                names, now, position, np.zeros_like(position), radius=0.1, source="person"
            )
        return encode(
            JointsMessage(now + self._offset, self._names, READY.tobytes(), bytes(56), None)
        )

    def close(self):
        """Nothing is held."""


def run_case(case, build, folder, seconds):
    """Durations of the ticks of one turn, in [s]. Shape (ticks,)."""
    clock = MonotonicClock()
    robot, obstacles, monitor = build()
    edge = Edge(obstacles, robot.joints, clock, FaultLog(clock.now))
    resting = Resting(clock, obstacles, robot.joints, edge.offset)
    verdicts = VerdictPublisher(f"ipc://{folder}/verdicts", edge.offset)
    context = zmq.Context()
    if case.startswith("reader"):
        reader = context.socket(zmq.SUB)
        reader.subscribe(b"")
        reader.connect(verdicts.address)
    durations = []
    with FramePublisher(f"ipc://{folder}/frames") as frames:
        recorder = None
        if case.endswith("recorder"):
            recorder = Recorder(Path(folder) / "run.mcap", monitor)
        feed = None if case == "no feed" or recorder else MonitorFeed(monitor, frames)
        view = launch(frames.address) if case in WITH_VIEW else None

        def observe(loop, verdict):
            if feed is not None:
                feed.observe(verdict, clock.now(), loop.durations, loop.late)

        loop = TimedLoop(
            monitor, edge, [resting], clock, verdicts.publish, verdicts.answer, observe
        )
        if view is not None:
            loop.run(1.0)
            if case == "hung view":
                os.kill(view.pid, signal.SIGSTOP)
            elif case == "killed view":
                os.kill(view.pid, signal.SIGKILL)
        loop.run(0.5)
        if case == "hung recorder":
            os.kill(recorder.pid, signal.SIGSTOP)
        loop.spent = durations
        loop.run(seconds)
        if view is not None:
            view.close()
        if recorder is not None:
            os.kill(recorder.pid, signal.SIGCONT)
            recorder.close()
    verdicts.close()
    context.destroy(linger=0)
    return durations


class TimedLoop(RateLoop):
    """Keeps each tick's duration."""

    spent = None

    def tick(self):
        """As ever, timed."""
        begin = time.perf_counter()
        verdict = super().tick()
        if self.spent is not None:
            self.spent.append(time.perf_counter() - begin)
        return verdict


def compute_figures(durations):
    """Their p50, p99, p99.9 and maximum, from [s] to [µs]. Shape (4,)."""
    times = 1e6 * np.array(durations)
    return np.append(np.percentile(times, [50, 99, 99.9]), times.max())


def main(arguments=None):
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each case in each round")
    options = parser.parse_args(arguments)
    rounds, seconds = options.rounds, options.seconds
    spent = {case: [] for case in CASES}
    cell = Cell.from_text(CELL)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(rounds):
            for case in CASES[number % len(CASES) :] + CASES[: number % len(CASES)]:
                place = Path(folder) / f"{number}{CASES.index(case)}"
                place.mkdir()
                spent[case] += run_case(case, cell.build, place, seconds)
    print(f"{'':26}{'ticks':>8}{'p50':>14}{'p99':>14}{'p99.9':>14}{'max':>14}")
    base = compute_figures(spent["no view"])
    for case in CASES:
        figures = compute_figures(spent[case])
        cells = "".join(
            f"{figure:8.0f} ×{figure / first:4.2f}"
            for figure, first in zip(figures, base, strict=True)
        )
        print(f"{case:26}{len(spent[case]):8d}{cells}")


if __name__ == "__main__":
    main()
