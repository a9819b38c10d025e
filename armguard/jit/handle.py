"""Many arrays as one argument: what a compiled call of every tick is handed.

Each array that Python hands to compiled code costs some 60 ns, and a tick needs a hundred. A handle
holds a tuple of them, however nested, in compiled memory and crosses as one pointer.

What compiled code reads from a handle it borrows: to count references on a hundred arrays, each
with a counter elsewhere in memory, takes longer than most ticks. The caller holds the handle
until the call returns, and compiled code keeps nothing of it.
"""

from __future__ import annotations

import functools
from typing import Any

import numba
from numba.core import cgutils as numba_cgutils
from numba.core import imputils as numba_imputils
from numba.experimental import structref as numba_structref

from armguard.jit.kernels import kernel

# Numba's functions are untyped: they are called as anything is.
structref: Any = numba_structref
imputils: Any = numba_imputils
cgutils: Any = numba_cgutils
types: Any = numba.types
typeof: Any = numba.typeof


@structref.register
class HandleType(types.StructRef):  # type: ignore[misc]  # a class of unknown type
    """Numba's type of handles; it depends on what they hold."""

    def preprocess_fields(self, fields: Any) -> Any:
        """Literal values are held as what they are instances of."""
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


class Handle(structref.StructRefProxy):  # type: ignore[misc]  # a class of unknown type
    """What compiled code reads as `handle.content`; made by `pack`."""


structref.define_proxy(Handle, HandleType, ["content"])


@imputils.lower_getattr(HandleType, "content")  # type: ignore[untyped-decorator]  # it has no types
def _read_content(context: Any, builder: Any, kind: Any, handle: Any) -> Any:
    """Machine code for `handle.content`, in place of Numba's, which counts references."""
    data = structref._Utils(context, builder, kind).get_data_struct(handle)
    return _borrow(context, builder, kind.field_dict["content"], data.content)


def _borrow(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The value as if its arrays had no owner: then there are no references to be counted."""
    if isinstance(kind, types.BaseTuple):
        for place, part in enumerate(kind):
            borrowed = _borrow(context, builder, part, builder.extract_value(value, place))
            value = builder.insert_value(value, borrowed, place)
    elif isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value=value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        value = array._getvalue()
    return value


def pack(content: Any) -> Any:
    """A handle on a named tuple of arrays and numbers, which it keeps alive.

    Arrays that are replaced by others must be packed again.
    """
    return _make_packer(type(content))(content)  # type: ignore[arg-type]  # it is hashable


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


@functools.cache
def _make_packer(kind: Any) -> Any:
    """What packs one kind of tuple.

    Each has a cache of its own: a process that reads a cache must be able to import all kinds
    that are in it, and one of them may belong to another program.
    """

    def pack_content(content: Any) -> Any:
        return Handle(content)

    return kernel(pack_content, subject=f"{kind.__module__}.{kind.__qualname__}")
