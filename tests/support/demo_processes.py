"""Finds the processes of a demo that a test has started, and what they listen on."""

import contextlib
import os
import subprocess
import sys
import time
import uuid
from pathlib import Path

from armguard.streams import VerdictReader

ARMGUARD = Path(sys.executable).with_name("armguard")
PATIENCE = 60.0
SOON = 10.0
"""How long an end may take on a busy machine, in [s]."""
SIGNS = {
    "-m armguard run": "monitor",
    "-m armguard.view": "view",
    "-m armguard.recording": "recorder",
    '"type":"Perception"': "perception",
    '"type":"RobotNode"': "robot",
}


class RunningDemo:
    """`armguard demo` with what it started; ends everything when left.

    Every process inherits a mark in its environment, by which it is found again even when its
    parent has gone.
    """

    def __init__(self, *arguments, folder, command="demo", **environment):
        self._mark = f"ARMGUARD_TEST_MARK={uuid.uuid4()}"
        name, value = self._mark.split("=")
        self.folder = folder
        self.process = subprocess.Popen(
            [ARMGUARD, command, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {name: value, "TMPDIR": str(folder)} | environment,
            start_new_session=True,
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for pid in self.pids():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, 9)
        self.process.communicate()

    def pids(self):
        """All processes that carry the mark and have not ended."""
        found = []
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # ended meanwhile, or somebody else's
                if self._mark.encode() in (folder / "environ").read_bytes():
                    found.append(int(folder.name))
        return found

    def pid_of(self, role):
        """The process with a role: "launcher", or one of those in `SIGNS`."""
        if role == "launcher":
            return self.process.pid
        roles = {}
        for pid in self.pids():
            with contextlib.suppress(OSError):
                words = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
                for sign, name in SIGNS.items():
                    if sign in words:
                        roles[name] = pid
        return roles[role]

    @property
    def verdicts(self):
        """Address of the monitor's verdicts, once it has bound it."""
        return "".join(f"ipc://{path}" for path in self.folder.glob("armguard-*/verdicts"))

    def wait_for_verdicts(self):
        """Return when the monitor judges joint states."""
        assert wait_until(lambda: self.verdicts or self.process.poll() is not None)
        if self.process.poll() is None:
            with VerdictReader(self.verdicts) as reader:
                wait_until(
                    lambda: (
                        ((verdict := reader.latest()) and verdict.sequence > 0)
                        or self.process.poll() is not None
                    )
                )
        assert self.process.poll() is None, self.process.communicate()

    def wait_until_gone(self, patience):
        """Whether all of its processes have ended within `patience` [s]."""
        return wait_until(lambda: not self.pids(), patience)


def wait_until(condition, patience=PATIENCE):
    """Whether the condition came true in time, in [s]."""
    deadline = time.monotonic() + patience
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def listening_sockets(pids):
    """Local addresses, in the kernel's hexadecimal, on which these processes accept connections."""
    inodes = set()
    for pid in pids:
        for descriptor in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                target = os.readlink(descriptor)
                if target.startswith("socket:["):
                    inodes.add(target[8:-1])
    found = []
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes and (table.startswith("udp") or fields[3] == "0A"):
                found.append(fields[1])
    return found


def finish(demo):
    """What a demo printed, its exit code, and that nothing stayed behind."""
    out, err = demo.process.communicate(timeout=120)
    assert demo.wait_until_gone(PATIENCE)
    assert "Traceback" not in err
    return out, err
