"""However the process of a monitor ends, an arm that obeys its verdicts stands."""

import os
import signal
import subprocess
import sys
import time

import pytest

from armguard.streams import Publisher, VerdictReader
from armguard.verdict import Level, ReasonKind

PATIENCE = 300.0  # a cold start compiles
SOON = 30.0
PERIOD, LATENCY = 0.001, 0.05  # [s]; a busy machine holds up any process for a while
CELL = f"""
[robot]
name = "panda"
operating = "published"
[sources.camera]
[thresholds]
latency = {LATENCY}
joint_timeout = 1.0
source_timeout = 1.0
"""
NAMES = [f"panda_joint{number}" for number in range(1, 8)]
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]

RUN = """
import sys
from pathlib import Path
from armguard.app.cell.cell import Cell
from armguard.app.loop import Observer, RunOptions, run

class Failing(Observer):
    def observe(self, loop, verdict):
        if Path(sys.argv[1], "fail").exists():
            raise ZeroDivisionError("as it was asked to")

run(
    Cell.load(Path(sys.argv[1], "cell.toml")),
    RunOptions(*(f"ipc://{sys.argv[1]}/{name}" for name in ("obstacles", "joints", "verdicts"))),
    observer=Failing(),
)
"""


class RunningCell:
    """A monitor in a process of its own, and an arm at rest with a ball far away."""

    def __init__(self, folder):
        (folder / "cell.toml").write_text(CELL)
        self.process = subprocess.Popen(
            [sys.executable, "-c", RUN, str(folder)], stderr=subprocess.PIPE, text=True
        )
        self._arm = Publisher(f"ipc://{folder}/joints")
        self._camera = Publisher(f"ipc://{folder}/obstacles", "camera")
        self.reader = VerdictReader(f"ipc://{folder}/verdicts")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()
        for one in (self._arm, self._camera, self.reader):
            one.close()

    def publish(self):
        """Tell the monitor of the present, and hear what it says."""
        now = time.monotonic()
        self._arm.joints(now, NAMES, READY, [0.0] * 7)
        self._camera.update(["ball"], now, [[9.0, 0.0, 0.5]], radius=0.1)
        time.sleep(0.005)
        return self.reader.latest()

    def publish_until(self, condition, patience):
        """Go on until the condition holds."""
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, self.reader.latest()
            self.publish()

    def publish_for(self, seconds):
        """Go on for so long."""
        until = time.monotonic() + seconds
        self.publish_until(lambda: time.monotonic() > until, seconds + SOON)


@pytest.fixture
def cell(tmp_path):
    """One whose monitor lets the arm move."""
    with RunningCell(tmp_path) as running:
        running.publish_until(lambda: running.reader.speed_scale() == 1.0, PATIENCE)
        yield running


def check_last_word(verdict, words):
    assert (verdict.level, verdict.speed_scale, verdict.stop) == (Level.STOP, 0.0, "brake")
    (reason,) = verdict.reasons
    assert reason.kind is ReasonKind.ENDED
    assert words in reason.detail


@pytest.mark.hazard("H-07")
def test_the_last_word_of_a_loop_that_fails_is_stop(cell, tmp_path):
    (tmp_path / "fail").touch()
    assert cell.process.wait(SOON) != 0
    cell.publish_for(0.3)
    check_last_word(cell.reader.latest(), "ZeroDivisionError: as it was asked to")
    assert "as it was asked to" in cell.process.stderr.read(), "and it is no secret"


def test_the_last_word_of_a_loop_that_is_told_to_end_is_stop(cell):
    cell.process.send_signal(signal.SIGINT)
    assert cell.process.wait(SOON) == 0
    cell.publish_for(0.3)
    check_last_word(cell.reader.latest(), "asked to end")


@pytest.mark.hazard("H-07")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_without_a_last_word_the_arm_stands_by_the_deadline(cell, number):
    os.kill(cell.process.pid, number)
    os.waitid(os.P_PID, cell.process.pid, os.WEXITED | os.WSTOPPED | os.WNOWAIT)
    silenced = time.monotonic()
    cell.publish_for(0.3)
    last = cell.reader.latest()
    assert last.level is not Level.STOP
    assert last.valid_until <= silenced + PERIOD + LATENCY
    assert cell.reader.silent(last.valid_until + 1e-9)
    assert cell.reader.speed_scale() == 0.0
    if number == signal.SIGSTOP:
        os.kill(cell.process.pid, signal.SIGCONT)
        cell.publish_until(lambda: not cell.reader.silent(), SOON)
