import csv
import json
import math
import re

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.pages import JSON_FILE, PAGE, write_json
from armguard.lab.tradeoff.figures import Figures
from armguard.lab.tradeoff.ladder import AXES, OPERATING, Setting
from armguard.lab.tradeoff.report import (
    CSV_FILE,
    HTML_FILE,
    About,
    _list_facts,
    describe,
    summarise,
    tabulate,
    write_report,
)
from armguard.lab.tradeoff.study import Outcome
from armguard.lab.tradeoff.truth import Contact
from support.tradeoff_cases import make_figures, make_study

ABOUT = About(
    "an arm & <others>", "armguard tradeoff", "a machine", {"numpy": "2"}, 7, 20.0, "none stated"
)


@pytest.fixture
def folder(tmp_path):
    write_report(tmp_path, make_study(), ABOUT, {"price.png": b"\x89PNG"})
    return tmp_path


def test_json_and_csv_have_the_same_figures(folder):
    data = json.loads((folder / JSON_FILE).read_text())
    rows = list(csv.DictReader((folder / CSV_FILE).read_text().splitlines()))
    assert [row["setting"] for row in rows] == [one["name"] for one in data["settings"]]
    for row, one in zip(rows, data["settings"], strict=True):
        assert row["refused"] == one["refused"]
        assert row["on_front"] == str(int(one["name"] in data["front"]))
        for name in Figures._fields:
            number = None if one["figures"] is None else one["figures"][name]
            assert row[name] == ("" if number is None else str(number))
    assert (data["seed"], data["machine"], data["versions"]) == (7, "a machine", {"numpy": "2"})
    assert data["exponents"] == {"full": pytest.approx(0.5)}


def test_the_page_needs_nothing_else(folder):
    page = (folder / HTML_FILE).read_text()
    assert 'src="data:image/png;base64,iVBORw' in page
    assert not re.search(r"https?:|src=\"(?!data:)|<link|<script|url\(", page)
    assert "an arm &amp; &lt;others&gt;" in page
    assert page.count("<tr>") == 1 + 4
    assert "<code>armguard tradeoff</code>" in page


def test_the_markdown_shows_pictures_table_and_facts(folder):
    page = (folder / PAGE).read_text()
    assert "![Price against caution" in page
    lengths = {line.count("|") for line in page.splitlines() if line.startswith("|")}
    assert len(lengths) == 1, "every row has every column"
    for fact in ("`armguard tradeoff`", "seed 7", "a machine", "numpy 2", "none stated"):
        assert fact in page


def test_a_user_can_choose_by_the_summary_alone():
    text = "\n".join(summarise(make_study()))
    assert "Contacts in the scene: 0. Nothing was there to be missed." in text
    assert "within 1 percentage point of the finest's: **default**, 10.0% of a core" in text
    assert "in at least 99% of the ticks: **budget 16**, 5.0% of a core at STOP 30.0%" in text
    assert "Least STOP: **finest**" in text
    assert "Nothing here is both cheaper and no more cautious." in text
    assert "pairs^0.50 with schedule full" in text


def test_the_summary_tells_which_levels_there_are_to_be_told_apart():
    finest = make_figures(stop=0.25, slow=0.25, aware=0.125)
    outcomes = [*make_study().outcomes]
    outcomes[1] = outcomes[1]._replace(figures=finest)
    told = "\n".join(summarise(make_study(outcomes=outcomes)))
    assert "finest setting judges it: STOP 25.0%, SLOW 25.0%, AWARE 12.5%, CLEAR 37.5%." in told


def test_a_setting_that_slows_down_more_is_no_better():
    study = make_study()
    for slow, told in ((1.0, "no more cautious here: budget 16."), (1.2, "Nothing here is both")):
        outcomes = [*study.outcomes]
        figures = make_figures(core=0.05, stop=0.1, slow=slow)
        outcomes[2] = outcomes[2]._replace(figures=figures)
        assert told in "\n".join(summarise(study._replace(outcomes=outcomes)))


def test_other_operating_limits_are_told_of_and_not_recommended():
    study = make_study()
    rung = AXES[OPERATING][0]
    cheap = make_figures(core=0.01, stop=0.0, work_lost=0.2)
    lines = summarise(
        study._replace(outcomes=[*study.outcomes, Outcome(Setting(str(rung), (rung,)), cheap)])
    )
    (told,) = (line for line in lines if "operating none" in line)
    assert "STOP is 0.0% and SLOW 100.0% instead of the default's 10.5% and 100.0%" in told
    assert "20.0% of the work are lost instead of 100.0%" in told
    assert "State those limits that the controller enforces." in told


def test_what_was_measured_on_other_machines_names_them():
    study = make_study()
    outcomes = [one._replace(machine="a (x)") for one in study.outcomes]
    grown = [one._replace(machine="b (y)") for one in study.grown]
    spread = study._replace(outcomes=outcomes, grown=grown)
    assert "Measured: 4 settings on a (x), 3 sizes of the growth on b (y)" in _list_facts(
        spread, ABOUT
    )
    assert {one["machine"] for one in describe(spread, ABOUT)["growth"]} == {"b (y)"}
    assert not any("machine" in one for one in describe(study, ABOUT)["growth"])


def test_what_missed_is_named_and_never_recommended():
    study = make_study()
    outcomes = list(study.outcomes)
    cheap = outcomes[2]._replace(figures=make_figures(core=0.01, stop=0.0, missed=2.0))
    outcomes[2] = cheap
    lines = summarise(study._replace(outcomes=outcomes))
    (named,) = (line for line in lines if "budget 16" in line)
    assert named.startswith("MISSED contacts: budget 16")


def test_contacts_and_an_early_end_are_told():
    contacts = [Contact(1.0, 0.0, "a", False), Contact(2.0, 0.0, "b", True)]
    lines = summarise(make_study(contacts=contacts, interrupted="growth"))
    assert "Interrupted in the part “growth”" in lines[0]
    assert "5.0 s" in lines[0]
    assert "Contacts in the scene: 1, and 1 with bodies beyond their stated bounds." in lines


def test_what_was_not_looked_for_is_not_said_to_be_missed_by_none():
    lines = summarise(make_study(contacts=None, interrupted="axes"))
    (told,) = (line for line in lines if line.startswith("Contacts"))
    assert "not looked for" in told


def test_what_is_no_number_is_a_dash_or_null():
    study = make_study()
    _, rows = tabulate(study)
    (row,) = (row for row in rows if row[0].startswith("budget"))
    assert "–" in row
    data = json.loads(write_json(describe(study, ABOUT)))
    assert data["settings"][2]["figures"]["late_max"] is None
    assert math.isnan(study.outcomes[2].figures.late_max)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(ArmguardError, match="cannot be written"):
        write_report(tmp_path / "no", make_study(), ABOUT, {})
