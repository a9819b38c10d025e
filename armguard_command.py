"""The command `armguard`, which Ctrl-C ends without a traceback while it still loads.

It stands beside the package: to import any module of `armguard` loads Pinocchio and Numba first,
which takes half a second. Until the command line takes over, Ctrl-C ends the process at once. Only
the first 0.03 s, in which Python itself starts, are out of its reach.
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

_STANDARD_ERROR = 2


def end_at_once(number: int, frame: FrameType | None) -> None:
    """End the process with one line and no traceback; a handler of SIGINT."""
    try:
        os.write(_STANDARD_ERROR, b"armguard: interrupted\n")
    finally:
        os._exit(128 + number)


def main() -> int:
    """Run `armguard` with the arguments of the process; the exit code."""
    # A shell lets background processes ignore Ctrl-C: such a process goes on ignoring it.
    is_heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_heeded:
        signal.signal(signal.SIGINT, end_at_once)
    try:
        from armguard.app.cli import main as run_command
    except Exception as error:
        # A variable of the environment is wrong: to import the exceptions by name raises as well.
        if type(error).__module__ != "armguard.exceptions":
            raise
        sys.stderr.write(f"armguard: {error}\n")
        return 2

    try:
        if is_heeded:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return run_command()
    finally:
        # Everything was printed: what is left is the end of the interpreter.
        if is_heeded:
            signal.signal(signal.SIGINT, end_at_once)


if __name__ == "__main__":
    sys.exit(main())
