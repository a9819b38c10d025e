"""A run that starts the driver of its robot, with a simulated controller and the real client."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip("rtde_receive", reason="the extra `ur` is not installed")

from armguard.app import driver_process
from armguard.app.cli import main
from armguard.app.driver_process import DriverProcess
from armguard.lab.simulation.ur_controller import UrController
from support.driven_cell import CELL, find_host
from support.waiting import wait_until

SLOW = "rate = 125.0\n[monitor]\nrate = 50.0\n[thresholds]\nlatency = 0.2\nreaction_time = 0.1\n"


def find_drivers(pid):
    """Processes of `armguard drive` that a process has started."""
    shown = subprocess.run(
        ["ps", "--no-headers", "-o", "pid,args", "--ppid", str(pid)], capture_output=True, text=True
    )
    return [int(line.split()[0]) for line in shown.stdout.splitlines() if " drive " in line]


@contextlib.contextmanager
def ended(process):
    """In the end the process has ended, whatever has failed before."""
    try:
        yield
    finally:
        process.kill()


def test_a_run_starts_its_driver_starts_it_again_and_ends_it(tmp_path):
    host = find_host()
    cell = tmp_path / "cell.toml"
    cell.write_text(CELL.format(host=host, timeout=0.5, more=SLOW))
    words = ["run", str(cell), "--drive", "--no-realtime", "--json"]
    for name in ("obstacles", "joints", "verdicts"):
        words += [f"--{name}", f"ipc://{tmp_path}/{name}"]
    words += ["--parent", str(os.getpid())]
    with (
        UrController(host) as controller,
        subprocess.Popen(
            [sys.executable, "-m", "armguard", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process,
        ended(process),
    ):
        lines = []
        reader = threading.Thread(target=lambda: lines.extend(process.stderr), daemon=True)
        reader.start()
        wait_until(lambda: any(" states; age " in one for one in lines))
        wait_until(lambda: controller.slider > 0.5)
        (driver,) = find_drivers(process.pid)
        subprocess.run(["kill", "-KILL", str(driver)], check=True)
        wait_until(lambda: any("by SIGKILL, and is restarted" in one for one in lines))
        wait_until(lambda: find_drivers(process.pid) not in ([], [driver]))
        wait_until(lambda: controller.clients == 1)
        (driver,) = find_drivers(process.pid)
        process.send_signal(signal.SIGINT)
        output = process.stdout.read()
        assert process.wait() == 0, lines
        reader.join()
    assert '"ticks"' in output
    with pytest.raises(FileNotFoundError):
        open(f"/proc/{driver}/status").close()


@pytest.mark.hazard("H-24")
@pytest.mark.parametrize("is_attended", [False, True])
def test_only_the_first_driver_of_a_person_is_a_persons_start(tmp_path, monkeypatch, is_attended):
    started, lines = tmp_path / "started", []
    process = tmp_path / "process"
    process.write_text(f'#!/bin/sh\necho "$@" >> {started}\nexit 1\n')
    process.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(process))
    monkeypatch.setattr(driver_process, "RESTART_DELAY", 0.0)
    driver = DriverProcess(Path("cell.toml"), "", lines.append, 1.0, is_attended=is_attended)
    with driver:
        driver.start(dict.fromkeys(("joints", "obstacles", "verdicts"), "-"))
        wait_until(lambda: len(lines) > 2)
    firsts = ["--again" not in line for line in started.read_text().splitlines()]
    assert firsts[:3] == [is_attended, False, False]


@pytest.mark.hazard("H-20")
def test_a_driver_has_as_long_to_end_as_its_arm_may_move(tmp_path, monkeypatch):
    lines, process = [], tmp_path / "process"
    end = "trap 'sleep 1; exit' INT"
    process.write_text(f"#!/bin/sh\n{end}\n: > {tmp_path}/begun\nwhile :; do sleep 0.01; done\n")
    process.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(process))
    monkeypatch.setattr(driver_process, "END_TIMEOUT", 0.0)
    with DriverProcess(Path("cell.toml"), "", lines.append, 60.0) as driver:
        driver.start(dict.fromkeys(("joints", "obstacles", "verdicts"), "-"))
        wait_until((tmp_path / "begun").exists)
    assert lines == []


def test_a_run_without_a_driver_has_nothing_to_attend(tmp_path, capsys):
    cell = tmp_path / "cell.toml"
    cell.write_text('sources = {}\n[robot]\nname = "ur5e"\n')
    assert main(["run", str(cell), "--attended"]) == 2
    assert "--attended" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", "robot.driver: is missing"),
        ('[robot.driver]\nname = "ur"\nhost = "127.0.0.1"\nmodel = "UR5e"\n', "joint states"),
    ],
)
def test_what_cannot_be_driven_is_one_line(tmp_path, capsys, more, said):
    cell = tmp_path / "cell.toml"
    cell.write_text(f'sources = {{}}\n[robot]\nname = "ur5e"\n{more}')
    assert main(["run", str(cell), "--drive", "--joints", "-"]) == 2
    assert said in capsys.readouterr().err
