import math

import pytest

from armguard import SeparationRule
from armguard.exceptions import ArmguardError
from armguard.settings.separation_rule import HUMAN_SPEED


def test_a_rule_is_the_usual_one_unless_told_otherwise():
    assert SeparationRule() == SeparationRule(HUMAN_SPEED, 0.0, 0.0, 0.0)


def test_the_speed_of_each_obstacle_has_a_word():
    assert SeparationRule(human_speed="own") == SeparationRule(human_speed=None)


@pytest.mark.parametrize("name", SeparationRule.__struct_fields__)
@pytest.mark.parametrize("bad", [-0.1, math.nan, math.inf, "far"])
def test_a_number_that_makes_no_sense_is_refused_by_name(name, bad):
    with pytest.raises(ArmguardError, match=f"^{name}: is .*; expected a finite number from 0 on"):
        SeparationRule(**{name: bad})
