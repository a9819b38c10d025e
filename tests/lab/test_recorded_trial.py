"""The most telling part of a recording, as a trial."""

import math

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.recorded_trial import read_trial
from armguard.monitor import Monitor
from armguard.obstacles import Frame, Obstacles
from armguard.recording import Recorder
from armguard.robot import Robot
from armguard.verdict import Level
from support.panda_monitor import HOME, STILL, panda
from support.trials import RATE, lead, make_robot, make_trial

SETTINGS = {"rate": RATE, "operating": "published"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of a second of nothing, and of a ball that comes and goes; and its verdicts."""
    path = tmp_path_factory.mktemp("trial") / "ball.mcap"
    obstacles = Obstacles()
    monitor = Monitor(make_robot(), obstacles, **SETTINGS)
    first = 1.0
    with Recorder(path, monitor) as recorder:
        obstacles.add_static("post", [9.0, 0.0, 0.5], 0.1)
        for number in range(round(first * RATE)):
            obstacles.update(["far"], number / RATE, [[30.0, 0.0, 0.5]], radius=0.1, source="eye")
            monitor.step(number / RATE, HOME, STILL)
        obstacles.remove(["far"], source="eye")
        obstacles.update([], first, radius=(), source="eye")
        verdicts = []
        for tick in make_trial(0.9):
            obstacles.update([], first + tick.stamp, source="eye")
            if tick.tell is not None:
                _, place, pace = tick.tell.args
                obstacles.update(["ball"], first + tick.stamp, [place], [pace], radius=0.1)
            verdicts.append(monitor.step(first + tick.stamp, tick.q, tick.v))
        assert recorder.close() == ""
    return path, verdicts


def try_on(trial, **settings):
    obstacles = Obstacles()
    obstacles.add_static("post", [9.0, 0.0, 0.5], 0.1)
    return lead(Monitor(make_robot(), obstacles, **{**SETTINGS, **settings}), trial)


def test_a_trial_gives_the_verdicts_that_were_recorded(recorded):
    path, verdicts = recorded
    trial = read_trial(path, panda(), RATE)
    assert len(trial) == round(2.5 * RATE)
    again = try_on(trial)[-len(verdicts) :]
    assert [one.level for one in again] == [one.level for one in verdicts]
    assert [one.contact_time for one in again] == [one.contact_time for one in verdicts]


def test_the_part_with_the_most_changes_is_taken_and_what_was_told_before_it(recorded):
    path, verdicts = recorded
    levels = [one.level for one in verdicts]
    assert set(levels) >= {Level.CLEAR, Level.AWARE}
    part = read_trial(path, panda(), RATE, seconds=1.2)
    assert len(part) == round(1.2 * RATE)
    stamps = np.array([tick.stamp for tick in part])
    np.testing.assert_allclose(np.diff(stamps), 1.0 / RATE, rtol=1e-9)
    assert stamps[0] > 0.5
    said = {one.level for one in try_on(part)}
    assert len(said) >= 3, "the quiet beginning would show one"


def test_of_a_recording_at_a_higher_rate_fewer_ticks_are_taken(recorded):
    path, _ = recorded
    trial = read_trial(path, panda(), RATE / 4.0)
    stamps = np.array([tick.stamp for tick in trial])
    np.testing.assert_allclose(np.diff(stamps), 4.0 / RATE, rtol=1e-6)
    assert len(read_trial(path, panda(), 10.0 * RATE)) == round(2.5 * RATE)


def test_resets_and_payloads_are_told_as_well(tmp_path):
    obstacles = Obstacles(sources=[])
    monitor = Monitor(make_robot(), obstacles, **SETTINGS)
    verdicts = []
    with Recorder(tmp_path / "told.mcap", monitor) as recorder:
        for number in range(40):
            if number == 10:
                monitor.payload = 0.2
            if number == 20:
                monitor.reset()
            q = np.full(3, math.nan) if number == 15 else HOME
            verdicts.append(monitor.step(number / RATE, q, STILL))
        assert recorder.close() == ""
    trial = read_trial(tmp_path / "told.mcap", panda(), RATE)
    again = Monitor(make_robot(), Obstacles(sources=[]), **SETTINGS)
    assert again.payload > 0.2
    assert lead(again, trial) == verdicts
    assert again.payload == 0.2
    assert verdicts[19].level is Level.STOP
    assert verdicts[19].reasons


def test_a_recording_of_another_arm_is_refused(recorded):
    with pytest.raises(ArmguardError, match=r"ball\.mcap: is of an arm with joints panda_joint1"):
        read_trial(recorded[0], Robot.load("ur10"), RATE)


def test_a_recording_without_joint_states_is_refused(tmp_path):
    with Recorder(tmp_path / "none.mcap", Monitor(make_robot(), Obstacles())) as recorder:
        assert recorder.close() == ""
    with pytest.raises(ArmguardError, match="has no joint states"):
        read_trial(tmp_path / "none.mcap", panda(), RATE)


def test_what_the_table_does_not_take_is_told_by_the_file(tmp_path):
    obstacles = Obstacles(frames={"lens": Frame(np.eye(3), np.zeros(3))})
    monitor = Monitor(make_robot(), obstacles, **SETTINGS)
    with Recorder(tmp_path / "lens.mcap", monitor) as recorder:
        obstacles.update(["ball"], 0.0, [[2.0, 0.0, 0.0]], radius=0.1, frame="lens")
        monitor.step(0.0, HOME, STILL)
        assert recorder.close() == ""
    trial = read_trial(tmp_path / "lens.mcap", panda(), RATE)
    with pytest.raises(
        ArmguardError, match=r"lens\.mcap: has a ObstaclesMessage that cannot be.*lens"
    ):
        try_on(trial)
