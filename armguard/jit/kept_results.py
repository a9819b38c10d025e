"""Results that are kept, under the very bytes of what they were computed from.

What is known of an arm's geometry is worked out anew for every monitor and every cover, and mostly
of the same arm. What has changed has other bytes: nothing has to be told that it has.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, TypeVar

Result = TypeVar("Result")


def keep_results(most: int) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Decorate a function of arrays whose results depend on them alone, and are never changed.

    What it raises is raised again each time. Any thread may call it.

    Args:
        most: How many results are kept; those that were asked for longest ago go first.
    """

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        kept: dict[Any, Result] = {}
        lock = threading.Lock()

        @functools.wraps(function)
        def find(*arrays: Any) -> Result:
            key = tuple((array.dtype.str, array.shape, array.tobytes()) for array in arrays)
            with lock:
                if key in kept:
                    kept[key] = kept.pop(key)  # now the youngest
                    return kept[key]
            result = function(*arrays)
            with lock:
                kept[key] = result
                while len(kept) > most:
                    del kept[next(iter(kept))]
            return result

        return find

    return decorate
