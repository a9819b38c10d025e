import base64
import gzip
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from armguard.view import FramePublisher, launch
from armguard.view.messages import StatusMessage
from support.view_samples import make_frame, make_scene

TIMEOUT = 10.0


def wait_until(condition):
    deadline = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.02)


def port_of(url):
    return int(url.rstrip("/").rsplit(":", 1)[1])


def is_open(port):
    with socket.socket() as connection:
        return connection.connect_ex(("127.0.0.1", port)) == 0


def is_alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def listening_addresses(pid):
    """Local addresses, in the kernel's hexadecimal, on which a process accepts connections."""
    inodes = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        try:
            target = os.readlink(descriptor)
        except FileNotFoundError:
            continue  # it was closed meanwhile
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    addresses = set()
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes and (table.startswith("udp") or fields[3] == "0A"):
                addresses.add(fields[1].split(":")[0])
    return addresses


@pytest.fixture(scope="module")
def view():
    with launch("tcp://127.0.0.1:1") as process:
        yield process


def test_it_listens_on_the_loopback_interface_only(view):
    assert view.url.startswith("http://127.0.0.1:")
    assert listening_addresses(view.pid) == {"0100007F"}


def test_a_mistake_of_who_starts_it_alone_is_one_line():
    command = [sys.executable, "-m", "armguard.view", '{"address": "nonsense"}']
    process = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert process.returncode == 2
    assert "nonsense" in process.stderr
    assert len(process.stderr.splitlines()) == 1


def test_closing_leaves_no_process_and_no_port():
    process = launch("tcp://127.0.0.1:1")
    assert process.running
    assert is_open(port_of(process.url))
    process.close()
    assert not process.running
    assert not is_alive(process.pid)
    assert not is_open(port_of(process.url))
    process.close()


def test_it_ends_when_its_parent_is_killed():
    script = """
import time
from armguard.view import launch
view = launch("tcp://127.0.0.1:1")
print(view.pid, view.url, flush=True)
time.sleep(60)
"""
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True
    ) as parent:
        pid, url = parent.stdout.readline().split()
        assert is_alive(pid)
        parent.kill()
        parent.wait()
    wait_until(lambda: not is_alive(pid))
    assert not is_open(port_of(url))


def test_a_stopped_view_can_be_closed():
    process = launch("tcp://127.0.0.1:1")
    os.kill(process.pid, signal.SIGSTOP)
    process.close()
    assert not is_alive(process.pid)


def test_an_export_has_what_was_sent_before_its_end_though_the_view_was_slow(tmp_path):
    export, count = tmp_path / "film.html", 100
    with FramePublisher("tcp://127.0.0.1:*", is_patient=True) as publisher:
        view = launch(publisher.address, export=export)
        publisher.publish_scene(make_scene(robot="bare", is_recorded=True))
        os.kill(view.pid, signal.SIGSTOP)
        for number in range(count):
            publisher.publish_frame(make_frame(sequence=number + 1, now=0.1 * number))
        publisher.publish_status(StatusMessage(text="the end", is_over=True))
        os.kill(view.pid, signal.SIGTERM)
        os.kill(view.pid, signal.SIGCONT)
        view.close()
    packed = re.search(r'id="film" type="text/plain">([^<]*)<', export.read_text())[1]
    film = msgspec.msgpack.decode(gzip.decompress(base64.b64decode(packed)))
    assert film["news"]["moments"][-1][1] == pytest.approx(0.1 * (count - 1))
