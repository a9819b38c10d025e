"""The monitor and simulated devices as processes of their own, each device described by one object.

A module that has such objects is run with `python -m`; the object crosses on its command line.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import msgspec

from armguard.app.processes import end_with


def start_device(
    device: msgspec.Struct, log: IO[bytes], *, takes_orders: bool = False
) -> subprocess.Popen[bytes]:
    """Start a device as a process of its own, which is to end with this one.

    Args:
        device: What the process is to do; its module is run, and calls `run_device`.
        log: Where it writes what goes wrong.
        takes_orders: Whether its standard input is a pipe from here; else it has none.
    """
    described = msgspec.json.encode(device).decode()
    return subprocess.Popen(
        [sys.executable, "-m", type(device).__module__, described, str(os.getpid())],
        stdin=subprocess.PIPE if takes_orders else subprocess.DEVNULL,
        stderr=log,
        start_new_session=True,  # a Ctrl-C is for what started it, which ends it in due order
    )


def run_device(kind: Any) -> None:
    """Run the device that the command line describes, until this process is told to end.

    SIGTERM ends it, and so does the end of the process that started it.

    Args:
        kind: A struct with a method `run`, or a union of several.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    # What is left at the end goes with the process: to collect it would take up to 0.3 s.
    atexit.register(gc.freeze)
    described, parent = sys.argv[1:]
    device = msgspec.json.decode(described, type=kind)
    end_with(int(parent))
    device.run()


def start_monitor(
    cell: Path,
    addresses: Mapping[str, str],
    *options: str,
    log: IO[bytes] | int,
    command: str = "run",
) -> subprocess.Popen[bytes]:
    """Start `armguard run --json` as a process of its own, which ends with this one.

    Args:
        cell: Its cell file.
        addresses: By option: of obstacles, joints, verdicts and view.
        options: Others.
        log: Its standard error, as for `subprocess.Popen`.
        command: "run", or "shield".
    """
    words = [sys.executable, "-m", "armguard", command, str(cell), "--json", "--quiet", *options]
    words += ["--no-realtime", "--parent", str(os.getpid())]
    words += [word for name, one in addresses.items() for word in (f"--{name}", one)]
    return subprocess.Popen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=log,
        start_new_session=True,  # Ctrl-C reaches it through us, so that it ends first
    )
