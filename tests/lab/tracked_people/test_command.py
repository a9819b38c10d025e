import json
import os
import tomllib
from pathlib import Path

import pytest

from armguard.app.cli import main
from armguard.lab.tracked_people.command import run_people
from armguard.obstacles import Obstacles
from armguard.people import Skeleton, find_bounds

from .test_tracks import write_recording

RECORDINGS = Path(os.environ.get("ARMGUARD_RECORDINGS", "/nowhere"))


@pytest.fixture
def walk(tmp_path):
    return write_recording(tmp_path / "camera.jsonl", range(1100), noise=0.004)


def test_the_page_says_what_to_do_and_its_lines_can_be_pasted(walk, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["people", str(walk), "--check"]) == 0
    page = capsys.readouterr().out
    assert "camera.jsonl: zed, 36.6 s at 30 Hz, 1 person, 0 bad frames" in page
    for words in ("broken", "jitter", "hidden", "longest", "too long", "Position error:"):
        assert words in page
    assert "Never seen: " not in page
    lines = page[page.index("# position_error") :]
    cell = tomllib.loads(lines)
    bounds = [(one, *values.values()) for one, values in cell["bounds"]["of"].items()]
    # Each part of a skeleton has its own bounds by these patterns.
    obstacles = Obstacles(bounds=bounds)
    for id in Skeleton("anna").ids:
        part = find_bounds(id)
        found = obstacles.bounds.find([id])
        is_joint = id.endswith(("shoulder", "elbow"))
        assert part is None or is_joint or found[0][0] == part.accel, id
        assert found[0][0] >= 5.0


def test_without_check_it_says_what_the_file_holds(walk, capsys):
    walk.write_text(walk.read_text() + "\nrubbish\nrubbish\n")
    assert main(["people", str(walk)]) == 0
    page = capsys.readouterr().out
    assert "2 bad frames" in page
    assert "2 times: is no JSON" in page
    assert "jitter" not in page


def test_programs_get_one_object(walk, capsys):
    assert main(["people", str(walk), "--check", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["recordings"][0]["people"] == ["person1"]
    assert report["findings"]["hidden"]["hand"]["longest"] is None
    assert report["findings"]["bones"]["forearm"]["broken"] == 0.0
    assert "[bounds.of]" in report["cell_lines"]
    assert main(["people", str(walk), "--json"]) == 0
    assert "findings" not in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["nothing.jsonl"], "nothing.jsonl: cannot be read"),
        (["{walk}", "--threshold", "nan"], "--threshold: is nan"),
        (["{walk}", "--threshold", "99"], "has no joint that counts as seen; state --threshold"),
        (["{walk}", "--height", "180"], "--height: is 180.0; expected 1.3 to 2.3 metres"),
        (["{walk}", "--position-error", "-1"], "--position-error: is -1.0"),
        (["{walk}", "--unit", "0"], "unit: is 0.0"),
        (["{walk}", "--unit", "0.001"], "is no recording of a body-tracking kit"),
        (["{walk}", "--rate", "inf"], "rate: is inf"),
        ([], "recordings: are missing; name files, or set ARMGUARD_RECORDINGS"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(walk, options, message, capsys, monkeypatch):
    monkeypatch.delenv("ARMGUARD_RECORDINGS", raising=False)
    words = [option.replace("{walk}", str(walk)) for option in options]
    assert main(["people", *words, "--check"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert captured.err.count("\n") == 1


@pytest.mark.skipif(not any(RECORDINGS.glob("*.csv")), reason="no ARMGUARD_RECORDINGS")
def test_motion_captures_of_the_usual_folder_are_read_too(capsys):
    assert run_people([], check=True) == 0
    page = capsys.readouterr().out
    assert ": vicon, " in page
    assert "forearm and hand" in page
