"""The two ports of a Universal Robots controller that accept lines: dashboard and scripts.

Plain sockets with timeouts: a stop of the arm must work while the RTDE client hangs, and pausing a
program must not delay the joint states.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time

from armguard.drivers.arm import ArmLostError

DASHBOARD_PORT, SCRIPT_PORT, RTDE_PORT = 29999, 30002, 30004

TIMEOUT = 1.0
"""How long the controller may take to answer while it is being connected, in [s]."""

TAKE_TIME = 0.02
"""How long the controller may take to read a script, in [s]."""

REMOTE_CONTROL = "is in remote control"
"""Question of the dashboard; controllers of the CB series do not understand it."""

_HEADER = struct.Struct(">HB")
_VERSION_REQUEST = _HEADER.pack(5, ord("V")) + struct.pack(">H", 2)
"""RTDE: request of version 2 of the protocol."""


class Dashboard:
    """A connection to the dashboard server.

    Args:
        host: Of the controller.
        timeout: How long it may take to answer, in [s]; by default `TIMEOUT`.

    Raises:
        ArmLostError: It does not answer.
    """

    def __init__(self, host: str, timeout: float | None = None) -> None:
        self._name = f"the dashboard at {host}:{DASHBOARD_PORT}"
        self._received = b""
        self._timeout = TIMEOUT if timeout is None else timeout
        self._socket = _connect(host, DASHBOARD_PORT, self._timeout)
        try:
            self._read_line()  # its greeting
        except ArmLostError:
            self.close()
            raise

    def ask(self, line: str) -> str:
        """Send a line, and wait for the answer.

        Raises:
            ArmLostError: It does not answer.
        """
        self.order(line)
        self._socket.settimeout(self._timeout)
        return self._read_line()

    def order(self, line: str) -> None:
        """Send a line without waiting.

        Raises:
            ArmLostError: It cannot be sent.
        """
        self._socket.setblocking(False)
        try:
            self._socket.send(line.encode() + b"\n")
        except OSError as error:
            raise ArmLostError(f"{self._name} cannot be reached ({error.strerror})") from None

    def read_answers(self) -> list[str]:
        """Answers since the last call.

        Raises:
            ArmLostError: It has ended the connection.
        """
        self._socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            self._receive()
        *lines, self._received = self._received.split(b"\n")
        return [line.decode(errors="replace").strip() for line in lines]

    def _read_line(self) -> str:
        while b"\n" not in self._received:
            self._receive()
        line, self._received = self._received.split(b"\n", 1)
        return line.decode(errors="replace").strip()

    def _receive(self) -> None:
        try:
            data = self._socket.recv(4096)
        except BlockingIOError:
            raise
        except OSError:
            raise ArmLostError(f"{self._name} does not answer") from None
        if not data or len(self._received) > 65536:
            raise ArmLostError(f"{self._name} has ended the connection")
        self._received += data

    def close(self) -> None:
        """Disconnect."""
        self._socket.close()


def check_rtde(host: str) -> None:
    """Check that the RTDE port supports version 2 of the protocol.

    The client library waits for an answer without a timeout, and ends its process at an invalid
    one, so this check comes first.

    Raises:
        ArmLostError: It does not.
    """
    name = f"RTDE at {host}:{RTDE_PORT}"
    with _connect(host, RTDE_PORT, TIMEOUT) as connection:
        try:
            connection.sendall(_VERSION_REQUEST)
            answer = b""
            while len(answer) < 4 and (data := connection.recv(4 - len(answer))):
                answer += data
        except OSError:
            raise ArmLostError(f"{name} does not answer") from None
    if answer != _HEADER.pack(4, ord("V")) + b"\1":
        raise ArmLostError(f"{name} does not support version 2 of the protocol")


def stop_by_script(host: str, deceleration: float, timeout: float = 0.3) -> bool:
    """Stop the arm by a script of one line, which replaces the running program.

    Args:
        host: Of the controller.
        deceleration: In [rad/s²].
        timeout: How long to wait for a connection, in [s].

    Returns:
        Whether it could be sent. The controller does not answer: only joint states show whether it
        obeys.
    """
    is_open = False
    try:
        with _connect(host, SCRIPT_PORT, timeout) as connection:
            connection.sendall(f"stopj({deceleration:.3f})\n".encode())
            # Data that nobody reads would end the connection before the line is taken.
            connection.shutdown(socket.SHUT_WR)
            deadline = time.monotonic() + TAKE_TIME
            while (left := deadline - time.monotonic()) > 0.0:
                connection.settimeout(left)
                if not connection.recv(65536):
                    # One that accepts scripts sends its states.
                    return is_open
                is_open = True
    except TimeoutError:
        return True
    except (OSError, ArmLostError):
        return False
    return True


def is_in_local_control(host: str, timeout: float = 0.3) -> bool:
    """Whether the controller says that it is in local control, where it ignores scripts.

    Args:
        host: Of the controller.
        timeout: How long to wait for a connection, or for an answer, in [s].
    """
    try:
        with contextlib.closing(Dashboard(host, timeout)) as dashboard:
            return dashboard.ask(REMOTE_CONTROL).lower() == "false"
    except ArmLostError:
        return False


def _connect(host: str, port: int, timeout: float) -> socket.socket:
    try:
        connection = socket.create_connection((host, port), timeout)
    except OSError as error:
        reason = error.strerror or "no answer"
        raise ArmLostError(f"{host}:{port} cannot be reached ({reason})") from None
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection
