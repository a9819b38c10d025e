"""Watching a driver's process, without a robot or its client library."""

import sys
import time
from collections import deque

import pytest

from armguard.drivers import options as options_of_drivers
from armguard.drivers import watch as watching
from armguard.exceptions import ArmguardError
from support.driven_cell import OPTIONS


def pretend(monkeypatch, tmp_path, script):
    """Have a shell script run in place of the driver's process."""
    process = tmp_path / "process"
    process.write_text(f"#!/bin/sh\n{script}")
    process.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(process))


def test_what_the_library_prints_is_no_sign_of_life(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/echo")  # prints, and sends nothing by the link
    driver = watching._Driver(OPTIONS)
    try:
        driver.process.wait()
        driver.heard = 0.0
        lines = driver.read(1.0) + driver.read(0.1)
        assert any("client library" in text for _, text in lines)
        assert driver.heard == 0.0
    finally:
        driver.close()


@pytest.mark.hazard("H-20")
def test_an_arm_is_told_to_stop_whatever_ends_the_watching(monkeypatch):
    stopped = []

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys, "executable", "/bin/true")
    monkeypatch.setattr(watching, "_attend", interrupt)
    monkeypatch.setattr(watching, "stop_alone", stopped.append)
    with pytest.raises(KeyboardInterrupt):
        watching.watch(OPTIONS, lambda _: None, lambda: False, 10.0)
    assert stopped == [OPTIONS]


@pytest.mark.hazard("H-20")
def test_an_arm_whose_driver_crashes_while_it_is_told_to_end_is_stopped(monkeypatch, tmp_path):
    pretend(monkeypatch, tmp_path, "trap 'kill -SEGV $$' TERM\nwhile :; do sleep 0.01; done\n")
    stopped, lines = [], []
    monkeypatch.setattr(watching, "stop_alone", stopped.append)
    ends = time.monotonic() + 0.3  # the trap is set by then
    watching.watch(OPTIONS, lines.append, lambda: time.monotonic() > ends, 10.0)
    assert len(stopped) == 1
    assert "ended unexpectedly" in lines[-1]


@pytest.mark.hazard("H-24")
def test_a_driver_that_somebody_else_ends_is_told_and_replaced(monkeypatch, tmp_path):
    pretend(monkeypatch, tmp_path, "trap 'exit 4' TERM\nkill $$\n")
    lines, firsts = [], []

    class Driver(watching._Driver):
        def __init__(self, options):
            super().__init__(options)
            firsts.append(options.is_first)

    monkeypatch.setattr(watching, "RETRY", 0.0)
    monkeypatch.setattr(watching, "_Driver", Driver)
    watching.watch(OPTIONS, lines.append, lambda: len(lines) == 2, 10.0)
    assert firsts == [True, False]
    assert all("ended by a signal from elsewhere" in line for line in lines)


def test_a_driver_that_is_told_to_end_has_not_been_lost(monkeypatch, tmp_path):
    pretend(monkeypatch, tmp_path, "trap 'exit 4' TERM\nwhile :; do sleep 0.01; done\n")
    lines = []
    ends = time.monotonic() + 0.3  # the trap is set by then
    report = watching.watch(OPTIONS, lines.append, lambda: time.monotonic() > ends, 10.0)
    assert (report.lost, lines) == (0, [])


@pytest.mark.hazard("H-20")
@pytest.mark.parametrize("ends", ["exit 3", "while :; do sleep 0.01; done"])
def test_a_driver_that_does_not_end_with_the_arm_at_rest_is_a_problem(monkeypatch, tmp_path, ends):
    pretend(monkeypatch, tmp_path, f"trap '{ends}' TERM\nwhile :; do sleep 0.01; done\n")
    monkeypatch.setattr(watching, "stop_alone", lambda _: "")
    monkeypatch.setattr(options_of_drivers, "END_TIMEOUT", 0.0)
    ends_at = time.monotonic() + 0.3  # the trap is set by then

    class Driver(watching._Driver):
        def __init__(self, options):
            super().__init__(options)
            self.is_driving = True

    monkeypatch.setattr(watching, "_Driver", Driver)
    report = watching.watch(OPTIONS, lambda _: None, lambda: time.monotonic() > ends_at, 10.0)
    assert "check that the arm is at rest" in report.problem


def test_a_driver_that_brings_its_arm_to_rest_is_not_hanging(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/true")
    driver, report = watching._Driver(OPTIONS), watching.Report(watching.Counts())
    try:
        for word in (watching.DRIVING, watching.LEAVING):
            watching._take(driver, word, "", report, lambda _: None, deque())
        driver.heard = time.monotonic() - OPTIONS.stop_within
        assert not driver.is_hanging
        driver.heard -= 10.0
        assert driver.is_hanging
    finally:
        driver.close()


def test_a_measurement_that_arrives_in_part_is_a_problem(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/true")
    driver, report = watching._Driver(OPTIONS), watching.Report(watching.Counts())
    try:
        watching._take(driver, watching.MEASURED, '[false, "reac', report, lambda _: None, deque())
    finally:
        driver.close()
    assert (bool(report.problem), report.measured) == (True, "")


def test_lines_of_processes_that_connect_are_told_once_and_not_kept_for_ever(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/true")
    driver, report = watching._Driver(OPTIONS), watching.Report(watching.Counts())
    lines, told = [], deque(maxlen=watching._TOLD)
    try:
        for k in range(1000):
            for text in ("the same", f"line {k}"):
                watching._take(driver, watching.TELL, text, report, lines.append, told)
        assert len(told) == watching._TOLD
        assert set(lines) == {"the same", *(f"line {k}" for k in range(1000))}
        assert lines.count("the same") < 1000 / 50
        driver.is_driving = True
        for _ in range(2):
            watching._take(driver, watching.TELL, "a line a second", report, lines.append, told)
        assert lines[-2:] == ["a line a second"] * 2
        assert len(told) == watching._TOLD
    finally:
        driver.close()


def test_counts_are_added_and_what_was_not_measured_stays_so():
    total = watching.Counts(stops=1, longest_gap=0.1)
    watching._add(total, watching.Counts(stops=2, longest_gap=0.01))
    assert (total.stops, total.longest_gap, total.obeyed_p99) == (3, 0.1, None)
    watching._add(total, watching.Counts(obeyed_p99=0.002, obeyed_max=0.004))
    watching._add(total, watching.Counts(obeyed_p99=0.001))
    assert (total.obeyed_p99, total.obeyed_max) == (0.002, 0.004)


@pytest.mark.parametrize(("driver", "extra"), [("ur", "ur"), ("ros2", "dds")])
def test_what_is_not_installed_is_told_with_the_remedy(monkeypatch, driver, extra):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ArmguardError, match=rf"pip install 'armguard\[{extra}\]'"):
        watching.check_library(driver)


def test_a_persons_start_is_that_of_the_first_process_alone(monkeypatch):
    """Also where that one never drove: what happened meanwhile, nobody has acknowledged."""
    firsts = []

    class Driver(watching._Driver):
        def __init__(self, options):
            super().__init__(options)
            firsts.append(options.is_first)

    monkeypatch.setattr(sys, "executable", "/bin/true")
    monkeypatch.setattr(watching, "RETRY", 0.0)
    monkeypatch.setattr(watching, "_Driver", Driver)
    monkeypatch.setattr(watching, "_attend", lambda *_: watching.LOST)
    watching.watch(OPTIONS, lambda _: None, lambda: len(firsts) == 3, 10.0)
    assert firsts == [True, False, False]
