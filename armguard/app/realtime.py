"""What a loop needs to be on time: scheduling, memory in RAM, garbage collected between ticks.

Real-time scheduling and locked memory are asked of Linux; what is refused is told, and the loop
runs on without. Garbage is collected in the idle time before a deadline, never in the middle of a
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
"""Before all ordinary work, and after whatever else on the machine was given more thought: after
the kernel's interrupt threads (50), for which a process that keeps them waiting waits."""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_MADV_DONTNEED = 4
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30
_CAP_IPC_LOCK = 14
_INITIAL_NAMESPACE = ["0", "0", "4294967295"]
_STATUS, _USER_MAP = Path("/proc/self/status"), Path("/proc/self/uid_map")
_MAPS = Path("/proc/self/maps")


class Realtime(NamedTuple):
    """What the system granted."""

    priority: int
    """Of real-time scheduling; 0: ordinary scheduling."""
    memory_locked: bool
    refusals: tuple[str, ...]
    """A line for each thing that was refused: what, and how to allow it."""


@contextlib.contextmanager
def request_realtime() -> Iterator[Realtime]:
    """Inside, the calling thread has what the system grants; afterwards all is as before.

    A thread that was started with real-time scheduling keeps its own policy and priority.
    """
    with contextlib.ExitStack() as undo:
        _sharpen_timer(undo)
        granted, refused = _schedule(undo)
        unlocked = _lock_memory(undo)
        refusals = tuple(line for line in (refused, unlocked) if line)
        yield Realtime(granted, not unlocked, refusals)


def release_compiler() -> None:
    """Give back the memory that the compiler's code takes: some 50 MB that no tick uses.

    To be called when all kernels are there, and before memory is locked, which would keep it in RAM
    for good. Code that is called again is read from its file again.
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
    """Let sleeps of ordinary scheduling end when they should, not up to 50 µs later."""
    prctl = ctypes.CDLL(None).prctl
    before = prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0)
    if before > 0 and prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0:
        undo.callback(prctl, _PR_SET_TIMERSLACK, before, 0, 0, 0)


def _schedule(undo: contextlib.ExitStack) -> tuple[int, str]:
    """The priority granted, 0 if none; and if none, why."""
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
    """Keep in RAM what is in use, and what comes into use; if that is not to be had, why."""
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
"""So many times one of Python's own thresholds: from there on collections may cost a late tick."""


class IdleCollector:
    """Collects when told that there is time; a context in which Python itself does not.

    Args:
        clock: Tells how long collections take.
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
        """Collect what is due, if that fits into `idle` [s] by what it cost the last time.

        Where collection was switched off before, it stays so.
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
