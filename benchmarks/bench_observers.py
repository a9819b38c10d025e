"""What observers cost the loop: a recorder, a view, a reader that never reads; in one run.

All cases run the same scene, each with a monitor of its own, and take turns of a second or so, many
times and each time in another order, so that whatever else the machine does falls on all of them.
Processes whose turn it is not are stopped. A turn yields the p50, the p99 and the maximum of its
ticks in microseconds, and how many came late; printed are medians over the turns, and behind × the
median of the ratios to "nothing", or to the case of `--against`, in the same round. "nothing,
again" is that same case once more: what the ratios there are off 1 by is what this machine cannot
tell.

In the case "recorder" verdicts are written after the tick, as by `armguard run --record`; in
"recorder, signed" the process that writes signs as well, and verdicts carry the digest of the
configuration; in "recorder, no chain" it writes no links, makes no digests, and verdicts carry
none, so that these two differ by digest, chain and signature alone; "not deferred" is a loop that
calls `Monitor.step` itself. A recorder and a view are processes, and share the machine with the
loop. "busy process" is neither, but a process that is busy for as long as the recorder's, as often
and at the same priority: what it costs the loop is what the processor pays for the work beside it,
however little the loop does.

    python benchmarks/bench_observers.py --rounds 10 --seconds 1
    python benchmarks/bench_observers.py --only recorder busy --realtime
    python benchmarks/bench_observers.py --only "recorder, signed" --against "recorder, no chain"
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from unittest import mock

import numpy as np
import zmq

from armguard.app.cell import Cell
from armguard.app.loop import Observer, RateLoop, RunRecording
from armguard.app.realtime import request_realtime
from armguard.app.stepper import Stepper
from armguard.app.view_feed import MonitorFeed
from armguard.clock import MonotonicClock
from armguard.lab.simulation import ProceduralPerson
from armguard.messages.incoming import JointsMessage, encode
from armguard.monitor.configuration import digest_configuration
from armguard.recording import Recorder
from armguard.recording.signing import write_signing_pair
from armguard.streams import Edge, FaultLog, VerdictPublisher
from armguard.view import FramePublisher, launch

CELL = '[robot]\nname = "panda"\n[sources.person]\n'
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])

NOTHING = "nothing"
CASES = (
    NOTHING,
    "nothing, again",
    "recorder",
    "recorder, signed",
    "recorder, no chain",
    "recorder, no chain, again",
    "recorder, not deferred",
    "stopped recorder",
    "busy process",
    "no view",
    "view",
    "stopped view",
    "killed view",
    "reader that never reads",
)

SETTLING = 0.3
"""[s] of each turn that are not measured: joint states begin anew, and caches fill."""

BUSY = """
import os, sys, time
from armguard.recording.writer import PAUSE, give_way
share, parent = float(sys.argv[1]), int(sys.argv[2])
give_way()
while os.getppid() == parent:
    end = time.process_time() + PAUSE * share / (1.0 - share)
    while time.process_time() < end:
        pass
    time.sleep(PAUSE)
"""

WITHOUT_CHAIN = """
import sys
from armguard.recording import part_writer, writer
class File(part_writer.ChainedFile):
    def write(self, data): return self._file.write(data)
    def add_link(self, writer, begin, end): pass
    def close(self, writer, time, next_file): writer.finish()
part_writer.ChainedFile = File
sys.exit(writer.main(sys.argv[1:]))
"""


class PopenWithoutChain(subprocess.Popen):
    """Starts what writes a recording, without links and digests."""

    def __init__(self, command, **options):
        super().__init__([command[0], "-c", WITHOUT_CHAIN, *command[3:]], **options)


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


class TimedLoop(RateLoop):
    """Keeps each tick's duration, in [s]."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.spent = []

    def tick(self):
        """As ever, timed."""
        begin = perf_counter()
        verdict = super().tick()
        self.spent.append(perf_counter() - begin)
        return verdict


class Feeding(Observer):
    """Feeds a view, as `armguard run --view` does."""

    def __init__(self, feed):
        self._feed = feed

    def observe(self, loop, verdict):
        """Note it, and publish a frame if one has waited for long."""
        self._feed.note(verdict, loop.clock.now())
        self.rest(loop, 0.0)

    def rest(self, loop, idle):
        """Publish a frame if one is due."""
        self._feed.publish(loop.clock.now(), loop.durations, loop.late, idle=idle)


