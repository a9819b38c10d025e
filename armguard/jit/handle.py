"""Handles: many arrays as one argument of a compiled call.

Each array that Python hands to compiled code costs some 60 ns, and a tick needs a hundred. A handle
on a named tuple, whatever named tuples it holds, crosses as one pointer: to a block of memory with
the addresses, shapes and strides of all arrays, and the numbers. Compiled code reads a field where
it stands, when it needs it, and passes a named tuple within on as a pointer as well: a tuple of
arrays by value would be copied at each call, which takes long to run and far longer to compile.

What compiled code reads from a handle it borrows: references are not counted. The caller holds the
handle until the call returns, and compiled code keeps nothing of it.

All of this uses `numba.extending`, Numba's public interface for types of one's own, and so it is
the same with every version of Numba. One class comes from elsewhere, `AttributeTemplate`: what is
registered by `infer_getattr` must derive from it, and no public name leads to it.
"""

from __future__ import annotations

import functools
import hashlib
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import extending as numba_extending
from numba import types as numba_types

# Numba's functions are untyped: they are called as anything is.
extending: Any = numba_extending
typeof: Any = numba.typeof
types: Any = numba_types
# `infer_getattr` demands this class; no public name leads to it.
AttributeTemplate: Any = numba.core.typing.templates.AttributeTemplate

WORD = 8
"""[bytes]: what each number, address, length and stride takes in a handle's memory."""


class Field(NamedTuple):
    """Where one field of a named tuple stands."""

    start: int
    """First word, counted from the tuple's own."""
    kind: Any
    """Numba's type."""


class HandleType(types.Type):  # type: ignore[misc]  # a class of unknown type
    """Numba's type of handles and of the named tuples within: what each field is, and where.

    Tuples of one class whose arrays are of the same types have the same type. It knows the class by
    name alone, so that a cache with kernels for it can be read where the class cannot be imported.

    Args:
        title: Name of the tuple's class.
        fields: Name and type of each field.
    """

    def __init__(self, title: str, fields: tuple[tuple[str, Any], ...]) -> None:
        self.fields = {}
        self.size = 0
        for name, kind in fields:
            self.fields[name] = Field(self.size, kind)
            self.size += _count_words(kind)
        # The name is what types are compared by, and becomes part of the name of each function that
        # is compiled for it: spelled out, a hundred types of arrays would take long to read.
        digest = hashlib.sha256(repr(fields).encode()).hexdigest()[:16]
        super().__init__(name=f"Handle({title}, {digest})")


def _count_words(kind: Any) -> int:
    """How many words a value of this type takes in a handle's memory."""
    if isinstance(kind, HandleType):
        size: int = kind.size
        return size
    return 1 + 2 * int(kind.ndim) if isinstance(kind, types.Array) else 1


class Handle:
    """What compiled code reads as `handle.content`; made by `pack`.

    Attributes:
        kind: Numba's type of it.
        address: Of its memory, which never changes.
    """

    __slots__ = ("__weakref__", "_content", "_memory", "address", "kind")

    def __init__(self, content: Any) -> None:
        self._content = content  # whose arrays live as long as this
        self.kind, words = _lay_out("handle", content)
        self._memory = np.array(words, dtype=np.int64)
        self.address = self._memory.ctypes.data

    def __reduce__(self) -> tuple[Any, tuple[Any]]:
        """A copy has memory of its own, about arrays of its own."""
        return pack, (self._content,)


def pack(content: Any) -> Any:
    """A handle on a named tuple of arrays, numbers and such tuples, which it keeps alive.

    Arrays that are replaced by others must be packed again, and so must numbers.

    Raises:
        TypeError: It holds something else.
    """
    return Handle(content)


def _lay_out(name: str, value: Any) -> tuple[Any, list[int]]:
    """Numba's type of a value, and the words that it takes in a handle's memory."""
    if isinstance(value, np.ndarray) and value.ndim > 0:
        flags = value.flags
        kind = _find_array_type(
            value.dtype, value.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable
        )  # fmt: skip
        return kind, [value.__array_interface__["data"][0], *value.shape, *value.strides]
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        title = f"{type(value).__module__}.{type(value).__qualname__}"
        kinds, words = [], []
        for field, part in zip(value._fields, value, strict=True):
            kind, some = _lay_out(f"{name}.{field}", part)
            kinds.append((field, kind))
            words += some
        return _make_type(title, tuple(kinds)), words
    if isinstance(value, bool | np.bool_):
        return types.boolean, [int(value)]
    if isinstance(value, int | np.int64):
        return types.int64, [int(value)]
    if isinstance(value, float):
        return types.float64, np.array([value]).view(np.int64).tolist()
    raise TypeError(
        f"{name} is a {type(value).__name__}; "
        "expected an array, a number, a boolean or a named tuple of these"
    )


