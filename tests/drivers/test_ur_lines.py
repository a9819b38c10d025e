import contextlib
import socket
import threading
import time

import pytest

from armguard.drivers import ur_lines
from armguard.drivers.arm import ArmLostError
from armguard.drivers.ur_lines import Dashboard, check_rtde, stop_by_script
from armguard.lab.simulation.ur_controller import STOPPED, UrController
from support.driven_cell import find_host
from support.waiting import wait_until


@pytest.fixture
def controller(monkeypatch):
    monkeypatch.setattr(ur_lines, "TIMEOUT", 0.3)
    with UrController(find_host()) as one:
        yield one


def test_the_dashboard_answers_questions_and_takes_orders(controller):
    dashboard = Dashboard(controller.host)
    assert dashboard.ask("get robot model") == "UR5"
    dashboard.order("pause")
    found = []
    wait_until(lambda: found.extend(dashboard.read_answers()) or found)
    assert found == ["Pausing program"]
    assert dashboard.ask("is in remote control") == "true"
    controller.cut()
    with pytest.raises(ArmLostError):
        wait_until(dashboard.read_answers)
    dashboard.close()


def test_a_script_stops_the_arm_and_ends_its_program(controller):
    check_rtde(controller.host)
    assert stop_by_script(controller.host, 4.0)
    wait_until(lambda: controller.program == STOPPED and controller.pace == 0.0)
    (stop,) = [one for one in controller.received if one.order == "stopj"]
    assert stop.value == 4.0


def test_a_controller_that_is_silent_is_not_waited_for(controller):
    controller.is_frozen = True
    dashboard = Dashboard(controller.host)
    for ask in (lambda: dashboard.ask("running"), lambda: check_rtde(controller.host)):
        with pytest.raises(ArmLostError, match="does not answer"):
            ask()
    dashboard.close()


def test_a_controller_that_refuses_or_is_not_there_is_told():
    host = find_host()
    for ask in (Dashboard, check_rtde):
        with pytest.raises(ArmLostError, match=r"cannot be reached \(Connection refused\)"):
            ask(host)
    assert not stop_by_script(host, 4.0)


def test_a_controller_that_closes_at_once_has_taken_no_script():
    host = find_host()
    with socket.create_server((host, ur_lines.SCRIPT_PORT)) as server:

        def serve():
            connection, _ = server.accept()
            connection.recv(100)
            connection.close()

        thread = threading.Thread(target=serve)
        thread.start()
        assert not stop_by_script(host, 4.0)
        thread.join()


@pytest.mark.parametrize("answer", [b"", b"\xff" * 10, b"\0\4V\0", b"HTTP/1.1 400 Bad Request"])
def test_what_does_not_speak_rtde_is_told(answer):
    host = find_host()
    with socket.create_server((host, ur_lines.RTDE_PORT)) as server:

        def serve():
            connection, _ = server.accept()
            with contextlib.suppress(OSError), connection:
                connection.recv(100)
                connection.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(ArmLostError, match="does not support version 2"):
            check_rtde(host)
        thread.join()


def test_a_controller_that_sends_all_the_time_is_not_read_for_ever():
    host = find_host()
    with socket.create_server((host, ur_lines.SCRIPT_PORT)) as server:

        def serve():
            connection, _ = server.accept()
            end = time.monotonic() + 2.0
            with contextlib.suppress(OSError), connection:
                while time.monotonic() < end:
                    connection.sendall(b"state")
                    time.sleep(0.002)

        thread = threading.Thread(target=serve)
        thread.start()
        begun = time.monotonic()
        assert stop_by_script(host, 4.0)
        assert time.monotonic() - begun < 1.0
        thread.join()
