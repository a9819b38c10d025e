import json

import pytest

from armguard.app.cli import main
from armguard.lab.paper import command as paper


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(paper, "BALLS", (3, 8))
    monkeypatch.setattr(paper, "MOST_EVALUATIONS", 300)


def run(tmp_path, *words):
    return main(["paper", "--out", str(tmp_path / "out"), *words])


def test_the_report_is_written_and_its_summary_printed(tmp_path, capsys):
    assert run(tmp_path) == 0
    out = capsys.readouterr().out
    assert "- Unwatched pairs: 0, in" in out
    data = json.loads((tmp_path / "out" / "report.json").read_text())
    assert {row["pairs"] for row in data["rows"]} == {3, 28}
    assert {row["period"] for row in data["rows"]} == {0.05, 0.001}
    assert data["interrupted"] is False
    assert "numpy" in data["versions"]
    page = (tmp_path / "out" / "README.md").read_text()
    assert all(f"- {line}" in page for line in data["summary"])
    assert page.count("| daa, powers |") == len(data["rows"]) / 5


def test_a_mistake_is_one_line(tmp_path, capsys):
    assert run(tmp_path, "--seed", "-1") == 2
    assert capsys.readouterr() == ("", "armguard: --seed: is -1; expected 0 or more\n")


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
