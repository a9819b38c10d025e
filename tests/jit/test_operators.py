import operator

import pytest
from numba import types

from armguard.jit.operators import OperatorTypes


class Flags(tuple):
    def copy(self):
        return self


class Context:
    """Stands for Numba's: its answers are distinct objects, each given once."""

    def __init__(self):
        self.asked = []

    def resolve_value_type(self, function):
        return types.Function(type("Operator", (), {"key": function}))

    def resolve_function_type(self, function, args, kws):
        self.asked.append((function, args, kws))
        return object()


FLOAT, ADD = types.float64, types.Function(type("Add", (), {"key": operator.add}))
ARRAY = types.Array(FLOAT, 1, "C")


@pytest.fixture
def known():
    context = Context()
    return context, OperatorTypes(context, Flags((object(),)))


def ask(known, function=ADD, args=(FLOAT, FLOAT), kws=None):
    return known[1].resolve_function_type(function, args, kws or {})


@pytest.mark.parametrize("args", [(FLOAT, FLOAT), (ARRAY, types.UniTuple(types.int64, 2))])
def test_an_operator_is_asked_for_once_for_each_kind_of_operands(known, args):
    assert ask(known, args=args) is ask(known, args=args)
    assert len(known[0].asked) == 1
    assert ask(known, args=(types.int64, FLOAT)) is not ask(known, args=args)
    assert len(known[0].asked) == 2


def test_items_are_asked_for_once_by_whatever_name(known):
    assert ask(known, operator.getitem, (ARRAY, types.int64)) is ask(
        known, operator.getitem, (ARRAY, types.int64)
    )
    assert known[1].resolve_setitem(ARRAY, types.int64, FLOAT) is known[1].resolve_setitem(
        ARRAY, types.int64, FLOAT
    )
    assert len(known[0].asked) == 2


def test_other_options_of_the_compiler_are_asked_for_anew(known):
    other = known[0], OperatorTypes(known[0], Flags((object(),)))
    assert ask(known) is not ask(other)


@pytest.mark.parametrize(
    "asked",
    [
        {"kws": {"key": FLOAT}},
        {"args": (types.undefined, FLOAT)},
        {"args": (types.List(FLOAT), types.int64)},
        {"args": (types.Tuple([FLOAT, types.unicode_type]), types.int64)},
        {"function": types.Function(type("Mine", (), {"key": ask}))},
        {"function": operator.add},
    ],
)
def test_what_is_no_operator_on_numbers_is_left_to_numba(known, asked):
    assert ask(known, **asked) is not ask(known, **asked)
    assert len(known[0].asked) == 2


def test_what_there_is_no_meaning_of_is_not_kept(known, monkeypatch):
    monkeypatch.setattr(known[0], "resolve_function_type", lambda *_: None)
    assert ask(known) is None
    monkeypatch.undo()
    assert ask(known) is not None
