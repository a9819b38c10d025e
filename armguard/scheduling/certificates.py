"""Certificates of every obstacle: expiry, basis, and the time of the next evaluation."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel, separate_kernel
from armguard.jit.layout import make_records
from armguard.obstacles.reference_states import allows_reference_state, keep_reference_state
from armguard.obstacles.table import ChangedRows, Marks, States, extend_rows, make_states
from armguard.pairs.scene import UNKNOWN
from armguard.scheduling.tether_uses import TetherUses, drop_uses, make_uses, resize_uses
from armguard.scheduling.timing_wheel import Wheel, grow_wheel, make_due, make_wheel, take_out
from armguard.scheduling.tournament import (
    ROOT,
    find_least,
    grow_tournament,
    make_tournament,
    parent_of,
    set_value,
)

UNSEEN, UNPLACED = -3, -2
"""In place of a row, where nothing was evaluated yet, or the arm must be placed first."""

ACTIVE, MOVED, PREPARED, EVALUATED_ROWS, SPENT, BROKEN, UNSAFE, READ_AHEAD = range(8)
"""Places in `Certificates.numbers`."""


PROVED, ENDING, ASKABLE, IN_VAIN = range(4)
"""What is known of stops from earlier ticks: all are in time; so they are, but not all for long,
and the tick has done little so far; some are to be asked about; or all of those that are not proved
were asked about a moment ago, and might not be in time."""


class KnownStates(NamedTuple):
    """What was known of obstacles when something was proved of them, by place."""

    states: States
    """Their accepted states; no points where there was none."""
    revision: IntArray
    """Of the last state of each that agreed with that. Shape (places,)."""


def make_known_states(places: int, width: int) -> KnownStates:
    """Room for states that have at most `width` points."""
    return KnownStates(make_states(places, width), np.zeros(places, dtype=np.int64))


@kernel
def keep_known_state(
    bodies: States, marks: Marks, known: KnownStates, row: int, place: int
) -> None:
    """Keep what is known of a row now, for a proof that is made of it now."""
    keep_reference_state(bodies, known.states, marks, row, place)
    known.revision[place] = marks.revision[row]


@separate_kernel
def agrees(bodies: States, marks: Marks, states: States, row: int, place: int) -> bool:
    """Whether what is known of a row now is among what a proof of a kept state allows for.

    A proof is about all that can become of that state. A newer one is among that if it agrees, and
    if no bound has grown.
    """
    if marks.static[row] or not marks.has_state[row]:
        return False
    allowed, grown = allows_reference_state(bodies, states, row, place)
    return bool(allowed and not grown)


class StopProofs(NamedTuple):
    """Until when a STOP is in time as far as each row is concerned, and what that rests on.

    Whenever the arm is told to stop up to then, it rests before it touches the row. A row has two
    places: `stop_place` says which one is meant.
    """

    until: FloatArray
    """In [s] since the epoch; -inf: nothing is proved. Shape (places,)."""
    made_at: FloatArray
    """When it was proved, in [s] since the epoch. Shape (places,)."""
    retry_at: FloatArray
    """From when on what was asked in vain is asked again, alike, if there is no newer state of the
    row before. Shape (places,)."""
    retry_revision: IntArray
    """The row's revision that it was asked with. Shape (places,)."""
    link: IntArray
    """Link that may touch the row before it rests, as is permitted; -1: none. Shape (places,)."""
    speed: FloatArray
    """How fast its surface is then at most, in [m/s]. Shape (places,)."""
    asked_at: FloatArray
    """When the last two were found, in [s] since the epoch. Shape (places,)."""
    known: KnownStates
    """What it was proved of."""
    reference_states: States
    """What certificates rested on then: it is by these that some links were not asked."""


