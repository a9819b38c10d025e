import inspect

from armguard.obstacles.record import Record
from armguard.obstacles.table import States


def test_each_field_says_what_it_is_and_in_which_unit():
    source = inspect.getsource(Record)
    assert source.count('"""') == 2 * (len(Record._fields) + 1)
    assert source.count(" in [m") == len(Record._fields) - 2


def test_what_may_differ_from_a_state_is_called_as_there():
    assert set(Record._fields) - {"states", "row"} < set(States._fields)
