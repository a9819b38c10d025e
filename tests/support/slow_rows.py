"""Rows that say when they have begun and wait until they may end; workers import them by name."""

import os
import time
from pathlib import Path

from armguard.exceptions import ArmguardError

PATIENCE = 200.0
"""For another process, in [s]: more than any machine needs."""


def square(shared, number):
    return {"square": shared * number * number}


def wait_then_square(shared, number):
    """Begins by leaving its process's number in a folder, ends once the folder says `go`."""
    folder = Path(shared)
    (folder / f"begun-{number}-{os.getpid()}").touch()
    wait_until((folder / "go").exists)
    return {"square": number * number, "process": os.getpid()}


def refuse(shared, number):
    raise ArmguardError("the row", "cannot be measured")


def die(shared, number):
    os.kill(os.getpid(), 9)


def wait_until(is_so):
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end, "what was waited for did not come"
        time.sleep(0.02)
