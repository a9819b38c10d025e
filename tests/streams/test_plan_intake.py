import pytest

from support.stream_messages import (
    ZONE,
    plan,
    two_arms,
)


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
