import re

import pytest

from armguard.app.cli import main
from armguard.lab.extremes import command as extremes
from armguard.lab.extremes.report import SOUND, UNSOUND, Line


@pytest.fixture
def found(monkeypatch):
    """What the measurement finds, instead of measuring."""
    lines = [Line("radius", "1 m", SOUND)]
    monkeypatch.setattr(
        extremes, "measure_all", lambda seed, all_lines, tell: all_lines.extend(lines)
    )
    return lines


def interrupt(lines, monkeypatch):
    def measure(seed, all_lines, tell):
        all_lines.extend(lines)
        raise KeyboardInterrupt

    monkeypatch.setattr(extremes, "measure_all", measure)


def test_the_page_is_printed_or_written(found, tmp_path, capsys):
    assert main(["extremes"]) == 0
    assert "# At the extremes" in capsys.readouterr().out
    assert main(["extremes", "--out", str(tmp_path / "page.md")]) == 0
    assert "1 cases: 1 sound" in capsys.readouterr().out
    assert "(page.csv)" in (tmp_path / "page.md").read_text()
    assert "radius,1 m,sound," in (tmp_path / "page.csv").read_text()


def test_what_is_unsound_is_an_exit_code(found, capsys):
    found.append(Line("radius", "2 m", UNSOUND))
    assert main(["extremes"]) == 1
    assert "please report it" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["--out", "."], ["--out", "no/such/page.md"], ["--out", "page.csv"], ["--seed", "-1"]]
)
def test_a_mistake_is_one_line(words, found, capsys):
    assert main(["extremes", *words]) == 2
    out, err = capsys.readouterr()
    assert re.fullmatch(rf"armguard: {words[0]}[^\n]+\n", err)
    assert out == ""


def test_an_interrupt_keeps_what_was_found(found, monkeypatch, capsys):
    interrupt(found, monkeypatch)
    assert main(["extremes"]) == 0
    out = capsys.readouterr().out
    assert "Interrupted: what is missing had not begun." in out
    assert "| 1 m | sound |" in out
    interrupt([], monkeypatch)
    assert main(["extremes"]) == 130
    assert "interrupted before there was a result" in capsys.readouterr().err


def test_all_cases_are_measured_in_their_order(monkeypatch):
    monkeypatch.setattr(extremes.Evaluations, "measure", lambda one, seed: one.group)
    monkeypatch.setattr(extremes.Case, "measure", lambda one, seed: one.group)
    groups, told = [], []
    extremes.measure_all(0, groups, lambda text, share: told.append(share))
    assert groups[0] == "acceleration of a body"
    assert groups[-1] == "joints"
    assert len(groups) == len(told) > 60
