"""The command line: `armguard …`.

Each command is a small dataclass: its fields are the options, its docstring the help, `run` the
work. Mistakes are one line on standard error and exit code 2; a traceback is always a bug. With
`json` among its fields, it hands what it has found to `armguard.app.terminal.print_json`.
Libraries are imported by the command that needs them, so that help and mistakes come at once.
"""

from __future__ import annotations

import atexit
import contextlib
import dataclasses
import difflib
import gc
import importlib.metadata
import io
import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Protocol, TypeVar, dataclass_transform, get_type_hints

import tyro
from tyro.conf import Positional

from armguard.app.processes import (
    COMPLAINT,
    INTERRUPTED,
    complain,
    end_with,
    termination_as_interrupt,
)
from armguard.exceptions import ArmguardError
from armguard.settings.schedule import ScheduleName
from armguard.streams.addresses import JOINTS_ADDRESS, OBSTACLES_ADDRESS, VERDICTS_ADDRESS

MISTAKE = 2
"""Exit code of a call that could not be carried out as given."""

_T = TypeVar("_T")

Flag = tyro.conf.FlagCreatePairsOff[bool]


_USUAL_VERDICTS = f"port {VERDICTS_ADDRESS.rpartition(':')[2]} of the same host"


def _default(address: str) -> object:
    """What help says of an address that counts where none is given."""
    return tyro.conf.arg(help_behavior_hint=f"(default: {address})")


class Command(Protocol):
    """What `armguard` can be asked to do."""

    def run(self) -> int:
        """Do it; the exit code."""
        ...


@dataclass_transform(frozen_default=True)
def command(kind: type[_T]) -> type[_T]:
    """Make a class a command: its fields are the options."""
    return dataclasses.dataclass(frozen=True)(kind)


@command
class Demo:
    """Supervise a simulated arm at 1 kHz among moving people and obstacles.

    Example: armguard demo --robot ur5 --duration 20 --obstacles 10 --record demo.mcap
    """

    robot: str = "panda"
    """Which arm: one that `armguard robots` lists, or a folder that `robot new` has written."""

    duration: float = 20.0
    """How long to run, in seconds; a recording may end it sooner."""
    person: Path | None = None
    """A Vicon CSV recording of a person; without it, a simulated one comes and goes."""
    obstacles: int = 0
    """How many balls wander about the cell too."""
    shield: Flag = False
    """A shield moves the arm, on proved motions only; without it, the arm obeys verdicts."""
    schedule: ScheduleName = "deadline"
    """Which pairs are evaluated in each tick."""
    seed: int = 0
    """Of the arm's, the person's and the balls' motions."""
    no_view: Flag = False
    """Serve no browser page."""
    port: int = 0
    """TCP port of the page on 127.0.0.1; 0: any that is free."""
    open: Flag = False
    """Open the page in the browser."""
    record: Path | None = None
    """Write a recording: a new MCAP file, or a folder for one."""
    export: Path | None = None
    """Write, at the end, one HTML file that plays what the page showed, offline."""
    premises: Flag = False
    """Print every premise that verdicts rest on, a line each."""
    json: Flag = False
    """Print one JSON object at the end and nothing else."""

    def run(self) -> int:
        """Run the demo."""
        from armguard.lab.demo.launcher import run_demo

        return run_demo(self)


