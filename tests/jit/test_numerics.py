import re
from pathlib import Path

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


def test_every_allowance_stands_in_numerics():
    """But for the simulation's, which proves nothing."""
    package = Path(numerics.__file__).parents[1]
    allowance = re.compile(r"^\w*(?:ROUNDING|SLACK)\w* = ", re.MULTILINE)
    found = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if allowance.search(path.read_text(encoding="utf-8"))
        and "simulation" not in path.relative_to(package).parts
    }
    assert found == {"jit/numerics.py"}
