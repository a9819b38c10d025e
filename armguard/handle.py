"""Many arrays as one argument: what a compiled call of every tick is handed.

Each array that Python hands to compiled code costs some 60 ns, and a tick needs a hundred. A handle
holds a tuple of them, however nested, in compiled memory and crosses as one pointer.
"""

from __future__ import annotations

import functools
from typing import Any

import numba
from numba.experimental import structref as numba_structref

from armguard.compilation import kernel

# Numba's functions are untyped: they are called as anything is.
structref: Any = numba_structref
types: Any = numba.types


@structref.register
class HandleType(types.StructRef):  # type: ignore[misc]  # a class of unknown type
    """Numba's type of handles; it depends on what they hold."""

    def preprocess_fields(self, fields: Any) -> Any:
        """Literal values are held as what they are instances of."""
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


class Handle(structref.StructRefProxy):  # type: ignore[misc]  # likewise
    """What compiled code reads as `handle.content`; made by `pack`."""


structref.define_proxy(Handle, HandleType, ["content"])


def pack(content: Any) -> Any:
    """A handle on a named tuple of arrays and numbers, which it keeps alive.

    Arrays that are replaced by others must be packed again.
    """
    return _make_packer(type(content))(content)  # type: ignore[arg-type]  # it is hashable


@functools.cache
def _make_packer(kind: Any) -> Any:
    """What packs one kind of tuple.

    Each has a cache of its own: who reads a cache must be able to import all kinds that are in it,
    and one of them may be somebody else's.
    """

    def pack_content(content: Any) -> Any:
        return Handle(content)

    return kernel(pack_content, subject=f"{kind.__module__}.{kind.__qualname__}")
