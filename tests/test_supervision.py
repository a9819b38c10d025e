"""`armguard run` and `armguard view` as their users meet them: processes, addresses, mistakes."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from armguard.cli import main
from armguard.streams import VerdictReader

ARMGUARD = Path(sys.executable).with_name("armguard")
CELL = '[robot]\nname = "panda"\n'
NAMES = [f"panda_joint{number}" for number in range(1, 8)]
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
PATIENCE = 60.0


@pytest.fixture
def cell(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(CELL)
    return path


@pytest.fixture
def addresses(tmp_path):
    """Options that keep a run off the default ports."""
    names = ("obstacles", "joints", "verdicts")
    return [word for name in names for word in (f"--{name}", f"ipc://{tmp_path}/{name}")]


def check_mistake(capsys, arguments, words):
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert words in err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[robot", "cell.toml"),
        ("", "robot"),
        ('[robot]\nname = "nobody"\n', "nobody"),
        ('[robot]\nname = "panda"\n[bounds]\nspeed = "fast"\n', "speed"),
        ('[robot]\nname = "panda"\n[surprise]\nx = 1\n', "surprise"),
        ('[robot]\nname = "panda"\n[monitor]\nrate = -1.0\n', "rate"),
    ],
)
def test_a_wrong_cell_is_a_mistake(cell, addresses, text, words, capsys):
    cell.write_text(text)
    check_mistake(capsys, ["run", str(cell), "--duration", "0.1", *addresses], words)


def test_a_missing_cell_is_a_mistake(capsys):
    check_mistake(capsys, ["run", "/nowhere/cell.toml"], "/nowhere/cell.toml")


@pytest.mark.parametrize("option", ["--obstacles", "--joints", "--verdicts", "--view"])
@pytest.mark.parametrize(
    "address", ["tcp://0.0.0.0:5701", "tcp://192.168.0.1:5701", "tcp://localhost:5701", "rubbish"]
)
def test_an_address_beyond_this_machine_is_a_mistake(cell, addresses, option, address, capsys):
    check_mistake(capsys, ["run", str(cell), *addresses, option, address], address)


@pytest.mark.parametrize("option", ["--obstacles", "--joints", "--verdicts", "--view"])
def test_an_address_in_use_is_a_mistake(cell, addresses, option, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        check_mistake(capsys, ["run", str(cell), *addresses, option, address], "in use")


@pytest.mark.parametrize("address", ["rubbish", "tcp://10.0.0.1:5704"])
def test_a_view_of_no_usable_address_is_a_mistake(address, capsys):
    check_mistake(capsys, ["view", address], address)


def test_a_view_port_in_use_is_a_mistake(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        check_mistake(capsys, ["view", "tcp://127.0.0.1:1", "--port", port], port)


def start(*arguments, **options):
    return subprocess.Popen(
        [ARMGUARD, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def test_a_view_waits_for_a_monitor_until_control_c():
    with start("view", "tcp://127.0.0.1:1", start_new_session=True) as view:
        assert "http://127.0.0.1:" in view.stdout.readline()
        os.killpg(view.pid, signal.SIGINT)
        assert view.wait(PATIENCE) == 0
        assert view.stderr.read() == ""


def test_lines_on_standard_input_are_judged(cell, tmp_path):
    state = {"type": "joints", "names": NAMES, "q": READY, "v": [0.0] * 7}
    verdicts = f"ipc://{tmp_path}/verdicts"
    arguments = ("run", str(cell), "--obstacles", "-", "--verdicts", verdicts, "--json")
    with start(*arguments, stdin=subprocess.PIPE) as run, VerdictReader(verdicts) as reader:
        deadline = time.monotonic() + PATIENCE
        while (verdict := reader.latest()) is None or verdict.sequence == 0:
            assert time.monotonic() < deadline
            line = json.dumps(state | {"stamp": time.monotonic()})
            run.stdin.write(line + "\nnonsense\n")
            run.stdin.flush()
            time.sleep(0.01)
        out, err = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0
    summary = json.loads(out)
    assert summary["ticks"] > 0
    assert summary["faults"] > 0
    assert set(summary["realtime"]) == {"priority", "memory_locked"}
    assert "malformed" in err


def test_nothing_is_asked_of_the_system_where_it_is_not_wanted(cell, addresses, capsys):
    options = ["--duration", "0.05", "--json", "--no-realtime"]
    assert main(["run", str(cell), *addresses, *options]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["realtime"] is None
    assert err == ""


def test_it_ends_with_the_parent_it_was_told_of(cell, addresses, tmp_path):
    script = """
import os, subprocess, sys
run = subprocess.Popen([*sys.argv[1:], "--parent", str(os.getpid())])
print(run.pid, flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", script, ARMGUARD, "run", str(cell), *addresses]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as parent:
        pid = int(parent.stdout.readline())
        deadline = time.monotonic() + PATIENCE
        while not (tmp_path / "verdicts").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        parent.kill()
        while is_alive(pid):
            assert time.monotonic() < deadline
            time.sleep(0.05)
    assert not (tmp_path / "verdicts").exists()


def is_alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
