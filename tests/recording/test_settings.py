import math

import msgspec
import numpy as np
import pytest

import armguard
from armguard.exceptions import ArmguardError
from armguard.monitor.portable import describe_settings
from armguard.recording import Recorder, Recording
from armguard.recording.replay import Replay, replay
from armguard.recording.settings import (
    change_settings,
    make_monitor,
    make_obstacles,
)
from armguard.scheduling import DaaSchedule
from support import eventful_runs, panda_monitor
from support.eventful_runs import MOTIONS
from support.trials import lead, make_auto, make_trial


def through_json(data):
    return msgspec.json.decode(msgspec.json.encode(data))


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_monitor_that_is_made_anew_has_the_same_settings(motion):
    robot, _, monitor = eventful_runs.make_monitor(motion)
    data = through_json(describe_settings(monitor))
    again = make_monitor(data["monitor"], robot, make_obstacles(data["obstacles"]))
    assert describe_settings(again) == data
    assert again.period == monitor.period
    assert again.payload == monitor.payload
    placements = (one.base_placement.homogeneous.tobytes() for one in (again, monitor))
    assert len(set(placements)) == 1
    frames = [one.obstacles.settings.frames["tilted"].rotation for one in (again, monitor)]
    assert frames[0].tobytes() == frames[1].tobytes()


def test_contact_limits_and_regions_are_made_anew_and_can_be_taken_away():
    limits = armguard.ContactLimits(
        {
            "hand": armguard.ContactLimit(speed=0.9, source="assumed", person_speed=0.1 + 0.2),
            "chest": armguard.ContactLimit(
                force=140.0, stiffness=25e3, body_mass=40.0, source="a paper", gap=0.0
            ),
        }
    )
    robot, regions = panda_monitor.panda(), {"*_hand": "hand"}
    obstacles = armguard.Obstacles(regions=regions)
    data = through_json(
        describe_settings(armguard.Monitor(robot, obstacles, contact_limits=limits))
    )
    again = make_monitor(data["monitor"], robot, make_obstacles(data["obstacles"]))
    assert again.settings.contact_limits == limits
    assert again.obstacles.settings.regions == regions
    change_settings(data, {"contact_limits": "none"}, robot)
    again = make_monitor(data["monitor"], robot, make_obstacles(data["obstacles"]))
    assert again.settings.contact_limits is None
    with pytest.raises(ArmguardError, match=r"contact_limits: is '0.5'; expected \"none\""):
        change_settings(data, {"contact_limits": "0.5"}, robot)


def test_a_recording_of_before_there_were_contact_limits_has_none():
    robot, _, monitor = eventful_runs.make_monitor("joint")
    data = through_json(describe_settings(monitor))
    del data["monitor"]["contact_limits"], data["obstacles"]["regions"]
    again = make_monitor(data["monitor"], robot, make_obstacles(data["obstacles"]))
    assert again.settings.contact_limits is None


@pytest.mark.parametrize("rate", [1000.0, 333.3, 49.0, 1e3 / 3.0])
def test_a_rate_is_kept_to_the_bit(rate):
    _, monitor = panda_monitor.make_monitor(rate=rate)
    data = through_json(describe_settings(monitor))
    robot = panda_monitor.panda()
    assert make_monitor(data["monitor"], robot, make_obstacles(data["obstacles"])).period == (
        1.0 / rate
    )


def test_laws_of_the_papers_schedule_are_kept():
    _, monitor = panda_monitor.make_monitor(("fibonacci", "total"))
    data = through_json(describe_settings(monitor))
    robot = panda_monitor.panda()
    again = make_monitor(data["monitor"], robot, make_obstacles(data["obstacles"]))
    schedule = again.settings.schedule
    assert isinstance(schedule, DaaSchedule)
    assert (schedule.law, schedule.sort) == ("fibonacci", "total")


def change(**changes):
    robot, _, monitor = eventful_runs.make_monitor("joint")
    data = through_json(describe_settings(monitor))
    named = {name.replace("__", "."): value for name, value in changes.items()}
    change_settings(data, named, robot)
    return robot, data


def test_settings_that_are_none_any_more_or_missing_are_refused():
    robot, _, monitor = eventful_runs.make_monitor("joint")
    data = through_json(describe_settings(monitor))
    table = make_obstacles(data["obstacles"])
    with pytest.raises(ArmguardError, match="advances: is 8, and is no setting any more"):
        make_monitor({**data["monitor"], "advances": 8}, robot, table)
    del data["monitor"]["scale_rise"]
    with pytest.raises(KeyError, match="scale_rise"):
        make_monitor(data["monitor"], robot, table)


def test_settings_are_changed_by_name():
    robot, data = change(
        latency="0.01",
        operating__velocity="0.3",
        bounds__speed="inf",
        budget="500",
        leave="never",
    )
    assert data["monitor"]["leave"] == "never"
    assert data["monitor"]["latency"] == 0.01
    assert data["monitor"]["budget"] == 500
    assert data["monitor"]["operating"]["acceleration"] is None
    assert np.allclose(data["monitor"]["operating"]["velocity"], 0.3 * robot.velocity_limit)
    assert data["obstacles"]["speed"] == math.inf
    _, data = change(operating="published")
    assert len(data["monitor"]["operating"]["velocity"]) == 7
    _, data = change(operating="none", motion="planned", schedule="full")
    assert data["monitor"]["operating"] is None
    assert (data["monitor"]["motion"], data["monitor"]["schedule"]) == ("planned", "full")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"colour": "red"}, "setting 'colour': is not known; expected one of rate, schedule"),
        ({"latency": "soon"}, "latency: is 'soon'; expected a number"),
        ({"latency": "nan"}, "latency: is 'nan'"),
        ({"budget": "1.5"}, "budget: is '1.5'"),
        ({"advances": "3"}, "setting 'advances': is not known; .*leave it out"),
        ({"budget": "inf"}, "budget: is 'inf'"),
        ({"operating": "fast"}, "operating: is 'fast'"),
        ({"operating__velocity": "3"}, "operating velocity: is the fraction 3"),
        ({"stop": "path"}, "setting 'stop': is not known; .*commits pieces"),
        ({"operating__speed": "1"}, r"setting 'operating\.speed': is not known"),
    ],
)
def test_a_change_that_makes_no_sense_is_told_by_name(changes, words):
    with pytest.raises(ArmguardError, match=words):
        change(**changes)


def test_what_was_chosen_and_why_is_kept_and_replayed_to_the_bit(tmp_path):
    monitor = make_auto()
    with Recorder(tmp_path / "auto.mcap", monitor) as recorder:
        lead(monitor, make_trial(0.9))
        assert recorder.close() == ""
    report = replay(tmp_path / "auto.mcap")
    assert report.is_identical
    settings = Recording(tmp_path / "auto.mcap").settings
    kept, told = settings["choice"], monitor.choice
    assert tuple(kept["reasons"]) == told.reasons
    assert kept["settings"] == told.settings
    assert {name: settings["monitor"][name] for name in told.settings} == told.settings
    # To be made anew takes no trial.
    again = Replay(Recording(tmp_path / "auto.mcap")).monitor
    assert again.choice is None
    assert again.settings.max_staleness == monitor.settings.max_staleness
