"""The view process; started by `launch`."""

from __future__ import annotations

import asyncio
import atexit
import gc
import os
import sys

import msgspec

from armguard.exceptions import ArmguardError
from armguard.view.process import WatchOptions
from armguard.view.viewer import watch

NICENESS = 10
"""Niceness of the view's process: all other work goes first, above all the monitor."""


def main() -> int:
    """Run a view until it is asked to end. Returns the exit code."""
    # What is left at the end goes with the process: to collect it would take up to 0.3 s.
    atexit.register(gc.freeze)
    os.nice(NICENESS)
    try:
        options = msgspec.json.decode(" ".join(sys.argv[1:]), type=WatchOptions)
    except msgspec.DecodeError:
        sys.stderr.write("armguard starts this module: run `armguard view ADDRESS` instead\n")
        return 2
    try:
        asyncio.run(watch(options))
    except ArmguardError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
