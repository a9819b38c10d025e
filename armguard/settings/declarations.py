"""What a record declares of its settings: kinds, ranges, defaults, and their place in a cell file.

Constructors, cell files, recordings and pages read the declarations here, so that a setting is
written down once. msgspec checks values that it decodes; those that an application hands over are
checked here, by the same declaration, and infinite numbers and NaN are refused as well.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import msgspec
import numpy as np
from msgspec import Meta, Struct, UnsetType

from armguard.exceptions import ArmguardError

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]

PLAIN = (float, int, bool, str)
"""Types of values that files and command lines can state."""

WORDS = {
    bool: "true or false", NoneType: "None", str: "text",
    Iterable: "a list", list: "a list", tuple: "a list", dict: "a table",
}  # fmt: skip
"""What some types are called in errors."""


LIMITS: Mapping[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "gt": ("above {:g}", operator.gt),
    "ge": ("from {:g} on", operator.ge),
    "lt": ("below {:g}", operator.lt),
    "le": ("up to {:g}", operator.le),
}
"""Ends of a range as `Meta` names them: in words, and as a comparison that holds within it."""


class Declaration(NamedTuple):
    """One setting as its record declares it."""

    name: str
    kinds: tuple[Any, ...]
    """Each type that its value can have: plain ones, `Literal`, classes, `NoneType`."""
    notes: Mapping[str, Any]
    """What `Meta` says of it: `LIMITS`, examples, `table` and `may_be_infinite`."""
    default: Any

    @property
    def plain_type(self) -> Any:
        """The type that a file can state, with its range; None where there is no such type."""
        plain = [kind for kind in self.kinds if kind in PLAIN or get_origin(kind) is Literal]
        if plain and self.is_number:
            plain[0] = Annotated[plain[0], Meta(**{end: self.notes[end] for end in self._ends})]
        return functools.reduce(operator.or_, plain) if plain else None

    @property
    def table(self) -> str:
        """The table of a cell file in which it stands; empty where it has a form of its own."""
        return self.notes.get("table", "monitor")

    @property
    def examples(self) -> Sequence[Any]:
        """Values that a trial tries."""
        return self.notes.get("examples", ())

    @property
    def is_number(self) -> bool:
        """Whether its value can be a number."""
        return float in self.kinds or int in self.kinds

    def describe(self, *, in_file: bool) -> str:
        """What its value must be, in words; in a file a record is a table."""
        kinds = [self._describe(kind, in_file) for kind in self.kinds if kind is not UnsetType]
        return ", or ".join(kinds)

    def check(self, value: object) -> object:
        """The value as the record holds it.

        Raises:
            ArmguardError: It is of another kind, out of range, infinite or NaN.
        """
        for kind in self.kinds:
            fits, read = self._read(kind, value)
            if fits:
                return read
        raise ArmguardError(self.name, f"is {value!r}", expected=self.describe(in_file=False))

    @property
    def _ends(self) -> list[str]:
        return [end for end in LIMITS if end in self.notes]

    def _read(self, kind: Any, value: Any) -> tuple[bool, object]:
        """Whether a value is of this kind and within range, and the value as it is kept."""
        if kind in (float, int):
            number = read_number(value)
            fits = math.isfinite(number) or ("may_be_infinite" in self.notes and number == math.inf)
            fits = fits and all(LIMITS[end][1](number, self.notes[end]) for end in self._ends)
            if kind is float:
                return fits, number
            is_whole = isinstance(value, int | np.integer)
            return fits and is_whole, int(value) if fits and is_whole else value
        if get_origin(kind) is Literal:
            # As a plain text, which every writer of settings knows.
            is_one = isinstance(value, str) and value in get_args(kind)
            return is_one, str(value) if is_one else value
        return isinstance(value, get_origin(kind) or kind), value

    def _describe(self, kind: Any, in_file: bool) -> str:
        if kind in (float, int):
            number = "a whole number" if kind is int else "a finite number"
            number = "a number" if "may_be_infinite" in self.notes else number
            limits = [LIMITS[end][0].format(self.notes[end]) for end in self._ends]
            return f"{number} {' and '.join(limits)}".strip()
        if get_origin(kind) is Literal:
            words = [repr(word) for word in get_args(kind)]
            return f"one of {', '.join(words)}" if len(words) > 1 else words[0]
        kind = get_origin(kind) or kind
        if in_file and issubclass(kind, Struct):
            return "a table"
        return WORDS.get(kind, kind.__name__)


@functools.cache
def read_declarations(record: type[Struct]) -> Mapping[str, Declaration]:
    """What a record declares of each of its fields, by name."""
    return {
        field.name: Declaration(field.name, *_split(field.type), field.default)
        for field in msgspec.structs.fields(record)
    }


def _split(declared: Any) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """The kinds within a type, and what is annotated to any of them."""
    kinds: tuple[Any, ...] = ()
    notes: dict[str, Any] = {}
    parts = get_args(declared)
    if get_origin(declared) is Annotated:
        kinds, notes = _split(parts[0])
        for meta in parts[1:]:
            stated = {name: getattr(meta, name) for name in (*LIMITS, "examples")}
            notes |= {name: one for name, one in stated.items() if one is not None}
            notes |= meta.extra or {}
        return kinds, notes
    if get_origin(declared) not in (Union, UnionType):
        return (declared,), {}
    for part in parts:
        more, beside = _split(part)
        kinds, notes = kinds + more, notes | beside
    return kinds, notes


def read_number(value: object) -> float:
    """The number that `value` is; NaN for whatever is not one."""
    try:
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
            return math.nan
        return float(value)
    except Exception:
        # Whatever a foreign object raises here, it is no number.
        return math.nan


def check_fields(record: Struct) -> None:
    """Check every field of a record by its declaration, and keep its value as declared.

    Raises:
        ArmguardError: One of them is of another kind or out of range.
    """
    for name, declaration in read_declarations(type(record)).items():
        value = declaration.check(getattr(record, name))
        msgspec.structs.force_setattr(record, name, value)
