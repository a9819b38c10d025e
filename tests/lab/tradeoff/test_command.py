import json
import re

import pytest

from armguard.app.cli import main

CELL = '[robot]\nname = "panda"\n[sources.eye]\n[sources.ear]\n[monitor]\nrate = 100.0\n'


def run(tmp_path, *words):
    usual = ["tradeoff", "--out", str(tmp_path / "out"), "--seconds", "1"]
    return main([*usual, *words])


@pytest.mark.parametrize(
    ("words", "pattern"),
    [
        (["--axis", "colour"], "--axis: 'colour' is no axis; expected some of operating, cover"),
        (["--person", "/no/where.csv"], "/no/where.csv"),
        (["--person", "README.md"], "README.md"),
        (["--robot", "nobody"], "robot 'nobody': is not known"),
        (["--seconds", "0"], "--seconds: is 0"),
        (["--seconds", "nan"], "--seconds: is nan"),
        (["--obstacles", "-1"], "--obstacles: is -1"),
        (["--seed", "-1"], "--seed: is -1"),
        (["no.toml"], "no.toml: cannot be read"),
    ],
)
def test_mistakes_are_one_line(words, pattern, tmp_path, capsys):
    assert run(tmp_path, *words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert pattern in err
    assert not (tmp_path / "out").exists()


def test_a_cell_that_does_not_go_with_a_study_is_a_mistake(tmp_path, capsys):
    cell = tmp_path / "cell.toml"
    cell.write_text(CELL)
    assert run(tmp_path, str(cell), "--robot", "panda") == 2
    assert "beside a cell file" in capsys.readouterr().err
    cell.write_text(CELL.replace("100.0", "33.0"))
    assert run(tmp_path, str(cell)) == 2
    assert "monitor.rate: is 33; expected a multiple of 10 Hz" in capsys.readouterr().err


def test_a_cell_is_a_scene(tmp_path, capsys):
    (tmp_path / "cell.toml").write_text(CELL)
    assert (
        run(tmp_path, str(tmp_path / "cell.toml"), "--axis", "max_staleness", "--obstacles", "2")
        == 0
    )
    out = capsys.readouterr().out
    assert "Cheapest setting whose STOP share is within 1 percentage point" in out
    data = json.loads((tmp_path / "out" / "report.json").read_text())
    assert data["title"] == "panda and 2 balls from 1 m on"
    # Both sources are heard, or all would be STOP.
    assert data["settings"][0]["figures"]["stop"] < 1.0
    assert data["interrupted"] == ""
    assert data["command"].startswith("armguard")
    assert {one["name"] for one in data["settings"]} >= {"default", "finest", "max_staleness 0"}
    assert "](price.png)" in (tmp_path / "out" / "README.md").read_text()
    assert (tmp_path / "out" / "price.png").read_bytes().startswith(b"\x89PNG")


def test_an_interrupt_writes_what_there_is(tmp_path, capsys, monkeypatch):
    def find_contacts(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("armguard.lab.tradeoff.study.find_contacts", find_contacts)
    (tmp_path / "cell.toml").write_text(CELL)
    assert run(tmp_path, str(tmp_path / "cell.toml"), "--axis", "max_staleness") == 0
    assert "Interrupted in the part “true contacts”" in capsys.readouterr().out
    page = (tmp_path / "out" / "README.md").read_text()
    assert "Interrupted in the part" in page


def test_balls_that_touch_the_arm_are_told_of(tmp_path, capsys):
    (tmp_path / "cell.toml").write_text(CELL)
    words = ["--axis", "max_staleness", "--obstacles", "1", "--touching", "1"]
    assert run(tmp_path, str(tmp_path / "cell.toml"), *words) == 0
    data = json.loads((tmp_path / "out" / "report.json").read_text())
    assert data["title"] == "panda and 1 balls from 1 m on and 1 balls that touch it"
    assert len(data["contacts"]) >= 1
    assert all(one["figures"]["missed"] == 0 for one in data["settings"])
    assert run(tmp_path, "--touching", "-1") == 2
    assert "--touching: is -1" in capsys.readouterr().err
