"""Every shell command of README.md, CONTRIBUTING.md and docs/ works as it is written.

Commands are taken from fenced blocks (`sh`, `console`) and from indented lines that begin with
`armguard`. In a folder that is laid out like a checkout, with the files that a page has its reader
bring, and in the environment that the tests run in unless said otherwise:

- `RUN`: run to their end, which has to be good, on a short recording of ours.
- `LIVE`: started together, seen to work with each other, and ended by Ctrl-C, all on the ports
  that the pages name.
- Blocks of `console`: run by test_readme.py.
- These and those of `LIVE`, and what else Start has its reader run that ends by itself: run in the
  environment that Start's first command makes, where `ARMGUARD_START` names it, as in `.ci/run`.
- All other commands of `armguard` are only parsed, by the parser of the command line itself: they
  take minutes, ask on a terminal, or serve until Ctrl-C. Each file that one reads has to be there,
  be brought by the reader, or be made by an earlier command of the page.
- `NOT_RUN`: commands of other programs, each with the reason.
"""

import contextlib
import fcntl
import itertools
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from armguard.app.cli import COMMANDS, _parse, main
from armguard.streams import VerdictReader
from support import commissioned_runs

ROOT = Path(__file__).parents[2]
PAGES = {
    path.stem: path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md"))
}
PATIENCE = 300.0  # a cold start compiles
START = Path(os.environ.get("ARMGUARD_START", sys.prefix))
"""The environment that docs/start.md makes; where there is none, that of the tests."""

BROUGHT = {
    "arms": {"FILE.urdf"},
    "commission": {"cell.toml"},
    "covers": {"my_arm.urdf", "spheres.yml"},
    "keys": {"cell/cell.toml", "desk.secret", "monitor.public"},
    "recording": {"bag/", "keys/recorder.secret", "keys/recorder.public"},
    "robot": {"arm.urdf"},
    "settings": {"cell.toml", "person.csv"},
    "skeletons": {"camera.jsonl"},
    "several_arms": {"cell.toml"},
    "view": {"cell.toml"},
}
"""Files that a page speaks of as the reader's own."""

RUN = {
    "covers": [
        "armguard cover panda --export panda.yml",
        "armguard cover panda --export panda.urdf",
        "armguard cover panda --import spheres.yml",
    ],
    "keys": [f"armguard keys new {name} --dir cell" for name in ("monitor", "camera")],
    "recording": [
        "armguard keys new recorder --recordings --dir keys",
        "armguard replay demo.mcap",
        "armguard replay demo.mcap --what-if latency=0.005,operating.velocity=0.3",
        "armguard check demo.mcap",
    ],
}

LIVE = {
    "start": [
        "armguard run demos/cell.toml --json-verdicts --view tcp://127.0.0.1:5704 "
        "--reset-token TOKEN",
        "python docs/nodes/perception.py",
        "python docs/nodes/controller.py",
        "armguard reset tcp://127.0.0.1:5702 --token TOKEN",
    ],
    "cells": [
        "armguard run demos/cell.toml --view tcp://127.0.0.1:5704 --reset-token TOKEN",
        ".venv/bin/python demos/03_perception.py",
        ".venv/bin/python demos/04_controller.py",
        "armguard view tcp://127.0.0.1:5704",
        "armguard reset tcp://127.0.0.1:5702 --token TOKEN",
    ],
}
"""The monitor first; then what it hears; a view; and a reset, which ends by itself."""

NOT_RUN = {
    "python3 -m venv": "makes the environment, from the network",
    "source .venv/bin/activate": "is for a person's shell",
    ".venv/bin/pip install": "installs from the network; .ci/run does, for README and for Start",
    "franka/bin/pip install": "installs from the network; .ci/run does",
    "franka/bin/python": "simulates a robot; tests/drivers/test_franka.py runs it",
    ".venv/bin/pytest": "would run the tests within themselves",
    ".venv/bin/ruff": "is what .ci/run does",
    ".venv/bin/mypy": "is what .ci/run does",
    ".venv/bin/mkdocs": "is what .ci/run does",
    "python -m hatchling build": "test_wheel.py and .ci/run build the wheel",
    "python3 demos/06_ros2_bridge.py": "needs ROS 2; test_demos.py runs it with a stand-in",
}
"""Beginnings of commands, and why they are not run."""

OUTPUTS = {"--out", "--record", "--export", "--dir"}
"""Options that name what is written."""

READ = re.compile(r"[^=:]+(\.(toml|urdf|csv|mcap|yml|secret|public)|/)")
"""Words that name what is read."""


def list_commands(page):
    """Commands of a page, in their order, and whether they are in a block of `console`."""
    blocks = r"^( *)```(\w*)\n(.*?)^\1```$|^    (armguard [^\n]*)$"
    found = []
    for block in re.finditer(blocks, page, re.MULTILINE | re.DOTALL):
        language, text, line = block.group(2, 3, 4)
        if line is not None:
            language, text = "sh", line
        if language not in ("sh", "console"):
            continue
        for row in text.replace("\\\n", " ").splitlines():
            if language == "console" and not row.startswith("$ "):
                continue
            for part in row.removeprefix("$ ").split(" && "):
                words = shlex.split(part, comments=True)
                if words:
                    found.append((shlex.join(words), language == "console"))
    return found


