"""The partition of the places 1 … M into buckets, and the bucket of each turn.

The arithmetic of [Awareness]_, section 4, apart from everything else so that it can be checked by
hand. Bucket k has `sizes[k]` places from `bases[k]` on and one of them is visited in each tick, so
every place of it comes round after exactly `sizes[k]` ticks. In the last bucket places beyond M are
empty: their turn passes unused, which keeps the round of the others at `sizes[k]` ticks.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import IntArray
from armguard.jit.kernels import kernel

PartitionLaw: TypeAlias = Literal["powers", "fibonacci"]

# Far more places than memory can hold, and small enough that no sum below leaves int64.
_MOST_PLACES = 2**60


class Partition(NamedTuple):
    """Buckets in the order of their places, as many as could ever be needed."""

    bases: IntArray
    """First place of each bucket, from 1 on. Shape (buckets,)."""
    sizes: IntArray
    """Places in each bucket = ticks in which it comes round once. Shape (buckets,)."""


def make_partition(law: PartitionLaw) -> Partition:
    """Buckets of 1, 2, 4, 8 … places (`powers`) or of 1, 2, 3, 5, 8 … (`fibonacci`)."""
    if law not in get_args(PartitionLaw):
        raise ArmguardError(
            "partition", f"unknown law {law!r}", expected=", ".join(get_args(PartitionLaw))
        )
    bases, sizes = [1], [1]
    following = 2
    while bases[-1] + sizes[-1] < _MOST_PLACES:
        bases.append(bases[-1] + sizes[-1])
        sizes.append(following)
        following = 2 * sizes[-1] if law == "powers" else sizes[-1] + sizes[-2]
    return Partition(np.array(bases, dtype=np.int64), np.array(sizes, dtype=np.int64))


@kernel
def compute_places_in_turn(partition, count, tick, places):
    """The places to visit in a tick: bases[k] + tick mod sizes[k], where there is such a place.

    Args:
        partition: The `Partition`.
        count: Number of places M.
        tick: Number of the tick, from 0 on.
        places: Filled from its start with the places, ascending. Shape (M or more,).

    Returns:
        How many were filled in: at most one for each bucket.
    """
    found = 0
    for k in range(partition.bases.size):
        if partition.bases[k] > count:
            break
        place = partition.bases[k] + tick % partition.sizes[k]
        if place <= count:
            places[found] = place
            found += 1
    return found


@kernel
def compute_ticks_until_turn(base, size, place, tick):
    """Ticks after `tick` until a place comes round: 1 … size, and `size` for one just visited.

    Args:
        base: First place of its bucket.
        size: Places in its bucket.
        place: The place.
        tick: Number of the present tick, whose visits are over.
    """
    return (place - base - tick - 1) % size + 1
