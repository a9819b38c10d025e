"""The command line: `armguard …`.

Each command is a small dataclass: its fields are the options, its docstring the help, `run` the
work. A mistake of the user prints one line on standard error and exits with code 2; a traceback is
always a bug. A command with a field `json` passes its results to
`armguard.app.terminal.print_json`. Each command imports the libraries that it needs, so that help
and errors appear at once.
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
"""Exit code of a command whose arguments cannot be used."""

_T = TypeVar("_T")

Flag = tyro.conf.FlagCreatePairsOff[bool]


_USUAL_VERDICTS = f"port {VERDICTS_ADDRESS.rpartition(':')[2]} of the same host"


def _default(address: str) -> object:
    """An option whose help shows `address` as its default."""
    return tyro.conf.arg(help_behavior_hint=f"(default: {address})")


class Command(Protocol):
    """A command of `armguard`."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
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
    """The arm: a name that `armguard robots` lists, or a folder that `armguard robot new` wrote."""

    duration: float = 20.0
    """Duration in seconds; the demo ends sooner if the recording of the person is shorter."""
    person: Path | None = None
    """Vicon CSV recording of a person. Default: a simulated person comes and goes."""
    obstacles: int = 0
    """Number of balls that move about the cell, in addition to the person."""
    shield: Flag = False
    """Let a shield move the arm, on proved motions only; otherwise the arm obeys verdicts."""
    schedule: ScheduleName = "deadline"
    """Which pairs are evaluated in each tick."""
    seed: int = 0
    """Seed of the random motions of arm, person and balls."""
    no_view: Flag = False
    """Do not serve the browser page."""
    port: int = 0
    """TCP port of the page on 127.0.0.1; 0: any free port."""
    open: Flag = False
    """Open the page in the browser."""
    record: Path | None = None
    """Write a recording: path of a new MCAP file, or of a folder."""
    export: Path | None = None
    """At the end, write one HTML file that plays what the page showed, without a network."""
    premises: Flag = False
    """Print each premise that verdicts rest on, one a line."""
    json: Flag = False
    """Print one JSON object at the end and nothing else."""

    def run(self) -> int:
        """Run the demo."""
        from armguard.lab.demo.launcher import run_demo

        return run_demo(self)


@command
class Run:
    """Supervise a cell: read streams of obstacles and joint states, publish verdicts.

    Example: armguard run demos/cell.toml --view tcp://127.0.0.1:5704 --record run.mcap
    """

    cell: Positional[Path]
    """The cell file."""
    arm: str | None = None
    """The arm to watch, in a cell with several arms; each arm needs its own process."""
    obstacles: str = OBSTACLES_ADDRESS
    """Address to bind for obstacles; "-" reads JSON lines of obstacles and joints from stdin."""
    joints: Annotated[str | None, _default(JOINTS_ADDRESS)] = None
    """Address to bind for joint states."""
    verdicts: str = VERDICTS_ADDRESS
    """Address to bind for verdicts and commands, to which readers connect."""
    view: str | None = None
    """Address to bind for views, to which `armguard view` connects."""
    reset_token: str | None = None
    """Token that `armguard reset` must send to end a latched STOP. Default: refuse all resets."""
    record: Path | None = None
    """Write a recording for `armguard replay`: path of a new MCAP file, or of a folder."""
    drive: Flag = False
    """Also start `armguard drive` for the robot of [robot.driver], and restart it when it ends."""
    attended: Flag = False
    """With --drive: state that a person starts this and has seen the robot, which may then move."""
    proof_interval: float | None = None
    """Time between two proofs in the recording, in seconds; inf: no proofs. Default: 0.1 s."""
    sign: Path | None = None
    """Secret key file to sign the recording with, made by `armguard keys new --recordings`."""
    part_hours: float | None = None
    """Continue the recording in a new file after this many hours."""
    part_megabytes: float | None = None
    """Continue the recording in a new file when a file reaches this size, in megabytes."""
    keep_days: float | None = None
    """Delete earlier files of the recording, or of its folder, after this many days; ten stay."""
    expect: str | None = None
    """Start only if the configuration has this digest; each start prints its digest."""
    no_realtime: Flag = False
    """Do not request real-time scheduling and locked memory from the system."""
    duration: float = float("inf")
    """Duration in seconds."""
    json: Flag = False
    """Print the summary as one JSON object."""
    json_verdicts: Flag = False
    """Publish verdicts and commands as JSON objects instead of msgpack maps."""
    premises: Flag = False
    """Print each premise that verdicts rest on, one a line."""
    quiet: Flag = False
    """Print no addresses and no changes of level, only errors in messages."""
    parent: int | None = None
    """Process id of the parent; the command ends when that process has ended."""

    def run(self) -> int:
        """Run until the duration or standard input ends, or until Ctrl-C."""
        return self._supervise(moves=False)

    def _supervise(self, *, moves: bool) -> int:
        if self.parent is not None:
            end_with(self.parent)
        from armguard.app.run import supervise

        return supervise(self, moves=moves)


