import os
import socket
import time

import pytest

from armguard.exceptions import StreamError
from armguard.streams import (
    Publisher,
    SocketInput,
    VerdictPublisher,
    VerdictReader,
)
from armguard.streams.addresses import check_address, find_reachable
from support.stream_sockets import PATIENCE


@pytest.mark.parametrize(
    "address", ["ipc:///tmp/a b", "tcp://127.0.0.1:5701", "tcp://[::1]:1", "tcp://127.9.9.9:*"]
)
def test_addresses_of_this_machine_are_good(address):
    check_address(address)


@pytest.mark.parametrize(
    "address",
    [
        "",
        "5701",
        "tcp://",
        "tcp://127.0.0.1",
        "tcp://127.0.0.1:",
        "tcp://127.0.0.1:x",
        "tcp://127.0.0.1:0",
        "tcp://127.0.0.1:65536",
        "tcp://*:5701",
        "tcp://0.0.0.0:5701",
        "tcp://[::]:5701",
        "tcp://192.168.0.7:5701",
        "tcp://eth0:5701",
        "tcp://example.com:5701",
        "tcp://127.0.0.1:5701;tcp://192.168.0.7:1",
        "udp://127.0.0.1:5701",
        "inproc://a",
        "ipc://",
    ],
)
@pytest.mark.parametrize("user", [SocketInput, Publisher, VerdictReader])
def test_other_addresses_are_refused_by_name(address, user):
    with pytest.raises(StreamError) as caught:
        user(address)
    assert caught.value.offender == address
    assert caught.value.expected


@pytest.mark.parametrize("second", [SocketInput, lambda address: VerdictPublisher(address, 0.0)])
def test_an_address_in_use_is_a_clear_error(address, second):
    first = SocketInput(address)
    try:
        with pytest.raises(StreamError, match=r"in use by another process; .*choose another"):
            second(first.address)
    finally:
        first.close()


def test_a_port_of_a_foreign_program_is_in_use():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(StreamError, match="in use"):
            SocketInput(f"tcp://127.0.0.1:{port}")


def test_what_a_killed_process_left_behind_is_taken_over(tmp_path):
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(tmp_path / "in"))
    left.close()
    SocketInput(f"ipc://{tmp_path}/in").close()


def test_a_file_is_not_replaced_by_a_socket(tmp_path):
    (tmp_path / "in").write_text("precious")
    with pytest.raises(StreamError, match="is a file"):
        SocketInput(f"ipc://{tmp_path}/in")
    assert (tmp_path / "in").read_text() == "precious"


def test_folders_that_do_not_exist_and_names_too_long_are_clear_errors(tmp_path):
    for path in (tmp_path / "no" / "in", tmp_path / ("x" * 200)):
        with pytest.raises(StreamError, match="cannot be used"):
            SocketInput(f"ipc://{path}")


def test_closing_frees_the_address(address):
    first = SocketInput(address)
    first.close()
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            SocketInput(first.address).close()
        except StreamError:
            time.sleep(0.01)
        else:
            return
    pytest.fail("still in use")


def test_no_file_is_left_behind(tmp_path):
    source = SocketInput(f"ipc://{tmp_path}/in")
    publisher = VerdictPublisher(f"ipc://{tmp_path}/out", 0.0)
    assert sorted(os.listdir(tmp_path)) == ["in", "out"]
    for resource in (source, publisher):
        resource.close()
        resource.close()
    assert os.listdir(tmp_path) == []


FAR = "tcp://192.0.2.10:5704"


@pytest.mark.parametrize(
    ("address", "beside", "reachable"),
    [
        ("tcp://0.0.0.0:5702", FAR, "tcp://192.0.2.10:5702"),
        ("tcp://[::]:5702", "tcp://[2001:db8::1]:5704", "tcp://[2001:db8::1]:5702"),
        ("tcp://127.0.0.1:5702", FAR, "tcp://192.0.2.10:5702"),
        ("tcp://0.0.0.0:5702", "tcp://cell7:5704", "tcp://cell7:5702"),
        ("tcp://192.0.2.11:5702", FAR, "tcp://192.0.2.11:5702"),
        ("tcp://127.0.0.1:5702", "tcp://127.0.0.1:5704", "tcp://127.0.0.1:5702"),
        ("tcp://0.0.0.0:5702", "tcp://localhost:5704", "tcp://0.0.0.0:5702"),
        ("tcp://127.0.0.1:5702", "ipc:///tmp/view", "tcp://127.0.0.1:5702"),
        ("ipc:///tmp/joints", "tcp://127.0.0.1:5704", "ipc:///tmp/joints"),
        ("ipc:///tmp/joints", FAR, ""),
    ],
)
def test_an_address_of_another_machine_is_not_sought_on_this_one(address, beside, reachable):
    assert find_reachable(address, beside) == reachable
