"""Starts and ends the view's process.

A view in the monitor's process would hold its interpreter lock 30 times a second and make ticks
late. The view's process ends when its parent ends.
"""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
from pathlib import Path

import msgspec

from armguard.exceptions import ArmguardError
from armguard.streams.addresses import check_address
from armguard.streams.keys import Keys
from armguard.view.access import Access
from armguard.view.listening import LOOPBACK, listen

START_TIMEOUT = 30.0
END_TIMEOUT = 3.0
EXPORT_TIMEOUT = 120.0
"""Timeout for the end of the process, in [s], before it is killed; longer if it exports."""


class WatchOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a view's process; passed as JSON on its command line."""

    address: str
    """Address of a `FramePublisher`."""
    port: int = 0
    """TCP port of the page; 0: any free port."""
    floor: float = 0.0
    """Height of the floor that is drawn, in [m]."""
    export: str | None = None
    """Path of a file that plays offline, written at the end; None: no file."""
    host: str = LOOPBACK
    """Address of the interface on which the page is served; see `ViewServer`."""
    key_files: tuple[str, str] | None = None
    """If the monitor requires keys: secret key file of a client with `view`, and the monitor's
    public key file."""
    parent: int | None = None
    """Process id of the parent, with which the view ends; None: no parent."""

    def load_keys(self) -> Keys | None:
        """The keys of the client; None without keys."""
        return None if self.key_files is None else Keys.load(*map(Path, self.key_files))


class ViewProcess:
    """A running view; made by `launch`.

    Attributes:
        url: Address of the page.
        pid: Process id.
    """

    def __init__(self, process: subprocess.Popen[str], url: str, end_timeout: float) -> None:
        self._process = process
        self._end_timeout = end_timeout
        self.url = url
        self.pid = process.pid

    @property
    def running(self) -> bool:
        """Whether the process is alive."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Return when the process has ended."""
        self._process.wait()

    def close(self) -> None:
        """End the process, and wait until its port is free; can be called twice."""
        _end(self._process, self._end_timeout)

    def __enter__(self) -> ViewProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def launch(
    address: str,
    port: int = 0,
    *,
    floor: float = 0.0,
    export: Path | None = None,
    host: str = LOOPBACK,
    key_files: tuple[Path, Path] | None = None,
) -> ViewProcess:
    """Start a view of the feed at `address`, and wait until its page can be opened.

    Args:
        address: As in `WatchOptions`, like all that follow.
        port: TCP port of the page.
        floor: Height of the floor, in [m].
        export: Path of a file that plays offline; None: no file.
        host: Address of the interface on which the page is served.
        key_files: Secret key file of a client with `view`, and the monitor's public key file.

    Raises:
        ArmguardError: The address or port cannot be used, or the process did not listen in time.
    """
    options = WatchOptions(
        address=address,
        port=port,
        floor=floor,
        export=None if export is None else str(export),
        host=host,
        key_files=None if key_files is None else (str(key_files[0]), str(key_files[1])),
        parent=os.getpid(),
    )
    # Mistakes are told here, in one line: from the process there would be its own and ours.
    check_address(address, has_keys=key_files is not None)
    options.load_keys()
    Access(host)
    listen(port, host).close()
    command = [sys.executable, "-P", "-m", "armguard.view", msgspec.json.encode(options).decode()]
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,  # a Ctrl-C while it still imports would end it with a traceback
    )
    assert process.stdout is not None
    try:
        # It says one line, all at once.
        with process.stdout as output:
            is_told = select.select([output], [], [], START_TIMEOUT)[0]
            found = re.search(r"http://\S+", output.readline() if is_told else "")
    except BaseException:
        _end(process)
        raise
    if found is None:
        _end(process)
        raise ArmguardError(
            "view process",
            f"did not start (exit code {process.returncode})",
            remedy="its own message, if any, is on standard error",
        )
    return ViewProcess(process, found[0], END_TIMEOUT if export is None else EXPORT_TIMEOUT)


def _end(process: subprocess.Popen[str], timeout: float = END_TIMEOUT) -> None:
    process.terminate()
    try:
        process.wait(timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
