"""Pages that tell what studies measured have their figures from the files that commands wrote."""

import csv
import itertools
import json
import math
import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
REPORTS = sorted(path.parent for path in (DOCS / "tradeoff").glob("*/report.json"))
ROW = re.compile(r"^\| (?P<name>[^|]+?) \| (?P<cells>.+) \|$", flags=re.MULTILINE)


def read(folder):
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


def test_there_are_reports():
    assert {path.name for path in REPORTS} >= {"panda", "ur10", "near-1000", "contacts"}


@pytest.mark.parametrize("folder", REPORTS, ids=lambda path: path.name)
def test_a_report_is_whole_and_missed_nothing(folder):
    data = read(folder)
    assert data["interrupted"] == ""
    assert all(one["figures"]["missed"] == 0 for one in data["settings"] if one["figures"])
    page = (folder / "README.md").read_text(encoding="utf-8")
    assert all(f"- {line}" in page for line in data["summary"])
    assert f"`{data['command']}`" in page
    for file in folder.iterdir():
        assert file.stat().st_size < 200_000, file


def test_there_are_contacts_to_be_missed():
    contacts = read(DOCS / "tradeoff" / "contacts")["contacts"]
    count = sum(not one["is_beyond"] for one in contacts)
    assert count >= 5
    page = (DOCS / "settings.md").read_text(encoding="utf-8")
    assert f"the {count} contacts" in page


def test_the_page_on_settings_is_what_its_script_writes():
    script = runpy.run_path(str(DOCS / "make_settings.py"))
    page = (DOCS / "settings.md").read_text(encoding="utf-8")
    assert page == script["write_page"](), "python docs/make_settings.py writes it anew"
    assert not re.search(r"\{\w+/", page)
    for name in ("figures", "trials"):
        table = (DOCS / "settings" / f"{name}.csv").read_text(encoding="utf-8")
        assert table == script[f"write_{name}"]()


@pytest.mark.parametrize("name", ["panda", "ur10", "contacts"])
def test_a_scene_has_all_that_settings_can_be_told_apart_by(name):
    settings = {one["name"]: one["figures"] for one in read(DOCS / "tradeoff" / name)["settings"]}
    finest = settings["finest"]
    assert 0.1 < finest["stop"] < 0.7
    assert finest["slow"] > 0.05
    assert finest["aware"] > 0.05
    assert settings["operating none"]["stop"] > settings["default"]["stop"]


def read_table(name):
    with (DOCS / "settings" / name).open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))[1:]


def cells(figures):
    """As docs/settings/figures.csv has them."""
    tight = figures["tight_finest"]
    return [
        f"{figures['tick_p50']:.0f}",
        f"{figures['core']:.1%}",
        f"{figures['stop']:.1%}",
        f"{figures['slow']:.1%}",
        f"{figures['work_lost']:.1%}",
        "" if tight is None or math.isnan(tight) else f"{tight:.2f}",
    ]


@pytest.mark.parametrize("folder", REPORTS, ids=lambda path: path.name)
def test_the_table_of_settings_quotes_the_reports(folder):
    known = {one["name"]: one["figures"] for one in read(folder)["settings"] if one["figures"]}
    quoted = {
        name: found for scene, name, *found in read_table("figures.csv") if scene == folder.name
    }
    assert {"default", "finest"} <= set(quoted) == set(known)
    for name, found in quoted.items():
        assert found == cells(known[name]), name


def test_the_page_on_settings_quotes_the_reports():
    page = (DOCS / "settings.md").read_text(encoding="utf-8")
    known = {
        path.name: {one["name"]: one["figures"] for one in read(path)["settings"]}
        for path in REPORTS
    }
    (heads, *rows) = (
        match["cells"].split(" | ")
        if match["name"] == "setting"
        else (match["name"], match["cells"])
        for match in ROW.finditer(page[: page.index("## What")])
    )
    assert {"default", "finest"} <= {name for name, _ in rows}
    for name, found in rows:
        for head, cell in zip(heads, found.split(" | "), strict=True):
            scene, key = head.split(": ")
            assert cell == f"{known[scene][name][key.lower()]:.1%}", (name, head)


