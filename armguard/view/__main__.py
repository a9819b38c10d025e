"""`python -m armguard.view ADDRESS [--port 0]`: see a running monitor in the browser."""

from __future__ import annotations

import argparse
import asyncio
import atexit
import gc
import os
import sys
from pathlib import Path

from armguard.exceptions import ArmguardError
from armguard.streams.keys import Keys
from armguard.view.listening import LOOPBACK
from armguard.view.viewer import watch

NICENESS = 10
"""Drawing gives way to whatever else the machine has to do: the monitor, above all."""


def main() -> int:
    """Run a view until it is told to end. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m armguard.view", description=__doc__)
    parser.add_argument("address", help='feed of a running monitor, e.g. "tcp://127.0.0.1:5555"')
    parser.add_argument("--port", type=int, default=0, help="of the page; 0: any that is free")
    parser.add_argument("--host", default=LOOPBACK, help="interface on which the page is served")
    parser.add_argument("--key", type=Path, help="secret file of a client that may view")
    parser.add_argument("--server-key", type=Path, help="the monitor's public file")
    parser.add_argument("--floor", type=float, default=0.0, help="height of the floor, in metres")
    parser.add_argument("--export", type=Path, help="write a file that plays offline at the end")
    parser.add_argument("--parent", type=int, default=None, help="end when this process has ended")
    options = parser.parse_args()
    # What is left at the end goes with the process: to collect it would take up to 0.3 s.
    atexit.register(gc.freeze)
    os.nice(NICENESS)
    try:
        keys = None
        if options.key is not None and options.server_key is not None:
            keys = Keys.load(options.key, options.server_key)
        asyncio.run(
            watch(
                options.address,
                options.port,
                options.parent,
                host=options.host,
                keys=keys,
                floor=options.floor,
                export=options.export,
            )
        )
    except ArmguardError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
