from armguard.jit import numerics
from armguard.jit.numerics import ACCEPTANCE_SLACK, ALLOWED, MEANING


def test_each_code_but_that_of_success_has_words_of_its_own():
    codes = {
        value for name, value in vars(numerics).items() if name.isupper() and isinstance(value, int)
    }
    assert set(MEANING) == codes - {ALLOWED}
    assert len(set(MEANING.values())) == len(MEANING)


def test_slack_is_eight_units_in_the_last_place_of_one():
    assert ACCEPTANCE_SLACK == 2.0**-49
