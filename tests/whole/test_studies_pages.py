"""Pages that tell what studies measured have their figures from the files that commands wrote."""

import csv
import json
import math
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
REPORTS = sorted(path.parent for path in (DOCS / "tradeoff").glob("*/report.json"))
ROW = re.compile(r"^\| (?P<name>[^|]+?) \| (?P<cells>.+) \|$", flags=re.MULTILINE)


def read(folder):
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


def test_there_are_reports():
    assert {path.name for path in REPORTS} >= {"panda", "ur10", "near-1000"}


@pytest.mark.parametrize("folder", REPORTS, ids=lambda path: path.name)
def test_a_report_is_whole_and_missed_nothing(folder):
    data = read(folder)
    assert data["interrupted"] == ""
    assert all(one["figures"]["missed"] == 0 for one in data["settings"] if one["figures"])
    rows = list(csv.DictReader((folder / "settings.csv").read_text().splitlines()))
    assert [row["setting"] for row in rows] == [one["name"] for one in data["settings"]]
    page = (folder / "README.md").read_text(encoding="utf-8")
    assert all(f"- {line}" in page for line in data["summary"])
    assert f"`{data['command']}`" in page
    for file in folder.iterdir():
        assert file.suffix == ".html" or file.stat().st_size < 200_000, file


def cells(figures):
    """As docs/settings.md shows them."""
    tight = figures["tight_finest"]
    return [
        f"{figures['tick_p50']:.0f}",
        f"{figures['core']:.1%}",
        f"{figures['stop']:.1%}",
        f"{figures['work_lost']:.1%}",
        "–" if tight is None or math.isnan(tight) else f"{tight:.2f}",
    ]


@pytest.mark.parametrize("folder", REPORTS, ids=lambda path: path.name)
def test_the_page_on_settings_quotes_the_reports(folder):
    page = (DOCS / "settings.md").read_text(encoding="utf-8")
    start = page.index(f"<!-- figures: {folder.name} -->")
    table = page[start : page.index("<!-- end of figures -->", start)]
    known = {one["name"]: one["figures"] for one in read(folder)["settings"]}
    quoted = {match["name"]: match["cells"].split(" | ") for match in ROW.finditer(table)}
    del quoted["setting"]
    assert {"default", "finest"} <= set(quoted)
    for name, found in quoted.items():
        assert found == cells(known[name]), name


def test_the_page_on_settings_quotes_what_trials_chose():
    page = (DOCS / "settings.md").read_text(encoding="utf-8")
    start = page.index("<!-- figures: auto -->")
    table = page[start : page.index("<!-- end of figures -->", start)]
    quoted = {
        re.search(r"tradeoff/auto/([^/]+)/README", match["name"])[1]: match["cells"].split(" | ")
        for match in list(ROW.finditer(table))[1:]
    }
    reports = {path.name for path in (DOCS / "tradeoff" / "auto").iterdir()}
    assert set(quoted) == reports >= {"cell", "panda", "ur10", "near-1000"}
    for name, found in quoted.items():
        data = read(DOCS / "tradeoff" / "auto" / name)
        assert data["interrupted"] == ""
        figures = {one["name"]: one["figures"] for one in data["settings"]}
        settings, level = data["choice"]["settings"], data["choice"]["level"]
        fineness = "all" if level is None else str(level)
        told = [f"{settings['max_staleness']:g}, {fineness}, {settings['advances']}"]
        for one in ("auto", "default"):
            assert figures[one]["missed"] == 0
            told.append(f"{figures[one]['same_level']:.1%}")
            told += [
                f"{figures[one][price] / figures['finest'][price]:.1%}"
                for price in ("evaluated", "core")
            ]
        assert found == told, name


def test_nothing_at_the_extremes_is_unsound():
    page = (DOCS / "extremes.md").read_text(encoding="utf-8")
    outcomes = re.findall(r"^\| [^|]+ \| (\w+) \|", page, flags=re.MULTILINE)
    assert "UNSOUND" not in page
    assert outcomes.count("sound") > 40
    told = re.search(r"(\d+) cases: (\d+) sound, (\d+) refused, 0 unsound", page)
    assert [int(number) for number in told.groups()[1:]] == [
        outcomes.count("sound"), outcomes.count("refused")
    ]  # fmt: skip
