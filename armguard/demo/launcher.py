"""Starts the demo's processes, shows what they say, and ends them all.

    perception ──obstacles──▶ armguard run ──verdicts──▶ robot
                                 ▲    │                    │
                                 └────┼──────joints────────┘
                                      └──frames──▶ view, and the table here

Nothing here is a short cut: `armguard run` gets a cell file and addresses, as in a real cell.
"""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import tempfile
import time
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import zmq
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from armguard.demo import nodes
from armguard.exceptions import ArmguardError
from armguard.summary import COLORS, draw_summary
from armguard.view.feed import FrameMessage, decode_message
from armguard.view.process import launch

REFRESH = 0.1
"""Between two drawings of the table, in [s]."""

END_TIMEOUT = 10.0
"""How long a process may take to end when asked to, in [s]."""

CELL = """\
[robot]
name = "{robot}"

[joint_state]
clock = "monotonic"

{sources}
[monitor]
schedule = "{schedule}"

[thresholds]
# A desktop machine may hold up any of these processes for a while; a real controller does not. The
# bounds grow with age and latency, so waiting longer costs no safety, only a little room.
latency = 0.01
joint_timeout = 0.5
source_timeout = 0.5
"""


def run_demo(
    *,
    duration: float = 20.0,
    person: Path | None = None,
    obstacle_count: int = 0,
    schedule: str = "full",
    seed: int = 0,
    view: bool = True,
    port: int = 0,
    open_browser: bool = False,
    as_json: bool = False,
) -> int:
    """Run the demo and print its summary.

    Args:
        duration: How long, in [s]; a recording may end it sooner.
        person: Vicon CSV of a person; None: a simulated one.
        obstacle_count: Wandering balls besides.
        schedule: Name of the monitor's schedule.
        seed: Of all motions.
        view: Show the cell in a browser page.
        port: TCP port of that page on 127.0.0.1; 0: any that is free.
        open_browser: Open the page.
        as_json: Print one JSON object instead of tables.

    Returns:
        The process's exit code.

    Raises:
        ArmguardError: An argument is out of range, or the recording cannot be read.
    """
    if not 0.0 < duration < float("inf"):
        raise ArmguardError("--duration", f"is {duration}", expected="seconds above 0")
    if not obstacle_count >= 0:
        raise ArmguardError("--obstacles", f"is {obstacle_count}", expected="at least 0")
    recording = "" if person is None else str(person)
    # Made here as well, so that a mistake is one line now and not a process that dies later.
    sources = nodes.make_sources(duration, recording, obstacle_count, seed)
    duration = min(duration, *(source.duration for source in sources))
    console = Console(stderr=as_json)
    with contextlib.ExitStack() as resources:
        folder = resources.enter_context(tempfile.TemporaryDirectory(prefix="armguard-"))
        obstacles, joints, verdicts, frames = (
            f"ipc://{folder}/{name}" for name in ("obstacles", "joints", "verdicts", "frames")
        )
        cell = Path(folder) / "cell.toml"
        tables = "".join(f"[sources.{source.name}]\nrate = {source.rate}\n" for source in sources)
        cell.write_text(CELL.format(robot=nodes.ROBOT, sources=tables, schedule=schedule))
        if view:
            page = resources.enter_context(launch(frames, port))
            console.print(f"see it in the browser: {page.url}", soft_wrap=True)
            if open_browser:
                webbrowser.open(page.url)
        perception = nodes.Perception(
            obstacles=obstacles,
            verdicts=verdicts,
            duration=duration,
            seed=seed,
            person=recording,
            balls=obstacle_count,
        )
        robot = nodes.RobotNode(joints=joints, verdicts=verdicts, seed=seed)
        for node in (perception, robot):
            resources.enter_context(_ending(nodes.start(node)))
        command = [sys.executable, "-m", "armguard", "run", str(cell), "--json"]
        command += ["--obstacles", obstacles, "--joints", joints, "--verdicts", verdicts]
        command += ["--view", frames, "--duration", str(duration)]
        monitor = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=None if as_json else subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C reaches it through us, so that it ends first
        )
        resources.enter_context(_ending(monitor))
        summary = _watch(monitor, frames, console, live=not as_json)
    if as_json:
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
    else:
        console.print(draw_summary(summary))
    return 0


@contextlib.contextmanager
def _ending(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Whatever happens inside, the process is gone afterwards."""
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _watch(
    monitor: subprocess.Popen[bytes], frames: str, console: Console, *, live: bool
) -> dict[str, Any]:
    """Show frames until the monitor ends, or Ctrl-C ends it; its summary."""
    context = zmq.Context()
    try:
        reader = context.socket(zmq.SUB)
        reader.set(zmq.CONFLATE, 1)
        reader.subscribe(b"")
        reader.connect(frames)
        table = Live(console=console, auto_refresh=False, transient=True)
        with console.status("starting (the first start compiles for a minute)") as waiting:
            while monitor.poll() is None and not reader.poll(round(1000 * REFRESH)):
                pass
            waiting.stop()
            with table if live else contextlib.nullcontext():
                while monitor.poll() is None:
                    if reader.poll(round(1000 * REFRESH)):
                        message = decode_message(reader.recv())
                        if live and isinstance(message, FrameMessage):
                            table.update(draw_frame(message), refresh=True)
                    time.sleep(REFRESH)
    except KeyboardInterrupt:
        monitor.send_signal(signal.SIGINT)
    finally:
        context.destroy(linger=0)
    output, _ = monitor.communicate(timeout=END_TIMEOUT)
    if monitor.returncode != 0:
        raise ArmguardError("armguard run", f"ended with exit code {monitor.returncode}")
    summary: dict[str, Any] = msgspec.json.decode(output)
    return summary


def draw_frame(frame: FrameMessage) -> Table:
    """The live table."""
    verdict, load = frame.verdict, frame.load
    table = Table(title=f"armguard, {frame.now:.1f} s", show_header=False, width=78)
    table.add_row("level", f"[{COLORS[verdict.level]}]{verdict.level}[/]")
    table.add_row("contact possible in", f"{verdict.contact_time:.3f} s")
    table.add_row("stop time", f"{verdict.stop_time:.3f} s")
    table.add_row("pair", f"{verdict.link} and {verdict.obstacle}" if verdict.link else "none")
    if load is not None:
        table.add_row("evaluations", str(load.evaluated))
        table.add_row("tick p50 / p99", f"{1e6 * load.p50:.0f} / {1e6 * load.p99:.0f} µs")
    table.add_row("why", escape("; ".join(verdict.reasons)))
    return table