@command
class Shield(Run):
    """Move an arm on proved motions only: read goals and joint states, publish commands.

    Has the options of `armguard run`, and reads goals as well. The cell file must have [shield].

    Example: armguard shield demos/shield.toml --view tcp://127.0.0.1:5704
    """

    def run(self) -> int:
        """Run until the duration or standard input ends, or until Ctrl-C."""
        return self._supervise(moves=True)


@command
class Drive:
    """Connect a robot to a running monitor: send joint states, obey verdicts.

    The cell file names the robot in [robot.driver]: an arm of Universal Robots or Franka Robotics,
    or one in a ROS 2 graph. Without a valid verdict the driver stops the arm.

    Example: armguard drive demos/ur5e.toml

    Example: armguard drive demos/panda_franka.toml

    Example: armguard drive demos/ros2.toml
    """

    cell: Positional[Path]
    """The cell file that `armguard run` uses."""
    arm: str | None = None
    """The arm to drive, in a cell with several arms."""
    joints: Annotated[
        tuple[str, ...], tyro.conf.UseAppendAction, _default(f"{JOINTS_ADDRESS}; repeatable")
    ] = ()
    """Address at which a monitor reads joint states: that of every monitor in the cell."""
    obstacles: str = OBSTACLES_ADDRESS
    """Address at which the monitor reads obstacles, for drivers that also send obstacles."""
    verdicts: str = VERDICTS_ADDRESS
    """Address at which the monitor publishes verdicts."""
    measure: Flag = False
    """Stop the arm a few times while its program runs, and print times and distances."""
    stops: int = 5
    """Number of stops, with --measure."""
    key: Path | None = None
    """Secret key file of a client with `joints` and `verdicts`, if the monitor requires keys."""
    server_key: Path | None = None
    """Public key file of the monitor, if it requires keys."""
    duration: float = float("inf")
    """Duration in seconds."""
    json: Flag = False
    """Print one JSON object at the end; what is for people goes to standard error."""
    again: Flag = False
    """State that this is an automatic restart: a robot that a person must start stays at rest."""
    parent: int | None = None
    """Process id of the parent; the command ends when that process has ended."""

    def run(self) -> int:
        """Drive until the duration ends, or until Ctrl-C."""
        if self.parent is not None:
            end_with(self.parent)
        from armguard.app.drive import drive

        return drive(self)


