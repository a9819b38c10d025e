"""`--json`: one JSON object on standard output, and nothing else there, of every command."""

import dataclasses
import json

import pytest

from armguard.app.cli import COMMANDS, main
from armguard.lab.extremes import command as extremes
from armguard.lab.extremes.report import SOUND, Line
from armguard.lab.faults import command
from armguard.lab.faults.campaign import CampaignReport
from armguard.lab.faults.truth import Closest
from armguard.lab.paper import command as paper
from support import commissioned_runs
from support.driven_cell import find_host
from support.kits import write_frame
from support.urdf_arms import two_links
from support.walking_person import WalkingPerson

REPORT_NOTHING = {
    "view": "serves a page until Ctrl-C",
    "show": "serves a page until Ctrl-C",
    "keys": "writes two files, and says what to do with them",
    "kernels": "compiles, and finds nothing out",
}
"""Commands without `--json`, and why."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    commissioned_runs.record(path)
    return path


@pytest.fixture
def words_of(tmp_path, recording, monkeypatch):
    """By command: what is typed after it, and what its object has among others.

    What would take long is made short, or its result is made up.
    """
    monkeypatch.setattr("armguard.app.run.REACH_TIMEOUT", 0.1)
    monkeypatch.setattr(paper, "BALLS", (3, 8))
    monkeypatch.setattr(paper, "MOST_EVALUATIONS", 300)
    monkeypatch.setattr(paper, "PERIODS", (0.05,))
    line = Line("radius", "1 m", SOUND)
    monkeypatch.setattr(extremes, "measure_all", lambda seed, lines, tell: lines.append(line))
    found = CampaignReport([], [], Closest(0, 1.0, 0.5), 1.0)
    monkeypatch.setattr(command, "run_campaign", lambda faults, tell: found)
    walk = WalkingPerson(1)
    frames = [
        json.dumps(write_frame("zed", k / 30.0, {1: walk.locate(k / 30.0)})) for k in range(90)
    ]
    camera = tmp_path / "camera.jsonl"
    camera.write_text("\n".join(frames))
    cell, out = tmp_path / "cell.toml", str(tmp_path / "out")
    cell.write_text('[robot]\nname = "panda"\noperating = "published"\n[sources]\n')
    moved = tmp_path / "moved.toml"
    planned = 'motion = "planned"\nrate = 100.0\n[shield]\njerk = 500.0\n'
    moved.write_text(f"{cell.read_text()}[monitor]\n{planned}")
    driven = tmp_path / "driven.toml"
    driven.write_text(
        'sources = {}\n[robot]\nname = "ur5e"\n[robot.driver]\n'
        f'name = "ur"\nhost = "{find_host()}"\nmodel = "UR5e"\n'
    )
    addresses = [
        word
        for name in ("obstacles", "joints", "verdicts")
        for word in (f"--{name}", f"ipc://{tmp_path}/{name}")
    ]
    return {
        "demo": (["--duration", "0.3", "--no-view"], "ticks"),
        "run": ([str(cell), "--duration", "0.05", "--no-realtime", *addresses], "ticks"),
        "shield": ([str(moved), "--duration", "0.05", "--no-realtime", *addresses], "ticks"),
        "drive": ([str(driven), "--duration", "0.1"], "counts"),
        "reset": ([f"ipc://{tmp_path}/nobody", "--token", "x"], "obeyed"),
        "replay": ([str(recording)], "identical"),
        "check": ([str(recording)], "verified"),
        "robots": ([], "robots"),
        "robot": (
            ["new", str(two_links(tmp_path)), "--out", out, "--yes", "--spheres", "2"],
            "choices",
        ),
        "cover": (["panda", "--export", str(tmp_path / "panda.yml")], "wrote"),
        "commission": ([str(recording)], "cell_lines"),
        "people": ([str(camera)], "recordings"),
        "tradeoff": (
            ["--out", out, "--seconds", "1", "--axis", "max_staleness"],
            "settings",
        ),
        "faults": ([], "passed"),
        "extremes": ([], "lines"),
        "paper": (["--out", out], "rows"),
    }


def test_every_command_that_reports_has_it():
    without = {
        name
        for name, kind in COMMANDS.items()
        if "json" not in (field.name for field in dataclasses.fields(kind))
    }
    assert without == set(REPORT_NOTHING)


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in REPORT_NOTHING])
def test_standard_output_has_one_object_and_nothing_else(name, words_of, capfd):
    if name == "drive":
        pytest.importorskip("rtde_receive", reason="ur-rtde is not installed")
    words, key = words_of[name]
    assert main([name, *words, "--json"]) in (0, 1)
    out, err = capfd.readouterr()
    assert key in json.loads(out)
    assert out.count("\n") == 1
    assert "Traceback" not in err


def test_a_table_and_an_object_cannot_share_standard_output(recording, capsys):
    assert main(["replay", str(recording), "--csv", "-", "--json"]) == 2
    assert "standard output" in capsys.readouterr().err
