from armguard import SeparationRule
from armguard.settings.separation_rule import HUMAN_SPEED


def test_a_rule_is_the_usual_one_unless_told_otherwise():
    assert SeparationRule() == (HUMAN_SPEED, 0.0, 0.0, 0.0)
