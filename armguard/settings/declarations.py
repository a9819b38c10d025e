"""What a record declares of its settings: kinds, ranges, defaults, and their place in a cell file.

Constructors, cell files, recordings and pages read the declarations here, so that a setting is
written down once. msgspec checks values that it decodes; those that an application hands over are
checked here, by the same declaration, and infinite numbers and NaN are refused as well.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterable, Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import msgspec
import numpy as np
from msgspec import Meta

from armguard.exceptions import ArmguardError

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]

PLAIN = (float, int, bool, str)
"""Types of values that files and command lines can state."""

WORDS = {bool: "True or False", NoneType: "None", Iterable: "a list"}
"""What some types are called in errors."""


class Declaration(NamedTuple):
    """One setting as its record declares it."""

    name: str
    kinds: tuple[Any, ...]
    """Each type that its value can have: plain ones, `Literal`, classes, `NoneType`."""
    metas: tuple[Meta, ...]
    """Range, examples, and place in a cell file."""
    default: Any
    """`msgspec.NODEFAULT` where a function makes it."""

    @property
    def plain_type(self) -> Any:
        """The type that a file can state, with its range; None where there is no such type."""
        kinds = [kind for kind in self.kinds if kind in PLAIN or get_origin(kind) is Literal]
        if not kinds:
            return None
        ranges = [meta for meta in self.metas if _list_limits(meta)]
        kinds[0] = functools.reduce(lambda kind, meta: Annotated[kind, meta], ranges, kinds[0])
        return functools.reduce(operator.or_, kinds)

    @property
    def table(self) -> str:
        """The table of a cell file in which it stands."""
        return self._find_note("table", "monitor")

    @property
    def may_be_infinite(self) -> bool:
        """Whether its number can be infinite."""
        return self._find_note("may_be_infinite", False)

    @property
    def examples(self) -> tuple[Any, ...]:
        """Values that a trial tries."""
        return next((tuple(meta.examples) for meta in self.metas if meta.examples), ())

    @property
    def is_whole(self) -> bool:
        """Whether its numbers are whole."""
        return int in self.kinds

    @property
    def is_number(self) -> bool:
        """Whether its value can be a number."""
        return float in self.kinds or int in self.kinds

    @property
    def expected(self) -> str:
        """What its value must be, in words."""
        return ", or ".join(self._describe(kind) for kind in self.kinds)

    def check(self, value: object) -> object:
        """The value as the record holds it.

        Raises:
            ArmguardError: It is of another kind, out of range, infinite or NaN.
        """
        for kind in self.kinds:
            fits, read = self._read(kind, value)
            if fits:
                return read
        raise ArmguardError(self.name, f"is {value!r}", expected=self.expected)

    def _find_note(self, name: str, default: Any) -> Any:
        notes = [meta.extra for meta in self.metas if meta.extra]
        return next((note[name] for note in notes if name in note), default)

    def _read(self, kind: Any, value: Any) -> tuple[bool, object]:
        """Whether a value is of this kind and within range, and the value as it is kept."""
        if kind is float:
            number = read_number(value)
            is_usable = math.isfinite(number) or (self.may_be_infinite and not math.isnan(number))
            return is_usable and self._is_within(number), number
        if kind is int:
            is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            return is_whole and self._is_within(value), int(value) if is_whole else value
        if kind is bool:
            return isinstance(value, bool | np.bool_), bool(value)
        if get_origin(kind) is Literal:
            return isinstance(value, str) and value in get_args(kind), value
        return isinstance(value, get_origin(kind) or kind), value

    def _is_within(self, number: float) -> bool:
        return all(
            compare(number, limit)
            for meta in self.metas
            for _, compare, limit in _list_limits(meta)
        )

    def _describe(self, kind: Any) -> str:
        if kind in (float, int):
            ends = [end for meta in self.metas for end in _list_limits(meta)]
            limits = [words.format(limit) for words, _, limit in ends]
            number = "a whole number" if kind is int else "a finite number"
            number = "a number" if self.may_be_infinite else number
            return f"{number} {' and '.join(limits)}".strip()
        if get_origin(kind) is Literal:
            words = get_args(kind)
            return f"one of {', '.join(words)}" if len(words) > 1 else f'"{words[0]}"'
        kind = get_origin(kind) or kind
        if kind in WORDS:
            return WORDS[kind]
        package = kind.__module__.partition(".")[0]
        return f"{'an' if package[0] in 'aeiou' else 'a'} {package}.{kind.__name__}"


def _list_limits(meta: Meta) -> list[tuple[str, Any, float]]:
    """The ends of a range: in words, as a comparison that holds within it, and the number."""
    ends = (
        ("above {:g}", operator.gt, meta.gt),
        ("from {:g} on", operator.ge, meta.ge),
        ("below {:g}", operator.lt, meta.lt),
        ("up to {:g}", operator.le, meta.le),
    )
    return [(words, compare, limit) for words, compare, limit in ends if limit is not None]


@functools.cache
def read_declarations(record: type[msgspec.Struct]) -> Mapping[str, Declaration]:
    """What a record declares of each of its fields, by name."""
    return {
        field.name: Declaration(field.name, *_split(field.type), field.default)
        for field in msgspec.structs.fields(record)
    }


def _split(declared: Any) -> tuple[tuple[Any, ...], tuple[Meta, ...]]:
    """The kinds within a type, and what is annotated to any of them."""
    if get_origin(declared) is Annotated:
        inner, *notes = get_args(declared)
        kinds, metas = _split(inner)
        return kinds, (*metas, *(note for note in notes if isinstance(note, Meta)))
    if get_origin(declared) in (Union, UnionType):
        parts = [_split(one) for one in get_args(declared)]
        return sum((kinds for kinds, _ in parts), ()), sum((metas for _, metas in parts), ())
    return (declared,), ()


def read_number(value: object) -> float:
    """The number that `value` is; NaN for whatever is not one."""
    try:
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
            return math.nan
        return float(value)
    except Exception:
        # Whatever a foreign object raises here, it is no number.
        return math.nan


def check_fields(record: msgspec.Struct) -> None:
    """Check every field of a record by its declaration, and keep its value as declared.

    Raises:
        ArmguardError: One of them is of another kind or out of range.
    """
    for name, declaration in read_declarations(type(record)).items():
        value = declaration.check(getattr(record, name))
        msgspec.structs.force_setattr(record, name, value)
