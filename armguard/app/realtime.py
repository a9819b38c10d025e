"""Real-time properties of a loop: scheduling, locked memory, garbage collection between ticks.

Real-time scheduling and locked memory are requested from Linux. A refusal is reported, and the loop
runs without. Garbage is collected in the idle time before a deadline, never in the middle of a
tick.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import resource
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from armguard.clock import Clock

PRIORITY = 10
"""Real-time priority: above all ordinary work, and below the kernel's interrupt threads (50), which
the loop itself needs."""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_MADV_DONTNEED = 4
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30
_CAP_IPC_LOCK = 14
_INITIAL_NAMESPACE = ["0", "0", "4294967295"]
_STATUS, _USER_MAP = Path("/proc/self/status"), Path("/proc/self/uid_map")
_MAPS = Path("/proc/self/maps")


class Realtime(NamedTuple):
    """Real-time properties that the system granted."""

    priority: int
    """Priority of real-time scheduling; 0: ordinary scheduling."""
    memory_locked: bool
    refusals: tuple[str, ...]
    """One line for each refusal: what was refused, and how to allow it."""


@contextlib.contextmanager
def request_realtime() -> Iterator[Realtime]:
    """Context in which the calling thread has what the system grants; restores all afterwards.

    A thread that was started with real-time scheduling keeps its own policy and priority.
    """
    with contextlib.ExitStack() as undo:
        _sharpen_timer(undo)
        granted, refused = _schedule(undo)
        unlocked = _lock_memory(undo)
        refusals = tuple(line for line in (refused, unlocked) if line)
        yield Realtime(granted, not unlocked, refusals)


def release_compiler() -> None:
    """Release the memory of the compiler's code: some 50 MB that no tick uses.

    Must be called after all kernels are compiled, and before memory is locked. Code that is called
    again is loaded from its file again.
    """
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    for line in _MAPS.read_text(errors="replace").splitlines():
        addresses, rights, *_, file = line.split(maxsplit=5)
        # Code alone: it is as it stands in the file, while data may have changed.
        if rights == "r-xp" and "libllvmlite" in file:
            start, end = (int(address, 16) for address in addresses.split("-"))
            madvise(start, end - start, _MADV_DONTNEED)


def _sharpen_timer(undo: contextlib.ExitStack) -> None:
    """Set the timer slack to the minimum, so that sleeps do not end up to 50 µs late."""
    prctl = ctypes.CDLL(None).prctl
    before = prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0)
    if before > 0 and prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0:
        undo.callback(prctl, _PR_SET_TIMERSLACK, before, 0, 0, 0)


def _schedule(undo: contextlib.ExitStack) -> tuple[int, str]:
    """Request real-time scheduling; returns the priority (0: refused), and why it was refused."""
    before, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    policy = before & ~os.SCHED_RESET_ON_FORK
    if policy in (os.SCHED_FIFO, os.SCHED_RR):
        wanted = [parameters.sched_priority]
    else:
        policy = os.SCHED_FIFO
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        wanted = [PRIORITY, *([limit] if 0 < limit < PRIORITY else [])]
    for level in wanted:
        try:
            os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, os.sched_param(level))
        except OSError:
            continue
        undo.callback(_unschedule, before, parameters)
        return level, ""
    return 0, (
        "real-time scheduling is refused, so ticks may come late on a busy machine; to allow it: "
        f"`ulimit -r {PRIORITY}`, `rtprio {PRIORITY}` in /etc/security/limits.conf, or CAP_SYS_NICE"
    )


def _unschedule(policy: int, parameters: os.sched_param) -> None:
    try:
        os.sched_setscheduler(0, policy, parameters)
    except PermissionError:
        # Only the privileged may let a thread's children inherit again; that much stays.
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)


def _lock_memory(undo: contextlib.ExitStack) -> str:
    """Lock present and future memory in RAM; returns why it was refused, else an empty text."""
    libc = ctypes.CDLL(None, use_errno=True)
    # With a limit, memory would be refused to the loop itself as soon as it needs more.
    if not _may_lock_all():
        reason = "the limit on it is too low"
    # On fault: what was only reserved must not fill the machine.
    elif libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        reason = os.strerror(ctypes.get_errno())
    else:
        undo.callback(libc.munlockall)
        return ""
    return (
        f"memory is not locked ({reason}), so ticks may wait for a disk where memory is short; to "
        "allow it: `ulimit -l unlimited`, `memlock unlimited` in /etc/security/limits.conf, or "
        "CAP_IPC_LOCK"
    )


def _may_lock_all() -> bool:
    """Whether there is no limit on locked memory for this process."""
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        return True
    try:
        rights = dict(line.split(":\t", 1) for line in _STATUS.read_text().splitlines())
        # In a user namespace, capabilities do not lift limits.
        privileged = _USER_MAP.read_text().split() == _INITIAL_NAMESPACE
        return privileged and bool(int(rights["CapEff"], 16) >> _CAP_IPC_LOCK & 1)
    except (OSError, ValueError, KeyError):
        return False


OVERDUE = 5
"""At this multiple of Python's own thresholds a collection is forced, even if a tick is late."""


class IdleCollector:
    """Collects garbage in idle time; a context in which Python's own collection is switched off.

    Args:
        clock: Measures how long collections take.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._costs = [0.0, 0.0, 0.0]
        self._was_enabled = False

    def __enter__(self) -> IdleCollector:
        self._was_enabled = gc.isenabled()
        gc.disable()
        gc.collect()
        gc.freeze()
        self._costs = [self._collect(2)] * 3
        return self

    def __exit__(self, *_: object) -> None:
        gc.unfreeze()
        if self._was_enabled:
            gc.enable()

    def collect(self, idle: float) -> None:
        """Collect the generations that are due, if their last duration fits into `idle` [s].

        If collection was switched off before the context, nothing is collected.
        """
        if not self._was_enabled:
            return
        due = overdue = False
        counts, thresholds = gc.get_count(), gc.get_threshold()
        for count, threshold in zip(counts, thresholds, strict=True):
            due = due or 0 < threshold < count
            overdue = overdue or 0 < OVERDUE * threshold < count
        if not due:
            return
        for generation in (2, 1, 0):
            if 0 < thresholds[generation] < counts[generation] and (
                overdue or self._costs[generation] <= idle
            ):
                self._costs[generation] = self._collect(generation)
                return

    def _collect(self, generation: int) -> float:
        begin = self._clock.now()
        gc.collect(generation)
        return self._clock.now() - begin
