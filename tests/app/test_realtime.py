"""What is said to be granted is what the kernel has, and afterwards everything is as before."""

import ctypes
import gc
import os
import resource
import subprocess
import sys
import threading
import weakref
from pathlib import Path

import pytest

from armguard.app import realtime
from armguard.app.realtime import (
    OVERDUE,
    PRIORITY,
    IdleCollector,
    request_realtime,
)

ANOTHER_USER = 65534


def locked_memory():
    """In kB."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmLck:")[1].split()[0])


def see_all():
    return (
        os.sched_getscheduler(0),
        os.sched_getparam(0).sched_priority,
        locked_memory(),
        ctypes.CDLL(None).prctl(30, 0, 0, 0, 0),
    )


def test_what_is_said_is_what_is_and_all_is_undone():
    before = see_all()
    with request_realtime() as granted:
        policy, priority, locked, slack = see_all()
        assert granted.priority == priority
        assert granted.priority in (0, PRIORITY)
        if granted.priority:
            assert policy == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        else:
            assert policy == before[0]
        assert granted.memory_locked == (locked > 0)
        assert slack <= 1
        assert len(granted.refusals) == (granted.priority == 0) + (not granted.memory_locked)
    assert see_all() == before


def test_neither_children_nor_threads_have_any_of_it():
    script = "import os; print(os.sched_getscheduler(0), open('/proc/self/status').read())"
    seen = []
    with request_realtime():
        thread = threading.Thread(target=lambda: seen.append(os.sched_getscheduler(0)))
        thread.start()
        thread.join()
        child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert seen == [os.SCHED_OTHER]
    assert child.stdout.split()[0] == str(os.SCHED_OTHER)
    assert int(child.stdout.split("VmLck:")[1].split()[0]) == 0


def test_a_thread_with_real_time_scheduling_keeps_its_own():
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(3))
    except PermissionError:
        pytest.skip("needs the right to real-time scheduling")
    try:
        with request_realtime() as granted:
            assert granted.priority == 3
            assert os.sched_getscheduler(0) == os.SCHED_RR | os.SCHED_RESET_ON_FORK
        assert os.sched_getscheduler(0) == os.SCHED_RR
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


UNPRIVILEGED = """
import os, resource, sys
from armguard.app.realtime import request_realtime
user, limit = map(int, sys.argv[1:])
try:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (limit, limit))
except ValueError:
    sys.exit("limits cannot be raised")
resource.setrlimit(resource.RLIMIT_MEMLOCK, (2**23, 2**23))
os.setuid(user)
with request_realtime() as granted:
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    print(granted.priority, policy, granted.memory_locked, os.sched_getparam(0).sched_priority)
    room = bytearray(2**26)
assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
print(*granted.refusals, sep="\\n")
"""


@pytest.mark.skipif(os.getuid() != 0, reason="needs the right to give up rights")
@pytest.mark.parametrize(("limit", "priority"), [(0, 0), (4, 4), (30, 10)])
def test_without_privileges_the_limits_count(limit, priority):
    arguments = [sys.executable, "-c", UNPRIVILEGED, str(ANOTHER_USER), str(limit)]
    result = subprocess.run(arguments, capture_output=True, text=True)
    if "limits cannot be raised" in result.stderr:
        pytest.skip("needs the right to raise limits")
    assert result.returncode == 0, result.stderr
    policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
    granted, *refusals = result.stdout.splitlines()
    assert granted == f"{priority} {policy} False {priority}"
    assert len(refusals) == 1 + (priority == 0)


@pytest.mark.parametrize(("limit", "expected"), [(4, 4), (10, 10), (30, 10), (0, 0), (-1, 0)])
def test_a_limit_below_the_priority_is_made_use_of(limit, expected, monkeypatch):
    asked = []

    def schedule(process, policy, parameters):
        asked.append(parameters.sched_priority)
        if not parameters.sched_priority <= limit:
            raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit, limit))
    with request_realtime() as granted:
        assert granted.priority == expected
    assert max(asked) <= 10


def test_each_refusal_is_a_line_that_says_what_to_do(monkeypatch):
    def refuse(*arguments):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(realtime, "_may_lock_all", lambda: False)
    before = see_all()
    with request_realtime() as granted:
        assert granted[:2] == (0, False)
        assert see_all()[:3] == before[:3]
    scheduling, memory = granted.refusals
    for line, words in (
        (scheduling, ("`ulimit -r 10`", "limits.conf", "CAP_SYS_NICE")),
        (memory, ("`ulimit -l unlimited`", "limits.conf", "CAP_IPC_LOCK")),
    ):
        assert "\n" not in line
        assert all(word in line for word in words)


@pytest.mark.parametrize(
    ("limit", "capabilities", "namespace", "may"),
    [
        (resource.RLIM_INFINITY, "0", "0 0 4294967295", True),
        (2**40, "0", "0 0 4294967295", False),
        (2**40, f"{1 << 14:x}", "         0          0 4294967295\n", True),
        (2**40, f"{(1 << 41) - 1 - (1 << 14):x}", "0 0 4294967295", False),
        (2**40, f"{1 << 14:x}", "0 1000 1", False),
        (2**40, "", "0 0 4294967295", False),
    ],
)
def test_memory_is_locked_only_without_a_limit(
    limit, capabilities, namespace, may, monkeypatch, tmp_path
):
    """A lock that the limit cuts short would let the loop's own memory run out."""
    status, user_map = tmp_path / "status", tmp_path / "uid_map"
    status.write_text(f"Name:\tpython\nCapEff:\t{capabilities}\nVmLck:\t0 kB\n")
    user_map.write_text(namespace)
    monkeypatch.setattr(realtime, "_STATUS", status)
    monkeypatch.setattr(realtime, "_USER_MAP", user_map)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit, limit))
    assert realtime._may_lock_all() == may


