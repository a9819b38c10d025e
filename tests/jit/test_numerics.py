import re
from pathlib import Path

from armguard.jit import numerics
from armguard.jit.numerics import ACCEPTANCE_SLACK


def test_no_two_codes_are_alike():
    codes = [
        value for name, value in vars(numerics).items() if name.isupper() and isinstance(value, int)
    ]
    assert len(set(codes)) == len(codes)


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
