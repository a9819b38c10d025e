import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.monitor_arguments import check_not_negative, read_budget, read_number


@pytest.mark.parametrize("value", [0, -3, 2.5, 10**30, math.inf, np.float32(0.5), np.int8(7)])
def test_numbers_are_read_as_what_they_are(value):
    assert read_number(value) == float(value)
    assert type(read_number(value)) is float


@pytest.mark.parametrize(
    "value",
    [
        None,
        "1",
        b"1",
        True,
        np.bool_(True),
        1j,
        [1.0],
        np.ones(1),
        Decimal(1),
        Fraction(1, 2),
        math.nan,
        10**400,
        -(10**400),
        object(),
    ],
    ids=repr,
)
def test_whatever_else_there_is_is_none(value):
    assert math.isnan(read_number(value))


@pytest.mark.parametrize("value", [0, 0.0, 5, 1e300, np.float64(0.1)])
def test_durations_that_make_sense(value):
    check_not_negative(hold=value, latency=0.0)


@pytest.mark.parametrize("value", [-1e-300, -1, math.inf, math.nan, None, "0", True])
def test_durations_that_do_not(value):
    with pytest.raises(ArmguardError, match="latency"):
        check_not_negative(hold=0.0, latency=value)


def test_a_budget_is_a_whole_number_for_deadlines_alone():
    assert read_budget(None, by_deadline=True) is None
    assert read_budget(None, by_deadline=False) is None
    assert read_budget(np.int32(5), by_deadline=True) == 5
    assert type(read_budget(np.int32(5), by_deadline=True)) is int
    for wrong in (0, -1, 1.0, math.inf, True, "5", [5]):
        with pytest.raises(ArmguardError, match="budget"):
            read_budget(wrong, by_deadline=True)
    with pytest.raises(ArmguardError, match="deadline"):
        read_budget(5, by_deadline=False)