COMPILER = """
import re
from pathlib import Path

import armguard
from armguard.app.realtime import release_compiler
from armguard.jit import kernel

def measure():
    maps = Path("/proc/self/smaps").read_text()
    sizes = re.findall(r" r-xp .*libllvmlite.*\\n(?:\\w+: .*\\n)*?Rss: +(\\d+) kB", maps)
    return sum(map(int, sizes))

obstacles = armguard.Obstacles()  # which loads kernels, or compiles them
before = measure()
release_compiler()
print(before, measure())
obstacles.update(["hand"], 1.0, [[2.0, 0.0, 0.6]], radius=0.1)

@kernel
def double(x):
    return 2.0 * x

assert double(3.0) == 6.0
"""


def test_the_compiler_takes_no_memory_and_is_there_where_it_is_called_again(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(COMPILER)
    told = subprocess.run([sys.executable, program], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    before, after = map(int, told.stdout.split())
    assert before > 10_000
    assert after < 0.1 * before


THRESHOLDS = (50, 3, 3)


@pytest.fixture(autouse=True)
def thresholds():
    before = gc.get_threshold()
    gc.set_threshold(*THRESHOLDS)
    yield
    gc.set_threshold(*before)
    gc.enable()


class SlowClock:
    """Every look at it takes `step` seconds, so that collections cost as much."""

    def __init__(self, step=0.0):
        self.step = step
        self.time = 0.0

    def now(self):
        self.time += self.step
        return self.time

    def sleep_until(self, deadline):
        self.time = max(self.time, deadline)


class Knot:
    """Nothing but a collection gets rid of it."""

    def __init__(self):
        self.itself = self


def make_knots(count):
    return [weakref.ref(Knot()) for _ in range(count)]


def count_living(knots):
    return sum(knot() is not None for knot in knots)


@pytest.mark.parametrize("enabled", [True, False])
def test_python_does_not_collect_inside_and_does_as_before_afterwards(enabled):
    (gc.enable if enabled else gc.disable)()
    frozen = gc.get_freeze_count()
    seen = []

    def be_interrupted():
        with IdleCollector(SlowClock()):
            seen.extend([gc.isenabled(), gc.get_freeze_count() > frozen])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        be_interrupted()
    assert seen == [False, True]
    assert gc.isenabled() == enabled
    assert gc.get_freeze_count() == 0


def test_garbage_goes_where_there_is_time_for_it():
    with IdleCollector(SlowClock(0.001)) as collector:
        knots = make_knots(2 * THRESHOLDS[0])
        collector.collect(0.0005)
        assert count_living(knots) == len(knots)
        collector.collect(0.0015)
        assert count_living(knots) == 0


@pytest.mark.parametrize(("idle", "wait"), [(0.0, OVERDUE), (1.0, 1)])
def test_garbage_never_grows_without_bounds(idle, wait):
    """Neither what dies at once nor what dies when it is old, be there ever so little time."""
    living, kept, most = set(), [], 0
    rounds = (THRESHOLDS[1] + 1) * (THRESHOLDS[2] + 1)
    with IdleCollector(SlowClock(0.001)) as collector:
        for _ in range(3000):
            fresh = [Knot() for _ in range(20)]
            living.update(weakref.ref(knot, living.discard) for knot in fresh)
            kept = [*kept[-200:], *fresh[:10]]
            del fresh
            collector.collect(idle)
            most = max(most, len(living))
    # Each object is in a dictionary and a list as well, so a knot counts for less than one.
    assert most < 200 + 2 * wait * THRESHOLDS[0] * rounds < 30_000


def test_old_generations_are_collected_too_where_only_the_youngest_fits():
    """Their cost is that of everything that lives; time for it may never come."""
    clock = SlowClock()
    with IdleCollector(clock) as collector:
        collected = []

        def watch(phase, info):
            if phase == "start":
                clock.time += 0.01 if info["generation"] else 0.0001
                collected.append(info["generation"])

        gc.callbacks.append(watch)
        try:
            for _ in range(2000):
                make_knots(20)
                collector.collect(0.001)
        finally:
            gc.callbacks.remove(watch)
    assert collected.count(0) > collected.count(1) > collected.count(2) > 0
    # Once for each of the two to see what it costs; from then on when they are overdue.
    assert collected.count(1) < collected.count(0) / THRESHOLDS[1] / 2


def test_who_switched_collection_off_has_it_off():
    gc.disable()
    with IdleCollector(SlowClock()) as collector:
        knots = make_knots(10 * OVERDUE * THRESHOLDS[0])
        collector.collect(10.0)
        assert count_living(knots) == len(knots)
    gc.enable()
    gc.set_threshold(0)
    with IdleCollector(SlowClock()) as collector:
        knots = make_knots(100)
        collector.collect(10.0)
        assert count_living(knots) == len(knots)
