"""Caches results under a digest of their inputs.

What is known of an arm's geometry is worked out anew for every monitor and every cover, and mostly
of the same arm. What has changed has other bytes: nothing has to be told that it has.
"""

from __future__ import annotations

import functools
import hashlib
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

Result = TypeVar("Result")


def keep_results(most: int) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Decorate a function of arrays and numbers whose results depend on them alone.

    They are shared by all who ask, and so must not be changed.

    What it raises is raised again each time. Any thread may call it.

    Args:
        most: How many results are kept; those that were asked for longest ago go first.
    """

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        kept: dict[Any, Result] = {}
        lock = threading.Lock()

        @functools.wraps(function)
        def find(*arguments: Any) -> Result:
            key = tuple(map(_describe, arguments))
            with lock:
                if key in kept:
                    kept[key] = kept.pop(key)  # now the youngest
                    return kept[key]
            result = function(*arguments)
            with lock:
                kept[key] = result
                while len(kept) > most:
                    del kept[next(iter(kept))]
            return result

        return find

    return decorate


def _describe(argument: Any) -> tuple[Any, ...]:
    """What tells an argument from all others, and is small however large that is."""
    if isinstance(argument, np.ndarray):
        content = hashlib.blake2b(argument.tobytes(), digest_size=32).digest()
        return argument.dtype.str, argument.shape, content
    return type(argument), argument