@command
class Replay:
    """Replay a recording and check that the verdicts are bit-identical.

    Example: armguard replay demo.mcap --what-if latency=0.005,operating.velocity=0.3

    Example: armguard replay run.mcap --verify --key keys/recorder.public
    """

    file: Positional[Path]
    """The recording; with --topics, a rosbag2 folder or an MCAP file of other software."""
    topics: tuple[str, ...] = ()
    """In a recording of other software: /topic of joint states, source=/topic of obstacles."""
    cell: Path | None = None
    """The cell file for a recording of other software."""
    radius: float | None = None
    """Radius of obstacles that are recorded as poses without sizes, in metres."""
    snapshot: Flag = False
    """Each message shows all obstacles of its source: an absent obstacle is removed."""
    stamps: Literal["header", "recorded"] = "header"
    """Times of measurement in a recording of other software: from headers, or when recorded."""
    record: Path | None = None
    """Convert a recording of other software: path of a new MCAP file, or of a folder."""
    explain: str | None = None
    """Explain the verdict at this time: seconds of the monitor, or a time such as 14:03:12.5."""
    what_if: str | None = None
    """Print which stops other settings would have avoided: name=value, separated by commas."""
    verify: Flag = False
    """Do not replay; check that no part was changed, removed, reordered or cut off."""
    key: Path | None = None
    """With --verify: public key file; the recording must be signed with its secret key."""
    csv: Path | None = None
    """Write a table of all verdicts to this file; "-" is standard output."""
    view: Flag = False
    """Serve a browser page that plays, steps and searches the recording, until Ctrl-C."""
    export: Path | None = None
    """Write one HTML file that plays what the page shows, without a network."""
    port: int = 0
    """TCP port of the page on 127.0.0.1; 0: any free port."""
    open: Flag = False
    """Open the page in the browser."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Replay the recording; the exit code is 1 if verdicts differ."""
        from armguard.app.replay import replay

        return replay(self)


@command
class Check:
    """Check the proofs in a recording with a program that shares no code with armguard.

    Example: armguard check run.mcap
    """

    file: Positional[Path]
    """A recording that `--record` or `armguard.Recorder` wrote."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Check the proofs; the exit code is 1 if there is none, or if one does not hold."""
        from armguard.app.check import check

        return check(self)


@command
class Commission:
    """Measure an arm's limits and its controller's delays from a recording of stops.

    Prints and writes the lines to paste into the cell file and robot.toml.

    Example: armguard commission run.mcap --out commissioned
    """

    file: Positional[Path]
    """A recording by `--record` or `armguard.Recorder` in which the arm was stopped a few times."""
    out: Path | None = None
    """Folder to write cell-lines.toml and robot.toml into."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Measure and print them."""
        from armguard.lab.commission.command import run_commission

        return run_commission(self.file, self.out)