@command
class Run:
    """Supervise a cell: obstacles and joint states streamed in, verdicts streamed out.

    Example: armguard run demos/cell.toml --view tcp://127.0.0.1:5704 --record run.mcap
    """

    cell: Positional[Path]
    """The cell file."""
    arm: str | None = None
    """Which arm is watched, in a cell with several: one process for each."""
    obstacles: str = OBSTACLES_ADDRESS
    """Address to bind for obstacles; "-" reads JSON lines, joint states among them, from stdin."""
    joints: Annotated[str | None, _default(JOINTS_ADDRESS)] = None
    """Address to bind for joint states."""
    verdicts: str = VERDICTS_ADDRESS
    """Address to bind for readers of verdicts, and of commands."""
    view: str | None = None
    """Address to bind for views to attach to, as `armguard view` does."""
    reset_token: str | None = None
    """Token that `armguard reset` must give to end a latched STOP; without one, none is obeyed."""
    record: Path | None = None
    """Write a recording for `armguard replay`: a new MCAP file, or a folder for one."""
    drive: Flag = False
    """Start `armguard drive` for the robot of [robot.driver] as well, and look after it."""
    proof_interval: float | None = None
    """Seconds between two proofs in the recording; inf: none. By default it is 0.1."""
    sign: Path | None = None
    """Sign the recording: the secret file that `armguard keys new --recordings` wrote."""
    part_hours: float | None = None
    """Let the recording go on in another file after so long."""
    part_megabytes: float | None = None
    """Let the recording go on in another file once one is so large."""
    keep_days: float | None = None
    """Remove earlier files of the recording, or its folder, that are older; ten stay."""
    expect: str | None = None
    """Start only if the configuration has this digest, which a start tells."""
    no_realtime: Flag = False
    """Do not ask the system for real-time scheduling and memory kept in RAM."""
    duration: float = float("inf")
    """How long to run, in seconds."""
    json: Flag = False
    """Print the summary as one JSON object."""
    json_verdicts: Flag = False
    """Send verdicts and commands as JSON objects, not as msgpack maps."""
    premises: Flag = False
    """Print every premise that verdicts rest on, a line each."""
    quiet: Flag = False
    """Print neither addresses nor changes of level, only errors in messages."""
    parent: int | None = None
    """End when this process is no longer the one that started this command."""

    def run(self) -> int:
        """Run until the end of the duration, of standard input, or Ctrl-C."""
        return self._supervise(moves=False)

    def _supervise(self, *, moves: bool) -> int:
        if self.parent is not None:
            end_with(self.parent)
        from armguard.app.run import supervise

        return supervise(self, moves=moves)


@command
class Shield(Run):
    """Move an arm on proved motions only: goals and joint states streamed in, commands out.

    Takes what `armguard run` takes, and goals beside it. The cell file needs [shield].

    Example: armguard shield demos/shield.toml --view tcp://127.0.0.1:5704
    """

    def run(self) -> int:
        """Run until the end of the duration, of standard input, or Ctrl-C."""
        return self._supervise(moves=True)


@command
class Drive:
    """Join a robot to a running monitor: joint states out, verdicts obeyed.

    The robot is that of [robot.driver] in the cell file: an arm of Universal Robots, or one in a
    ROS 2 graph. Without a valid verdict it stands.

    Example: armguard drive demos/ur5e.toml
    """

    cell: Positional[Path]
    """The cell file, as `armguard run` has it."""
    arm: str | None = None
    """Which arm, in a cell with several."""
    joints: str = JOINTS_ADDRESS
    """Address of the monitor's joint states."""
    obstacles: str = OBSTACLES_ADDRESS
    """Address of its obstacles, for a driver that brings them along."""
    verdicts: str = VERDICTS_ADDRESS
    """Address of its verdicts."""
    measure: Flag = False
    """Stop the arm a few times while its program runs, and print how it stops."""
    stops: int = 5
    """How often, with --measure."""
    key: Path | None = None
    """Where the monitor asks for keys: the secret file of a client with joints and verdicts."""
    server_key: Path | None = None
    """The monitor's public file."""
    duration: float = float("inf")
    """How long to drive, in seconds."""
    json: Flag = False
    """Print one JSON object at the end; what is for people goes to standard error."""
    again: Flag = False
    """Nobody has just started this: a robot that a person must start stands, as after a fault."""
    parent: int | None = None
    """End when this process is no longer the one that started this command."""

    def run(self) -> int:
        """Drive until the end of the duration, or Ctrl-C."""
        if self.parent is not None:
            end_with(self.parent)
        from armguard.app.drive import drive

        return drive(self)


