"""Recordings written by a fork of the test's process, which need not import everything anew.

What writes a recording spends a second on its imports, and a hundred tests record something. A
fork is a process of its own as well, with a number, signals and an end. That `Recorder` starts the
real one is shown by tests of its own, and by all that run `armguard`.
"""

import contextlib
import os
import subprocess
import sys
import time
import traceback
import warnings
from pathlib import Path

import mcap.writer  # so that no fork has to import it

from armguard.recording.writer import main

assert mcap.writer

DEVNULL, TimeoutExpired = subprocess.DEVNULL, subprocess.TimeoutExpired


class Popen:
    """Instead of the process that `python -m armguard.recording` is."""

    def __init__(self, command, *, stdin, pass_fds, start_new_session):
        assert command[1:4] == ["-P", "-m", "armguard.recording"]
        assert stdin == DEVNULL
        assert start_new_session
        self.returncode = None
        with warnings.catch_warnings():
            # Later Pythons warn of threads, which are not there in the fork; it needs none of them.
            warnings.simplefilter("ignore", DeprecationWarning)
            self.pid = os.fork()
        if self.pid == 0:
            code = 1
            try:
                os.setsid()
                leave_open(pass_fds)
                # What is captured by pytest is closed now.
                sys.stdout = sys.stderr = open(2, "w", buffering=1)  # noqa: SIM115
                code = main(command[4:])
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(code)

    def poll(self):
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout=float("inf")):
        deadline = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > deadline:
                raise TimeoutExpired("a fork that writes a recording", timeout)
            time.sleep(0.002)
        return self.returncode

    def kill(self):
        os.kill(self.pid, 9)


def leave_open(descriptors):
    """Close all files but these and what is printed to; nothing comes in."""
    for name in Path("/proc/self/fd").iterdir():
        if int(name.name) not in (0, 1, 2, *descriptors):
            with contextlib.suppress(OSError):  # the folder's own
                os.close(int(name.name))
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