class Contestant:
    """One case with all that belongs to it.

    Args:
        case: One of `CASES`.
        folder: For its sockets and files.
        resources: Are closed at the end.

    Attributes:
        pid: Of the process beside the loop; None: there is none.
    """

    def __init__(self, case, folder, resources):
        clock = MonotonicClock()
        robot, obstacles, self._monitor = Cell.from_text(CELL).build()
        edge = Edge(obstacles, robot.joints, clock, FaultLog(clock.now, _ignore))
        resting = Resting(clock, obstacles, robot.joints, edge.times.offset)
        is_signed = case == "recorder, signed"
        digest = digest_configuration(self._monitor) if is_signed else None
        verdicts = VerdictPublisher(
            f"ipc://{folder}/verdicts", edge.times.offset, configuration=digest
        )
        resources.callback(verdicts.close)
        self.pid = None
        self._is_stopped = case.startswith("stopped")
        view, observers = None, []
        if "recorder" in case:
            key = write_signing_pair("recorder", folder)[0] if is_signed else None
            popen = PopenWithoutChain if "no chain" in case else subprocess.Popen
            with mock.patch("subprocess.Popen", popen):
                recorder = Recorder(folder / "run.mcap", self._monitor, key=key)
            resources.callback(recorder.close)
            self.pid = recorder.pid
            if "not deferred" not in case:
                observers.append(RunRecording(recorder, edge.faults, _ignore))
        elif "view" in case:
            frames = resources.enter_context(FramePublisher(f"ipc://{folder}/frames"))
            feed = MonitorFeed(self._monitor, frames)

            observers.append(Feeding(feed))
            if case != "no view":
                view = launch(frames.address)
                resources.callback(view.close)
                self.pid = view.pid
        elif case.startswith("reader"):
            context = zmq.Context()
            resources.callback(context.destroy, linger=0)
            reader = context.socket(zmq.SUB)
            reader.subscribe(b"")
            reader.connect(verdicts.address)
        stepper = Stepper(self._monitor, edge, verdicts.answer)
        self._loop = TimedLoop(
            stepper, edge, [resting], clock, verdicts.publish, verdicts.answer, observers
        )
        self._loop.run(SETTLING)
        if case == "killed view":
            os.kill(self.pid, signal.SIGKILL)
            self.pid = None
        if self.pid is not None:
            # Before anything of it is closed it goes on.
            resources.callback(os.kill, self.pid, signal.SIGCONT)
        self._send(signal.SIGSTOP)

    def be_beside(self, share, resources):
        """Have a process beside the loop that is busy for this share of the time."""
        command = [sys.executable, "-c", BUSY, str(share), str(os.getpid())]
        process = resources.enter_context(subprocess.Popen(command))
        resources.callback(process.kill)
        self.pid = process.pid
        self._send(signal.SIGSTOP)

    def take_turn(self, seconds):
        """Take a turn of some seconds.

        Returns:
            Durations of its ticks in [s], how many were late, and for which share of the time the
            process beside was busy.
        """
        loop = self._loop
        if not self._is_stopped:
            self._send(signal.SIGCONT)
        self._monitor.reset()  # joint states stayed away
        loop.run(SETTLING)
        loop.spent, late, busy, begin = [], loop.late, self._read_use(), perf_counter()
        loop.run(seconds)
        share = (self._read_use() - busy) / (perf_counter() - begin)
        self._send(signal.SIGSTOP)
        return np.array(loop.spent), loop.late - late, share

    def _read_use(self):
        """For how long the process beside was busy so far, in [s]."""
        if self.pid is None:
            return 0.0
        return 1e-9 * int(Path(f"/proc/{self.pid}/schedstat").read_text().split()[0])

    def _send(self, number):
        if self.pid is not None:
            os.kill(self.pid, number)


def _ignore(line):
    """Takes lines for people."""


def measure(cases, rounds, seconds, *, realtime):
    """Have the cases take turns, with real-time scheduling where that is asked for and granted.

    Returns:
        p50, p99 and maximum in [µs], late ticks, and how busy the process beside was in [%], of
        shape (cases, rounds, 5); and the priority that was granted, 0 if none.
    """
    figures = np.full((len(cases), rounds, 5), np.nan)
    random = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as resources:
        contestants = []
        for number, case in enumerate(cases):
            folder = Path(name) / str(number)
            folder.mkdir()
            contestants.append(Contestant(case, folder, resources))
        share = 0.0
        if "recorder" in cases:
            for _ in range(2):  # in the first one it starts
                share = contestants[cases.index("recorder")].take_turn(seconds)[2]
        if "busy process" in cases:
            contestants[cases.index("busy process")].be_beside(share, resources)
        granted = resources.enter_context(request_realtime()) if realtime else None
        for turn in range(rounds):
            for number in random.permutation(len(cases)):
                spent, late, busy = contestants[number].take_turn(seconds)
                times = 1e6 * spent
                p50, p99 = np.percentile(times, [50, 99])
                figures[number, turn] = p50, p99, times.max(), late, 100.0 * busy
    return figures, 0 if granted is None else granted.priority


def main(arguments=None):
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each turn")
    parser.add_argument("--realtime", action="store_true", help="ask for it, as `armguard run`")
    parser.add_argument("--against", choices=CASES, default=NOTHING, help="what ratios are to")
    parser.add_argument("--only", nargs="+", default=[""], help="beginnings of cases")
    options = parser.parse_args(arguments)
    # What the ratios are to is among them in any case, and its control.
    chosen = options.against, *options.only
    cases = [case for case in CASES if case.startswith(chosen)]
    figures, priority = measure(cases, options.rounds, options.seconds, realtime=options.realtime)
    ratios = np.median(figures[:, :, :3] / figures[cases.index(options.against), :, :3], axis=1)
    print(f"{os.cpu_count()} cores, real-time priority {priority or 'none'},", end=" ")
    print(f"{options.rounds} turns of {options.seconds:g} s each; µs")
    print(f"{'':26}{'p50':>15}{'p99':>15}{'max':>15}{'late':>8}{'beside':>9}")
    for case, row, ratio in zip(cases, np.median(figures, axis=1), ratios, strict=True):
        cells = "".join(f"{row[i]:8.0f} ×{ratio[i]:5.3f}" for i in range(3))
        print(f"{case:26}{cells}{row[3]:8.0f}{row[4]:7.1f} %")


if __name__ == "__main__":
    main()
