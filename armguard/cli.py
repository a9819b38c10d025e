"""The command line: `armguard …`.

Each command is a small dataclass: its fields are the options, its docstring the help, `run` the
work. Mistakes are one line on standard error and exit code 2; a traceback is always a bug.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import tyro

from armguard.exceptions import ArmguardError

MISTAKE = 2
"""Exit code of a call that could not be carried out as given."""


@dataclasses.dataclass(frozen=True)
class Demo:
    """Supervise a simulated Panda at 1 kHz among moving people and obstacles.

    Example: armguard demo --duration 20 --obstacles 10
    """

    duration: float = 20.0
    """How long to run, in seconds; a recording may end it sooner."""
    person: Path | None = None
    """A Vicon CSV recording of a person; without it, a simulated one comes and goes."""
    obstacles: int = 0
    """How many balls wander about the cell besides."""
    schedule: Literal["full", "distance", "daa"] = "full"
    """Which pairs are looked at in each tick."""
    seed: int = 0
    """Of the arm's, the person's and the balls' motions."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object at the end and nothing else."""

    def run(self) -> int:
        """Run the demo; the exit code."""
        # Imported here: help and mistakes should not wait for Pinocchio and Numba.
        from armguard.demo import run_demo

        return run_demo(
            duration=self.duration,
            person=self.person,
            obstacle_count=self.obstacles,
            schedule=self.schedule,
            seed=self.seed,
            as_json=self.json,
        )


@dataclasses.dataclass(frozen=True)
class Robots:
    """List the robots that armguard knows by name.

    Example: armguard robots
    """

    def run(self) -> int:
        """Print the list; the exit code."""
        from armguard.robot_description import list_robots

        for name in list_robots():
            print(name)  # noqa: T201
        return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `armguard` with `arguments` (default: the process's own); the exit code."""
    command = _parse(arguments)
    try:
        return command.run()
    except ArmguardError as error:
        print(f"armguard: {error}", file=sys.stderr)  # noqa: T201 - the command line speaks here
        return MISTAKE


def _parse(arguments: Sequence[str] | None) -> Demo | Robots:
    """Read the command line; a mistake ends the process with one line and exit code 2."""
    messages = io.StringIO()
    try:
        with contextlib.redirect_stderr(messages):
            return tyro.cli(
                tyro.conf.OmitSubcommandPrefixes[  # type: ignore[misc]
                    Annotated[Demo, tyro.conf.subcommand("demo")]
                    | Annotated[Robots, tyro.conf.subcommand("robots")]
                ],
                prog="armguard",
                description="Real-time safety monitor for robot arms; no certified safety device.",
                args=arguments,
            )
    except SystemExit as end:
        if end.code not in (0, None):
            print(f"armguard: {_one_line(messages.getvalue())}", file=sys.stderr)  # noqa: T201
            raise SystemExit(MISTAKE) from None
        raise


def _one_line(box: str) -> str:
    """The message inside the box that Tyro draws around it."""
    words: list[str] = []
    for line in box.splitlines():
        text = line.strip("│╭╮╰╯─ ")
        if line.startswith("│ ──"):
            break
        if line.startswith("│") and text:
            words.append(text)
    return " ".join(words) or box.strip()
