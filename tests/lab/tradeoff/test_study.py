import pytest

from armguard.lab.tradeoff.command import _make_site
from armguard.lab.tradeoff.ladder import AUTO, DEFAULT, FINEST, Setting
from armguard.lab.tradeoff.report import summarise
from armguard.lab.tradeoff.scene import make_scene
from armguard.lab.tradeoff.study import TURN, Outcome, _choose, run_study
from support.tradeoff_cases import make_figures, make_site, small_scene


def study(tell=lambda text, share: None, axes=("schedule", "budget"), **settings):
    return run_study(make_site(**{"rate": 100.0} | settings), small_scene(0.4), axes, tell)


def interrupt(where, times=1):
    """Ctrl-C at the so-manieth telling of a part."""
    left = [times]

    def tell(text, share):
        if text.startswith(where):
            left[0] -= 1
            if left[0] == 0:
                raise KeyboardInterrupt

    return tell


def test_all_settings_see_the_same_and_the_finest_is_the_measure():
    told = []
    found = study(lambda text, share: told.append(share))
    names = [one.setting.name for one in found.outcomes]
    assert names[:2] == [DEFAULT, FINEST]
    assert {name for name in names if name.startswith("budget") and "+" not in name} == {
        f"budget {size}" for size in ("16", "64", "256", "1,024")
    }
    assert all(one.figures.missed == 0.0 for one in found.outcomes)
    finest = found.find(FINEST)
    assert finest.tight_finest == finest.same_level == 1.0
    assert found.seconds == pytest.approx(0.4)
    assert found.interrupted == ""
    assert set(found.front) <= set(names)
    assert all(0.0 <= share <= 1.0 for share in told)


def test_what_a_trial_chooses_is_held_against_the_finest_on_another_scene():
    site = make_site(rate=100.0)
    trial = make_scene(site, None, 3, 0.4, 7)[0]
    found = run_study(site, small_scene(0.4), [AUTO], lambda text, share: None, trial)
    assert [one.setting.name for one in found.outcomes] == [DEFAULT, FINEST, AUTO]
    assert found.choice.ticks == 40
    assert found.find(AUTO).missed == 0.0
    assert found.find(AUTO).same_level > 0.9
    assert any(line.startswith("**auto** chose motion joint") for line in summarise(found))


@pytest.mark.parametrize("keeps_cover", [False, True])
def test_a_cover_that_a_cell_states_is_not_chosen(keeps_cover, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(
        "armguard.lab.tradeoff.study.choose_settings",
        lambda *some, **more: given.append(more["keeps_cover"]),
    )
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nname = "panda"\n' + keeps_cover * "level = 1\n")
    _choose(_make_site(cell, None), small_scene(0.4), [])
    assert given == [keeps_cover]


def test_what_does_not_go_together_is_told_and_left_out():
    found = study(axes=("schedule",), budget=50)
    refused = {one.setting.name: one.refused for one in found.outcomes if one.figures is None}
    assert set(refused) == {"schedule full", "schedule daa, powers", "schedule daa, fibonacci"}
    assert all("budget" in reason for reason in refused.values())


def test_an_interrupt_keeps_what_all_have_seen():
    found = study(interrupt("budget 64", times=3))
    assert found.interrupted == "axes"
    assert found.seconds == pytest.approx(2 * TURN)
    assert found.contacts == []
    assert all(one.figures is None or one.figures.missed == 0.0 for one in found.outcomes)
    assert found.find("budget 16") is not None


def test_an_interrupt_later_on_leaves_out_what_had_not_begun():
    found = study(interrupt("true contacts"), axes=("schedule",))
    assert found.interrupted == "true contacts"
    assert found.find(FINEST) is not None
    assert found.contacts is None


def test_an_interrupt_before_there_is_anything_is_one():
    with pytest.raises(KeyboardInterrupt):
        study(interrupt("default"))
    with pytest.raises(KeyboardInterrupt):
        study(interrupt("making finest"))


def test_a_setting_that_missed_a_contact_is_not_sound():
    assert Outcome(Setting("x"), make_figures(missed=0.0)).is_sound
    assert not Outcome(Setting("x"), make_figures(missed=1.0)).is_sound
    assert not Outcome(Setting("x"), None, "why").is_sound
