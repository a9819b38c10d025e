"""Arrays whose rows are adjacent in memory, so that they are fetched together.

Of ten thousand rows a tick reads ten, somewhere. From as many arrays as a row has fields that would
be as many waits for memory; here a row is one record, on as few cache lines as it can be.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

CACHE_LINE = 64
"""[bytes] on nearly every processor; another size would cost time only."""


def make_records(rows: int, **fields: tuple[type, tuple[int, ...]]) -> list[NDArray[Any]]:
    """An array of zeros for each field, with so many rows; what is not written takes no memory.

    Args:
        rows: How many. Fewer than two are of another type for compiled code: contiguous.
        fields: Kind of number of each, and shape within a row; the widest kinds first.
    """
    layout = np.dtype([(name, kind, shape) for name, (kind, shape) in fields.items()])
    size = -(-layout.itemsize // CACHE_LINE) * CACHE_LINE
    if layout.itemsize < CACHE_LINE:
        # Several to a line, and none across two.
        size = 1 << (layout.itemsize - 1).bit_length()
    memory = np.zeros(rows * size + CACHE_LINE, dtype=np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    padded = np.dtype([*layout.descr, ("unused", np.uint8, (size - layout.itemsize,))])
    records = memory[start : start + rows * size].view(padded)
    return [records[name] for name in fields]