def test_the_table_of_trials_quotes_their_reports():
    quoted = {name: found for name, *found in read_table("trials.csv")}
    reports = {path.name for path in (DOCS / "tradeoff" / "auto").iterdir()}
    assert set(quoted) == reports >= {"cell", "panda", "ur10", "near-1000"}
    for name, found in quoted.items():
        data = read(DOCS / "tradeoff" / "auto" / name)
        assert data["interrupted"] == ""
        figures = {one["name"]: one["figures"] for one in data["settings"]}
        settings, level = data["choice"]["settings"], data["choice"]["level"]
        told = [f"{settings['max_staleness']:g}", "all" if level is None else str(level)]
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
    with (DOCS / "extremes.csv").open(encoding="utf-8", newline="") as file:
        outcomes = [row["outcome"] for row in csv.DictReader(file)]
    assert outcomes.count("sound") > 40
    told = re.search(r"(\d+) cases: (\d+) sound, (\d+) refused, 0 unsound", page)
    assert [int(number) for number in told.groups()] == [
        len(outcomes), outcomes.count("sound"), outcomes.count("refused")
    ]  # fmt: skip


def test_each_fault_was_noticed_and_touched_nobody():
    page = (DOCS / "faults.md").read_text(encoding="utf-8")
    with (DOCS / "faults.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert f"{len(rows)} faults" in page
    assert all(row["contacts"] == "0" and row["control"] == "hit" for row in rows)
    assert "no" not in {row["detected [ms]"] for row in rows}


PAPER = DOCS / "paper"


def read_paper():
    data = json.loads((PAPER / "report.json").read_text(encoding="utf-8"))
    return data, (DOCS / "paper.md").read_text(encoding="utf-8")


def cut(page, name):
    """What stands between the marks of some figures."""
    return page.split(f"<!-- figures: {name} -->")[1].split("<!-- end of figures -->")[0]


def quote_cost(data):
    """The table of costs in docs/paper.md, row by row."""
    lines = []
    for name in ("daa, powers", "daa, Fibonacci", "full-DAA", "full-DF"):
        some = [row for row in data["rows"] if row["schedule"] == name and row["period"] == 0.05]
        last = some[-1]
        lines.append(
            f"| {name} | {last['evaluations']:,.0f} | "
            f"{data['exponents'][name]['evaluations']:.2f} | {last['tick']:,.0f} |"
        )
    return lines


def quote_awareness(data):
    """The table of what is noticed in docs/paper.md, row by row."""
    found = {(row["period"], row["pairs"], row["schedule"]): row for row in data["rows"]}
    lines = []
    for period, pairs in itertools.product((0.05, 0.001), (3, 100_128)):
        powers, distance = (found[period, pairs, name] for name in ("daa, powers", "full-DF"))
        lines.append(
            f"| {1e3 * period:g} ms | {pairs:,} | {powers['agreement']:.1%} | "
            f"{powers['flagged']:.1%} | {distance['agreement']:.1%} |"
        )
    return lines


def test_the_page_on_the_paper_quotes_its_report():
    data, page = read_paper()
    assert data["interrupted"] is False
    assert cut(page, "cost").strip().splitlines()[2:] == quote_cost(data)
    assert cut(page, "awareness").strip().splitlines()[2:] == quote_awareness(data)
    report = (PAPER / "README.md").read_text(encoding="utf-8")
    assert all(f"- {line}" in report for line in data["summary"])


def test_the_claims_hold_that_the_page_on_the_paper_makes():
    data, _ = read_paper()
    rows = data["rows"]
    assert {row["pairs"] for row in rows} >= {3, 100_128}
    assert all(row["unwatched"] == 0 for row in rows)
    assert sum(row["alarms"] for row in rows if row["schedule"] == "full-DAA") > 100
    for row in rows:
        buckets = math.floor(math.log2(row["pairs"])) + 1
        if row["schedule"] == "daa, powers":
            assert row["evaluations"] <= buckets
            assert row["comparisons"] <= max(1.0, buckets * math.log2(buckets))
        if row["schedule"] == "full-DAA":
            assert row["evaluations"] == row["pairs"]
            assert row["agreement"] == 1.0
