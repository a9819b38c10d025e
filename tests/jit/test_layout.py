import numpy as np
import pytest

from armguard.jit.layout import CACHE_LINE, make_records

FIELDS = {
    "time": (float, ()),
    "place": (float, (2, 3)),
    "count": (np.int32, (5,)),
    "on": (bool, ()),
}


@pytest.mark.parametrize("rows", [0, 1, 2, 100])
def test_every_field_has_its_shape_and_kind_and_begins_as_zeros(rows):
    arrays = make_records(rows, **FIELDS)
    for array, (kind, shape) in zip(arrays, FIELDS.values(), strict=True):
        assert array.shape == (rows, *shape)
        assert array.dtype == kind
        assert array.flags.aligned
        assert not array.any()


def test_a_row_is_one_record_on_cache_lines_of_its_own():
    arrays = make_records(50, **FIELDS)
    used = 8 + 48 + 20 + 1
    size = -(-used // CACHE_LINE) * CACHE_LINE
    first = min(array.ctypes.data for array in arrays)
    assert first % CACHE_LINE == 0
    for array in arrays:
        assert array.strides[0] == size
        assert first <= array.ctypes.data < first + used


def test_small_records_share_a_line_and_none_lies_on_two():
    one, other = make_records(100, one=(np.int32, ()), other=(np.int8, ()))
    assert one.strides == other.strides == (8,)
    assert one.ctypes.data % CACHE_LINE == 0


def test_fields_do_not_overlap():
    arrays = make_records(3, **FIELDS)
    for number, array in enumerate(arrays):
        array[...] = number % 2
    for number, array in enumerate(arrays):
        assert (array == number % 2).all()