@command
class People:
    """Measure bounds, hidden joints and errors in recordings of tracked people.

    Reads JSON of OpenPose (--3d), Azure Kinect, MediaPipe and ZED, and CSV of Vicon. Prints lines
    to paste into the cell file.

    Example: armguard people camera.jsonl --check
    """

    files: Positional[tuple[Path, ...]] = ()
    """Recordings, measured together. Default: the folder that ARMGUARD_RECORDINGS names."""
    check: Flag = False
    """Measure how often bounds are broken, how long joints are hidden, and position errors."""
    threshold: float | None = None
    """Confidence below which a joint is hidden; 0 uses all joints. Default: that of the kit."""
    rate: float | None = None
    """Frame rate in Hz, for recordings whose frames have no stamps."""
    unit: float | None = None
    """Unit of positions in metres, such as 0.001 for mm. Default: that of the kit."""
    position_error: float | None = None
    """Greatest error of positions to assume, in metres. Default: the proposed one."""
    height: float | None = None
    """Height of the people in metres, which limits bone lengths. Default: any adult."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Measure and print the results."""
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
    """End a latched STOP of a running monitor, after its cause is gone.

    Prints the monitor's answer. The exit code is 1 if the reset was refused.

    Example: armguard reset tcp://127.0.0.1:5702 --token sesame
    """

    address: Positional[str]
    """Address at which the monitor reads obstacles or joint states; `armguard run` prints it."""
    token: str
    """The token given to `armguard run --reset-token`."""
    verdicts: Annotated[str | None, _default(_USUAL_VERDICTS)] = None
    """Address at which the monitor publishes verdicts and its answer."""
    arm: str = ""
    """Name of the arm whose monitor to reset, in a cell with several arms."""
    key: Path | None = None
    """Secret key file of a client with `reset`, if the monitor requires keys."""
    server_key: Path | None = None
    """Public key file of the monitor, if it requires keys."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

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
    """The address given to `armguard run --view`."""
    port: int = 0
    """TCP port of the page; 0: any free port."""
    floor: float = 0.0
    """Height at which the floor is drawn, in metres."""
    open: Flag = False
    """Open the page in the browser."""
    host: str = "127.0.0.1"
    """Address of the interface that serves the page; other machines need the token in the URL."""
    key: Path | None = None
    """Secret key file of a client with `view`, if the monitor requires keys."""
    server_key: Path | None = None
    """Public key file of the monitor, if it requires keys."""

    def run(self) -> int:
        """Serve the page until Ctrl-C."""
        from armguard.app.run import show

        return show(self)


@command
class Keys:
    """Make a key pair for streams that leave this machine, or to sign recordings.

    A monitor with keys accepts only clients whose keys its cell file lists. With --recordings, the
    pair signs recordings; `armguard replay --verify` then detects every later change.

    Example: armguard keys new camera --dir keys

    Example: armguard keys new recorder --recordings --dir keys
    """

    action: Positional[Literal["new"]]
    """Make a new key pair."""
    name: Positional[str]
    """Name of the client, as in [keys.clients.NAME] of the cell file, or of the monitor."""
    dir: Path = Path()
    """Folder to write NAME.secret and NAME.public into."""
    recordings: Flag = False
    """Make a key pair that signs recordings instead of one for streams."""

    def run(self) -> int:
        """Make the key pair."""
        from armguard.app.run import make_keys, make_signing_keys

        return (make_signing_keys if self.recordings else make_keys)(self.name, self.dir)


@command
class Show:
    """Show an arm in the browser: its meshes, its cover, and each level of the cover's tree.

    Example: armguard show ur5 --open
    """

    robot: Positional[str]
    """A known robot, the folder of a robot, or a URDF; armguard fits a cover to a URDF."""
    package_dirs: tuple[Path, ...] = ()
    """Further folders to search for the packages that the URDF names."""
    port: int = 0
    """TCP port of the page on 127.0.0.1; 0: any free port."""
    open: Flag = False
    """Open the page in the browser."""

    def run(self) -> int:
        """Serve the page until Ctrl-C."""
        from armguard.lab.show import show_arm

        return show_arm(self)


@command
class Cover:
    """Fit spheres to a robot's links, prove that they contain the links, and write them.

    Example: armguard cover my_arm.urdf --protrusion 20 --out my_arm
    """

    robot: Positional[str]
    """A URDF, a known robot, or the folder of a robot."""
    limits: Path | None = None
    """A robot.toml for that URDF, which names the joints that move. Default: every joint moves."""
    package_dirs: tuple[Path, ...] = ()
    """Further folders to search for the packages that the URDF names."""
    spheres: int | None = None
    """Greatest number of spheres per link; give this or --protrusion."""
    protrusion: float | None = None
    """How far spheres may stick out, in mm; 20 mm if neither is given."""
    out: Path | None = None
    """Folder to write cover.json into."""
    check: Flag = False
    """Prove the cover of a known robot again, without a new fit."""
    spheres_from: Annotated[Path | None, tyro.conf.arg(name="import")] = None
    """Sphere file of cuRobo (.yml), VAMP or foam (.urdf): show what its spheres leave uncovered."""
    inflate: Flag = False
    """Enlarge the imported spheres until they are a proved cover."""
    export: Path | None = None
    """Write a known robot's cover as a sphere file of that kind."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Fit, check, import or export, as the options say."""
        from armguard.lab.covers import run

        return run(self)