@command
class Replay:
    """Replay a recording and check that its verdicts are the same, to the bit.

    Example: armguard replay demo.mcap --what-if latency=0.005,operating.velocity=0.3

    Example: armguard replay run.mcap --verify --key keys/recorder.public
    """

    file: Positional[Path]
    """What `--record` or `armguard.Recorder` wrote; with --topics a rosbag2 folder or MCAP file."""
    topics: tuple[str, ...] = ()
    """Of a recording of others: joint states, and obstacles as /topic or source=/topic."""
    cell: Path | None = None
    """The cell file for a recording of others."""
    radius: float | None = None
    """Of what comes as poses without sizes, in metres."""
    snapshot: Flag = False
    """Each message of obstacles shows all that its source sees; what is absent is gone."""
    stamps: Literal["header", "recorded"] = "header"
    """When states of others were measured: as their headers say, or when they were recorded."""
    record: Path | None = None
    """Make a recording of a recording of others: a new MCAP file, or a folder for one."""
    explain: str | None = None
    """Why the verdict at this time was as it was: in seconds of the monitor, or as 14:03:12.5."""
    what_if: str | None = None
    """Which stops other settings would have avoided: name=value, by commas."""
    verify: Flag = False
    """Replay nothing: find what was changed, removed, reordered or cut off since then."""
    key: Path | None = None
    """With --verify: the public file of the key that must have signed the recording."""
    csv: Path | None = None
    """Write a table of all verdicts; "-" is standard output."""
    view: Flag = False
    """Show the cell in a browser page, which plays, steps and searches, until Ctrl-C."""
    export: Path | None = None
    """Write one HTML file that plays what the page shows, offline."""
    port: int = 0
    """TCP port of the page on 127.0.0.1; 0: any that is free."""
    open: Flag = False
    """Open the page in the browser."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Replay; the exit code is 1 where verdicts differ."""
        from armguard.app.replay import replay

        return replay(self)


@command
class Check:
    """Check the proofs of a recording by a program that shares nothing with armguard.

    Example: armguard check run.mcap
    """

    file: Positional[Path]
    """What `--record` or `armguard.Recorder` wrote."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Check; the exit code is 1 where there is no proof, or one does not hold."""
        from armguard.app.check import check

        return check(self)


@command
class Commission:
    """Find an arm's limits and its controller's delays in a recording of stops, as lines to paste.

    Example: armguard commission run.mcap --out commissioned
    """

    file: Positional[Path]
    """What `--record` or `armguard.Recorder` wrote while the arm was stopped a few times."""
    out: Path | None = None
    """The folder to write cell-lines.toml and robot.toml into."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Find it."""
        from armguard.lab.commission.command import run_commission

        return run_commission(self.file, self.out)


@command
class People:
    """Measure recordings of tracked people: bounds, hidden joints, errors, lines to paste.

    Reads what OpenPose (--3d), Azure Kinect, MediaPipe and ZED write as JSON, and Vicon's CSV.

    Example: armguard people camera.jsonl --check
    """

    files: Positional[tuple[Path, ...]] = ()
    """The recordings, measured together; none: the folder that ARMGUARD_RECORDINGS names."""
    check: Flag = False
    """Measure how often bounds break, how long joints are hidden, and what positions are off by."""
    threshold: float | None = None
    """Joints of less confidence are hidden; without it, the kit's usual one. 0 takes all."""
    rate: float | None = None
    """Frames a second, in Hz, where frames have no stamps."""
    unit: float | None = None
    """Of positions, in metres, as 0.001; without it, the kit's usual one."""
    position_error: float | None = None
    """What positions are stated to be off by, in metres; without it, what is proposed."""
    height: float | None = None
    """Of the people, in metres; without it, bones may be as long as anybody's."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Measure."""
        from armguard.lab.tracked_people.command import run_people

        return run_people(
            self.files,
            check=self.check,
            threshold=self.threshold,
            rate=self.rate,
            unit=self.unit,
            position_error=self.position_error,
            height=self.height,
        )