class Certificates(NamedTuple):
    """What is known of each row of the obstacle table, and what it rests on."""

    wheel: Wheel
    expiry_tree: FloatArray
    """Tournament tree of the ends of their certificates, in [s] since the monitor's epoch."""
    reference_states: States
    """The table's: the states that certificates rest on; no points where there was none."""
    news: ChangedRows
    watched: NDArray[np.bool_]
    """Which links are watched against it. Shape (rows, links)."""
    evaluated_at: FloatArray
    """Time of the last evaluation, in [s] since the epoch. Shape (rows,)."""
    pair_expiry: FloatArray
    """End of each pair's certificate, alike: at least this. Shape (rows, links)."""
    harm_tree: FloatArray
    """As `expiry_tree`, of `pair_harm`; the same tree where no contact is permitted."""
    permits_contact: bool
    """Whether some contact is permitted, so that harm is another thing than contact."""
    pair_harm: FloatArray
    """Up to when no contact that is not permitted is possible, at least, in [s] since the epoch;
    the same array as `pair_expiry` where no contact is permitted. Shape (rows, links)."""
    pair_sphere: NDArray[np.int32]
    """Sphere that decided each pair. Shape (rows, links)."""
    pair_bound: NDArray[np.int8]
    """What that rests on, an index of `BOUND_NAMES`. Shape (rows, links)."""
    proofs: StopProofs
    uses: TetherUses
    """Partners' states that certificates and proofs of tethered rows rest on."""
    broken: IntArray
    """Rows whose changes broke the bounds behind their certificates. Shape (rows,)."""
    numbers: IntArray
    """Rows that are watched; the ticks for which the arm's spheres were last moved, and all its
    bounds prepared; of late, evaluated rows and evaluations spent on them; how many of `broken` are
    in use; the last tick in which the stop decision found a pair unsafe; and what reading ahead
    came to, which is of no use. Shape (8,)."""


def make_certificates(links: int, *, permits_contact: bool) -> Certificates:
    """Certificates of no rows, for an arm of so many links."""
    tree = make_tournament(1)
    return Certificates(
        wheel=make_wheel(0),
        expiry_tree=tree,
        harm_tree=make_tournament(1) if permits_contact else tree,
        permits_contact=permits_contact,
        reference_states=make_states(0),
        news=ChangedRows(
            np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_), np.zeros(1, dtype=np.int64)
        ),
        **_make_rows(0, links, permits_contact=permits_contact),
        proofs=_make_proofs(0, 1),
        uses=make_uses(0, 1),
        broken=np.zeros(0, dtype=np.int64),
        numbers=np.array([0, -1, -1, 0, 0, 0, -9, 0]),
    )


def _make_rows(rows: int, links: int, *, permits_contact: bool) -> dict[str, Any]:
    """The fields of certificates that are read together, without anything in them."""
    times: dict[str, tuple[type, tuple[int, ...]]] = {
        "evaluated_at": (float, ()),
        "pair_expiry": (float, (links,)),
    }
    if permits_contact:
        times["pair_harm"] = (float, (links,))
    fields = times | {
        "pair_sphere": (np.int32, (links,)),
        "pair_bound": (np.int8, (links,)),
        "watched": (np.bool_, (links,)),
    }
    made = dict(zip(fields, make_records(rows, **fields), strict=True))
    return {"pair_harm": made["pair_expiry"], **made}


def _make_proofs(rows: int, width: int) -> StopProofs:
    """Proofs of nothing, for states that have at most `width` points."""
    places = 2 * rows
    fields: dict[str, tuple[type, tuple[int, ...]]]
    fields = dict.fromkeys(("until", "made_at", "retry_at"), (float, ()))
    fields |= {"retry_revision": (int, ()), "link": (int, ())}
    fields |= dict.fromkeys(("speed", "asked_at"), (float, ()))
    until, made_at, retry_at, retry_revision, link, speed, asked_at = make_records(places, **fields)
    until[:] = -np.inf
    return StopProofs(
        until=until,
        made_at=made_at,
        retry_at=retry_at,
        retry_revision=retry_revision,
        link=link,
        speed=speed,
        asked_at=asked_at,
        known=make_known_states(places, width),
        reference_states=make_states(places, width),
    )


@kernel
def stop_place(row: int, is_paced: bool) -> int:
    """Place of a row's proof: for an arm at any speed, or for one that keeps to a speed scale."""
    return 2 * row + is_paced


def grow_certificates(
    certificates: Certificates, news: ChangedRows, reference_states: States
) -> Certificates:
    """The same certificates for an obstacle table with these arrays, which may have more rows."""
    rows, width = reference_states.points.shape[:2]
    permits_contact = certificates.permits_contact
    grown = _make_rows(rows, certificates.watched.shape[1], permits_contact=permits_contact)
    for name, array in grown.items():
        before = getattr(certificates, name)
        array[: len(before)] = before
    tree = grow_tournament(certificates.expiry_tree, rows)
    return certificates._replace(
        wheel=grow_wheel(certificates.wheel, rows),
        expiry_tree=tree,
        harm_tree=grow_tournament(certificates.harm_tree, rows) if permits_contact else tree,
        reference_states=reference_states,
        news=news,
        **grown,
        # To prove it again takes less than to copy it.
        proofs=_make_proofs(rows, width),
        uses=resize_uses(certificates.uses, rows, width),
        broken=extend_rows(certificates.broken, rows),
    )


