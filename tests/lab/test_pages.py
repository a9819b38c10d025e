import json
import math
import re
from typing import NamedTuple

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.pages import (
    Column,
    fit_exponent,
    list_pictures,
    write_csv,
    write_files,
    write_html,
    write_json,
    write_page,
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


def test_plain_data_is_rounded_off_and_null_where_it_is_no_number():
    data = {"rows": [Record()], "name": "x", "least": -math.inf}
    assert json.loads(write_json(data)) == {
        "rows": [{"count": 3, "share": 0.666667, "nothing": None}], "name": "x", "least": None
    }  # fmt: skip


def test_exponents_are_those_of_powers():
    pairs = [10, 100, 1000]
    assert fit_exponent(pairs, [3.0 * count**1.5 for count in pairs]) == pytest.approx(1.5)
    assert math.isnan(fit_exponent([10], [1.0]))


def test_a_table_for_programs_has_the_same_numbers():
    content = write_csv(["name", *Record._fields], [["a, b", *Record()]])
    assert content.decode() == 'name,count,share,nothing\n"a, b",3,0.666667,\n'


def test_a_table_for_people_keeps_its_columns_whatever_cells_hold():
    lines = write_table(["name", "number", "note"], [["a|b", "1", ""]], (0, 2))
    assert lines == ["| name | number | note |", "|---|---:|---|", "| a&#124;b | 1 |  |"]


def test_a_page_has_its_parts_in_order():
    pictures = list_pictures({"p": "one", "q": "none"}, ["p.png"])
    assert pictures == {"p.png": "one"}
    page = write_page("Title", ["one", "two"], ["## Body"], pictures, ["Seed: 0"], "t.csv")
    text = page.decode()
    parts = [
        "# Title\n\n- one\n- two\n\n",
        "## Body\n",
        "![one](p.png)\n",
        "- Seed: 0\n",
        "(t.csv)",
    ]
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    html = write_html("A < B", page, {"p.png": b"\x89PNG"}).decode()
    assert "<title>A &lt; B</title>" in html
    assert re.search(r'<p><img src="data:image/png;base64,iVBORw=="[^>]*>one</p>', html)


def test_files_are_written_or_named(tmp_path):
    write_files(tmp_path, {"a": b"1", "b": b"2"})
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"1", "b": b"2"}
    (tmp_path / "c").mkdir()
    with pytest.raises(ArmguardError, match="c: cannot be written"):
        write_files(tmp_path, {"c": b""})
