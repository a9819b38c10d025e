"""The page on people says what the recordings say, and mistakes are one line."""

import importlib
import os
from pathlib import Path

import pytest

from armguard.people import BOUNDS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "people.md"
RECORDINGS = Path(os.environ.get("ARMGUARD_RECORDINGS", "/nowhere"))


@pytest.fixture
def benchmark_people(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("bench_people")


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings on this machine")
def test_the_page_is_what_the_command_makes(benchmark_people, tmp_path, capsys):
    page = tmp_path / "people.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    assert benchmark_people.main(["--page", str(page)]) == 0
    assert page.read_text(encoding="utf-8") == PAGE.read_text(encoding="utf-8")
    first = sorted(RECORDINGS.glob("*.csv"))[0]
    assert benchmark_people.main([str(first)]) == 0
    assert f"1 recordings ({first.stem})" in capsys.readouterr().out


def test_the_page_has_the_bounds():
    rows = [line.split("|") for line in PAGE.read_text(encoding="utf-8").splitlines()]
    told = {row[1].strip(): row[2].strip() for row in rows if len(row) == 9}
    for part in ("head", "trunk", "shoulder", "elbow", "hand"):
        assert told[part] == f"{BOUNDS[part].accel:g}, {BOUNDS[part].speed:g}"


def test_mistakes_are_one_line(benchmark_people, tmp_path, capsys, monkeypatch):
    (tmp_path / "none.csv").write_text("nothing\n")
    assert benchmark_people.main([str(tmp_path / "none.csv")]) == 2
    assert "none.csv: line 1: is 'nothing'" in capsys.readouterr().err
    monkeypatch.delenv("ARMGUARD_RECORDINGS", raising=False)
    assert benchmark_people.main([]) == 2
    assert "ARMGUARD_RECORDINGS" in capsys.readouterr().err
    with pytest.raises(Exception, match="lacks the marks"):
        benchmark_people.put_into_page(tmp_path / "none.csv", "")
