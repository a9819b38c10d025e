import os
import signal
import time
from pathlib import Path

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.faults.catalogue import Fault
from armguard.lab.faults.session import FaultyCell
from support.waiting import wait_until


def descendants(pid):
    """All processes that a process has started, and those that they have."""
    found = []
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        found += [int(child), *descendants(int(child))]
    return found


def test_a_cell_is_struck_and_ends_without_a_trace(tmp_path):
    before = set(descendants(os.getpid()))
    with FaultyCell(tmp_path) as cell:
        started = set(descendants(os.getpid())) - before
        assert len(started) == 6, "monitor, recorder, drives, driver, camera, view"
        wait_until(lambda: cell.verdicts.is_sound(time.monotonic(), 0.5))
        end_it = cell.strike(Fault("killed", "driver", "kill"), time.monotonic())
        wait_until(lambda: cell.verdicts.heard[-1].kinds)
        end_it()
        cell.check()
        # What is latched ends by a reset alone, once the driver is there again.
        wait_until(lambda: cell.reset() or cell.verdicts.is_sound(time.monotonic(), 0.5))
        full = cell.strike(Fault("full", "recorder", "full"), time.monotonic())
        wait_until(lambda: any("cannot be written" in line for _, line in cell.lines))
        full()
        cell.strike(Fault("hangs", "browser", "hang"), time.monotonic())()
        (drives,) = (
            pid
            for pid in descendants(os.getpid())
            if b'"type":"Drives"' in Path(f"/proc/{pid}/cmdline").read_bytes()
        )
        os.kill(drives, signal.SIGKILL)
        with pytest.raises(ArmguardError, match="the drives process: has ended by itself"):
            wait_until(lambda: cell.check())
        started |= set(descendants(os.getpid())) - before
    wait_until(lambda: not started & set(descendants(os.getpid())))
    assert cell.truth.stat().st_size > 0