@command
class Reset:
    """End a latched STOP of a running monitor, once its cause has gone.

    Says whether it was obeyed; the exit code is 1 where it was not.

    Example: armguard reset tcp://127.0.0.1:5702 --token sesame
    """

    address: Positional[str]
    """Where the monitor takes obstacles or joint states; `armguard run` prints it."""
    token: str
    """What `armguard run --reset-token` was given."""
    verdicts: Annotated[str | None, _default(_USUAL_VERDICTS)] = None
    """Where the monitor publishes verdicts, and its answer."""
    arm: str = ""
    """Whose monitor is meant, in a cell with several arms."""
    key: Path | None = None
    """Where the monitor asks for keys: the secret file of a client that may reset."""
    server_key: Path | None = None
    """The monitor's public file."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Send the reset and wait for the answer."""
        from armguard.app.run import send_reset

        return send_reset(self)


@command
class View:
    """Show a running monitor in the browser.

    Example: armguard view tcp://127.0.0.1:5704 --port 7000
    """

    address: Positional[str]
    """What `armguard run --view` was given."""
    port: int = 0
    """TCP port of the page; 0: any that is free."""
    floor: float = 0.0
    """Height of the floor that is drawn, in metres."""
    open: Flag = False
    """Open the page in the browser."""
    host: str = "127.0.0.1"
    """Address of the interface that serves the page: beyond this machine by a token in its URL."""
    key: Path | None = None
    """Where the monitor asks for keys: the secret file of a client that may view."""
    server_key: Path | None = None
    """The monitor's public file."""

    def run(self) -> int:
        """Serve the page until Ctrl-C."""
        from armguard.app.run import show

        return show(self)


@command
class Keys:
    """Make keys, with which streams can leave this machine; nothing else is then let in.

    Or a key that signs recordings, so that nobody else can change one unnoticed.

    Example: armguard keys new camera --dir keys

    Example: armguard keys new recorder --recordings --dir keys
    """

    action: Positional[Literal["new"]]
    """Make a new pair."""
    name: Positional[str]
    """Of the client, as in [keys.clients.NAME] of the cell file, or of the monitor."""
    dir: Path = Path()
    """The folder to write NAME.secret and NAME.public into."""
    recordings: Flag = False
    """Make a pair that signs recordings, not one for streams."""

    def run(self) -> int:
        """Make them."""
        from armguard.app.run import make_keys, make_signing_keys

        return (make_signing_keys if self.recordings else make_keys)(self.name, self.dir)


@command
class Show:
    """Show an arm in the browser: its meshes, its cover, and the levels of the cover's tree.

    Example: armguard show ur5 --open
    """

    robot: Positional[str]
    """A robot that armguard knows, the folder of one, or a URDF, to which a cover is fitted."""
    package_dirs: tuple[Path, ...] = ()
    """Folders in which the URDF's packages lie, besides those around it."""
    port: int = 0
    """TCP port of the page on 127.0.0.1; 0: any that is free."""
    open: Flag = False
    """Open the page in the browser."""

    def run(self) -> int:
        """Serve the page until Ctrl-C."""
        from armguard.lab.show import show_arm

        return show_arm(self)


