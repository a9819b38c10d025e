import inspect

import numpy as np

from armguard.obstacles.consistency import record_of
from armguard.obstacles.record import Record
from armguard.obstacles.table import States, make_states


def test_a_record_has_what_the_table_keeps_of_a_state():
    assert set(Record._fields) - {"size"} == set(States._fields) - {"point_count"}
    states = make_states(3, 2)
    for number, array in enumerate(states):
        array[1] = number + 1
    record = record_of.py_func(states, 1, 0.5, 2.0, 3.0)
    assert (record.radius, record.accel, record.speed) == (0.5, 2.0, 3.0)
    assert record.size == states.point_count[1]
    for field in ("points", "velocities", "position_error", "velocity_error", "stamp"):
        assert np.array_equal(getattr(record, field), getattr(states, field)[1])


def test_each_field_says_what_it_is_and_in_which_unit():
    source = inspect.getsource(Record)
    assert source.count('"""') == 2 * (len(Record._fields) + 1)
    assert source.count(" in [m") + source.count(" in [s]") == len(Record._fields) - 1
