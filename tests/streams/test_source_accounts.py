import msgspec
import numpy as np
import pytest

from armguard.messages.incoming import decode, to_points
from armguard.streams import SourceLimits
from armguard.streams.source_accounts import SourceAccount
from armguard.streams.stamp_clocks import MONOTONIC
from support.stream_messages import (
    World,
    obstacles,
    pack,
)


def crowd(names, **changes):
    position = [[float(i % 50), 1.0, 1.0] for i in range(len(names))]
    return obstacles(ids=list(names), position=position, velocity=None, **changes)


def make_world(**limits):
    return World(limits={"cam0": SourceLimits(**limits)})


def told(world):
    """What the verdict will know of."""
    return [(fault.source, fault.field, fault.value) for fault in world.obstacles.take_faults()]


def test_a_source_that_keeps_to_its_limits_is_no_fault():
    world = make_world(message_rate=10.0, obstacles=3)
    for second in range(3):
        world.clock.sleep_until(5.0 + second)
        world.send(*(crowd("abc", seq=10 * second + i) for i in range(10)))
    assert world.faults.total == 0
    assert len(world.obstacles) == 3


def test_more_messages_than_a_second_allows_are_refused_named_and_a_stop():
    world = make_world(message_rate=10.0)
    world.send(*(obstacles(seq=i) for i in range(15)))
    assert world.kinds() == ["beyond limit"]
    assert world.faults.total == 5
    assert "cam0 message 10" in world.lines[0]
    assert "max_message_rate, 10 a second" in world.lines[0]
    found = told(world)
    assert len(found) == 5
    assert found[0][0] == "cam0"
    # What others send is not held against them, and after a while it may send again.
    world.send(obstacles(source="cam1"))
    world.clock.sleep_until(5.2)
    world.send(obstacles(seq=15), obstacles(seq=16))
    assert world.faults.total == 5


def test_removals_count_as_messages():
    world = make_world(message_rate=2.0)
    remove = {"type": "remove", "ids": ["a"], "stamp": 1005.0, "source": "cam0"}
    world.send(remove, remove, remove)
    assert world.faults.count("beyond limit") == 1


def test_a_message_that_is_too_long_for_its_source_is_refused():
    world = make_world(message_size=300)
    world.send(crowd("abcdefghijklmnop"), obstacles(seq=2))
    assert world.faults.count("beyond limit") == 1
    assert "max_message_size, 300 at most" in world.lines[0]
    assert len(world.obstacles) == 1


def test_what_is_refused_for_its_size_or_rate_costs_little_and_goes_no_further(monkeypatch):
    decoded, converted = [], []
    monkeypatch.setattr(
        "armguard.streams.edge.decode", lambda data: decoded.append(data) or decode(data)
    )
    monkeypatch.setattr(
        "armguard.messages.batch.to_points",
        lambda field, *rest: converted.append(field) or to_points(field, *rest),
    )
    world = make_world(message_size=1000, message_rate=3.0)
    long = crowd([str(number) for number in range(1000)])
    world.send(pack(long), msgspec.json.encode(long), pack(long)[:-1])
    # The first two are refused by their headers. The last has no end: none can be read.
    assert decoded == [pack(long)[:-1]]
    assert world.faults.count("malformed") == 1
    assert world.faults.count("beyond limit") == 2
    assert converted == []
    world.send(*(obstacles(seq=number) for number in range(2, 12)))
    assert world.faults.count("beyond limit") == 11
    assert converted == ["position", "velocity"]
    # What was refused was not lost on the way.
    assert world.faults.count("lost") == 0


def test_a_long_message_beyond_the_rate_is_refused_undecoded(monkeypatch):
    decoded = []
    monkeypatch.setattr(
        "armguard.streams.edge.decode", lambda data: decoded.append(data) or decode(data)
    )
    world = make_world(message_rate=3.0)
    names = [str(number) for number in range(1000)]
    world.send(*(crowd(names, seq=number) for number in range(10)))
    assert len(decoded) == 3
    assert world.faults.counts["beyond limit", "cam0"] == 7
    assert world.faults.count("lost") == 0
    assert len(world.obstacles) == 1000


def test_malformed_messages_count_against_the_limits_of_the_source_that_they_name():
    world = make_world(message_rate=3.0)
    world.send(*(obstacles(seq=number, radius="wide") for number in range(5)))
    assert world.faults.counts["malformed", "cam0"] == 3
    assert world.faults.counts["beyond limit", "cam0"] == 2
    assert len(told(world)) == 2
    world = make_world(message_size=1000)
    world.send(obstacles(radius="wide", ids=[str(number) for number in range(1000)]))
    assert world.faults.counts["beyond limit", "cam0"] == 1


def test_obstacles_beyond_a_limit_are_refused_as_a_whole():
    world = make_world(obstacles=4)
    world.send(crowd("abc"), crowd("abcd", seq=2))
    assert world.faults.total == 0
    world.send(crowd("de", seq=3))
    assert world.faults.count("beyond limit") == 1
    assert "'cam0' has 5 obstacles; expected max_obstacles, 4 at most" in world.lines[0]
    assert told(world) == [
        (
            "cam0",
            "message",
            "one by which 'cam0' has 5 obstacles; expected max_obstacles, 4 at most",
        )
    ]
    assert len(world.obstacles) == 4
    # A snapshot replaces what was there; other sources have limits of their own.
    world.send(crowd("wxyz", seq=4, snapshot=True), crowd("abcde", source="cam1"))
    assert world.faults.total == 1
    world.send(crowd("uvwxyz", seq=5, snapshot=True))
    assert world.faults.total == 2


def test_a_crowd_beyond_the_usual_limit_costs_no_room():
    world = World()
    names = [str(i) for i in range(30_000)]
    world.send(crowd(names))
    assert world.faults.count("beyond limit") == 1
    assert len(world.obstacles) == 0


def test_more_sources_than_anybody_has_are_refused():
    world = World()
    for number in range(400):
        world.send(obstacles(source=f"made up {number}", ids=[f"id {number}"], seq=...))
    assert world.faults.count("too many sources") == 144
    assert len(world.obstacles) == 256


@pytest.mark.parametrize("rate", [0.5, 1.0, 7.0, 1000.0])
def test_an_allowance_keeps_to_its_rate_however_calls_are_spread(rate):
    """In any stretch of time T it grants no more than one second's worth, and rate times T."""
    random = np.random.default_rng(7)
    account, now, granted = (
        SourceAccount(SourceLimits(message_rate=rate), MONOTONIC, None, 0.0),
        0.0,
        [],
    )
    for _ in range(20_000):
        now += random.exponential(0.3 / rate)
        if account.allows_message(now):
            granted.append(now)
    times = np.array(granted)
    for k in (1, 5, 50, 500):
        assert (times[k:] - times[:-k] >= (k - max(1.0, rate)) / rate - 1e-6).all()
    # And it grants most of what there is room for: what comes while it is full is lost.
    assert len(times) >= 0.7 * rate * now


@pytest.mark.parametrize("jumps", [[-1e9, 1e9], [1e300, -1e300], [0.0, 0.0]])
def test_no_jump_of_a_clock_grants_more(jumps):
    account = SourceAccount(SourceLimits(message_rate=2.0), MONOTONIC, None, 0.0)
    for now in jumps:
        assert sum(account.allows_message(now) for _ in range(10)) <= 2
