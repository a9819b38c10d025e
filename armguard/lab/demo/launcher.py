"""Starts the demo's processes, shows their output, and ends them all.

    perception ──obstacles──▶ armguard run ──verdicts──▶ robot
                                 ▲    │                    │
                                 └────┼──────joints────────┘
                                      └──frames──▶ view

Nothing here is a short cut: `armguard run` gets a cell file and addresses, as in a real cell.
"""

from __future__ import annotations

import contextlib
import json
import secrets
import subprocess
import tempfile
import webbrowser
from collections.abc import Iterator, Sequence
from pathlib import Path

from armguard.app import cli
from armguard.app.premises import list_premises, summarise_premises
from armguard.app.processes import COMPLAINT, complain
from armguard.app.summary import draw_summary
from armguard.app.terminal import make_console, print_json
from armguard.exceptions import ArmguardError
from armguard.lab.demo import nodes
from armguard.lab.demo.places import find_place
from armguard.lab.demo.watcher import Watcher
from armguard.lab.simulation.processes import start_device, start_monitor
from armguard.lab.simulation.sources import ObstacleSource
from armguard.recording.recorder import check_new
from armguard.robot.description import (
    DESCRIPTION,
    find_robot,
    is_known,
    locate_urdf,
    read_description,
)
from armguard.robot.robot import Robot
from armguard.view.export import check_export
from armguard.view.listening import listen
from armguard.view.process import ViewProcess, launch

END_TIMEOUT = 3.0
"""How long a process may take to end when asked to, in [s]."""

FLOOR = -0.75
"""Height of the floor that is drawn, in [m]: the arm of the demo stands on a table."""

OPERATING = 'operating = "published" # the simulated controller keeps to these'

MOTION = """motion = "planned"
rate = 250.0

[shield]
jerk = 500.0 # [rad/s³]
"""
"""Of an arm that a shield moves."""

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
{motion}
[thresholds]
# A desktop machine may hold up any of these processes for a while; a real controller does not. The
# bounds grow with age and latency, so waiting longer costs no safety, only a little room.
latency = 0.01
joint_timeout = 0.5
source_timeout = 0.5
"""


def run_demo(wishes: cli.Demo) -> int:
    """Run the demo and print its summary.

    Args:
        wishes: What the command line says.

    Returns:
        The process's exit code.

    Raises:
        ArmguardError: An argument is out of range, or the recording cannot be read.
    """
    robot, duration, seed = wishes.robot, wishes.duration, wishes.seed
    record, export = wishes.record, wishes.export
    if not 0.0 < duration < float("inf"):
        raise ArmguardError("--duration", f"is {duration}", expected="seconds above 0")
    for option, count in (("--obstacles", wishes.obstacles), ("--seed", seed)):
        if not count >= 0:
            raise ArmguardError(option, f"is {count}", expected="at least 0")
    if not is_known(robot):
        robot = str(find_robot(robot).resolve())  # its processes may be in another folder
    check_robot(robot)
    if wishes.shield:
        # What it needs beside armguard is told now, not by a process that dies later.
        from armguard.shield import shield  # noqa: F401  # loaded for its errors
    if record is not None:
        check_new(record)
    if export is not None:
        check_export(export)
    wants_page = not wishes.no_view or export is not None
    if wants_page:
        listen(wishes.port).close()  # a port in use is told before anything is started
    recording = "" if wishes.person is None else str(wishes.person)
    # Made here as well, so that a mistake is one line now and not a process that dies later.
    sources = nodes.make_sources(duration, recording, wishes.obstacles, seed)
    duration = min(duration, *(source.duration for source in sources))
    console = make_console(stderr=wishes.json)
    told = list_premises() if wishes.premises else [summarise_premises()]
    with contextlib.ExitStack() as resources:
        folder = resources.enter_context(tempfile.TemporaryDirectory(prefix="armguard-"))
        names = ("obstacles", "joints", "verdicts", "view")
        addresses = {name: f"ipc://{folder}/{name}" for name in names}
        obstacles, joints, verdicts, frames = addresses.values()
        cell, log = Path(folder) / "cell.toml", Path(folder) / "log"
        text = write_cell(robot, sources, wishes.schedule, is_moved=wishes.shield)
        cell.write_text(text, encoding="utf-8")
        errors = resources.enter_context(log.open("ab"))
        token = secrets.token_hex(4)
        options = ["--duration", str(duration), "--reset-token", token]
        if record is not None:
            options += ["--record", str(record)]
        # The monitor first: it has the longest way to go.
        command = "shield" if wishes.shield else "run"
        monitor = start_monitor(cell, addresses, *options, log=errors, command=command)
        resources.enter_context(_ending(monitor))
        perception = nodes.Perception(
            obstacles=obstacles,
            verdicts=verdicts,
            duration=duration,
            seed=seed,
            person=recording,
            balls=wishes.obstacles,
        )
        kind = nodes.ShieldedRobotNode if wishes.shield else nodes.RobotNode
        arm = kind(joints=joints, verdicts=verdicts, seed=seed, robot=robot)
        parts = {
            "perception": start_device(perception, errors),
            "robot": start_device(arm, errors),
        }
        for node in parts.values():
            resources.enter_context(_ending(node))

        def tell_premises() -> None:
            for line in told:
                console.print(line, soft_wrap=True)

        if not wants_page:
            tell_premises()

        def open_page() -> ViewProcess:
            page = launch(frames, wishes.port, floor=FLOOR, export=export)
            resources.callback(page.close)
            if not wishes.no_view:
                console.print(f"see it in the browser: {page.url}", soft_wrap=True)
                console.print(f"token for a reset in the browser view: {token}", soft_wrap=True)
            if wishes.open:
                webbrowser.open(page.url)
            tell_premises()
            return page

        watcher = Watcher(monitor, parts, log, console)
        summary, problem = watcher.run(frames, open_page if wants_page else None)
    if summary is not None:
        if wishes.json:
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


def write_cell(
    robot: str, sources: Sequence[ObstacleSource], schedule: str, *, is_moved: bool = False
) -> str:
    """The cell file of the demo.

    Args:
        robot: One that armguard knows, or the whole path of the folder of one.
        sources: What moves about the arm.
        schedule: Name of the monitor's schedule.
        is_moved: Whether a shield moves the arm.
    """
    operating = OPERATING if check_robot(robot) else ""
    if is_moved:
        limits = f"velocity = {nodes.SHIELDED_SPEED_FRACTION}{_find_acceleration(robot)}"
        operating = f"payload = 0.0 # the arm carries nothing\noperating = {{ {limits} }}"
    tables = "".join(f"[sources.{source.name}]\nrate = {source.rate}\n" for source in sources)
    return CELL.format(
        robot=json.dumps(robot),
        operating=operating,
        base=list(find_place(robot).base),
        sources=tables,
        schedule=schedule,
        motion=MOTION if is_moved else "",
    )


def _find_acceleration(robot: str) -> str:
    """The published operating acceleration as part of a table; empty where there is none."""
    published = Robot.load(robot).published_operating_limits
    return "" if published is None else f", acceleration = {published.acceleration.tolist()}"


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