@command
class NewRobot:
    """Describe a new arm from its URDF or MJCF: limits, brakes, and a proved cover.

    Asks for values that the file lacks. AMOUNT applies to all joints without a value. JOINT=AMOUNT
    applies to that joint and overrides the URDF; JOINT can be a pattern.

    Example: armguard robot new arm.urdf --joint-limits joint_limits.yaml --out my_arm

    Example: armguard robot new mujoco_arm.xml --velocity 3.14 --out my_arm
    """

    action: Positional[Literal["new"]]
    """Describe a new robot; `armguard robots` lists the known ones."""
    urdf: Positional[Path]
    """A URDF, an MJCF, a name in robots/ of example-robot-data, or YAML with robot_description."""
    out: Path
    """New or empty folder to write robot.toml and cover.json into."""
    yes: Flag = False
    """Use default values for all that is missing; the file marks them as CHOSEN."""
    joint_limits: Path | None = None
    """MoveIt's joint_limits.yaml, used as the operating limits."""
    package_dirs: tuple[Path, ...] = ()
    """Further folders to search for the packages that the URDF names."""
    title: str | None = None
    """Display name of the robot. Default: the folder's name."""
    joints: tuple[str, ...] = ()
    """Joints to watch. Default: all joints without mimic relations."""
    lock: tuple[str, ...] = ()
    """Joints that never move, as JOINT=POSITION, in rad or m."""
    travel: tuple[str, ...] = ()
    """Joints that are not measured and can be anywhere in their range, such as fingers."""
    collision_from_visual: tuple[str, ...] = ()
    """Links without collision geometry whose visual geometry is used instead."""
    bare_links: tuple[str, ...] = ()
    """Links without collision geometry that stay without a cover."""
    position: tuple[str, ...] = ()
    """Position limits, as JOINT=LOWER:UPPER, in rad or m."""
    velocity: tuple[str, ...] = ()
    """Velocity limits, in rad/s or m/s."""
    acceleration: tuple[str, ...] = ()
    """Acceleration limits that hold always, also in emergency stops, in rad/s² or m/s²."""
    load: str | None = None
    """Load up to which the decelerations are guaranteed, in kg."""
    deceleration: tuple[str, ...] = ()
    """Deceleration that the brakes guarantee at each instant, in rad/s² or m/s²."""
    operating_velocity: tuple[str, ...] = ()
    """Operating velocities that the controller enforces, in rad/s or m/s."""
    operating_acceleration: tuple[str, ...] = ()
    """Operating accelerations that the controller enforces, in rad/s² or m/s²."""
    position_error: tuple[str, ...] = ()
    """Greatest error of measured positions, in rad or m. Default: 0.001 rad or m."""
    velocity_error: tuple[str, ...] = ()
    """Greatest error of measured velocities, in rad/s or m/s. Default: 0.02 rad/s or m/s."""
    spheres: int | None = None
    """Greatest number of spheres per link; give this or --protrusion."""
    protrusion: float | None = None
    """How far spheres may stick out, in mm; 20 mm if neither is given."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Ask, fit, and write."""
        from armguard.lab.new_robot.command import run_new

        return run_new(self)


@command
class Faults:
    """Inject faults into a simulated cell of real processes, and check each reaction.

    Example: armguard faults --only "camera-*" --out docs/faults.md
    """

    only: tuple[str, ...] = ()
    """Names of faults, or patterns such as "driver-*". Default: all faults."""
    out: Path | None = None
    """Markdown page to write, with a CSV file beside it that has a row for each fault."""
    json: Flag = False
    """Print one JSON object instead of a table."""

    def run(self) -> int:
        """Run the campaign; the exit code is 1 if a reaction is not as required."""
        from armguard.lab.faults.command import run_faults

        return run_faults(self.only, self.out)


