"""Messages as JSON that viewers of recordings can read, and back to the bit.

A field that is packed on the wire stands as a flat list of numbers here, and rows of numbers stand
one after another in one list. A field that is one number or text for all or one for each is always
a list; one alone holds for all. What JSON has no number for stands as one of the strings
"Infinity", "-Infinity" and "NaN". Fields that do not apply are left out. Schemas keep to what
viewers understand: no unions, no lists of lists.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Callable
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

import msgspec
import numpy as np

from armguard.messages.incoming import to_plain
from armguard.robot.portable import read_numbers, write_number, write_numbers

_Message = TypeVar("_Message", bound=msgspec.Struct)

_encoder = msgspec.json.Encoder(enc_hook=to_plain)

_PLAIN = {int: "integer", str: "string", bool: "boolean"}


class _Form(NamedTuple):
    """How values of a type stand in JSON."""

    schema: dict[str, Any]
    write: Callable[[Any], Any] | None = None
    """Makes what JSON holds of a value; None: it stands as it is."""
    read: Callable[[Any], Any] | None = None
    """Makes what msgspec converts to the type of what JSON holds; None: that itself."""


class _Field(NamedTuple):
    name: str
    form: _Form
    is_required: bool
    is_nullable: bool


def write_json(message: msgspec.Struct) -> bytes:
    """A message as JSON."""
    return _encoder.encode(_write_struct(message))


def read_json(kind: type[_Message], data: bytes) -> _Message:
    """The message of a kind that `write_json` made JSON of.

    Raises:
        ValueError: It is something else.
    """
    try:
        return msgspec.convert(_read_struct(kind, msgspec.json.decode(data)), kind, strict=False)
    except (TypeError, AttributeError) as error:
        raise ValueError(str(error)) from None


def make_schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The JSON schema of a kind of message, in the part of the language that viewers understand."""
    tag = {} if _read_tag(kind) is None else {"type": {"type": "string"}}
    fields = _list_fields(kind)
    needed = [one.name for one in fields if one.is_required and not one.is_nullable]
    return {
        "title": kind.__name__,
        "description": (kind.__doc__ or "").partition("\n")[0],
        "type": "object",
        "properties": tag | {one.name: one.form.schema for one in fields},
        "required": [*tag, *needed],
    }


def _read_tag(kind: type[msgspec.Struct]) -> Any:
    return kind.__struct_config__.tag


@functools.cache
def _list_fields(kind: type[msgspec.Struct]) -> tuple[_Field, ...]:
    return tuple(
        _Field(
            field.name,
            _find_form(field.type),
            field.required,
            type(None) in get_args(field.type),
        )
        for field in msgspec.structs.fields(kind)
    )


def _write_struct(message: msgspec.Struct) -> dict[str, Any]:
    kind = type(message)
    tag = _read_tag(kind)
    written: dict[str, Any] = {} if tag is None else {"type": tag}
    for name, (_, write, _), _, _ in _list_fields(kind):
        value = getattr(message, name)
        if value is not None:
            written[name] = value if write is None else write(value)
    return written


def _read_struct(kind: type[msgspec.Struct], written: dict[str, Any]) -> dict[str, Any]:
    for name, (_, _, read), is_required, is_nullable in _list_fields(kind):
        if name in written:
            if read is not None:
                written[name] = read(written[name])
        elif is_required and is_nullable:
            written[name] = None
    return written


def _find_form(kind: Any) -> _Form:
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) in (Union, types.UnionType):
        options = [one for one in get_args(kind) if one is not type(None)]
        if str in options and len(options) > 1:
            return _TEXTS
        if bytes in options:
            return _VALUES if float in options else _PACKED
        return _find_form(options[0])
    if kind is float:
        return _NUMBER
    if kind is bytes:
        return _PACKED
    if get_origin(kind) is Literal:
        return _Form({"type": "string", "enum": list(get_args(kind))})
    if get_origin(kind) is list:
        return _find_list_form(get_args(kind)[0])
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return _Form(make_schema(kind), _write_struct, functools.partial(_read_struct, kind))
    return _Form({"type": _PLAIN[kind]})


def _find_list_form(kind: Any) -> _Form:
    if get_origin(kind) is tuple:
        width = len(get_args(kind))
        return _PACKED._replace(
            write=lambda rows: write_numbers(np.ravel(np.array(rows, float))),
            read=lambda values: read_numbers(values).reshape(-1, width).tolist(),
        )
    schema, write, read = _find_form(kind)
    return _Form(
        {"type": "array", "items": schema},
        None if write is None else lambda values: [write(value) for value in values],
        None if read is None else lambda values: [read(value) for value in values],
    )


def _write_packed(values: bytes) -> Any:
    return write_numbers(np.frombuffer(values, "<f8"))


def _read_packed(values: list[float | str]) -> bytes:
    numbers = read_numbers(values)
    if numbers.ndim != 1:
        raise ValueError(f"numbers of shape {numbers.shape}, expected a list")
    return numbers.tobytes()


def _write_values(values: float | bytes) -> Any:
    return [write_number(values)] if isinstance(values, float) else _write_packed(values)


def _read_values(values: list[float | str]) -> float | bytes:
    return float(values[0]) if len(values) == 1 else _read_packed(values)


def _write_texts(texts: str | list[str]) -> list[str]:
    return [texts] if isinstance(texts, str) else texts


def _read_texts(texts: list[str]) -> str | list[str]:
    return texts[0] if len(texts) == 1 else texts


_NUMBER = _Form({"type": "number"}, write_number)
_NUMBERS = {"type": "array", "items": _NUMBER.schema}
_PACKED = _Form(_NUMBERS, _write_packed, _read_packed)
_VALUES = _Form(_NUMBERS, _write_values, _read_values)
_TEXTS = _Form({"type": "array", "items": {"type": "string"}}, _write_texts, _read_texts)
