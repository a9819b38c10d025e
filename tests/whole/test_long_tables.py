"""Large tables of pages that benchmarks write are files beside them, with nothing lost."""

import csv

import pytest

HEAD = ["| rule | **share**, | a\\|b |", "| --- | --- | --- |"]


@pytest.fixture
def tables(load):
    return load("scene.long_tables")


def write(tables, tmp_path, rows):
    table = [*HEAD, *(f"| rule {k} | {k}.5 %, {k} | `x` |" for k in range(rows))]
    page = "\n".join(["# Page", "", "## Share of time", "", *table, "", "End.", ""])
    out = tmp_path / "page.md"
    tables.write_with_tables(page, out)
    return page, out


def test_a_short_table_stays(tables, tmp_path):
    page, out = write(tables, tmp_path, tables.MOST_ROWS)
    assert out.read_text() == page
    assert list(tmp_path.iterdir()) == [out]


def test_a_long_table_is_a_file_that_the_page_names(tables, tmp_path):
    rows = tables.MOST_ROWS + 1
    _, out = write(tables, tmp_path, rows)
    assert "|" not in out.read_text()
    assert "(page/share-of-time.csv)" in out.read_text()
    assert out.read_text().endswith("\nEnd.\n")
    with (tmp_path / "page" / "share-of-time.csv").open(newline="") as file:
        head, *found = csv.reader(file)
    assert head == ["rule", "share,", "a\\|b"]
    assert found == [[f"rule {k}", f"{k}.5 %, {k}", "x"] for k in range(rows)]


def test_a_wide_table_is_a_file_as_well(tables):
    for columns in (tables.MOST_COLUMNS, tables.MOST_COLUMNS + 1):
        line = f"| {' | '.join(['a'] * columns)} |"
        _, found = tables.split_tables(f"{line}\n{line}\n{line}\n", "page")
        assert bool(found) == (columns > tables.MOST_COLUMNS)


@pytest.mark.parametrize("count", [2, 3])
def test_tables_below_one_heading_have_files_of_their_own(tables, count):
    table = [*HEAD, *["| a | b | c |"] * 20]
    page = "\n".join(["# Page", *(line for _ in range(count) for line in ["", *table]), ""])
    _, found = tables.split_tables(page, "page")
    assert list(found) == ["page.csv", *(f"page-{k}.csv" for k in range(2, count + 1))]