@command
class Tradeoff:
    """Measure what accuracy costs: run one scene with all settings, and write a report.

    Example: armguard tradeoff --robot ur10 --seconds 10 --axis cover motion --out tradeoff
    """

    cell: Annotated[Path | None, Positional, tyro.conf.arg(metavar="[PATH]")] = None
    """Cell file whose settings are the default. Without it: a robot alone, with its published
    operating limits."""
    person: Path | None = None
    """Vicon CSV recording of a person. Default: a simulated person."""
    robot: str | None = None
    """A known robot, or the folder of a robot. Default: panda."""
    obstacles: int = 0
    """Number of balls that move about the arm; without --person, they replace the person."""
    touching: int = 0
    """Number of balls that touch the arm, so that the study has contacts to detect."""
    out: Path = Path("tradeoff")
    """Folder to write the report into."""
    axis: tuple[str, ...] = ()
    """Axes to measure, such as cover, motion, schedule, rate or auto. Default: all axes."""
    seconds: float = 20.0
    """Duration of the scene in seconds."""
    seed: int = 0
    """Seed of all random motions."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Measure and write the report."""
        from armguard.lab.tradeoff.command import run

        return run(self)


@command
class Extremes:
    """Test armguard with extreme numbers: whether answers are sound, tight, or refused.

    Example: armguard extremes --out extremes.md
    """

    out: Path | None = None
    """Markdown page to write, with all cases in a CSV file beside it. Default: print them."""
    seed: int = 0
    """Seed of all random cases."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Measure all cases; the exit code is 1 if an answer is unsound."""
        from armguard.lab.extremes.command import run

        return run(self)


@command
class Paper:
    """Measure the paper's claims about its schedules, with 3 to 100,000 pairs.

    Example: armguard paper --out paper
    """

    out: Path = Path("paper")
    """Folder to write the report into."""
    seed: int = 0
    """Seed of all random motions."""
    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

    def run(self) -> int:
        """Measure and write the report; the exit code is 1 if a pair came near unnoticed."""
        from armguard.lab.paper.command import run

        return run(self)


@command
class Kernels:
    """Compile all kernels in advance, for a container image or a wheel.

    Example: armguard kernels
    """

    carry: Flag = False
    """Write the kernels into the package's folder, for all processors with AVX2, for a wheel."""

    def run(self) -> int:
        """Compile the kernels."""
        from armguard.app import kernels

        return kernels.run(carry=self.carry)


@command
class Robots:
    """List the robots that armguard knows by name.

    Example: armguard robots
    """

    json: Flag = False
    """Print one JSON object; messages for people go to standard error."""

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
"""All commands, by purpose."""

COMMANDS = {name: kind for group in GROUPS.values() for name, kind in group.items()}


def describe_commands() -> str:
    """The text that `armguard --help` prints."""
    lines = [
        "usage: armguard COMMAND …",
        "",
        "Real-time safety monitor for robot arms. It is not a certified safety device.",
    ]
    for title, group in GROUPS.items():
        lines += ["", f"{title}:"]
        for name, kind in group.items():
            lines.append(f"  {name:11} {(kind.__doc__ or '').splitlines()[0]}")
    lines += [
        "",
        "`armguard COMMAND --help` shows the options of a command and an example.",
        "`armguard --version` shows the installed versions. Example: armguard demo --duration 20",
    ]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `armguard` with `arguments` (default: those of the process); returns the exit code."""
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
        complain("interrupted before there was a result")
        return INTERRUPTED


def _output_of(command: Command) -> contextlib.AbstractContextManager[None]:
    """Redirect the output of a command: with `--json`, standard output has only the report."""
    if not getattr(command, "json", False):
        return contextlib.nullcontext()
    from armguard.app.terminal import keep_for_report

    return keep_for_report()


def describe_version() -> str:
    """The installed versions that verdicts depend on, in one line."""
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
    """A suggestion for each unknown option, as the end of a message; empty if none is near."""
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
    """The message inside the box that Tyro draws; its lines consist of "─" or "-"."""
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
