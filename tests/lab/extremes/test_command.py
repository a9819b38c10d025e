import re

import pytest

from armguard.app.cli import main
from armguard.lab.extremes import command as extremes
from armguard.lab.extremes.line import SOUND, UNSOUND, Line


@pytest.fixture
def found(monkeypatch):
    """What the measurement finds, instead of measuring."""
    lines = [Line("radius", "1 m", SOUND)]
    monkeypatch.setattr(extremes, "measure_rows", lambda extent, rows, tell: (lines, True))
    return lines


def test_the_page_is_printed_or_written(found, tmp_path, capsys):
    assert main(["extremes"]) == 0
    assert "# At the extremes" in capsys.readouterr().out
    assert main(["extremes", "--out", str(tmp_path / "page.md")]) == 0
    out = capsys.readouterr().out
    assert "1 cases: 1 sound" in out
    assert "| 1 m | sound |" in (tmp_path / "page.md").read_text()


def test_what_is_unsound_is_an_exit_code(found, capsys):
    found.append(Line("radius", "2 m", UNSOUND))
    assert main(["extremes"]) == 1
    assert "please report it" in capsys.readouterr().err


@pytest.mark.parametrize("out", [".", "no/such/page.md"])
def test_a_page_that_cannot_be_written_is_a_mistake(out, found, capsys):
    assert main(["extremes", "--out", out]) == 2
    out, err = capsys.readouterr()
    assert re.fullmatch(r"armguard: --out [^\n]+ cannot be written [^\n]+\n", err)
    assert out == ""


def test_an_interrupt_keeps_what_was_found(found, monkeypatch, capsys):
    monkeypatch.setattr(extremes, "measure_rows", lambda extent, rows, tell: (found, False))
    assert main(["extremes"]) == 0
    out = capsys.readouterr().out
    assert "Interrupted: what is missing had not begun." in out
    assert "| 1 m | sound |" in out


def test_an_interrupt_before_anything_says_so(monkeypatch, capsys):
    monkeypatch.setattr(extremes, "measure_rows", lambda extent, rows, tell: ([], False))
    assert main(["extremes"]) == 130
    assert "interrupted before there was anything" in capsys.readouterr().err


def test_lines_by_rows_are_kept_beside_the_page(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(extremes, "measure_rows", measure_few)
    assert main(["extremes", "--resume", "--out", str(tmp_path / "page.md")]) == 0
    assert "1 cases: 1 sound" in capsys.readouterr().out
    assert (tmp_path / "page.md.kept" / "rows" / "study.json").is_file()
    assert "Measured: 1 lines on a machine" in (tmp_path / "page.md").read_text()
    assert main(["extremes", "--resume", "--seed", "1", "--out", str(tmp_path / "page.md")]) == 2
    assert "of another study: seed was 0, is 1" in capsys.readouterr().err
    assert main(["extremes", "--resume"]) == 2
    assert "--out: is needed" in capsys.readouterr().err


def measure_few(extent, rows, tell):
    return [Line("radius", "1 m", SOUND, machine="a machine")], True
