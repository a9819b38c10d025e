from armguard.obstacles.record import Record
from armguard.obstacles.table import States


def test_what_may_differ_from_a_state_is_called_as_there():
    assert set(Record._fields) - {"states", "row"} < set(States._fields)
