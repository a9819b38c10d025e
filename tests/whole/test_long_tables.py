"""Large tables of pages that benchmarks write are files beside them, with nothing lost."""

import csv

import pytest

TABLE = ["| rule | **share**, | a\\|b |", "| --- | --- | --- |", "| one | 0.5 %, 0 | `x` |"]


@pytest.fixture
def write(load):
    return load("scene.long_tables").write_with_tables


def test_a_page_without_tables_is_the_only_file(write, tmp_path):
    write("# Page\n", {}, tmp_path / "page.md")
    (out,) = tmp_path.iterdir()
    assert out.read_text() == "# Page\n"


def test_each_table_is_a_file_that_the_page_names(write, tmp_path):
    out = tmp_path / "page.md"
    write("# Page\n", {"shares": TABLE, "prices": TABLE[:2]}, out)
    links = "[shares.csv](page/shares.csv), [prices.csv](page/prices.csv)"
    assert out.read_text() == f"# Page\n\nAll figures: {links}.\n"
    heads = ["rule", "share,", "a\\|b"]
    for name, rows in {"shares": [heads, ["one", "0.5 %, 0", "x"]], "prices": [heads]}.items():
        with (tmp_path / "page" / f"{name}.csv").open(newline="") as file:
            assert list(csv.reader(file)) == rows
