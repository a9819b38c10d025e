"""Starts the demo's processes, shows what they say, and ends them all.

    perception ──obstacles──▶ armguard run ──verdicts──▶ robot
                                 ▲    │                    │
                                 └────┼──────joints────────┘
                                      └──frames──▶ view, and the table here

Nothing here is a short cut: `armguard run` gets a cell file and addresses, as in a real cell.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import subprocess
import sys
import tempfile
import webbrowser
from collections.abc import Iterator, Sequence
from pathlib import Path

from armguard.app.premises import list_premises, summarise_premises
from armguard.app.processes import COMPLAINT, complain
from armguard.app.summary import draw_summary
from armguard.app.terminal import make_console, print_json
from armguard.exceptions import ArmguardError
from armguard.lab.demo import nodes
from armguard.lab.demo.places import find_place
from armguard.lab.demo.watcher import Watcher
from armguard.lab.simulation.sources import ObstacleSource
from armguard.recording.recorder import check_new
from armguard.robot.description import (
    DESCRIPTION,
    find_robot,
    is_known,
    locate_urdf,
    read_description,
)
from armguard.view.export import check_export
from armguard.view.listening import listen
from armguard.view.process import ViewProcess, launch

END_TIMEOUT = 3.0
"""How long a process may take to end when asked to, in [s]."""

EXPORT_TIMEOUT = 120.0
"""How long the page's process may take to write its export, in [s]."""

FLOOR = -0.75
"""Height of the floor that is drawn, in [m]: the arm of the demo stands on a table."""

OPERATING = 'operating = "published" # the simulated controller keeps to these'

CELL = """\
[robot]
name = {robot}
{operating}

[robot.base]
xyz = {base}

[joint_state]
clock = "monotonic"

{sources}
# People come in by the door at -y; before the sensor has found them they may be this far inside.
[entrances.door]
points = [[-0.6, -6.0, -0.75], [0.6, -6.0, -0.75], [-0.6, -6.0, 1.4], [0.6, -6.0, 1.4]]
radius = 0.1
detection_time = 0.1

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
    robot: str = "panda",
    duration: float = 20.0,
    person: Path | None = None,
    obstacle_count: int = 0,
    schedule: str = "deadline",
    seed: int = 0,
    view: bool = True,
    port: int = 0,
    open_browser: bool = False,
    record: Path | None = None,
    export: Path | None = None,
    premises: bool = False,
    as_json: bool = False,
) -> int:
    """Run the demo and print its summary.

    Args:
        robot: Which arm: one that armguard knows, or the folder of one of your own.
        duration: How long, in [s]; a recording may end it sooner.
        person: Vicon CSV of a person; None: a simulated one.
        obstacle_count: Wandering balls besides.
        schedule: Name of the monitor's schedule.
        seed: Of all motions.
        view: Show the cell in a browser page.
        port: TCP port of that page on 127.0.0.1; 0: any that is free.
        open_browser: Open the page.
        record: Where to write a recording; None: nowhere.
        export: Where to write a file that plays offline what the page showed; None: nowhere.
        premises: Print every premise, not only how many there are.
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
    if not seed >= 0:
        raise ArmguardError("--seed", f"is {seed}", expected="at least 0")
    if not is_known(robot):
        robot = str(find_robot(robot).resolve())  # its processes may be in another folder
    check_robot(robot)
    if record is not None:
        check_new(record)
    if export is not None:
        check_export(export)
    wants_page = view or export is not None
    if wants_page:
        listen(port).close()  # a port in use is told before anything is started
    recording = "" if person is None else str(person)
    # Made here as well, so that a mistake is one line now and not a process that dies later.
    sources = nodes.make_sources(duration, recording, obstacle_count, seed)
    duration = min(duration, *(source.duration for source in sources))
    console = make_console(stderr=as_json)
    told = list_premises() if premises else [summarise_premises()]
    with contextlib.ExitStack() as resources:
        folder = resources.enter_context(tempfile.TemporaryDirectory(prefix="armguard-"))
        obstacles, joints, verdicts, frames = (
            f"ipc://{folder}/{name}" for name in ("obstacles", "joints", "verdicts", "frames")
        )
        cell, log = Path(folder) / "cell.toml", Path(folder) / "log"
        cell.write_text(write_cell(robot, sources, schedule), encoding="utf-8")
        errors = resources.enter_context(log.open("ab"))
        command = [sys.executable, "-m", "armguard", "run", str(cell), "--json", "--no-realtime"]
        command += ["--quiet"]  # the table says what it would
        command += ["--obstacles", obstacles, "--joints", joints, "--verdicts", verdicts]
        command += ["--view", frames, "--duration", str(duration), "--parent", str(os.getpid())]
        token = secrets.token_hex(4)
        command += ["--reset-token", token]
        if record is not None:
            command += ["--record", str(record)]
        # The monitor first: it has the longest way to go.
        monitor = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,  # Ctrl-C reaches it through us, so that it ends first
        )
        resources.enter_context(_ending(monitor))
        perception = nodes.Perception(
            obstacles=obstacles,
            verdicts=verdicts,
            duration=duration,
            seed=seed,
            person=recording,
            balls=obstacle_count,
        )
        arm = nodes.RobotNode(joints=joints, verdicts=verdicts, seed=seed, robot=robot)
        parts = {
            "perception": nodes.start(perception, errors),
            "robot": nodes.start(arm, errors),
        }
        for node in parts.values():
            resources.enter_context(_ending(node))

        def tell_premises() -> None:
            for line in told:
                console.print(line, soft_wrap=True)

        if not wants_page:
            tell_premises()

        def open_page() -> ViewProcess:
            page = launch(frames, port, floor=FLOOR, export=export)
            resources.callback(page.close, EXPORT_TIMEOUT if export is not None else END_TIMEOUT)
            if view:
                console.print(f"see it in the browser: {page.url}", soft_wrap=True)
                console.print(f"token to end a latched STOP with, there: {token}", soft_wrap=True)
            if open_browser:
                webbrowser.open(page.url)
            tell_premises()
            return page

        watcher = Watcher(monitor, parts, log, console, live=not as_json)
        summary, problem = watcher.run(frames, open_page if wants_page else None)
    if summary is not None:
        if as_json:
            print_json(lambda: summary)
        else:
            console.print(draw_summary(summary))
    if problem:
        complain(problem)
    return COMPLAINT if problem else 0


def check_robot(robot: str) -> bool:
    """Whether a controller of this robot is known to keep to something at work.

    Raises:
        RobotError: Its description or its URDF cannot be read.
    """
    directory = find_robot(robot)
    description = read_description(directory / DESCRIPTION)
    locate_urdf(directory, description)
    return description.operating.published is not None


def write_cell(robot: str, sources: Sequence[ObstacleSource], schedule: str) -> str:
    """The cell file of the demo.

    Args:
        robot: One that armguard knows, or the whole path of the folder of one.
        sources: What moves about the arm.
        schedule: Name of the monitor's schedule.
    """
    tables = "".join(f"[sources.{source.name}]\nrate = {source.rate}\n" for source in sources)
    return CELL.format(
        robot=json.dumps(robot),
        operating=OPERATING if check_robot(robot) else "",
        base=list(find_place(robot).base),
        sources=tables,
        schedule=schedule,
    )


@contextlib.contextmanager
def _ending(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Whatever happens inside, the process is gone afterwards."""
    with process:  # waits for its end, and closes its pipes
        try:
            yield
        finally:
            process.terminate()
            try:
                process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
