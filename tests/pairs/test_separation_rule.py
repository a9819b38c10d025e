import inspect

from armguard.pairs import SeparationRule, compute_separation


def test_a_person_walks_as_fast_where_nothing_is_said():
    parameters = inspect.signature(compute_separation).parameters
    assert SeparationRule().human_speed == parameters["human_speed"].default
    for name in SeparationRule._fields[1:]:
        assert getattr(SeparationRule(), name) == parameters[name].default
