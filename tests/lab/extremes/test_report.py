import math

from armguard.lab.extremes.report import EXACT, REFUSED, SOUND, UNSOUND, Line, summarise, write_page

LINES = [
    Line("radius", "1 m", SOUND, 1.0 - 2e-12, 0.5, 0.123456, f"10 cases {EXACT}"),
    Line("radius", "2 m", REFUSED, note="because | of that (it is so)"),
    Line("rate", "1 Hz", SOUND, 1.0, 1.0, 12345.0),
]


def test_each_case_has_a_row():
    page = write_page(LINES, "armguard extremes", ["Seed: 0"])
    assert "| radius | 1 m | sound | 1 − 2e-12 | 0.500 | 0.123 | 10 cases " in page
    assert "| radius | 2 m | refused | – | – | – | because &#124; of that (it is so) |" in page
    assert "| rate | 1 Hz | sound | 1.000 | 1.000 | 1.23e+04 |  |" in page
    assert "`armguard extremes` made this page. Seed: 0.\n" in page


def test_a_page_with_a_file_of_cases_has_a_row_for_each_group_of_ticks():
    page = write_page(LINES, "armguard extremes", ["Seed: 0"], table="page.csv")
    assert "[page.csv](page.csv)" in page
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    assert rows[1:] == ["| radius | 1 | 0 | – |", "| rate | 1 | 1 | 1.000 |"]


def test_the_summary_counts_and_names_what_is_unsound():
    assert summarise(LINES) == "3 cases: 2 sound, 1 refused, 0 unsound."
    bad = [*LINES, Line("rate", "9 Hz", UNSOUND, math.nan)]
    assert summarise(bad).endswith("1 unsound. UNSOUND: rate 9 Hz.")