@command
class Cover:
    """Fit spheres to a robot's links, prove that they contain them, and write them.

    Example: armguard cover my_arm.urdf --protrusion 20 --out my_arm
    """

    robot: Positional[str]
    """A URDF, a robot that armguard knows, or the folder of one of your own."""
    limits: Path | None = None
    """A robot.toml for that URDF, which says what moves; without it, every joint does."""
    package_dirs: tuple[Path, ...] = ()
    """Folders in which the URDF's packages lie, besides those around it."""
    spheres: int | None = None
    """At most so many spheres a link; or"""
    protrusion: float | None = None
    """how far they may stick out, in mm. Neither: 20 mm."""
    out: Path | None = None
    """The folder to write cover.json into."""
    check: Flag = False
    """Prove the cover of a known robot again; nothing is fitted."""
    spheres_from: Annotated[Path | None, tyro.conf.arg(name="import")] = None
    """A file of cuRobo (.yml), VAMP or foam (.urdf): show what its spheres leave uncovered."""
    inflate: Flag = False
    """Grow the imported spheres into a proved cover."""
    export: Path | None = None
    """Write a known robot's cover as such a file."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Do what the options ask for."""
        from armguard.lab.covers import run

        return run(self)


@command
class NewRobot:
    """Describe an arm of your own from its URDF or MJCF: limits, brakes, and a proved cover.

    Asks for what the file lacks. AMOUNT counts for all joints that lack one, JOINT=AMOUNT for that
    joint, whatever the URDF says; JOINT may be a pattern.

    Example: armguard robot new arm.urdf --joint-limits joint_limits.yaml --out my_arm

    Example: armguard robot new mujoco_arm.xml --velocity 3.14 --out my_arm
    """

    action: Positional[Literal["new"]]
    """Make a new one; `armguard robots` lists those that armguard knows."""
    urdf: Positional[Path]
    """A URDF, an MJCF, one below robots/ of example-robot-data, or YAML with robot_description."""
    out: Path
    """The folder to write robot.toml and cover.json into: new, or empty."""
    yes: Flag = False
    """Take what is usual for all that is missing; the file says what was CHOSEN."""
    joint_limits: Path | None = None
    """MoveIt's joint_limits.yaml: what the controller keeps to at work."""
    package_dirs: tuple[Path, ...] = ()
    """Folders in which the URDF's packages lie, besides those around it."""
    title: str | None = None
    """The robot's name for people; without it, that of the folder."""
    joints: tuple[str, ...] = ()
    """The joints to watch; without it, all but those that mimic or are mimicked."""
    lock: tuple[str, ...] = ()
    """Joints that stand still, as JOINT=POSITION, in rad or m."""
    travel: tuple[str, ...] = ()
    """Joints not to watch that may be anywhere in their range, such as fingers."""
    collision_from_visual: tuple[str, ...] = ()
    """Links without collision geometry that are collided with as they are drawn."""
    bare_links: tuple[str, ...] = ()
    """Links without collision geometry to leave uncovered."""
    position: tuple[str, ...] = ()
    """Position limits, as JOINT=LOWER:UPPER, in rad or m."""
    velocity: tuple[str, ...] = ()
    """Velocity limits, in rad/s or m/s."""
    acceleration: tuple[str, ...] = ()
    """Accelerations that are never exceeded, emergency stops included, in rad/s² or m/s²."""
    load: str | None = None
    """Up to which the decelerations hold, in kg."""
    deceleration: tuple[str, ...] = ()
    """What brakes guarantee at each instant, in rad/s² or m/s²."""
    operating_velocity: tuple[str, ...] = ()
    """What the controller keeps to at work, in rad/s or m/s."""
    operating_acceleration: tuple[str, ...] = ()
    """What the controller keeps to at work, in rad/s² or m/s²."""
    position_error: tuple[str, ...] = ()
    """What measured positions may be off by; without it, 0.001 rad or m."""
    velocity_error: tuple[str, ...] = ()
    """What measured velocities may be off by; without it, 0.02 rad/s or m/s."""
    spheres: int | None = None
    """At most so many spheres a link; or"""
    protrusion: float | None = None
    """how far they may stick out, in mm. Neither: 20 mm."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Ask, fit, and write."""
        from armguard.lab.new_robot.command import run_new

        return run_new(self)


