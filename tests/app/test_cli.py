"""The command line: help that shows how, mistakes in one line, a demo that ends as it should."""

import contextlib
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest

from armguard.app.cli import main

ARMGUARD = Path(sys.executable).with_name("armguard")


def list_commands(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    return re.findall(r"^  ([\w-]+) +[A-Z]", capsys.readouterr().out, re.MULTILINE)


def test_the_version_is_one_line_with_what_verdicts_depend_on(capsys):
    assert main(["--version"]) == 0
    out, err = capsys.readouterr()
    version = r"\d+\.\d+[\w.]*"
    assert re.fullmatch(
        rf"armguard {version} \(pin {version}, numba {version}, Python {version}\)\n", out
    )
    assert err == ""
    assert (
        "--version"
        in subprocess.run(
            [ARMGUARD, "--help"], capture_output=True, text=True, timeout=60, check=True
        ).stdout
    )


@pytest.mark.parametrize("arguments", [["--help"], ["keys", "--help"], ["run", "--help"]])
def test_help_that_nobody_reads_to_its_end_is_no_mistake(arguments):
    """As `armguard --help | head -1`, of which the reader has gone before all is written."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        told = subprocess.run(
            [ARMGUARD, *arguments], stdout=writing, stderr=subprocess.PIPE, timeout=60
        )
    finally:
        os.close(writing)
    assert (told.returncode, told.stderr) == (0, b"")


@pytest.mark.parametrize("delay", [0.1, 0.35, 0.8])
@pytest.mark.parametrize(
    "arguments",
    [["demo", "--no-view"], ["run", "demos/cell.toml"], ["--help"]],
    ids=lambda value: value[0],
)
def test_an_interrupt_while_a_command_starts_is_one_line(arguments, delay):
    with subprocess.Popen(
        [ARMGUARD, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
        start_new_session=True,
    ) as command:
        time.sleep(delay)
        command.send_signal(signal.SIGINT)
        _, err = command.communicate(timeout=60)
    if "KeyboardInterrupt" in err and str(ARMGUARD) not in err:
        pytest.skip("a busy machine: Python itself was still starting")
    assert "Traceback" not in err
    # 0 and 2: it had ended before. The signal: its interpreter was at its end, without handlers.
    assert command.returncode in (0, 2, 130, -signal.SIGINT), err
    if command.returncode == 130:
        assert re.search(r"^armguard: interrupted.*\n\Z", err, re.MULTILINE)


def test_a_command_in_the_background_of_a_shell_goes_on_ignoring_interrupts():
    """Which a shell without job control asks for, for all that it starts with `&`."""
    script = f'"{ARMGUARD}" --help & sleep 0.2; kill -INT $!; wait $!'
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert "usage: armguard" in done.stdout


def test_help_of_each_command_has_an_example(capsys):
    commands = list_commands(capsys)
    assert {"demo", "robots"} <= set(commands)
    for command in commands:
        with pytest.raises(SystemExit) as end:
            main([command, "--help"])
        assert end.value.code == 0
        out = capsys.readouterr().out
        assert f"Example: armguard {command}" in " ".join(out.split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "a command is missing"),
        (["dmeo"], "did you mean demo?"),
        (["nothing-like-it"], "armguard --help"),
        (["demo", "--sped", "3"], "Unrecognized options: --sped, 3: did you mean --seed?"),
        (["demo", "--durations=3", "--recrod", "x"], "did you mean --duration and --record?"),
        (["cover", "panda", "--imprt", "spheres.yml"], "did you mean --import?"),
        (["run", "cell.toml", "--cel", "x"], "Unrecognized options: --cel, x\n"),
        (["demo", "--duration", "long"], "--duration"),
        (["demo", "--duration", "nan"], "--duration"),
        (["demo", "--obstacles", "-1"], "--obstacles"),
        (["demo", "--seed", "-1"], "--seed"),
        (["demo", "--schedule", "psychic"], "psychic"),
        (["demo", "--person", "/nowhere/person.csv"], "/nowhere/person.csv"),
        (["demo", "--robot", "nobody"], "robot 'nobody': is not known"),
        (["robot", "new", "arm.urdf"], "--out"),
        (["robot", "old", "arm.urdf", "--out", "x"], "old"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_mistake_is_one_line_and_exit_code_2(arguments, words, capsys):
    assert run_main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert words in err


@pytest.mark.parametrize("encoding", ["utf-8", "UTF-8", "ascii"])
def test_a_mistake_is_one_line_whatever_the_terminal_can_show(encoding):
    result = run_armguard("demo", "--schedule", "psychic", PYTHONIOENCODING=encoding)
    assert result.returncode == 2
    assert result.stdout == ""
    assert re.fullmatch(r"armguard: [^\n]*psychic[^\n]+\n", result.stderr)


def run_main(arguments):
    """The exit code, whichever way the call ends."""
    try:
        return main(arguments)
    except SystemExit as end:
        return end.code


@pytest.mark.parametrize(
    ("send", "options"),
    [(os.kill, ["--no-view"]), (os.killpg, [])],
    ids=["process", "group"],
)
def test_an_interrupt_ends_the_demo_with_its_summary(send, options):
    """As Ctrl-C in a terminal (the whole group), and as `kill -INT` (the one process)."""
    terminal, theirs = pty.openpty()
    mark = f"ARMGUARD_TEST_MARK={uuid.uuid4()}"
    demo = subprocess.Popen(
        [ARMGUARD, "demo", "--duration", "60", *options],
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "100"} | dict([mark.split("=")]),
        start_new_session=True,
    )
    os.close(theirs)
    try:
        assert "is watched" in read_terminal(terminal, until="is watched")
        assert len(find_processes(mark)) > 1
        send(demo.pid, signal.SIGINT)
        shown = read_terminal(terminal)
        assert demo.wait(timeout=20) == 0
    finally:
        demo.kill()
        demo.wait()
        os.close(terminal)
    assert "summary" in shown
    assert "Traceback" not in shown
    assert not find_processes(mark), "nobody stays behind"


def test_a_misspelt_variable_is_one_line():
    done = subprocess.run(
        [sys.executable, "-m", "armguard_command", "robots"],
        env=os.environ | {"ARMGUARD_JIT": "Plain"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert re.fullmatch(r"armguard: ARMGUARD_JIT: is 'Plain'[^\n]+\n", done.stderr)


def find_processes(mark):
    """Numbers of the processes that have `mark` in the environment they were started with."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):  # ended meanwhile, or somebody else's
            if mark.encode() in path.read_bytes():
                found.append(int(path.parent.name))
    return found


def read_terminal(terminal, until=None, patience=40.0):
    """What comes from a terminal: up to some words, or until nobody is left to write to it."""
    shown = ""
    deadline = time.monotonic() + patience
    while until is None or until not in shown:
        ready, _, _ = select.select([terminal], [], [], max(0.0, deadline - time.monotonic()))
        if not ready:
            break
        try:
            chunk = os.read(terminal, 65536)
        except OSError:  # Linux: the last writer has closed its end
            break
        if not chunk:
            break
        shown += chunk.decode(errors="replace")
    return shown


def run_armguard(*arguments, **environment):
    return subprocess.run(
        [ARMGUARD, *arguments],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        env=os.environ | environment,
        timeout=300,  # a cold start compiles
        check=False,
    )
