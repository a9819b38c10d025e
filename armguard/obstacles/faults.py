"""Faults of data about obstacles: small records, kept until the next monitor step.

Bad data never raises inside the loop; it is refused, and each refusal is reported once. The queue
is bounded, so that a source that sends nonsense uses no more memory, and it counts dropped faults.
One fault lasts longer: an obstacle that found no room in the table is still in the cell.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

CAPACITY = 256
"""Greatest number of faults kept between two steps, and of named obstacles without room."""


class FaultKind(enum.StrEnum):
    """Kind of a fault."""

    MALFORMED = "malformed call"
    PROMISE_BROKEN = "against the stated limits or the shared plan of that arm"
    NOT_FINITE = "not a finite number"
    NEGATIVE = "negative"
    BEYOND_ACCEL = "beyond what its acceleration allows"
    BEYOND_SPEED = "beyond what its speed allows"
    SHAPE_CHANGED = "another number of points than before"
    BEYOND_EXTENT = "beyond the table's extent; positions are metres in the frame that is named"
    BOUND_TOO_LARGE = "beyond what bodies do; bounds are m/s and m/s², inf where there is none"
    SHARED_ID = "an id that another source uses, too; both are watched"
    LATE = "a new id with a stamp from before a removal"
    STALE_REMOVAL = "a removal older than the state it would remove"
    UNKNOWN_ID = "removal of an id that is not in the table"
    TRACK_CHANGED = "continued on another track"
    WRONG_FRAME = "another frame than before, and what came in it contradicts that"
    POINTS_DROPPED = "points that are not finite, or beyond the table's extent"
    TABLE_FULL = "no room left in the table"
    FORGOTTEN = "forgotten by a reset"


_STOPPING = frozenset({FaultKind.MALFORMED, FaultKind.PROMISE_BROKEN, FaultKind.LATE})
"""Kinds for which the arm must stop; the others are notes."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One refused row or call, or one row that changed its track.

    Attributes:
        kind: Kind of the fault.
        source: Name of the source that it came from.
        id: Id of the obstacle; empty for a malformed call, and for another arm that broke its
            limits.
        field: Field or argument; the joint, if another arm broke its limits.
        value: Value found there: the offending number, the length of a jump in [m] or [m]/[s], or
            text for a malformed call and for another arm's broken limits.
        stamp: Stamp of the message, in [s]; NaN if it had none.
    """

    kind: FaultKind
    source: str
    id: str
    field: str
    value: float | str
    stamp: float


class FaultQueue:
    """Queue of faults since the last step.

    Attributes:
        waiting: Faults that were not taken yet, oldest first.
        count: All faults so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._dropped = 0
        self.waiting: list[Fault] = []

    def leave(
        self,
        kind: FaultKind,
        source: str,
        name: str,
        field: str,
        value: float | str,
        stamp: float,
    ) -> None:
        """Adds a fault. In a full queue, a fault that stops the arm replaces one that does not."""
        self.count += 1
        if len(self.waiting) >= CAPACITY:
            self._dropped += 1
            lesser = (i for i, one in enumerate(self.waiting) if one.kind not in _STOPPING)
            place = next(lesser, None) if kind in _STOPPING else None
            if place is None:
                return
            del self.waiting[place]
        self.waiting.append(Fault(kind, source, name, field, value, stamp))

    def take(self) -> list[Fault]:
        """The faults since the last call, oldest first; the queue is empty afterwards."""
        taken, self.waiting = self.waiting, []
        return taken

    def take_dropped(self) -> int:
        """How many faults were not kept since the last call, because the queue was full."""
        dropped, self._dropped = self._dropped, 0
        return dropped


class Unplaced:
    """Reported obstacles without room in the table, until they get room or are removed.

    Only so many are known by name. Of a source with more of them, some stay missing until it sends
    a snapshot, which shows all that it sees.

    Attributes:
        some: Whether there are any.
    """

    def __init__(self) -> None:
        self.some = False
        self._known: dict[tuple[int, str], float] = {}
        self._nameless: set[int] = set()

    def add(self, name: str, source: int, stamp: float) -> None:
        """Notes an obstacle of the source with this number, seen at `stamp` [s]."""
        self.some = True
        key = source, name
        if key in self._known or len(self._known) < CAPACITY:
            self._known[key] = max(stamp, self._known.get(key, stamp))
        else:
            self._nameless.add(source)

    def discard(self, name: str, source: int | None = None, stamp: float | None = None) -> bool:
        """Forgets an obstacle, if it is one of these and may be forgotten.

        Args:
            name: Of the obstacle.
            source: Number of the source that it must belong to; None: any.
            stamp: After which it must not have been seen, in [s]; None: whenever.

        Returns:
            Whether it was forgotten.
        """
        keys = [
            key
            for key, seen in self._known.items()
            if key[1] == name and source in (None, key[0]) and (stamp is None or seen <= stamp)
        ]
        for key in keys:
            del self._known[key]
        self.some = bool(self._known or self._nameless)
        return bool(keys)

    def forget(self, source: int) -> None:
        """Drops all obstacles of a source, before its snapshot lists them again."""
        if self._known or self._nameless:
            self._known = {key: seen for key, seen in self._known.items() if key[0] != source}
            self._nameless.discard(source)
            self.some = bool(self._known or self._nameless)

    def names(self) -> list[str]:
        """Those known by name, the oldest first, and "more obstacles" if there are others."""
        return [
            *dict.fromkeys(name for _, name in self._known),
            *(["more obstacles"] if self._nameless else []),
        ]