@functools.cache
def _find_array_type(dtype: Any, ndim: int, is_c: bool, is_fortran: bool, writeable: bool) -> Any:
    """Numba's type of an array, by all that it depends on."""
    layout = "C" if is_c else "F" if is_fortran else "A"
    number = numba.from_dtype(dtype)
    return types.Array(number, ndim, layout, readonly=not writeable)


_make_type = functools.cache(HandleType)


@extending.typeof_impl.register(Handle)  # type: ignore[untyped-decorator]  # it has no types
def _type_of_handle(handle: Handle, _: Any) -> Any:
    return handle.kind


# In compiled code a handle, and a named tuple within, is an address.
extending.register_model(HandleType)(extending.models.OpaqueModel)


@extending.unbox(HandleType)  # type: ignore[untyped-decorator]  # it has no types
def _unbox_handle(_: Any, handle: Any, context: Any) -> Any:
    """The address that a handle has."""
    number = context.pyapi.object_getattr_string(handle, "address")
    address = context.pyapi.long_as_voidptr(number)
    context.pyapi.decref(number)
    return extending.NativeValue(address)


@extending.infer_getattr
class _FieldTypes(AttributeTemplate):  # type: ignore[misc]  # a class of unknown type
    """Numba's types of what compiled code reads from a handle."""

    key = HandleType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        """Type of the field of this name; None: there is no such field."""
        if name in kind.fields:
            return kind.fields[name].kind
        return kind if name == "content" else None


@extending.lower_getattr_generic(HandleType)  # type: ignore[untyped-decorator]  # it has no types
def _read_field(context: Any, builder: Any, kind: Any, address: Any, name: str) -> Any:
    """Machine code that reads a field where it stands."""
    if name not in kind.fields:
        return address
    start, field = kind.fields[name]
    if isinstance(field, HandleType):
        return _find_word(context, builder, address, start)
    if isinstance(field, types.Array):
        return _read_array(context, builder, field, address, start)
    if field == types.boolean:
        word = _read_word(context, builder, address, start)
        return builder.icmp_unsigned("!=", word, context.get_constant(types.int64, 0))
    return _read_word(context, builder, address, start, field)


def _read_array(context: Any, builder: Any, kind: Any, address: Any, start: int) -> Any:
    """An array without an owner: then there are no references to be counted."""
    number = functools.partial(context.get_constant, types.intp)
    read = functools.partial(_read_word, context, builder, address)
    itemsize = number(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    shape = [read(start + 1 + axis) for axis in range(kind.ndim)]
    items = functools.reduce(builder.mul, shape)
    if kind.layout == "C":
        # As they follow from the shape, which says more to the compiler than the numbers do.
        strides = [itemsize]
        for length in shape[:0:-1]:
            strides.insert(0, builder.mul(strides[0], length))
    else:
        strides = [read(start + 1 + kind.ndim + axis) for axis in range(kind.ndim)]
    # Nulls are left of what would name an owner.
    value = context.get_constant_null(kind)
    find_place = context.data_model_manager[kind].get_field_position
    for name, part in (
        ("data", read(start, types.CPointer(kind.dtype))),
        ("nitems", items),
        ("itemsize", itemsize),
    ):
        value = builder.insert_value(value, part, find_place(name))
    for name, numbers in (("shape", shape), ("strides", strides)):
        for axis, part in enumerate(numbers):
            value = builder.insert_value(value, part, [find_place(name), axis])
    return value


def _find_word(context: Any, builder: Any, address: Any, place: int) -> Any:
    """Address of a word of a handle's memory."""
    return builder.gep(address, [context.get_constant(types.intp, WORD * place)], inbounds=True)


def _read_word(
    context: Any, builder: Any, address: Any, place: int, kind: Any = types.int64
) -> Any:
    """A word of a handle's memory.

    That memory never changes, so one reading serves a whole loop, whatever the loop writes.
    """
    word = _find_word(context, builder, address, place)
    value = builder.load(builder.bitcast(word, context.get_value_type(kind).as_pointer()))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


def machine_code(compiled: Any, *arguments: Any) -> Any:
    """What a kernel runs for arguments of these types, to be called as it is.

    Numba looks up the types of all arguments at each call, which takes half a microsecond where a
    handle is among them. The entry point does not: its caller hands over arguments of exactly
    these types. Compiles what is not compiled yet.

    Over whole ticks among 10 and 1,000 obstacles that is 0.5 to 0.7 µs less in the median, and
    nothing at p99. It stays for another reason: a kernel called the usual way is compiled anew, in
    the middle of a tick, for each memory layout of the joint vectors that a caller hands over.

    Args:
        compiled: A kernel.
        arguments: For example.
    """
    kinds = tuple(typeof(argument) for argument in arguments)
    compiled.compile(kinds)
    return compiled.overloads[kinds].entry_point
