import os
from pathlib import Path

import pytest

from armguard.exceptions import ArmguardError
from armguard.recording import parts
from armguard.recording.parts import (
    Rotation,
    find_part,
    remove_old,
)


def test_parts_are_found_from_any_other():
    for name in ("run.mcap", "armguard-20261125T101112-77.mcap", "run.7.mcap"):
        first = Path("/data") / name
        paths = [find_part(first, 1, number) for number in range(1, 12)]
        assert paths[0] == first
        assert len(set(paths)) == 11
        for part, path in enumerate(paths, 1):
            assert [find_part(path, part, number) for number in range(1, 12)] == paths


@pytest.mark.parametrize("name", ["duration", "size", "keep"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_what_is_no_time_or_size_is_refused(name, value):
    with pytest.raises(ArmguardError, match=rf"rotation\.{name}"):
        Rotation(**{name: value}).check()
    Rotation(**{name: 1.0}).check()
    Rotation().check()


DAY = 86400.0
NOW = 4e9


def make_files(folder, names, ages):
    """A file of each name, last changed so many days ago; the last one is written at present."""
    for name, age in zip(names, ages, strict=True):
        (folder / name).write_text("x")
        os.utime(folder / name, (NOW - DAY * age,) * 2)
    return folder / names[-1]


def list_removed(present, part, days, monkeypatch, *, now=NOW):
    monkeypatch.setattr(parts.time, "time", lambda: now)
    return list(remove_old(present, part, DAY * days))


def name_runs(count):
    return [f"armguard-20260101T{number:06}-7.mcap" for number in range(count)]


OWN = ["run.mcap", *(f"run.{number}.mcap" for number in range(2, 41))]


@pytest.mark.parametrize("names", [OWN, name_runs(40)])
def test_files_are_removed_once_they_are_old_and_only_recordings(names, tmp_path, monkeypatch):
    """One a day: what is older goes, but for the longest step, which does not count."""
    others = ["precious.mcap", "run.41.mcap", "run.mcap.bak", "armguard-notes.mcap", "x.txt"]
    make_files(tmp_path, others, [500.0] * len(others))
    present = make_files(tmp_path, names, reversed(range(40)))
    assert list_removed(present, 40, 39.0, monkeypatch) == []
    # Of 40 files those go that are 31 days old and more.
    assert list_removed(present, 40, 30.0, monkeypatch) == [*reversed(names[:9])]
    assert {one.name for one in tmp_path.iterdir()} == {*names[9:], *others}
    assert list_removed(present, 40, 30.0, monkeypatch) == []


def test_a_run_with_a_name_of_its_own_leaves_those_that_are_named_by_the_time(
    tmp_path, monkeypatch
):
    make_files(tmp_path, name_runs(40), reversed(range(40)))
    assert list_removed(make_files(tmp_path, ["run.mcap"], [0.0]), 1, 1.0, monkeypatch) == []


@pytest.mark.hazard("H-11")
@pytest.mark.parametrize("place", range(1, 41))
@pytest.mark.parametrize("jump", [0.3, 20.0, 3650.0])
def test_a_clock_that_jumps_forward_removes_nothing_that_is_young(
    place, jump, tmp_path, monkeypatch
):
    """Forty files, one a day; before one of them, or at present, the clock jumped by some days."""
    names = name_runs(40)
    true_ages = [*reversed(range(40))]
    ages = [age + jump * (number < place) for number, age in enumerate(true_ages)]
    present = make_files(tmp_path, names, ages)
    told = list_removed(present, 1, 20.0, monkeypatch)
    assert not set(told) & {name for name, age in zip(names, true_ages, strict=True) if age < 20.0}


@pytest.mark.hazard("H-11")
def test_files_from_a_clock_that_was_wrong_stay(tmp_path, monkeypatch):
    """One that was not set, one that was ahead; and ten files stay whatever the clock says."""
    names = name_runs(40)
    ages = [*map(float, reversed(range(40)))]
    ages[3], ages[5] = (NOW - 3600.0) / DAY, -100.0
    present = make_files(tmp_path, names, ages)
    later = make_files(tmp_path, ["armguard-20300101T000000-7.mcap"], [500.0])
    told = list_removed(present, 1, 20.0, monkeypatch)
    assert told
    assert {names[3], names[5]}.isdisjoint(told)
    assert later.exists()
    other = tmp_path / "other"
    other.mkdir()
    present = make_files(other, names, [500.0 * age for age in reversed(range(40))])
    assert len(list_removed(present, 1, 1e-3, monkeypatch)) in (28, 29)


@pytest.mark.hazard("H-11")
def test_a_clock_that_jumps_removes_nothing_young_where_two_runs_record_at_once(
    tmp_path, monkeypatch
):
    """One file a day of each run, and a clock that then jumps by a year."""
    runs = [name.removesuffix(".mcap") for name in name_runs(2)]
    for run in runs:
        names = [f"{run}.mcap", *(f"{run}.{part}.mcap" for part in range(2, 15))]
        present = make_files(tmp_path, names, reversed(range(14)))
    told = list_removed(present, 14, 11.5, monkeypatch, now=NOW + 365.0 * DAY)
    # Those that are 12 days old and more, but for one that follows the jump's step.
    assert {*told} == {f"{runs[0]}.mcap", f"{runs[0]}.2.mcap", f"{runs[1]}.mcap"}


@pytest.mark.hazard("H-11")
def test_a_run_under_a_clock_that_was_behind_stays_among_earlier_files(tmp_path, monkeypatch):
    """Its changes lie between those of older files, which does not make it older."""
    earlier, behind, present = name_runs(3)
    names = [earlier, *(find_part(Path(earlier), 1, part).name for part in range(2, 41))]
    make_files(tmp_path, names, [20.0 + 0.5 * age for age in reversed(range(40))])
    parts_behind = [find_part(Path(behind), 1, part).name for part in range(1, 4)]
    make_files(tmp_path, parts_behind, [38.0, 37.0, 36.0])
    latest = make_files(tmp_path, [present], [0.0])
    told = list_removed(latest, 1, 15.0, monkeypatch)
    assert told
    assert {*told} <= {*names}


def test_what_cannot_be_removed_is_told(tmp_path, monkeypatch):
    names = name_runs(40)
    present = make_files(tmp_path, names, reversed(range(40)))

    def refuse(self):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "unlink", refuse)
    told = list_removed(present, 1, 38.0, monkeypatch)
    assert told == [f"{names[0]} (not possible: Operation not permitted)"]
