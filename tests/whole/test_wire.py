"""The page about the wire says what the schemas say, and the nodes beside it work as they are."""

import contextlib
import json
import re
import runpy
import shutil
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from armguard.messages.answers import (
    PlanVerdictMessage,
    ResetVerdictMessage,
    VerdictMessage,
)
from armguard.messages.command import CommandMessage
from armguard.messages.incoming import AnyMessage, GoalPath, decode
from armguard.messages.reasons import ReasonMessage
from armguard.streams import VerdictReader
from armguard.streams.addresses import JOINTS_ADDRESS, OBSTACLES_ADDRESS, VERDICTS_ADDRESS
from armguard.verdict import Level

DOCS = Path(__file__).parents[2] / "docs"
NODES = DOCS / "nodes"
PAGE = (DOCS / "wire.md").read_text(encoding="utf-8")
ARMGUARD = Path(sys.executable).with_name("armguard")
PATIENCE = 300.0  # a cold start compiles

INPUTS = (*AnyMessage.__args__, GoalPath)
ANSWERS = (
    VerdictMessage,
    CommandMessage,
    PlanVerdictMessage,
    ResetVerdictMessage,
    ReasonMessage,
)


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(DOCS / "make_wire.py"))


def test_the_page_is_what_its_script_writes(script):
    assert script["write_page"]() == PAGE


@pytest.mark.parametrize("message", [*INPUTS, *ANSWERS], ids=lambda message: message.__name__)
def test_each_field_is_told_and_each_measure_has_its_unit(message, script):
    fields = script["read_fields"](message)
    assert [name for name, *_ in fields] == list(message.__struct_fields__)
    for name, kind, _, text in fields:
        assert re.search(rf"^- .*`{name}`", PAGE, re.MULTILINE)
        assert text
        shares = ("speed_scale", "scale", "progress", "witnesses")
        is_measure = "number" in kind and name not in shares
        assert re.search(r"\[(s|m|m/s|m/s²|rad)\]", text) or not is_measure, name


@pytest.mark.parametrize("message", INPUTS, ids=lambda message: message.__name__)
def test_the_fields_that_are_told_to_be_needed_are_needed(message, script):
    needed = [name for name, _, default, _ in script["read_fields"](message) if not default]
    fields = msgspec.structs.fields(message)
    assert needed == [field.name for field in fields if field.required]


def test_addresses_are_the_usual_ones():
    for address in (OBSTACLES_ADDRESS, JOINTS_ADDRESS, VERDICTS_ADDRESS):
        assert f"`{address}`" in PAGE


def test_the_messages_that_are_shown_are_taken():
    blocks = re.findall(r"```json\n(.*?)```", PAGE, flags=re.DOTALL)
    shown = re.sub(r"\n +", " ", "".join(blocks)).splitlines()
    *others, path, jog = (decode(line.encode()) for line in shown)
    state, heartbeat, cloud, ignore, watch = others
    assert [len(message.ids) for message in (state, heartbeat)] == [1, 0]
    assert len(cloud.points) == 2
    assert len(ignore.zone) == 8
    assert watch.number == ignore.number
    assert len(path.paths[0].q) == 3
    assert len(jog.velocity) == 2


def compile_node(name, folder, *libraries):
    """A node in C++ as a program; skips where something that it needs is not there."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler: apt-get install g++")
    program = folder / name
    arguments = ["-std=c++17", "-Wall", "-Wextra", "-Werror", str(NODES / f"{name}.cpp")]
    command = [compiler, *arguments, *libraries, "-o", str(program)]
    built = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if "zmq.hpp: No such file" in built.stderr or "'zmq.hpp' file not found" in built.stderr:
        pytest.skip("no zmq.hpp: apt-get install cppzmq-dev")
    assert built.returncode == 0, built.stderr
    return program


@contextlib.contextmanager
def running(*commands):
    """Processes that are ended at the end."""
    with contextlib.ExitStack() as resources:
        for command in commands:
            process = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL)
            resources.callback(process.wait, 60)
            resources.callback(process.kill)
        yield


@pytest.mark.parametrize("language", ["python", "c++"])
def test_nodes_without_armguard_make_a_cell(language, tmp_path):
    perception = [sys.executable, NODES / "perception.py"]
    if language == "c++":
        perception = [compile_node("perception", tmp_path, "-lzmq")]
    cell = tmp_path / "cell.toml"
    cell.write_text(
        '[robot]\nname = "panda"\noperating = "published"\n[sources.eye]\nrequired = true\n'
        "[thresholds]\njoint_timeout = 60.0\nsource_timeout = 60.0\n"
    )
    names = ("obstacles", "joints", "verdicts")
    obstacles, joints, verdicts = (f"ipc://{tmp_path}/{name}" for name in names)
    options = [word for name in names for word in (f"--{name}", f"ipc://{tmp_path}/{name}")]
    run = subprocess.Popen(
        [ARMGUARD, "run", cell, *options, "--json-verdicts", "--json", "--no-realtime", "--quiet"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    nodes = (
        [*perception, obstacles, "eye"],
        [sys.executable, NODES / "controller.py", joints, verdicts],
    )
    try:
        with running(*nodes), VerdictReader(verdicts) as reader:
            told, until = None, time.monotonic() + PATIENCE
            while time.monotonic() < until and run.poll() is None:
                told = reader.latest(0.1)
                if told and told.level > Level.STOP and told.obstacle == "ball":
                    break
        run.terminate()
        out, err = run.communicate(timeout=60)
    finally:
        run.kill()
    assert told is not None, err
    assert told.level > Level.STOP, told
    assert told.obstacle == "ball"
    assert told.complete
    assert reader.refused == 0
    summary = json.loads(out)
    wrong = {"malformed", "refused", "not finite", "lost", "sequence went back"}
    assert not wrong & {kind.partition(":")[0] for kind in summary["message_faults"]}, summary


def test_lines_of_a_program_are_supervised(tmp_path):
    lines = compile_node("lines", tmp_path)
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nname = "panda"\n[thresholds]\njoint_timeout = 600.0\n')
    verdicts = ["--verdicts", f"ipc://{tmp_path}/verdicts"]
    with subprocess.Popen([lines, "1.0"], stdout=subprocess.PIPE) as source:
        run = subprocess.run(
            [ARMGUARD, "run", cell, "--obstacles", "-", *verdicts, "--json", "--no-realtime"],
            stdin=source.stdout,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    assert run.returncode == 0, run.stderr
    summary = json.loads(run.stdout)
    assert summary["received"] == 600
    assert not summary["message_faults"], summary
