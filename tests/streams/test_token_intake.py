import numpy as np

from armguard.streams import StampClock
from support.stream_messages import (
    MONOTONIC,
    ZONE,
    World,
)


def test_a_reset_needs_the_token_of_the_run():
    closed, opened = World(), World(reset_token="sesame")
    for world in (closed, opened):
        world.send({"type": "reset", "token": "open"}, {"type": "reset", "token": ""})
        assert not world.edge.requests.is_reset
        assert world.faults.count("reset refused") == 2
    closed.send({"type": "reset", "token": "sesame"})
    opened.send({"type": "reset", "token": "sesame"})
    assert not closed.edge.requests.is_reset
    assert opened.edge.requests.is_reset


def test_contact_that_is_wanted_needs_the_token_and_its_end_does_not():
    world = World(reset_token="sesame")
    asked = {"type": "ignore", "number": 7, "token": "sesame", "link": "hand", "ids": "part*"}
    world.send(
        {**asked, "until": MONOTONIC + 9.0, "source": "eye"},
        {**asked, "number": 8, "zone": ZONE},
        {**asked, "number": 9, "zone": np.array(ZONE).tobytes()},
        {"type": "watch", "number": 7},
    )
    until, listed, packed, end = world.edge.requests.exemptions
    assert until[:5] == (7, False, "hand", "part*", "eye")
    # Never later than was meant.
    assert 9.0 - 1e-9 <= until.until <= 9.0
    assert until.zone is None
    for one in (listed, packed):
        assert one.until is None
        assert np.array_equal(one.zone, ZONE)
    assert (end.number, end.is_end) == (7, True)
    world.send({**asked, "token": "open", "until": 9.0}, {**asked, "zone": [[1.0, 2.0]]})
    assert world.edge.requests.exemptions == []
    assert world.faults.count("ignore refused") == 1
    assert world.faults.count("malformed") == 1
    closed = World()
    closed.send({**asked, "until": 9.0})
    assert closed.edge.requests.exemptions == []
    assert closed.faults.count("ignore refused") == 1


def test_contact_is_not_wanted_for_longer_because_clocks_differ():
    clock = StampClock("monotonic", 0.5, 0.02)
    world = World(reset_token="sesame", joint_clock=clock)
    asked = {"type": "ignore", "number": 7, "token": "sesame", "link": "hand", "ids": "part*"}
    world.send({**asked, "until": MONOTONIC + 9.0})
    assert 8.98 - 1e-9 <= world.edge.requests.exemptions[0].until <= 8.98
