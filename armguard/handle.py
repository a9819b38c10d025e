"""Many arrays as one argument: what a compiled call of every tick is handed.

Each array that Python hands to compiled code costs some 60 ns, and a tick needs a hundred. A handle
holds a tuple of them, however nested, in compiled memory and crosses as one pointer.
"""

from __future__ import annotations

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


@kernel
def pack(content: Any) -> Any:
    """A handle on a tuple of arrays and numbers, which it keeps alive.

    Arrays that are replaced by others must be packed again.
    """
    return Handle(content)
