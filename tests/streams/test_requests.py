from support.stream_messages import (
    MONOTONIC,
    ZONE,
    World,
    plan,
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
