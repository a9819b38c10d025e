import math
from decimal import Decimal
from fractions import Fraction
from typing import Annotated, Literal

import msgspec
import numpy as np
import pytest
from msgspec import Meta

from armguard.exceptions import ArmguardError
from armguard.settings.declarations import check_fields, read_declarations, read_number


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
        pytest.param(object(), id="object"),
    ],
    ids=repr,
)
def test_whatever_else_there_is_is_none(value):
    assert math.isnan(read_number(value))


class Refusing(float):
    """A number that will not be read."""

    def __float__(self):
        raise ValueError("no")


class Nameless:
    """What will not even say what it is, as a proxy of something gone."""

    @property
    def __class__(self):
        raise ReferenceError("gone")


def test_what_raises_when_it_is_read_is_no_number():
    for value in (Refusing(1.0), Nameless()):
        assert math.isnan(read_number(value))


class Rule(msgspec.Struct):
    """A record within one."""


class Record(msgspec.Struct, frozen=True, kw_only=True):
    share: Annotated[float, Meta(ge=0.0, lt=1.0, examples=[0.5], extra={"table": "bounds"})] = 0.1
    count: Annotated[int, Meta(gt=0)] | None = None
    word: Literal["one", "other"] | np.ndarray = "one"
    flag: bool = False
    rule: Rule | None = None

    def __post_init__(self):
        check_fields(self)


def test_a_declaration_says_what_the_record_does():
    share, count, word, flag, rule = read_declarations(Record).values()
    assert (share.table, list(share.examples), share.default) == ("bounds", [0.5], 0.1)
    assert (count.table, list(count.examples), count.default) == ("monitor", [], None)
    assert [one.is_number for one in (share, count, word, flag)] == [True, True, False, False]
    assert share.plain_type == Annotated[float, Meta(ge=0.0, lt=1.0)]
    assert word.plain_type == Literal["one", "other"]
    assert flag.plain_type is bool
    words = [rule.describe(in_file=in_file) for in_file in (False, True)]
    assert words == ["Rule, or None", "a table, or None"]


@pytest.mark.parametrize(
    ("name", "wrong", "expected"),
    [
        ("share", 1.0, "a finite number from 0 on and below 1"),
        ("share", math.nan, "a finite number"),
        ("share", math.inf, "a finite number"),
        ("share", None, "a finite number"),
        ("count", 0, "a whole number above 0, or None"),
        ("count", 2.0, "a whole number"),
        ("count", True, "a whole number"),
        ("word", "none", "one of 'one', 'other', or ndarray"),
        ("word", None, "one of"),
        ("flag", 1, "true or false"),
        ("rule", {}, "Rule, or None"),
    ],
)
def test_what_is_not_as_declared_is_refused_in_the_words_of_the_declaration(name, wrong, expected):
    with pytest.raises(ArmguardError, match=f"^{name}: is .*; expected {expected}"):
        Record(**{name: wrong})


def test_values_are_kept_as_they_are_declared():
    kept = Record(share=np.float32(0.25), count=np.int8(7), flag=True)
    assert (kept.share, kept.count, kept.flag) == (0.25, 7, True)
    assert [type(one) for one in (kept.share, kept.count, kept.flag)] == [float, int, bool]
    assert type(Record(share=0).share) is float
    word = Record(word=np.str_("other")).word
    assert (word, type(word)) == ("other", str)
