"""A pause of Python's garbage collection while kernels are compiled.

Numba makes millions of objects for a start's kernels, and keeps most of them until each is done. To
go through them all again and again takes a twelfth of the time and frees next to nothing.
"""

from __future__ import annotations

import gc
from typing import Any

from numba.core import event as numba_event

# Numba's functions are untyped: they are called as anything is.
event: Any = numba_event


class CollectionPause(event.Listener):  # type: ignore[misc]  # a class of unknown type
    """Turns the collector off before a compilation, and on again after it if it was on before."""

    def __init__(self) -> None:
        self._depth = 0
        self._was_on = False

    def on_start(self, _: Any) -> None:
        """Called when a function begins to be compiled, perhaps for another one."""
        if self._depth == 0:
            self._was_on = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, _: Any) -> None:
        """Called when that is done, or has failed."""
        self._depth -= 1
        if self._depth == 0 and self._was_on:
            gc.enable()
