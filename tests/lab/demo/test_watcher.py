import json
import os
import re
import signal
import subprocess
import sys

import pytest
import zmq
from rich.console import Console

from armguard.lab.demo.watcher import Watcher
from armguard.streams import VerdictReader
from armguard.verdict import Level
from support.demo_processes import RunningDemo, finish, listening_sockets, wait_until


def test_without_its_perception_it_ends_and_says_so(start):
    demo = start("--duration", "60", "--no-view", "--json")
    os.kill(demo.pid_of("perception"), signal.SIGKILL)
    out, err = finish(demo)
    assert demo.process.returncode == 1
    assert json.loads(out)["ticks"] > 0
    assert re.search(r"^armguard: the demo's perception process ended by SIGKILL", err, re.M)
    assert err.count("armguard:") == 1


def test_without_its_view_it_goes_on_and_a_robot_that_hangs_is_a_stop(start, tmp_path):
    """And before, it listens on the loopback interface only; after, it ends when asked."""
    demo = start("--duration", "60", "--json")
    sockets = listening_sockets(demo.pids())
    assert len(demo.pids()) == 5
    assert len(sockets) == 1  # the page
    assert sockets[0].startswith("0100007F:")
    os.kill(demo.pid_of("view"), signal.SIGKILL)
    with VerdictReader(demo.verdicts) as reader:
        before = reader.latest(timeout=10.0).sequence
        assert wait_until(lambda: reader.latest().sequence > before + 1000)
        os.kill(demo.pid_of("robot"), signal.SIGSTOP)
        assert wait_until(lambda: reader.latest(timeout=1.0).level is Level.STOP)
    demo.process.terminate()
    out, err = finish(demo)
    assert demo.process.returncode == 0
    assert json.loads(out)["ticks"] > 0
    assert "the browser page has ended" in err
    assert "armguard:" not in err
    assert not list(tmp_path.iterdir())


def test_an_interrupt_before_the_first_tick_is_one_line(tmp_path):
    # It would last far longer than its end is waited for.
    with RunningDemo("--duration", "3600", "--no-view", folder=tmp_path) as demo:
        assert wait_until(lambda: list(tmp_path.glob("armguard-*/log")))
        demo.process.send_signal(signal.SIGINT)
        _, err = finish(demo)
    # Either nothing had been seen yet, or, on a quick machine, a few ticks.
    assert (demo.process.returncode, "interrupted" in err) in [(130, True), (0, False)]


MONITOR = """
import signal, sys
asked = 0
def end(*_):
    global asked
    asked += 1
    if asked == {needed}:
        print('{{"ticks": 7}}', flush=True)
        sys.exit(0)
signal.signal(signal.SIGTERM, end)
print("ready", file=sys.stderr, flush=True)
while True:
    signal.pause()
"""


@pytest.mark.parametrize("needed", [1, 2])
def test_an_interrupt_while_the_page_opens_ends_in_a_summary(tmp_path, monkeypatch, needed):
    # An interpreter loses an interrupt that meets it in a destructor: it is asked a second time.
    monkeypatch.setattr("armguard.lab.demo.watcher.END_TIMEOUT", 1.0 if needed > 1 else 20.0)

    def open_page():
        assert monitor.stderr.readline() == b"ready\n"
        raise KeyboardInterrupt

    log = tmp_path / "log"
    log.touch()
    command = [sys.executable, "-c", MONITOR.format(needed=needed)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as monitor:
        watcher = Watcher(monitor, {}, log, Console(quiet=True))
        assert watcher.run(f"ipc://{tmp_path}/frames", open_page) == ({"ticks": 7}, "")


def test_an_interrupt_while_a_socket_is_made_ends_in_a_summary(tmp_path, monkeypatch):
    """What interrupts ZeroMQ there leaves a socket open, and then its context never ends."""
    make = zmq.Context.socket

    def make_interrupted(context, kind):
        assert monitor.stderr.readline() == b"ready\n"
        made = make(context, kind)
        signal.raise_signal(signal.SIGINT)
        return made

    monkeypatch.setattr(zmq.Context, "socket", make_interrupted)
    log = tmp_path / "log"
    log.touch()
    command = [sys.executable, "-c", MONITOR.format(needed=1)]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as monitor:
            watcher = Watcher(monitor, {}, log, Console(quiet=True))
            assert watcher.run(f"ipc://{tmp_path}/frames") == ({"ticks": 7}, "")
    finally:
        signal.signal(signal.SIGINT, before)
