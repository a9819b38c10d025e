"""Watches a driver's process: if it hangs or ends, stops the robot and starts another process.

The client library hangs if a robot is silent, and ends its process on invalid data. So each
connection is a separate process, and this one stops the arm without the library or the robot's
answers.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import select
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable

import msgspec

from armguard.drivers.link import COUNTS, DRIVING, LEAVING, MEASURED, TELL, WRONG, Counts
from armguard.drivers.options import ENDED, LOST, WRONG_ARM, DriveOptions
from armguard.drivers.stop_alone import stop_alone
from armguard.exceptions import ArmguardError

CONNECT_TIMEOUT = 20.0
"""Greatest silence of a process that connects, in [s]; it ends itself a little earlier."""

RETRY = 0.5
"""Between the end of a process and the start of the next, in [s]."""

_LIBRARIES = {
    "ur": ("ur_rtde", "rtde_receive", "ur"),
    "franka": ("pylibfranka", "pylibfranka", "franka"),
    "ros2": ("cyclonedds", "cyclonedds", "dds"),
}
"""By driver: its library, a module of the library, and the extra that installs it."""

_TOLD = 100
"""Number of different lines of connecting processes that are reported once."""

_WAIT = 0.05
_LONGEST_LINE = 65536


class Report(msgspec.Struct):
    """Counts of all processes of a driver."""

    counts: Counts
    """Sums, and the longest of each duration."""
    connections: int = 0
    """Processes that drove."""
    lost: int = 0
    """Number of times that the robot was lost, or the process ended or hung."""
    measured: str = ""
    """Lines of a measurement."""
    problem: str = ""
    """Why there is no measurement, or the arm may not be at rest."""


class _Driver:
    """One process of a driver, and its messages."""

    def __init__(self, options: DriveOptions) -> None:
        reading, writing = os.pipe()
        described = msgspec.structs.replace(options, parent=os.getpid(), link=writing)
        try:
            self.process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "armguard.drivers",
                    msgspec.json.encode(described).decode(),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=[writing],
                start_new_session=True,  # a Ctrl-C is for this process, which ends it in due order
            )
        finally:
            os.close(writing)
        assert self.process.stdout is not None
        self.library = self.process.stdout.fileno()
        self.link = reading
        self.is_driving = False
        self.longest_silence, self.longest_end = options.longest_silence, options.longest_end
        self.heard = time.monotonic()
        self.counts = Counts()
        self.problem = ""
        self._received = {self.link: b"", self.library: b""}

    def read(self, timeout: float) -> list[tuple[str, str]]:
        """Received words and texts, after a wait of up to `timeout` [s]."""
        found = []
        open_ones = list(self._received)
        for descriptor in select.select(open_ones, [], [], timeout if open_ones else 0.0)[0]:
            data = os.read(descriptor, _LONGEST_LINE)
            if not data:
                del self._received[descriptor]
                continue
            if descriptor == self.link:
                # What the library's own threads print is no sign that the loop turns.
                self.heard = time.monotonic()
            *lines, rest = (self._received[descriptor] + data).split(b"\n")
            self._received[descriptor] = rest[-_LONGEST_LINE:]
            for line in lines:
                text = line.decode(errors="replace")
                if descriptor == self.library:
                    found.append((TELL, f"client library: {text}"))
                else:
                    word, _, rest_of_line = text.partition(" ")
                    found.append((word, rest_of_line))
        return found

    @property
    def is_hanging(self) -> bool:
        """Whether it has given no sign of life for too long."""
        longest = self.longest_silence if self.is_driving else CONNECT_TIMEOUT
        return not time.monotonic() - self.heard <= longest

    def close(self) -> None:
        """End it, and its descriptors."""
        self.process.kill()
        self.process.wait()
        os.close(self.link)
        assert self.process.stdout is not None
        self.process.stdout.close()


def check_library(driver: str) -> None:
    """Raise ArmguardError where the client library of a robot is not installed."""
    library, module, extra = _LIBRARIES[driver]
    if importlib.util.find_spec(module) is None:
        raise ArmguardError(
            f"driver {driver!r}",
            f"needs {library}, which is not installed",
            remedy=f"pip install 'armguard[{extra}]'",
        )


def watch(
    options: DriveOptions,
    tell: Callable[[str], None],
    is_ending: Callable[[], bool],
    duration: float,
) -> Report:
    """Drive a robot until the end, by as many processes as necessary.

    Args:
        options: What to drive.
        tell: Takes lines for people.
        is_ending: Whether to end now.
        duration: How long to drive at most, in [s].

    Returns:
        Counts.

    Raises:
        ArmguardError: Another robot answers than the cell file names.
    """
    report = Report(Counts())
    end = time.monotonic() + duration
    told: deque[str] = deque(maxlen=_TOLD)
    # A person's start acknowledges what was before it, and nothing that has happened since.
    is_first = options.is_first
    is_lost = False

    def is_over() -> bool:
        return is_ending() or time.monotonic() >= end

    while not is_over():
        driver = _Driver(msgspec.structs.replace(options, is_first=is_first))
        is_first = False
        try:
            code = _attend(driver, options, report, tell, told, is_over)
        except BaseException:
            # Whatever it is, a second Ctrl-C as well: the driver ends, and the arm stops.
            driver.process.kill()
            stop_alone(options)
            raise
        finally:
            driver.close()
            _add(report.counts, driver.counts)
        report.connections += driver.is_driving
        if code == 0:
            is_lost &= not driver.is_driving
            break
        if code == WRONG_ARM:
            problem = driver.problem or "it does not start"
            raise ArmguardError("driver", problem, remedy="see [robot.driver] in the cell file")
        is_lost |= driver.is_driving
        report.lost += driver.is_driving
        if driver.is_driving:
            told.clear()  # what is wrong now is news
        pause_end = time.monotonic() + RETRY
        while not is_over() and time.monotonic() < pause_end:
            time.sleep(_WAIT)
    if is_lost:
        report.problem = "the robot was lost: check that the arm is at rest"
    return report


def _attend(
    driver: _Driver,
    options: DriveOptions,
    report: Report,
    tell: Callable[[str], None],
    told: deque[str],
    is_over: Callable[[], bool],
) -> int:
    """Watch one process until it ends.

    Returns:
        Its exit code; 0 if this function ended it.
    """
    while driver.process.poll() is None:
        for word, text in driver.read(_WAIT):
            _take(driver, word, text, report, tell, told)
        if driver.is_hanging:
            driver.process.kill()
            _stop(options, "the driver's process hung and was killed", tell)
            return LOST
        if is_over():
            driver.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                driver.process.wait(driver.longest_end)
            break
    code = driver.process.returncode
    if code is None:
        driver.process.kill()
        _stop(options, "the driver's process does not end", tell)
        code = LOST
    elif code == ENDED:
        if is_over():
            code = 0
        else:
            tell("the driver's process was ended by a signal from elsewhere: another one starts")
    elif code not in (0, WRONG_ARM, LOST):
        # No other process can stop the arm now, even if this one was ending.
        how = "while it drove" if driver.is_driving else "while it connected"
        cause = f"the driver's process ended unexpectedly {how}"
        if code == -signal.SIGALRM:
            cause += ", because the robot did not answer the client library"
        _stop(options, cause, tell)
    for word, text in driver.read(0.0):
        _take(driver, word, text, report, tell, told)
    return code


def _stop(options: DriveOptions, cause: str, tell: Callable[[str], None]) -> None:
    """Stop the arm without the driver's process, and report why."""
    tell(f"{cause}: {stop_alone(options)}")


def _take(
    driver: _Driver,
    word: str,
    text: str,
    report: Report,
    tell: Callable[[str], None],
    told: deque[str],
) -> None:
    """Process a line of the driver; repeated lines are reported once."""
    if word == DRIVING:
        driver.is_driving = True
    elif word == LEAVING:
        driver.longest_silence = driver.longest_end
    elif word == COUNTS:
        with contextlib.suppress(msgspec.DecodeError):
            driver.counts = msgspec.json.decode(text, type=Counts)
    elif word == MEASURED:
        try:
            failed, measured = msgspec.json.decode(text, type=tuple[bool, str])
        except msgspec.DecodeError:
            failed, measured = True, "the measurement arrived incompletely"
        report.problem, report.measured = (measured, "") if failed else ("", measured)
    elif word == WRONG:
        driver.problem = text
    elif word == TELL:
        if not driver.is_driving:
            if text in told:
                return
            told.append(text)
        tell(text)


def _add(total: Counts, part: Counts) -> None:
    for name in total.__struct_fields__:
        mine, other = getattr(total, name), getattr(part, name)
        if isinstance(other, int):
            setattr(total, name, mine + other)
        elif other is not None:
            setattr(total, name, max(mine or 0.0, other))
