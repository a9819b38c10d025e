import os
import time
from pathlib import Path

import pytest

from armguard.exceptions import ArmguardError
from armguard.recording.parts import (
    Rotation,
    find_part,
    is_begun,
    name_by_time,
    open_file,
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


def test_a_file_is_begun_once_something_is_in_it(tmp_path):
    path = tmp_path / name_by_time()
    assert not is_begun(path)
    descriptor = open_file(path)
    assert not is_begun(path)
    os.write(descriptor, b"x")
    os.close(descriptor)
    assert is_begun(path)
    assert not is_begun(tmp_path)


def test_only_recordings_that_are_old_enough_are_removed(tmp_path):
    old = time.time() - 100.0
    own = ["run.mcap", "run.2.mcap", "run.3.mcap"]
    by_time = ["armguard-20261125T101112-77.mcap", "armguard-20261125T101112-77.12.mcap"]
    others = ["precious.mcap", "run.4.mcap", "run.mcap.bak", "armguard-notes.mcap", "x.txt"]
    for name in [*own, *by_time, *others, "armguard-20261126T101112-78.mcap"]:
        (tmp_path / name).write_text("x")
        os.utime(tmp_path / name, (old, old))
    os.utime(tmp_path / "armguard-20261126T101112-78.mcap")
    present = tmp_path / "run.3.mcap"
    assert list(remove_old(present, 3, 1000.0)) == []
    removed = list(remove_old(present, 3, 50.0))
    assert sorted(removed) == sorted([*by_time, "run.mcap", "run.2.mcap"])
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"run.3.mcap", "armguard-20261126T101112-78.mcap", *others}


def test_what_cannot_be_removed_is_told(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    path.write_text("x")
    os.utime(path, (0.0, 0.0))

    def refuse(self):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "unlink", refuse)
    told = list(remove_old(tmp_path / "run.2.mcap", 2, 1.0))
    assert told == ["run.mcap (not possible: Operation not permitted)"]
