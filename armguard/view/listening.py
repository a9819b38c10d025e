"""Listens for browsers, on the loopback interface and nowhere else."""

from __future__ import annotations

import socket

from armguard.exceptions import ArmguardError

LOOPBACK = "127.0.0.1"


def listen(port: int) -> socket.socket:
    """A socket that accepts connections at a TCP port of 127.0.0.1; 0: any that is free.

    Raises:
        ArmguardError: There is no such port, or it is in use.
    """
    try:
        # A number out of range would be wrapped around by the system, not refused.
        if not 0 <= port <= 65535:
            raise OSError("there is no such port")
        listener = socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise ArmguardError(
            f"port {port} on {LOOPBACK}",
            f"cannot be used by the view: {error}",
            remedy="name another port, or 0 for any that is free",
        ) from error
    listener.setblocking(False)
    return listener