@command
class Faults:
    """Make faults on purpose in a simulated cell of real processes, and judge each.

    Example: armguard faults --only "camera-*" --out docs/faults.md
    """

    only: tuple[str, ...] = ()
    """Names of faults, or patterns as "driver-*"; without it, all."""
    out: Path | None = None
    """The page to write."""
    json: Flag = False
    """Print one JSON object instead of a table."""

    def run(self) -> int:
        """Make the campaign; the exit code is 1 where something is not as it must be."""
        from armguard.lab.faults.command import run_faults

        return run_faults(self.only, self.out)


@command
class Tradeoff:
    """Measure what accuracy costs: one scene through all settings, and a report to choose by.

    Example: armguard tradeoff --robot ur10 --seconds 10 --axis cover motion --out tradeoff
    """

    cell: Annotated[Path | None, Positional, tyro.conf.arg(metavar="[PATH]")] = None
    """A cell file, whose settings are the default; without it, a robot by itself that keeps to
    its published operating limits."""
    person: Path | None = None
    """A Vicon CSV recording of a person; without it, a simulated one."""
    robot: str | None = None
    """A robot that armguard knows, or the folder of one of your own; without it, Panda."""
    obstacles: int = 0
    """How many balls wander about the arm; without a recording, instead of the person."""
    touching: int = 0
    """How many balls come and touch the arm, so that there are contacts to be missed."""
    out: Path = Path("tradeoff")
    """The folder to write the report into."""
    axis: tuple[str, ...] = ()
    """Only these axes, such as cover, motion, schedule, rate or auto; an unknown one names all."""
    seconds: float = 20.0
    """Of the scene."""
    seed: int = 0
    """Of all motions."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Measure and write the report."""
        from armguard.lab.tradeoff.command import run

        return run(self)


@command
class Extremes:
    """Test armguard with extreme numbers: sound, how tight, or refused.

    Example: armguard extremes --out extremes.md
    """

    out: Path | None = None
    """The page to write; without it, it is printed."""
    seed: int = 0
    """Of all cases."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Measure all cases; the exit code is 1 if one is unsound."""
        from armguard.lab.extremes.command import run

        return run(self)


@command
class Paper:
    """Measure what the paper claims of its schedules, from 3 to 100,000 pairs.

    Example: armguard paper --out paper
    """

    out: Path = Path("paper")
    """The folder to write the report into."""
    seed: int = 0
    """Of all motions."""
    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Measure and write the report; the exit code is 1 if a pair came near unwatched."""
        from armguard.lab.paper.command import run

        return run(self)


@command
class Kernels:
    """Compile all kernels now, while an image or a wheel is built.

    Example: armguard kernels
    """

    carry: Flag = False
    """Into the package's own folder, for all processors with AVX2, from where wheels take it."""

    def run(self) -> int:
        """Compile."""
        from armguard.app import kernels

        return kernels.run(carry=self.carry)


@command
class Robots:
    """List the robots that armguard knows by name.

    Example: armguard robots
    """

    json: Flag = False
    """Print one JSON object; what is for people goes to standard error."""

    def run(self) -> int:
        """Print the list."""
        from armguard.lab.covers import list_known

        return list_known()


GROUPS: dict[str, dict[str, type[Command]]] = {
    "run": {"demo": Demo, "run": Run, "shield": Shield, "drive": Drive, "reset": Reset},
    "look": {"view": View, "replay": Replay, "check": Check, "show": Show, "robots": Robots},
    "prepare": {
        "robot": NewRobot,
        "cover": Cover,
        "commission": Commission,
        "people": People,
        "keys": Keys,
        "kernels": Kernels,
    },
    "study": {"tradeoff": Tradeoff, "faults": Faults, "extremes": Extremes, "paper": Paper},
}
"""All commands, by what they are for."""

COMMANDS = {name: kind for group in GROUPS.values() for name, kind in group.items()}


