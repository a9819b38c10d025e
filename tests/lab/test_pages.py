import json
import math
from typing import NamedTuple

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.pages import (
    Column,
    fit_exponent,
    make_folder,
    write_files,
    write_report,
    write_table,
)


class Record(NamedTuple):
    count: int = 3
    share: float = 2.0 / 3.0
    nothing: float = math.nan


def test_a_column_shows_numbers_and_a_dash_where_one_is_none():
    assert Column("both", "count share", "{}, {:.1%}").show(Record()) == "3, 66.7%"
    assert Column("some", "share nothing", "{} {}").show(Record()) == "–"
    assert Column("some", "share", "{}").show(Record(share=math.inf)) == "–"


def test_exponents_are_those_of_powers():
    pairs = [10, 100, 1000]
    assert fit_exponent(pairs, [3.0 * count**1.5 for count in pairs]) == pytest.approx(1.5)
    assert math.isnan(fit_exponent([10], [1.0]))


def test_a_table_for_people_keeps_its_columns_whatever_cells_hold():
    lines = write_table(["name", "number", "note"], [["a|b", "1", ""]], (0, 2))
    assert lines == ["| name | number | note |", "|---|---:|---|", "| a&#124;b | 1 |  |"]


def test_a_report_has_a_page_with_its_parts_in_order_and_the_same_for_programs(tmp_path):
    data = {"summary": ["one", "two"], "rows": [Record()], "least": -math.inf}
    write_report(tmp_path, "Title", ["## Body"], ["Seed: 0"], data)
    assert (tmp_path / "README.md").read_text() == (
        "# Title\n\n- one\n- two\n\n## Body\n\n"
        "## How it was measured\n\n- Seed: 0\n\nAll figures are in [report.json](report.json).\n"
    )
    assert json.loads((tmp_path / "report.json").read_text()) == {
        "summary": ["one", "two"],
        "rows": [{"count": 3, "share": 0.666667, "nothing": None}],
        "least": None,
    }


def test_files_are_written_or_named(tmp_path):
    assert write_files(tmp_path, {"a": b"1"}) == [tmp_path / "a"]
    (tmp_path / "c").mkdir()
    with pytest.raises(ArmguardError, match="c: cannot be written"):
        write_files(tmp_path, {"c": b""})
    make_folder(tmp_path / "d" / "e")
    with pytest.raises(ArmguardError, match="cannot be made"):
        make_folder(tmp_path / "a" / "e")
