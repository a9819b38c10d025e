from armguard.lab.tradeoff.ladder import AXES, OPERATING, Setting
from armguard.lab.tradeoff.report import describe, summarise, tabulate
from armguard.lab.tradeoff.study import Outcome
from armguard.lab.tradeoff.truth import Contact
from support.tradeoff_cases import make_figures, make_study


def test_a_table_shows_every_setting_and_a_dash_for_what_is_no_number():
    heads, rows = tabulate(make_study())
    assert [row[0] for row in rows] == ["default *", "finest", "odd", "budget 16 *"]
    assert {len(row) for row in rows} == {len(heads)}
    assert rows[3][heads.index("late p50, max [ms]")] == "–"
    assert rows[2][1] == "refused: it | cannot be"


def test_programs_get_all_that_was_found():
    data = describe(make_study(), "an arm", {"command": "armguard tradeoff"})
    assert (data["title"], data["command"], data["seconds"]) == ("an arm", "armguard tradeoff", 5.0)
    assert [one["name"] for one in data["settings"]] == ["default", "finest", "budget 16", "odd"]
    assert data["settings"][3] == {
        "name": "odd", "axis": "", "refused": "it | cannot be", "figures": None
    }  # fmt: skip
    assert data["summary"] == summarise(make_study())


def test_a_user_can_choose_by_the_summary_alone():
    text = "\n".join(summarise(make_study()))
    assert "Contacts in the scene: 0. No contact could be missed." in text
    assert "within 1 percentage point of the finest's: **default**, 10.0% of a core" in text
    assert "in at least 99% of the ticks: **budget 16**, 5.0% of a core at STOP 30.0%" in text
    assert "Least STOP: **finest**" in text
    assert "Nothing here is both cheaper and no more cautious." in text


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
    assert "20.0% of the work is lost instead of 100.0%" in told
    assert "State only limits that the controller enforces." in told


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
    lines = summarise(make_study(contacts=contacts, interrupted="axes"))
    assert "Interrupted in the part “axes”" in lines[0]
    assert "5.0 s" in lines[0]
    assert "Contacts in the scene: 1, and 1 with bodies beyond their stated bounds." in lines


def test_what_was_not_looked_for_is_not_said_to_be_missed_by_none():
    lines = summarise(make_study(contacts=None, interrupted="axes"))
    (told,) = (line for line in lines if line.startswith("Contacts"))
    assert "not computed" in told