@kernel
def set_ends(certificates: Certificates, row: int, contact: float, harm: float) -> None:
    """Enter when the first of a row's certificates end, those about any contact and about harm."""
    set_value(certificates.expiry_tree, row, contact)
    set_value(certificates.harm_tree, row, harm)


@kernel
def invalidate(certificates: Certificates, row: int) -> None:
    """Invalidate all certificates of a row: it is to be evaluated at once."""
    for link in range(certificates.watched.shape[1]):
        certificates.pair_expiry[row, link] = certificates.pair_harm[row, link] = -np.inf
    certificates.proofs.until[2 * row : 2 * row + 2] = -np.inf
    make_due(certificates.wheel, row, -np.inf)
    set_ends(certificates, row, -np.inf, -np.inf)


@kernel
def end_uses(handle: Any, rows: IntArray) -> None:
    """End what was proved of some rows by tethers: these are others now."""
    certificates = handle.content
    for row in rows:
        if drop_uses(certificates.uses, row) and certificates.watched[row].any():
            invalidate(certificates, row)


@kernel
def withdraw_permissions(certificates: Certificates) -> None:
    """Let nothing count that was proved because contact is permitted.

    Whether an obstacle can be clamped depends on all others: where one of them changes, what was
    found of that is not known any more.
    """
    if not certificates.permits_contact:
        return
    for row in range(certificates.watched.shape[0]):
        for place in range(2 * row, 2 * row + 2):
            if certificates.proofs.link[place] >= 0:
                certificates.proofs.until[place] = -np.inf
        ends = False
        for link in range(certificates.watched.shape[1]):
            ends = ends or certificates.pair_harm[row, link] > certificates.pair_expiry[row, link]
            certificates.pair_harm[row, link] = certificates.pair_expiry[row, link]
        if ends:
            first = parent_of(certificates.expiry_tree.shape[0])
            set_value(certificates.harm_tree, row, certificates.expiry_tree[first + row])


@kernel
def insert(handle: Any, rows: IntArray, masks: NDArray[np.bool_]) -> None:
    """Insert rows, due in the next tick; masks, (n, links), say which links are watched."""
    certificates = handle.content
    for i in range(rows.shape[0]):
        row = rows[i]
        some = False
        for link in range(masks.shape[1]):
            certificates.watched[row, link] = masks[i, link]
            certificates.pair_bound[row, link] = UNKNOWN
            some = some or masks[i, link]
        certificates.reference_states.point_count[row] = 0
        certificates.evaluated_at[row] = -np.inf
        if some:
            certificates.numbers[ACTIVE] += 1
            invalidate(certificates, row)
    withdraw_permissions(certificates)


@kernel
def remove(handle: Any, rows: IntArray) -> None:
    """Remove rows."""
    certificates = handle.content
    for row in rows:
        if certificates.watched[row].any():
            certificates.numbers[ACTIVE] -= 1
        certificates.watched[row] = False
        take_out(certificates.wheel, row)
        set_ends(certificates, row, np.inf, np.inf)


@kernel
def invalidate_all(handle: Any) -> None:
    """Invalidate all certificates: everything is to be evaluated."""
    certificates = handle.content
    for row in range(certificates.watched.shape[0]):
        if certificates.watched[row].any():
            invalidate(certificates, row)


@kernel
def first_link(watched: NDArray[np.bool_], pair_expiry: FloatArray, row: int) -> int:
    """The watched link whose certificate against an obstacle ends first; both (rows, links)."""
    first = -1
    for link in range(watched.shape[1]):
        if not watched[row, link]:
            continue
        if first < 0 or pair_expiry[row, link] < pair_expiry[row, first]:
            first = link
    return first


@kernel
def find_most_imminent(certificates_handle: Any, rows: IntArray) -> int:
    """Fill `rows` with those whose certificates end first, in order; how many there are."""
    certificates = certificates_handle.content
    wanted = min(rows.shape[0], certificates.numbers[ACTIVE])
    values = np.empty(wanted)
    count = 0
    while count < wanted and certificates.expiry_tree[ROOT] < np.inf:
        # Each is taken out of the tournament tree until all are found.
        values[count] = certificates.expiry_tree[ROOT]
        rows[count] = find_least(certificates.expiry_tree)
        set_value(certificates.expiry_tree, rows[count], np.inf)
        count += 1
    for i in range(count):
        set_value(certificates.expiry_tree, rows[i], values[i])
    first = parent_of(certificates.expiry_tree.shape[0])
    for row in range(certificates.watched.shape[0]):
        if count == wanted:
            break
        if certificates.expiry_tree[first + row] == np.inf and certificates.watched[row].any():
            rows[count] = row
            count += 1
    return count
