import json

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.tracked_people.findings import measure_people
from armguard.lab.tracked_people.tracks import load_tracks
from support.kits import write_frame
from support.walking_person import WalkingPerson

RATE = 30.0


def write_recording(path, steps, people=(1,), hidden=(), kit="zed", noise=0.0):
    """A walk as a kit records it; frames that are not among the steps were dropped."""
    rng = np.random.default_rng(0)
    lines = []
    for step in steps:
        bodies = {}
        for id in people:
            truth = WalkingPerson(id).locate(step / RATE)
            bodies[id] = {
                name: at + rng.normal(0.0, noise, 3)
                for name, at in truth.items()
                if (step, name) not in hidden
            }
        lines.append(json.dumps(write_frame(kit, step / RATE, bodies)))
    path.write_text("\n".join(lines))
    return path


def test_people_are_laid_out_by_joint_and_time_and_what_is_missing_is_hidden(tmp_path):
    steps = [step for step in range(40) if step not in (10, 11)]
    path = write_recording(tmp_path / "c.jsonl", steps, (1, 2), {(20, "left_wrist")}, "kinect")
    recording = load_tracks(path)
    assert (recording.kit, recording.name) == ("kinect", "c.jsonl")
    assert recording.rate == pytest.approx(RATE, rel=1e-3)
    assert recording.duration == pytest.approx(39 / RATE, abs=1e-5)
    assert [track.person for track in recording.tracks] == ["person1", "person2"]
    track = recording.tracks[0]
    assert len(track.position) == 40
    wrist = track.position[:, track.joints.index("left_wrist")]
    is_seen = np.isfinite(wrist).all(axis=1)
    assert np.flatnonzero(~is_seen).tolist() == [10, 11, 20]
    truth = WalkingPerson(1).locate(5 / RATE)["left_wrist"]
    assert wrist[5] == pytest.approx(truth, abs=1e-9)


def test_a_person_who_comes_later_has_a_track_of_their_own_time(tmp_path):
    path = tmp_path / "c.jsonl"
    write_recording(path, range(20))
    first = path.read_text()
    write_recording(path, range(20, 50), (1, 2))
    path.write_text(first + "\n" + path.read_text())
    recording = load_tracks(path)
    assert [len(track.position) for track in recording.tracks] == [50, 30]


def test_one_who_was_away_for_long_has_two_tracks_and_wild_stamps_take_no_room(tmp_path):
    path = write_recording(tmp_path / "c.jsonl", [*range(20), *range(400, 420), 10**9])
    recording = load_tracks(path)
    assert [len(track.position) for track in recording.tracks] == [20, 20, 1]
    found = measure_people([recording])
    assert found.hidden["hand"].times == 0
    lines = path.read_text().splitlines()
    for factor, rate in ((1e-6, "3e"), (1e6, "3e-05 frames a second; expected 1 to 1000 Hz")):
        frames = [json.loads(line) for line in lines[:20]]
        for frame in frames:
            frame["stamp"] = factor * 1e-9 * frame["timestamp"]
        path.write_text("\n".join(map(json.dumps, frames)))
        with pytest.raises(ArmguardError, match=rate):
            load_tracks(path)


def test_recordings_that_say_nothing_are_refused_by_name(tmp_path):
    path = write_recording(tmp_path / "c.jsonl", range(5))
    with pytest.raises(ArmguardError, match="has 5 good frames; expected at least 10"):
        load_tracks(path)
    write_recording(path, range(20), ())
    with pytest.raises(ArmguardError, match="shows people in too few frames"):
        load_tracks(path)
    write_recording(path, range(20), kit="zed")
    with pytest.raises(ArmguardError, match="no joint that counts as seen"):
        load_tracks(path, threshold=99.0)
    assert load_tracks(path, threshold=10.0).kit == "zed"
    with pytest.raises(ArmguardError, match="cannot be read"):
        load_tracks(tmp_path / "nothing.csv")
