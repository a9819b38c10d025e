import math

from armguard.lab.extremes.report import REFUSED, SOUND, UNSOUND, Line, summarise, write_page

LINES = [
    Line("radius", "1 m", SOUND, 1.0 - 2e-12, 0.5, 0.123456, "10 cases"),
    Line("radius", "2 m", REFUSED, note="because | of that"),
    Line("rate", "1 Hz", SOUND, 1.0, 1.0, 12345.0),
]


def test_each_case_has_a_row_of_its_group():
    page = write_page(LINES, "armguard extremes", ["Seed: 0"])
    assert "| 1 m | sound | 1 − 2e-12 | 0.500 | 0.123 | 10 cases |" in page
    assert "| 2 m | refused | – | – | – | because &#124; of that |" in page
    assert "| 1 Hz | sound | 1.000 | 1.000 | 1.23e+04 |  |" in page
    assert page.index("## Radius") < page.index("## Rate")
    assert page.endswith("- Seed: 0\n")
    assert "`armguard extremes`" in page


def test_the_summary_counts_and_names_what_is_unsound():
    assert summarise(LINES) == "3 cases: 2 sound, 1 refused, 0 unsound."
    bad = [*LINES, Line("rate", "9 Hz", UNSOUND, math.nan)]
    assert summarise(bad).endswith("1 unsound. UNSOUND: rate 9 Hz.")
