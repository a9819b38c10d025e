"""A long run of the real loop: memory over time, ticks that were late, bytes recorded.

    python benchmarks/bench_soak.py --minutes 60 --record --realtime

It is the demo without its page: `armguard run` at 1 kHz, a simulated arm that obeys it, a person
and balls, each in a process of its own. Memory is what the system counts as resident of the loop's
process, and of the one that writes the recording; its trend is that of a straight line through the
samples after the first fifth of the run, in which caches fill. A line a minute tells what it has
been like so far, so that a run that is interrupted tells something as well; it is read from the
frames that the loop publishes for views. With --realtime the loop asks the system for real-time
scheduling, as `armguard run` does unless told otherwise.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec
import numpy as np
import zmq

from armguard.lab.demo import nodes
from armguard.lab.demo.launcher import write_cell
from armguard.lab.simulation.processes import start_device
from armguard.streams import VerdictReader
from armguard.view.messages import FrameMessage, decode_message

ROBOT = "panda"

SAMPLE_PERIOD = 1.0
"""Between two samples of memory, in [s]."""

LINE_PERIOD = 60.0
"""Between two lines, in [s]."""

WARMING = 0.2
"""Share of the run that is left out of the trend."""

END_TIMEOUT = 180.0
"""How long the run may take to end, in [s]: the recording is written to its end first."""


def read_memory(pid):
    """What a process has in memory, in [MB]."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1000.0
    raise ProcessLookupError(pid)


def read_children(pid):
    """What the processes that a process has started have in memory, in [MB]."""
    memory = 0.0
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        with contextlib.suppress(OSError, ProcessLookupError):  # it may have ended meanwhile
            memory += read_memory(child)
    return memory


def end(process):
    """End a process, if it has not ended, and wait for that."""
    process.kill()
    process.communicate()


class Progress:
    """Tells once a minute what the run has been like so far.

    Args:
        address: Where the loop publishes frames for views.
        record: The recording; None: there is none.
    """

    def __init__(self, address, record):
        self._context = zmq.Context()
        self._frames = self._context.socket(zmq.SUB)
        self._frames.subscribe(b"")
        self._frames.connect(address)
        self._record = record
        self._load = None
        self._late = 0
        self._next = LINE_PERIOD

    def follow(self, seconds, memory, beside):
        """Read the frames that have come, and print a line where that is due.

        Args:
            seconds: Since the beginning.
            memory: Of the loop, in [MB].
            beside: Of the process that writes the recording, in [MB].
        """
        with contextlib.suppress(zmq.Again):
            while True:
                message = decode_message(self._frames.recv(zmq.NOBLOCK))
                if isinstance(message, FrameMessage):
                    self._load = message.load
        if seconds < self._next or self._load is None:
            return
        self._next += LINE_PERIOD
        load = self._load
        line = (
            f"{seconds / 60.0:5.1f} min: memory {memory:.1f} + {beside:.1f} MB, "
            f"{load.ticks} ticks, "
            f"{load.late - self._late} late since the last line, "
            f"p50 {1e6 * load.p50:.0f} p99 {1e6 * load.p99:.0f} µs"
        )
        if self._record is not None:
            size = self._record.stat().st_size
            line += f", recorded {size / 1e6:.0f} MB ({3.6e-6 * size / seconds:.2f} GB an hour)"
        self._late = load.late
        print(line, flush=True)

    def close(self):
        """Read no more."""
        self._context.destroy(linger=0)


def run_cell(folder, duration, balls, record, *, realtime):
    """Run a cell for `duration` [s]; its summary, and samples of (seconds, MB). Shape (n, 2)."""
    names = ("obstacles", "joints", "verdicts", "view")
    addresses = {name: f"ipc://{folder}/{name}" for name in names}
    sources = nodes.make_sources(duration, "", balls, 0)
    cell = folder / "cell.toml"
    cell.write_text(write_cell(ROBOT, sources, "deadline"))
    command = [sys.executable, "-m", "armguard", "run", str(cell), "--json", "--quiet"]
    command += [word for name, one in addresses.items() for word in (f"--{name}", one)]
    command += [] if realtime else ["--no-realtime"]
    if record is not None:
        command += ["--record", str(record)]
    with contextlib.ExitStack() as resources, (folder / "log").open("wb") as log:
        monitor = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log)
        resources.callback(end, monitor)
        obstacles, joints, verdicts, view = addresses.values()
        for node in (
            nodes.Perception(
                obstacles=obstacles, verdicts=verdicts, duration=duration, seed=0, person="",
                balls=balls,
            ),
            nodes.RobotNode(joints=joints, verdicts=verdicts, seed=0, robot=ROBOT),
        ):  # fmt: skip
            resources.callback(end, start_device(node, log))
        with VerdictReader(verdicts) as reader:
            while (verdict := reader.latest(0.1)) is None or not verdict.sequence:
                if monitor.poll() is not None:
                    raise SystemExit((folder / "log").read_text())
        progress = Progress(view, record)
        resources.callback(progress.close)
        samples, start = [], time.monotonic()
        while (now := time.monotonic() - start) < duration and monitor.poll() is None:
            samples.append((now, read_memory(monitor.pid)))
            progress.follow(*samples[-1], read_children(monitor.pid))
            time.sleep(SAMPLE_PERIOD)
        # Not SIGINT, which is ignored by what a shell has started in the background.
        monitor.send_signal(signal.SIGTERM)
        output, _ = monitor.communicate(timeout=END_TIMEOUT)
    return msgspec.json.decode(output), np.array(samples)


def main(arguments=None):
    """Run, and print what it was like."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--balls", type=int, default=10)
    parser.add_argument("--record", action="store_true", help="record as well")
    parser.add_argument("--realtime", action="store_true", help="ask for real-time scheduling")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record = folder / "soak.mcap" if options.record else None
        duration, realtime = 60.0 * options.minutes, options.realtime
        summary, samples = run_cell(folder, duration, options.balls, record, realtime=realtime)
        size = None if record is None else record.stat().st_size
    seconds, memory = samples.T
    warm = seconds >= WARMING * seconds[-1]
    trend = 3600.0 * np.polyfit(seconds[warm], memory[warm], 1)[0] if warm.sum() > 1 else np.nan
    ticks, late, times = summary["ticks"], summary["late"], summary["tick_us"]
    print(f"cores {os.cpu_count()}, {seconds[-1] / 60.0:.1f} minutes, {ticks} ticks")
    print(f"late ticks {late} ({100.0 * late / max(1, ticks):.3f} %)")
    print("tick " + ", ".join(f"{key} {value:.0f} µs" for key, value in times.items()))
    print(f"memory {memory[0]:.1f} MB at the start, {memory[warm][0]:.1f} MB after a fifth,")
    print(f"  {memory[-1]:.1f} MB at the end, at most {memory.max():.1f} MB")
    print(f"  trend after the first fifth {trend:+.2f} MB an hour")
    print(f"real-time {summary['realtime']}")
    print(f"levels {summary['levels']}, faults {summary['faults']}")
    if size is not None:
        lost = summary["recording_lost"]
        print(f"recorded {3600.0 * size / seconds[-1] / 1e9:.2f} GB an hour, {lost} events lost")


if __name__ == "__main__":
    main()
