import sys

import pytest

from armguard.jit.progress import (
    INTERVAL,
    PATIENCE,
    USUAL,
    Compilation,
    Progress,
    Work,
    following,
    telling,
)
from armguard.jit.progress import show_on_terminal as show


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class World:
    """Compilations that take as long as is asked for."""

    def __init__(self):
        self.told = []
        self.clock = Clock()
        self.compilation = Compilation(self.told.append, self.clock)

    def begin(self, name="kernel"):
        self.compilation.begin(name)

    def end(self, duration=0.0, is_compiled=True):
        self.clock.now += duration
        self.compilation.end(is_compiled)


def test_what_takes_a_moment_is_not_told():
    world = World()
    for _ in range(5):
        world.begin()
        world.end(0.1)
    assert world.told == []
    assert world.compilation.count == 5


def test_what_takes_longer_is_told_with_its_number_and_ends():
    world = World()
    world.begin("first")
    world.end(PATIENCE)
    world.clock.now += 1000.0
    world.begin("second")
    world.begin("third")
    world.clock.now += INTERVAL
    world.begin("fourth")
    for _ in range(3):
        world.end()
    duration = PATIENCE + INTERVAL
    assert world.told == [
        Progress(2, "second", PATIENCE), Progress(4, "fourth", pytest.approx(duration)), None
    ]  # fmt: skip
    world.begin("fifth")
    assert world.compilation.count == 4


def test_what_is_read_from_a_cache_does_not_count():
    world = World()
    for _ in range(5):
        world.begin()
        world.end(PATIENCE, is_compiled=False)
    assert world.compilation.count == 0
    assert world.told == []


def test_it_is_shown_on_a_terminal_alone(capsys, monkeypatch):
    show(Progress(1, "", 2.0))
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    show(Progress(1, "", 2.0))
    assert f"compiling kernel 1 of about {USUAL}" in capsys.readouterr().err
    show(None)
    assert capsys.readouterr().err == "\r\x1b[K"
    monkeypatch.setattr(sys, "stderr", None)
    show(Progress(1, "", 2.0))


def test_long_work_is_told_part_by_part_and_ends():
    told, clock = [], Clock()
    with telling(told.append), following("fitting spheres to link", 2, clock) as begin:
        begin("upper")
        clock.now += 5.0
        begin("lower")
    assert [str(one) for one in told[:2]] == [
        "fitting spheres to link 1 of 2: upper", "fitting spheres to link 2 of 2: lower"
    ]  # fmt: skip
    assert (told[1].duration, told[2]) == (5.0, None)


def test_long_work_ends_where_it_fails_and_is_silent_where_nobody_listens(capsys, monkeypatch):
    told = []

    def fail():
        with telling(told.append), following("trying", 1) as begin:
            begin("first")
            raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        fail()
    assert told[-1] is None
    with telling(None), following("trying", 1) as begin:
        begin("first")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    show(Work("fitting spheres to link", 1, 2, "upper", 0.0))
    # Unlike compiled kernels, nothing of it is kept.
    assert capsys.readouterr().err == "\r\x1b[Karmguard: fitting spheres to link 1 of 2: upper"
