"""Rows that say when they have begun and wait until they may go on; workers import them by name.

Each wait ends, so that a test whose workers do not do what they should fails, and is over.
"""

import os
import queue
import threading
from pathlib import Path

from armguard.exceptions import ArmguardError
from armguard.lab.extremes.rows import measure_line
from support.waiting import wait_until


def square(shared, number):
    return {"square": shared * number * number}


def wait_then_square(shared, number):
    """Begins by leaving its process's number in a folder, ends once the folder says `go`."""
    begin_and_wait(Path(shared), number)
    return {"square": number * number}


def wait_then_measure(shared, number):
    """A line of the study of extremes, once the folder says `go`, and who measured it."""
    folder, extent = shared
    begin_and_wait(Path(folder), number)
    return measure_line(extent, "evaluation", number) | {"process": os.getpid()}


def begin_and_wait(folder, number):
    (folder / f"begun-{number}-{os.getpid()}").touch()
    wait_until((folder / "go").exists)


def refuse(shared, number):
    raise ArmguardError("the row", "cannot be measured")


def die(shared, number):
    os.kill(os.getpid(), 9)


def within(seconds, function, *arguments, **options):
    """What a function returns, or fails with; fails as well if that takes longer.

    A thread is left behind then, which keeps no process from ending.
    """
    ends = queue.SimpleQueue()

    def run():
        try:
            ends.put((function(*arguments, **options), None))
        except BaseException as error:
            ends.put((None, error))

    threading.Thread(target=run, daemon=True).start()
    try:
        found, error = ends.get(timeout=seconds)
    except queue.Empty:
        raise AssertionError(f"{function.__qualname__} has not ended after {seconds} s") from None
    if error is not None:
        raise error
    return found
