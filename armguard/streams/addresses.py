"""Checks addresses before a socket uses them: ipc and loopback TCP, and with keys any TCP.

Without keys these streams are neither encrypted nor signed, so an address that other machines could
reach is refused.
"""

from __future__ import annotations

import errno
import ipaddress
import re
import socket
import stat
from pathlib import Path

import zmq

from armguard.exceptions import StreamError

OBSTACLES_ADDRESS = "tcp://127.0.0.1:5701"
JOINTS_ADDRESS = "tcp://127.0.0.1:5702"
VERDICTS_ADDRESS = "tcp://127.0.0.1:5703"

_EXPECTED = "ipc:///some/path, or tcp://127.0.0.1:PORT"


def check_address(address: str, *, has_keys: bool = False) -> None:
    """Raise StreamError unless `address` can be used.

    Args:
        address: ipc, or TCP: on the loopback interface unless there are keys.
        has_keys: Whether both sides authenticate by keys.
    """
    if re.fullmatch(r"ipc://[^\0]+", address):
        return
    match = re.fullmatch(r"tcp://(\[[^\]]*\]|[^:\[\]]*):(\d+|\*)", address)
    if match is None:
        raise StreamError(address, "is not a usable address", expected=_EXPECTED)
    host, port = match.groups()
    try:
        loopback = ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:  # a name: what it stands for may change, so names are refused
        loopback = False
    if not loopback and not (has_keys and host):
        raise StreamError(
            address,
            "could be reached from other machines, or is a name, and there are no keys",
            expected=_EXPECTED,
            remedy="make keys with `armguard keys new`: without keys every client is accepted",
        )
    if port != "*" and not 0 < int(port) < 65536:
        raise StreamError(address, f"port {port} does not exist", expected="1 to 65535")


def check_free(address: str) -> None:
    """Raise StreamError if another process answers on an address, or listens there.

    On ipc, ZeroMQ would replace the other process's file without an error. For TCP the system
    refuses the address, but only after a long start.
    """
    if address.startswith("ipc://"):
        _check_path_free(address)
    elif not address.endswith(":*"):
        host, port = address.removeprefix("tcp://").rsplit(":", 1)
        family = socket.AF_INET6 if host.startswith("[") else socket.AF_INET
        host = "" if host == "*" else host.strip("[]")
        try:
            socket.create_server((host, int(port)), family=family).close()
        except socket.gaierror:
            return  # the name of an interface, which ZeroMQ looks up itself
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise _in_use(address) from None
            raise StreamError(address, f"cannot be used ({error.strerror})") from None


def _check_path_free(address: str) -> None:
    path = address.removeprefix("ipc://")
    if path.startswith("@"):
        return
    try:
        if not stat.S_ISSOCK(Path(path).stat().st_mode):
            raise StreamError(address, "is a file", expected="a path that is free")
    except OSError:
        return
    with socket.socket(socket.AF_UNIX) as probe:
        probe.setblocking(False)
        try:
            probe.connect(path)
        except BlockingIOError:  # a process listens, too busy to answer
            pass
        except OSError:
            return
    raise _in_use(address)


def find_reachable(address: str, beside: str) -> str:
    """The address by which other processes reach an address to which a process is bound.

    An address on all interfaces, or on the loopback interface, names no machine.

    Args:
        address: Address to which the process says it is bound.
        beside: Another address of the same process, by which it was reached.

    Returns:
        The address, with the host of the other one if its own names no machine; empty for a path on
        another machine.
    """
    is_elsewhere = beside.startswith("tcp://") and not _is_local(beside)
    if address.startswith("ipc://"):
        return "" if is_elsewhere else address
    if not is_elsewhere or not _is_local(address):
        return address
    return f"{beside.rsplit(':', 1)[0]}:{address.rsplit(':', 1)[1]}"


def is_unspecified(address: str) -> bool:
    """Whether an address is of all interfaces, which names no machine."""
    host = _read_host(address)
    return host is not None and host.is_unspecified


def _is_local(address: str) -> bool:
    """Whether an address means another machine on each machine; a name is not looked up."""
    host = _read_host(address)
    if host is None:
        return address.startswith("tcp://localhost:")
    return host.is_unspecified or host.is_loopback


def _read_host(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """The host of a TCP address, where it is a number."""
    try:
        return ipaddress.ip_address(address.removeprefix("tcp://").rsplit(":", 1)[0].strip("[]"))
    except ValueError:
        return None


def remove_file(address: str) -> None:
    """Remove the file of an ipc address that we still hold; ZeroMQ leaves it behind."""
    path = address.removeprefix("ipc://")
    if path != address and not path.startswith("@"):
        Path(path).unlink(missing_ok=True)


def explain(address: str, error: zmq.ZMQError) -> StreamError:
    """The StreamError that says why ZeroMQ refused to bind or connect."""
    if error.errno == zmq.EADDRINUSE:
        return _in_use(address)
    return StreamError(address, f"cannot be used ({error.strerror})", expected=_EXPECTED)


def _in_use(address: str) -> StreamError:
    return StreamError(
        address,
        "is in use by another process",
        remedy="end that one, or choose another address",
    )
