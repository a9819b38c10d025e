"""The demo as its user meets it: real processes, ended in every order."""

import json
import os
import re
import signal
import time
from pathlib import Path

import pytest
from demo_processes import RunningDemo, listening_sockets, wait_until

from armguard.demo.launcher import run_demo
from armguard.exceptions import ArmguardError
from armguard.streams import VerdictReader
from armguard.verdict import Level

RECORDINGS = Path(
    os.environ.get("ARMGUARD_RECORDINGS", Path(__file__).parents[2] / "../shared/data/human-motion")
)
SOON = 5.0
"""How long an end may take on a busy machine, in [s]."""


@pytest.fixture
def start(tmp_path):
    """Starts a demo and waits until its monitor speaks."""
    demos = []

    def start_demo(*arguments):
        demo = RunningDemo(*arguments, folder=tmp_path)
        demos.append(demo)
        demo.wait_for_verdicts()
        return demo

    yield start_demo
    for demo in demos:
        demo.__exit__()


def finish(demo):
    """What the demo printed, its exit code, and that nothing stayed behind."""
    out, err = demo.process.communicate(timeout=120)
    assert demo.wait_until_gone(SOON)
    assert "Traceback" not in err
    return out, err


def test_it_listens_on_the_loopback_interface_only_and_ends_when_asked(start, tmp_path):
    demo = start("--duration", "60", "--json")
    sockets = listening_sockets(demo.pids())
    assert len(demo.pids()) == 5
    assert len(sockets) == 1  # the page
    assert sockets[0].startswith("0100007F:")
    demo.process.terminate()
    out, err = finish(demo)
    assert demo.process.returncode == 0
    assert json.loads(out)["ticks"] > 0
    assert "armguard:" not in err
    assert not list(tmp_path.iterdir())


def test_nothing_outlives_a_launcher_that_is_killed(start):
    demo = start("--duration", "60", "--json")
    ports = listening_sockets(demo.pids())
    assert ports
    demo.process.kill()
    assert demo.wait_until_gone(SOON)
    assert demo.process.wait() == -signal.SIGKILL
    assert not listening_sockets(demo.pids())


def test_without_its_perception_it_ends_and_says_so(start):
    demo = start("--duration", "60", "--no-view", "--json")
    os.kill(demo.pid_of("perception"), signal.SIGKILL)
    out, err = finish(demo)
    assert demo.process.returncode == 1
    assert json.loads(out)["ticks"] > 0
    assert re.search(r"^armguard: the demo's perception process ended by SIGKILL", err, re.M)
    assert err.count("armguard:") == 1


def test_without_its_monitor_it_ends_and_says_so(start):
    demo = start("--duration", "60", "--json")
    os.kill(demo.pid_of("monitor"), signal.SIGKILL)
    out, err = finish(demo)
    assert demo.process.returncode == 1
    assert out == ""
    assert err.endswith("armguard: the monitor ended by SIGKILL\n")


def test_without_its_view_it_goes_on_and_a_robot_that_hangs_is_a_stop(start):
    demo = start("--duration", "60", "--json")
    os.kill(demo.pid_of("view"), signal.SIGKILL)
    with VerdictReader(demo.verdicts) as reader:
        before = reader.latest(timeout=10.0).sequence
        assert wait_until(lambda: reader.latest().sequence > before + 1000)
        os.kill(demo.pid_of("robot"), signal.SIGSTOP)
        assert wait_until(lambda: reader.latest(timeout=1.0).level is Level.STOP)
    demo.process.send_signal(signal.SIGINT)
    _, err = finish(demo)
    assert demo.process.returncode == 0
    assert "the page has ended" in err


def test_an_interrupt_before_the_first_tick_is_one_line(tmp_path):
    with RunningDemo("--duration", "60", "--no-view", folder=tmp_path) as demo:
        assert wait_until(lambda: list(tmp_path.glob("armguard-*/log")))
        begin = time.monotonic()
        demo.process.send_signal(signal.SIGINT)
        _, err = finish(demo)
    # Either nothing had been seen yet, or, on a quick machine, a few ticks.
    assert (demo.process.returncode, "interrupted" in err) in [(130, True), (0, False)]
    assert time.monotonic() - begin < 20.0


def test_a_page_whose_port_is_taken_is_a_mistake(tmp_path):
    with RunningDemo("--port", "1000000", folder=tmp_path) as demo:
        out, err = finish(demo)
    assert demo.process.returncode == 2
    assert out == ""
    assert re.fullmatch(r"armguard: port 1000000 [^\n]+\n", err)


def test_mistakes_are_raised_before_anything_is_started():
    for mistake in ({"duration": float("nan")}, {"duration": -1.0}, {"obstacle_count": -1}):
        with pytest.raises(ArmguardError):
            run_demo(**mistake)
    with pytest.raises(ArmguardError, match="port"):
        run_demo(port=-1)


@pytest.mark.skipif(
    not (RECORDINGS / "handover-0.csv").exists(),
    reason="no recordings there: set ARMGUARD_RECORDINGS to their folder",
)
def test_a_real_person_is_supervised_over_the_same_streams(tmp_path):
    person = str(RECORDINGS / "handover-0.csv")
    arguments = ["--person", person, "--duration", "6", "--no-view", "--json"]
    with RunningDemo(*arguments, folder=tmp_path) as demo:
        out, _ = finish(demo)
    assert demo.process.returncode == 0
    summary = json.loads(out)
    assert summary["received"] > 1000
    assert summary["levels"]["STOP"] > 0
    assert summary["min_contact_time"] >= 0.0
    assert summary["message_faults"] == {}
