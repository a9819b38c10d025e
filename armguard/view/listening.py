"""Listens for browsers, on the loopback interface unless another one is named."""

from __future__ import annotations

import socket

from armguard.exceptions import ArmguardError

LOOPBACK = "127.0.0.1"


def listen(port: int, host: str = LOOPBACK) -> socket.socket:
    """A socket that accepts connections at a TCP port of an interface; 0: any free port.

    Raises:
        ArmguardError: There is no such port or interface, or the port is in use.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        # A number out of range would be wrapped around by the system, not refused.
        if not 0 <= port <= 65535:
            raise OSError("there is no such port")
        listener = socket.create_server((host, port), family=family)
    except OSError as error:
        raise ArmguardError(
            f"port {port} on {host}",
            f"cannot be used by the view: {error}",
            remedy="name another port, or 0 for any free port",
        ) from error
    listener.setblocking(False)
    return listener
