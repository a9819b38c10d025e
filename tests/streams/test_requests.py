import numpy as np
import pytest

from armguard.streams import StampClock
from support.stream_messages import (
    MONOTONIC,
    ZONE,
    World,
    plan,
    two_arms,
)


def test_a_reset_ends_what_was_asked_for_a_time_before_it_in_the_same_drain():
    world = World(reset_token="sesame")
    asked = {"type": "ignore", "token": "sesame", "link": "hand", "ids": "part*"}
    until = {"until": MONOTONIC + 9.0}
    world.send(
        {**asked, **until, "number": 1},
        {**asked, "number": 2, "zone": ZONE},
        {"type": "watch", "number": 7},
        {"type": "reset", "token": "sesame"},
        {**asked, **until, "number": 3},
        {"type": "reset", "token": "guess"},
    )
    assert world.edge.requests.is_reset
    assert [one.number for one in world.edge.requests.exemptions] == [2, 7, 3]


def test_a_drain_forgets_what_the_one_before_asked_but_no_reset_that_was_not_obeyed():
    world = World(reset_token="sesame")
    reset = {"type": "reset", "token": "sesame", "number": 4}
    world.send(plan(), {"type": "watch", "number": 7}, reset, {"type": "watch", "number": 8})
    requests = world.edge.requests
    assert [one.number for one in requests.plans] == [3]
    assert [one.number for one in requests.exemptions] == [7, 8]
    assert [number for number, _ in requests.reset_verdicts] == [4]
    world.send()
    assert requests.plans == requests.exemptions == requests.reset_verdicts == []
    assert requests.is_reset


def test_plans_and_wanted_contact_go_to_the_arm_that_they_name():
    world, _ = two_arms(reset_token="sesame")
    asked = {"type": "ignore", "token": "sesame", "link": "hand", "ids": "part*", "zone": ZONE}
    for arm, number in (("right", 1), ("left", 2)):
        world.send(plan(arm=arm, number=number), {**asked, "arm": arm, "number": number})
    assert [(one.number, one.problem) for one in world.edge.requests.plans] == [(2, "")]
    assert [one.number for one in world.edge.requests.exemptions] == [2]
    assert world.faults.total == 0


@pytest.mark.parametrize("named", [{}, {"arm": "middle"}])
def test_plans_and_wanted_contact_of_no_arm_of_the_cell_are_refused(named):
    world, _ = two_arms(reset_token="sesame")
    asked = {"type": "ignore", "token": "sesame", "link": "hand", "ids": "part*", "zone": ZONE}
    world.send(plan(**named), {**asked, **named, "number": 2})
    (request,) = world.edge.requests.plans
    assert "arm" in request.problem
    assert world.edge.requests.exemptions == []
    assert world.faults.count("malformed") == 2


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