def describe_commands() -> str:
    """What `armguard --help` prints."""
    lines = [
        "usage: armguard COMMAND …",
        "",
        "Real-time safety monitor for robot arms; no certified safety device.",
    ]
    for title, group in GROUPS.items():
        lines += ["", f"{title}:"]
        for name, kind in group.items():
            lines.append(f"  {name:11} {(kind.__doc__ or '').splitlines()[0]}")
    lines += [
        "",
        "`armguard COMMAND --help` shows the options of a command, with an example.",
        "`armguard --version` shows what is installed. Example: armguard demo --duration 20",
    ]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `armguard` with `arguments` (default: the process's own); the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given == ["--version"]:
        sys.stdout.write(describe_version() + "\n")
        return 0
    if arguments is None:
        # What is left at the end goes with the process: to collect it would take up to 0.3 s.
        atexit.register(gc.freeze)
    command = None
    try:
        command = _parse(given)
        with termination_as_interrupt(), _output_of(command):
            return command.run()
    except ArmguardError as error:
        complain(str(error))
        return MISTAKE
    except BrokenPipeError:
        # Who read the output has enough, as `head` has. What is left goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0 if command is None else COMPLAINT  # of help, all that was wanted was read
    except KeyboardInterrupt:
        complain("interrupted before there was anything to show")
        return INTERRUPTED


def _output_of(command: Command) -> contextlib.AbstractContextManager[None]:
    """Where a command prints: with `--json`, standard output has its report and nothing else."""
    if not getattr(command, "json", False):
        return contextlib.nullcontext()
    from armguard.app.terminal import keep_for_report

    return keep_for_report()


def describe_version() -> str:
    """What is installed, in one line: versions that verdicts depend on."""
    armguard, pin, numba = map(importlib.metadata.version, ("armguard", "pin", "numba"))
    return f"armguard {armguard} (pin {pin}, numba {numba}, Python {platform.python_version()})"


def _parse(given: list[str]) -> Command:
    """Read the command line; a mistake ends the process with one line and exit code 2."""
    if given in (["--help"], ["-h"]):
        sys.stdout.write(describe_commands())
        sys.stdout.flush()
        raise SystemExit(0)
    if not given:
        complain("a command is missing: `armguard --help` lists them")
        raise SystemExit(MISTAKE)
    if given[0] not in COMMANDS:
        near = difflib.get_close_matches(given[0], COMMANDS, 1)
        hint = f"did you mean {near[0]}?" if near else "`armguard --help` lists them"
        complain(f"there is no command {given[0]!r}: {hint}")
        raise SystemExit(MISTAKE)
    messages = io.StringIO()
    try:
        with contextlib.redirect_stderr(messages):
            return tyro.cli(COMMANDS[given[0]], prog=f"armguard {given[0]}", args=given[1:])
    except SystemExit as end:
        if end.code in (0, None):
            raise
        complain(_one_line(messages.getvalue()) + _suggest_options(given))
        raise SystemExit(MISTAKE) from None


def _suggest_options(given: Sequence[str]) -> str:
    """The options nearest to those that a command does not have, as the end of a message."""
    names = []
    for name, hint in get_type_hints(COMMANDS[given[0]], include_extras=True).items():
        extras = getattr(hint, "__metadata__", ())
        if Positional not in extras:
            renamed = [one.name for one in extras if getattr(one, "name", None)]
            names.append("--" + (renamed or [name])[0].replace("_", "-"))
    words = {word.partition("=")[0].replace("_", "-") for word in given if word.startswith("--")}
    unknown = sorted(words - {*names, "--help"})
    near = [one for word in unknown for one in difflib.get_close_matches(word, names, 1)]
    return f": did you mean {' and '.join(near)}?" if near else ""


def _one_line(box: str) -> str:
    """The message inside the box that Tyro draws, with rules of either "─" or "-"."""
    words: list[str] = []
    inside = False
    for line in box.splitlines():
        text = line.strip("│ ")
        if text.startswith(("╭", "──", "--" * 4)):
            if words:
                break
            inside = True
        elif inside and text:
            words.append(text)
    return " ".join(words) or " ".join(box.split())
