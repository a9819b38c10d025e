"""Types of what operators give, found once for each kind of operands.

Numba tries all that an operator could mean, on strings, lists and sets as well, each time that it
meets one, and once more when it writes code for it. Kernels add, multiply and index the same few
kinds of numbers and arrays thousands of times: with this, the first time tells for all others.
"""

from __future__ import annotations

import operator
import types as python_types
from typing import Any

from numba import types as numba_types
from numba.core import typing as numba_typing

# Numba's functions are untyped: they are called as anything is.
types: Any = numba_types
typing: Any = numba_typing

EXTREMES: dict[Any, Any] = {min: operator.lt, max: operator.gt}
"""What says of two numbers that the later one is nearer to each extreme."""

_Signatures = dict[tuple[int, tuple[Any, ...]], tuple[Any, Any]]

_known: dict[Any, _Signatures] = {}
"""For each set of options of the compiler: signature by operator, named by its identity, and kinds
of operands. The operator stands beside it and lives as long."""
_operators: dict[tuple[Any, Any], Any] = {}
"""Numba's type of each operator, by the context that was asked."""


class OperatorTypes:
    """A context of Numba's type inference that knows operators which it was asked about before.

    Args:
        context: Numba's own.
        flags: Options that the function at hand is compiled with.
    """

    def __init__(self, context: Any, flags: Any) -> None:
        self._context = context
        self._signatures = _known.setdefault(flags.copy(), {})

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """Signature of a function for arguments of these types; None: there is none."""
        if not kws and _is_extreme(function, args):
            kinds = tuple(map(types.unliteral, args))
            return typing.signature(self._context.unify_types(*kinds), *kinds)
        if kws or not _is_operator(function) or not all(_is_plain(kind) for kind in args):
            return self._context.resolve_function_type(function, args, kws)
        key = id(function), tuple(args)
        if key not in self._signatures:
            signature = self._context.resolve_function_type(function, args, kws)
            if signature is None:
                return None
            self._signatures[key] = signature, function
        return self._signatures[key][0]

    def resolve_setitem(self, target: Any, index: Any, value: Any) -> Any:
        """Signature of setting an item of a target to a value."""
        setitem = self.find_operator(operator.setitem)
        return self.resolve_function_type(setitem, (target, index, value), {})

    def find_operator(self, function: Any) -> Any:
        """Numba's type of an operator."""
        key = self._context, function
        if key not in _operators:
            _operators[key] = self._context.resolve_value_type(function)
        return _operators[key]


def _is_extreme(function: Any, args: Any) -> bool:
    """Whether a call is that of the least or greatest of some numbers."""
    if not (isinstance(function, types.Function) and len(args) > 1):
        return False
    is_number = all(isinstance(kind, types.Integer | types.Float) for kind in args)
    return is_number and function.typing_key in EXTREMES


def _is_operator(function: Any) -> bool:
    """Whether a type of function is that of an operator or another function built into Python."""
    if isinstance(function, types.Function):
        return isinstance(function.typing_key, python_types.BuiltinFunctionType | type)
    return function is operator.getitem  # of which Numba asks for no type


def _is_plain(kind: Any) -> bool:
    """Whether a type is that of numbers, of arrays, or of tuples of these, and will not change."""
    if isinstance(kind, types.BaseTuple):
        return all(_is_plain(part) for part in kind)
    return isinstance(kind, types.Number | types.Boolean | types.Array) and kind.is_precise()
