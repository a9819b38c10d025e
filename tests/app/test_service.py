"""What systemd would hear, on a real socket in its place."""

import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

from armguard.app.service import ServiceNotifier

PATIENCE = 20.0


@pytest.fixture(params=["path", "abstract"])
def kind(request):
    """Of the two kinds of addresses that systemd uses."""
    return request.param


@pytest.fixture
def manager(kind, tmp_path):
    """A socket as systemd has one, and the address that it would tell."""
    name = f"@armguard-{os.getpid()}" if kind == "abstract" else f"{tmp_path}/notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + name[1:] if name.startswith("@") else name)
        listener.settimeout(PATIENCE)
        yield listener, name


def hear(listener):
    return listener.recv(4096).decode()


def hear_all(listener):
    """What waits, without waiting for more."""
    listener.settimeout(0.0)
    words = []
    try:
        while True:
            words.append(hear(listener))
    except BlockingIOError:
        return words


def make(name, count_ticks, timeout=0.1):
    usec = {} if timeout is None else {"WATCHDOG_USEC": str(round(1e6 * timeout))}
    return ServiceNotifier.from_environment(count_ticks, {"NOTIFY_SOCKET": name, **usec})


@pytest.mark.hazard("H-07")
def test_a_loop_that_hangs_feeds_nothing(manager):
    listener, name = manager
    ticks = [7]
    with make(name, lambda: ticks[0]):
        assert [hear(listener) for _ in range(2)] == ["READY=1", "WATCHDOG=1"]
        time.sleep(0.3)  # six times the interval, without a tick
        assert hear_all(listener) == []
        listener.settimeout(PATIENCE)
        ticks[0] += 1
        assert hear(listener) == "WATCHDOG=1"


def test_without_a_tick_it_never_says_that_it_is_ready(manager):
    listener, name = manager
    with make(name, lambda: 0):
        time.sleep(0.2)
    assert hear_all(listener) == ["STOPPING=1"]


@pytest.mark.parametrize(
    ("variables", "interval"),
    [
        ({}, math.inf),
        ({"WATCHDOG_USEC": "2000000"}, 1.0),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}, 1.0),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}, math.inf),
        ({"WATCHDOG_USEC": "0"}, math.inf),
        ({"WATCHDOG_USEC": "soon"}, math.inf),
    ],
)
def test_the_watchdog_is_fed_at_half_of_its_time_where_it_is_meant_for_this_process(
    variables, interval
):
    with ServiceNotifier.from_environment(lambda: 0, variables) as notifier:
        assert notifier._interval == interval


@pytest.mark.parametrize("name", ["", "/nowhere/notify", "@armguard-nobody", "x" * 500, "a\0b"])
def test_a_socket_that_is_not_there_changes_nothing(name):
    ticks = iter(range(1, 10**9))
    with make(name, lambda: next(ticks)):
        time.sleep(0.1)


def test_a_socket_that_nobody_reads_never_makes_it_wait(manager):
    _, name = manager
    ticks = iter(range(1, 10**9))
    with make(name, lambda: next(ticks), timeout=1e-3):
        time.sleep(0.5)  # far more words than a socket holds
        begin = time.monotonic()
    assert time.monotonic() - begin < PATIENCE
    assert threading.active_count() < 50


@pytest.mark.parametrize("kind", ["abstract"])  # a run knows nothing of the kind
def test_a_run_tells_systemd_of_itself(manager, tmp_path):
    listener, name = manager
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nname = "panda"\noperating = "published"\n')
    addresses = [
        word
        for part in ("obstacles", "joints", "verdicts")
        for word in (f"--{part}", f"ipc://{tmp_path}/{part}")
    ]
    listener.settimeout(300.0)  # a cold start compiles
    run = subprocess.Popen(
        [sys.executable, "-m", "armguard", "run", str(cell), "--quiet", "--json", *addresses],
        env=os.environ | {"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "400000"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert hear(listener) == "READY=1"
        listener.settimeout(PATIENCE)
        assert [hear(listener) for _ in range(3)] == ["WATCHDOG=1"] * 3
        run.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        hear_all(listener)
        time.sleep(1.0)
        assert hear_all(listener) == [], "a stopped process feeds no watchdog"
        run.send_signal(signal.SIGCONT)
        listener.settimeout(PATIENCE)
        assert hear(listener) == "WATCHDOG=1"
        run.send_signal(signal.SIGTERM)
        assert run.wait(PATIENCE) == 0
        assert hear_all(listener)[-1] == "STOPPING=1"
    finally:
        run.kill()
        run.wait()
