import json
import re

import pytest

from armguard.app.cli import main
from armguard.lab.paper import command as paper


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(paper, "SMALL_BALLS", (3, 8))
    monkeypatch.setattr(paper, "SMALL_EVALUATIONS", 300)


def run(tmp_path, *words):
    return main(["paper", "--small", "--no-plots", "--out", str(tmp_path / "out"), *words])


def test_the_report_is_written_and_its_summary_printed(tmp_path, capsys):
    assert run(tmp_path, "--period", "0.05") == 0
    out = capsys.readouterr().out
    assert "- Unwatched pairs: 0, in" in out
    data = json.loads((tmp_path / "out" / "report.json").read_text())
    assert {row["pairs"] for row in data["rows"]} == {3, 28}
    assert {row["period"] for row in data["rows"]} == {0.05}
    assert data["interrupted"] is False
    assert "numpy" in data["versions"]


@pytest.mark.parametrize(
    ("words", "pattern"),
    [
        (["--period", "0"], "--period: is 0 s; expected 0.0001 to 1"),
        (["--period", "nan"], "--period: is nan s"),
        (["--period", "0.1", "0.1"], "--period: names one period twice"),
        (["--seed", "-1"], "--seed: is -1"),
    ],
)
def test_mistakes_are_one_line(words, pattern, tmp_path, capsys):
    assert run(tmp_path, *words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert pattern in err


def test_an_output_folder_that_is_a_file_is_a_mistake(tmp_path, capsys):
    (tmp_path / "out").touch()
    assert run(tmp_path) == 2
    assert "is a file; expected a folder" in capsys.readouterr().err


def test_an_interrupt_keeps_what_was_measured(tmp_path, capsys, monkeypatch):
    measure = paper.measure_claims

    def end_early(*arguments):
        yield next(measure(*arguments))
        raise KeyboardInterrupt

    monkeypatch.setattr(paper, "measure_claims", end_early)
    assert run(tmp_path) == 0
    assert "Interrupted: this is what was measured" in capsys.readouterr().out
    data = json.loads((tmp_path / "out" / "report.json").read_text())
    assert {row["pairs"] for row in data["rows"]} == {3}


def test_an_interrupt_before_anything_says_so(tmp_path, capsys, monkeypatch):
    def measure(*arguments):
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(paper, "measure_claims", measure)
    assert run(tmp_path) == 130
    assert "interrupted before there was anything" in capsys.readouterr().err


def test_a_pair_that_came_near_unwatched_is_an_exit_code(tmp_path, capsys, monkeypatch):
    measure = paper.measure_claims
    monkeypatch.setattr(
        paper,
        "measure_claims",
        lambda *arguments: (
            [row._replace(unwatched=1) for row in some] for some in measure(*arguments)
        ),
    )
    assert run(tmp_path) == 1
    assert "please report it" in capsys.readouterr().err
