"""The simulated controller keeps to the protocols, and to what is known of real controllers."""

import socket
import struct
import time

import pytest

from armguard.lab.simulation.ur_controller import (
    PAUSED,
    PLAYING,
    RTDE_PORT,
    STOPPED,
    UrController,
)
from support.driven_cell import find_host
from support.waiting import wait_until


class Client:
    """Speaks RTDE by itself."""

    def __init__(self, controller):
        self.socket = socket.create_connection((controller.host, RTDE_PORT), 10.0)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def ask(self, kind, data=b""):
        self.send(kind, data)
        return self.read()

    def send(self, kind, data):
        self.socket.sendall(struct.pack(">HB", 3 + len(data), ord(kind)) + data)

    def read(self):
        size, kind = struct.unpack(">HB", self._read(3))
        return chr(kind), self._read(size - 3)

    def _read(self, count):
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            assert more, "the controller has ended the connection"
            data += more
        return data


@pytest.fixture
def controller():
    with UrController(find_host(), has_watchdog=True) as one:
        yield one


def set_slider(client, value):
    client.send("U", b"\1" + struct.pack(">Id", 1, value))


def test_it_shakes_hands_and_streams_what_was_asked_for(controller):
    with Client(controller) as client:
        assert client.ask("V", b"\0\2") == ("V", b"\1")
        assert client.ask("V", b"\0\7") == ("V", b"\0")
        assert client.ask("v") == ("v", struct.pack(">4I", 5, 12, 6, 1102099))
        names = b"timestamp,actual_q,actual_qd,nonsense"
        told = client.ask("O", struct.pack(">d", 500.0) + names)
        assert told == ("O", b"\1DOUBLE,VECTOR6D,VECTOR6D,NOT_FOUND")
        client.ask("O", struct.pack(">d", 500.0) + b"timestamp,actual_q,actual_qd")
        assert client.ask("S") == ("S", b"\1")
        before = None
        for _ in range(20):
            kind, data = client.read()
            stamp, *state = struct.unpack(">13d", data[1:])
            assert (kind, data[0]) == ("U", 1)
            if before:
                moved = [new - old for new, old in zip(state[:6], before[1][:6], strict=True)]
                assert stamp > before[0]
                assert moved == pytest.approx([0.002 * v for v in state[6:]], abs=1e-9)
            before = stamp, state
        client.send("P", b"")
        while client.read()[0] != "P":
            pass


def test_the_slider_scales_and_zero_stops_protectively(controller):
    with Client(controller) as client:
        told = client.ask("I", b"speed_slider_mask,speed_slider_fraction")
        assert told == ("I", b"\1UINT32,DOUBLE")
        set_slider(client, 0.25)
        wait_until(lambda: controller.slider == 0.25)
        set_slider(client, 0.0)
        wait_until(lambda: controller.safety == 3)
        assert controller.pace == 0.0
        assert not controller.play()


def test_a_client_that_falls_silent_lets_the_watchdog_pause_the_program(controller):
    with Client(controller) as client:
        client.ask("I", b"speed_slider_mask,speed_slider_fraction")
        time.sleep(0.2)
        assert controller.program == PLAYING, "it begins with the first package"
        set_slider(client, 1.0)
        wait_until(lambda: controller.program == PAUSED and controller.pace == 0.0)


def send_command(client, number, *values):
    client.send("U", b"\1" + struct.pack(">i6d", number, *values, *[0.0] * (6 - len(values))))


def test_it_runs_the_control_program_of_the_client_library(controller):
    registers = ["input_int_register_0", *(f"input_double_register_{k}" for k in range(6))]
    with Client(controller) as client:
        client.ask("I", ",".join(registers).encode())
        with socket.create_connection((controller.host, 30003), 10.0) as script:
            script.sendall(b"def rtde_control():\n  textmsg()\nend\n")
            wait_until(lambda: controller.is_controlled and controller.program == PLAYING)
        wait_until(lambda: not controller.v.any())
        home = controller.q.copy()
        for _ in range(200):
            send_command(client, 11, *(home + 0.1))
            time.sleep(0.002)
        assert controller.q == pytest.approx(home + 0.1, abs=0.01)
        send_command(client, 11, *(home + 1.0))
        wait_until(lambda: controller.v[0] > 0.5)
        send_command(client, 16, 10.0)
        wait_until(lambda: not controller.v.any())
        send_command(client, 0)
        time.sleep(0.05)
        send_command(client, 35, 20.0)  # a watchdog of 20 Hz
        wait_until(lambda: controller.program == STOPPED)
    assert [one.order for one in controller.received] == ["control", "servo stop", "watchdog"]


def test_the_dashboard_and_scripts(controller):
    with socket.create_connection((controller.host, 29999), 10.0) as dashboard:
        file = dashboard.makefile("rw")
        assert file.readline() == "Connected: Universal Robots Dashboard Server\n"
        for line, answer in (
            ("get robot model", "UR5"),
            ("pause", "Pausing program"),
            ("play", "Starting program"),
            ("stop", "Stopped"),
            ("nonsense", "could not understand: 'nonsense'"),
        ):
            file.write(f"{line}\n")
            file.flush()
            assert file.readline() == f"{answer}\n"
        file.close()
    wait_until(lambda: controller.program == STOPPED and controller.pace == 0.0)
    controller.play()
    with socket.create_connection((controller.host, 30002), 10.0) as script:
        script.sendall(b"stopj(4.0)\n")
        wait_until(lambda: controller.program == STOPPED and controller.pace == 0.0)
    assert [one.order for one in controller.received] == ["pause", "play", "stop", "stopj"]
