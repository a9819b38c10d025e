"""Simulated devices as processes of their own, each described by one object.

A module that has such objects is run with `python -m`; the object crosses on its command line.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import subprocess
import sys
from typing import IO, Any

import msgspec


def start_device(
    module: str, device: msgspec.Struct, log: IO[bytes], *, takes_orders: bool = False
) -> subprocess.Popen[bytes]:
    """Start a device as a process of its own, which is to end with this one.

    Args:
        module: Is run, and finds the device by `read_device`.
        device: What the process is to do.
        log: Where it writes what goes wrong.
        takes_orders: Whether its standard input is a pipe from here; else it has none.
    """
    described = msgspec.json.encode(device).decode()
    return subprocess.Popen(
        [sys.executable, "-m", module, described, str(os.getpid())],
        stdin=subprocess.PIPE if takes_orders else subprocess.DEVNULL,
        stderr=log,
        start_new_session=True,  # a Ctrl-C is for what started it, which ends it in due order
    )


def read_device(kind: Any) -> tuple[Any, int]:
    """What the command line of this process describes; SIGTERM ends the process from now on.

    Args:
        kind: A struct, or a union of several.

    Returns:
        The device, and the process that started it.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    # What is left at the end goes with the process: to collect it would take up to 0.3 s.
    atexit.register(gc.freeze)
    described, parent = sys.argv[1:]
    return msgspec.json.decode(described, type=kind), int(parent)
