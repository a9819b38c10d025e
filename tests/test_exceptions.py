import inspect

import pytest

from armguard import exceptions
from armguard.exceptions import ArmguardError

CHILDREN = [kind for _, kind in inspect.getmembers(exceptions, inspect.isclass)]


@pytest.mark.parametrize("kind", CHILDREN)
def test_every_error_carries_its_parts_and_spells_them_in_one_line(kind):
    error = kind("joint 'a'", "has no limit", expected="a number", remedy="give one")
    assert isinstance(error, ArmguardError)
    assert (error.offender, error.problem) == ("joint 'a'", "has no limit")
    assert (error.expected, error.remedy) == ("a number", "give one")
    assert str(error) == "joint 'a': has no limit; expected a number; give one"


def test_what_is_obvious_is_left_out():
    assert str(ArmguardError("q", "is 3")) == "q: is 3"
    assert str(ArmguardError("q", "is 3", remedy="wait")) == "q: is 3; wait"