ALL = {name: found for name, page in PAGES.items() if (found := list_commands(page))}


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A folder like a checkout, with an environment; the working directory."""
    for part in ("demos", "docs/arm", "docs/nodes"):
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"))
    peer = Path("tests/support/franka_peer.py")
    (tmp_path / peer).parent.mkdir(parents=True)
    shutil.copy(ROOT / peer, tmp_path / peer)
    (tmp_path / ".venv").symlink_to(START)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{START / 'bin'}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def test_commands_are_found_and_those_of_the_lists_stand_on_their_pages():
    assert sum(map(len, ALL.values())) > 60
    for listed in (RUN, LIVE):
        for name, commands in listed.items():
            assert set(commands) <= {command for command, _ in ALL[name]}, name
    every = [command for commands in ALL.values() for command, _ in commands]
    for beginning in NOT_RUN:
        assert any(command.startswith(beginning) for command in every), beginning
    consoles = {name for name, found in ALL.items() if any(is_console for _, is_console in found)}
    assert consoles == {"start"}, "of which test_readme.py runs them"
    for name, page in PAGES.items():
        assert not re.search(r"^ *```(bash|shell|zsh)", page, re.MULTILINE), f"{name}: `sh`, please"


@pytest.mark.parametrize("name", ALL)
def test_every_command_parses_and_its_files_are_there(name, checkout, capsys):
    there = set(BROUGHT.get(name, ()))
    for command, _ in ALL[name]:
        words = shlex.split(command)
        program = Path(words[0]).name
        if program == "python" and words[1] != "-m":
            assert (checkout / words[1]).is_file(), command
        elif program != "armguard":
            assert any(command.startswith(beginning) for beginning in NOT_RUN), command
        else:
            parsed = _parse(words[1:])
            assert isinstance(parsed, COMMANDS[words[1]]), command
            for option, word in itertools.pairwise(words):
                if option in OUTPUTS:
                    there.add(word)
                elif READ.fullmatch(word):
                    assert word in there or (checkout / word).exists(), f"{command}: {word}"


@pytest.mark.parametrize("name", RUN)
def test_what_is_quick_runs_to_its_end(name, checkout, capsys):
    if name == "recording":
        commissioned_runs.record(checkout / "demo.mcap")
    if name == "covers":
        assert main(["cover", "panda", "--export", "spheres.yml"]) == 0
    for command in RUN[name]:
        assert main(shlex.split(command)[1:]) == 0, f"{command}: {capsys.readouterr().err}"


@pytest.mark.skipif("ARMGUARD_START" not in os.environ, reason=".ci/run makes that environment")
def test_start_works_in_the_environment_that_it_makes(checkout):
    assert not (START / "bin" / "pytest").exists(), "that of the tests is another one"
    chosen = ["source .venv/bin/activate"]
    chosen += [one for one, _ in ALL["start"] if one.startswith("armguard cover ")]
    # Its extras are for pages that it leads to.
    commissioned_runs.record(checkout / "run.mcap")
    chosen += ["armguard replay run.mcap", "armguard commission run.mcap --out commissioned"]
    done = subprocess.run(
        ["bash", "-ec", "\n".join(chosen)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        timeout=PATIENCE,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert (checkout / "commissioned" / "cell-lines.toml").exists()


@contextlib.contextmanager
def started(command):
    """A command of a shell that goes on; ended by Ctrl-C, which it takes as its users expect."""
    with subprocess.Popen(
        ["bash", "-c", f"exec {command}"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as process:
        try:
            yield process
            assert process.poll() is None, process.stdout.read().decode()
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
            try:
                process.communicate(timeout=PATIENCE)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)


def read_until(process, sign):
    """Read what a process says until there is a sign in it."""
    told = []
    for line in process.stdout:
        told.append(line.decode())
        if sign in told[-1]:
            return
    raise AssertionError("".join(told))


@pytest.fixture
def usual_ports():
    """The ports that pages name, for one test of this machine at a time."""
    with (Path(tempfile.gettempdir()) / "armguard-usual-ports.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for port in range(5701, 5705):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    pytest.skip(f"port {port} is in use on this machine")
        yield


@pytest.mark.parametrize("name", LIVE)
@pytest.mark.usefixtures("usual_ports")
def test_what_a_page_starts_together_works_together(name, checkout):
    run, *others, reset = LIVE[name]
    with contextlib.ExitStack() as processes:
        monitor = processes.enter_context(started(run))
        read_until(monitor, "verdicts at tcp://127.0.0.1:5703")
        for command in others:
            process = processes.enter_context(started(command))
            if command.startswith("armguard view"):
                read_until(process, "see it in the browser: http://127.0.0.1:")
        with VerdictReader("tcp://127.0.0.1:5703") as reader:
            end = time.monotonic() + PATIENCE
            while not ((verdict := reader.latest(0.1)) and verdict.obstacle):
                assert time.monotonic() < end, verdict
        done = subprocess.run(["bash", "-c", reset], capture_output=True, check=False, timeout=60.0)
        assert (done.returncode, done.stderr) == (0, b"")
        assert done.stdout == b"tcp://127.0.0.1:5702: reset\n"
        wrong = reset.replace("--token TOKEN", "--token GUESS")
        assert (
            subprocess.run(["bash", "-c", wrong], capture_output=True, check=False).returncode == 1
        )
    assert monitor.returncode == 0
