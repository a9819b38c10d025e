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


def test_what_cannot_be_removed_is_told(tmp_path, monkeypatch):
    names = name_runs(40)
    present = make_files(tmp_path, names, reversed(range(40)))

    def refuse(self):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "unlink", refuse)
    told = list_removed(present, 1, 38.0, monkeypatch)
    assert told == [f"{names[0]} (not possible: Operation not permitted)"]
