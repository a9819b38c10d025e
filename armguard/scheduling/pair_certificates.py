"""What is known about every pair: until when its certificate holds, and what it rests on.

A certificate says "no contact before `expiry`, whatever happens within the bounds". It stays good
while every newer state of its obstacle lies within what the record behind it allowed; that record
(the reference state) is kept for each pair, and new states are tested against it. Schedules that
evaluate every pair in every tick need no reference states.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.obstacles.reference_states import allows_reference_state, expire, keep_reference_state
from armguard.obstacles.table import States, extend_rows, make_states, resize_states
from armguard.pairs.evaluate import TickState
from armguard.scheduling.flagged_pairs import FlaggedCheck, KeptCertificates

NEVER = -1
"""In place of a tick, for a pair that was never evaluated."""

NOBODY = -1
"""In place of a pair number, where there are no pairs."""

UNDISTURBED, GROWN, BROKEN = 0, 1, 2
"""What newer states did to the ground that a certificate stands on."""


class PairCertificates:
    """Certificates of all pairs; pair = obstacle row × links + link.

    Args:
        link_count: Links of the arm.
        watched: For a row, which links are watched against it. Shape (links,) of bool.
        keeps_certificates: Whether certificates outlive their tick, so that reference states are
            needed.
    """

    def __init__(
        self,
        link_count: int,
        watched: Callable[[int], NDArray[np.bool_]],
        *,
        keeps_certificates: bool,
    ) -> None:
        self.link_count = link_count
        self.keeps_certificates = keeps_certificates
        self._watched = watched
        self._proved: FloatArray = np.zeros(0)
        """Room for what the exact check proves; NaN in between."""
        self.active: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)
        self.expiry: FloatArray = np.zeros(0)
        """End of each certificate, in [s] since the monitor's epoch."""
        self.evaluated_at: FloatArray = np.zeros(0)
        """Time of each pair's last evaluation, alike."""
        self.tick: IntArray = np.zeros(0, dtype=np.int64)
        """Tick of each pair's last evaluation or exact check; NEVER before the first."""
        self.sphere: IntArray = np.zeros(0, dtype=np.int64)
        """Sphere that decided each pair."""
        self.bound: NDArray[np.int8] = np.zeros(0, dtype=np.int8)
        """What each certificate rests on, an index of `BOUND_NAMES`."""
        self.pairs: IntArray = np.zeros(0, dtype=np.int64)
        """The active pairs, ascending."""
        self._seen_revision: IntArray = np.zeros(0, dtype=np.int64)
        self._kept_revision: IntArray = np.zeros(0, dtype=np.int64)
        """Of the state that the last exact check of each pair left behind its certificate."""
        # Two rows at least: arrays of fewer would be of another type for compiled code.
        self._reference_states = make_states(2)
        self._outcomes: NDArray[np.int8] = np.zeros(0, dtype=np.int8)
        self._all_invalid = False

    def change(
        self, added: IntArray, removed: IntArray, capacity: int
    ) -> tuple[IntArray, IntArray]:
        """Follow rows of the obstacle table that came and went.

        Args:
            added: Rows now in use that were not, or that changed their occupant. Shape (a,).
            removed: Rows that lost their occupant. Shape (r,).
            capacity: Rows of the obstacle table.

        Returns:
            Pairs that are new, and pairs that are gone.
        """
        self._grow(capacity)
        links = np.arange(self.link_count)
        gone = (removed[:, None] * self.link_count + links).ravel()
        gone = gone[self.active[gone]]
        self.active[gone] = False
        masks = [self._watched(int(row)) for row in added]
        new = [row * self.link_count + links[mask] for row, mask in zip(added, masks, strict=True)]
        fresh = np.concatenate(new).astype(np.int64) if new else np.zeros(0, dtype=np.int64)
        self.active[fresh] = True
        self.expiry[fresh] = -np.inf
        self.evaluated_at[fresh] = -np.inf
        self.tick[fresh] = NEVER
        self._kept_revision[fresh] = NEVER
        self._seen_revision[added] = NEVER
        self.pairs = np.flatnonzero(self.active)
        return fresh, gone

    def clear(self) -> None:
        """Forget all pairs."""
        self.active[:] = False
        self.pairs = self.pairs[:0]

    def record(
        self,
        pairs: IntArray,
        contact_times: FloatArray,
        spheres: IntArray,
        bounds: NDArray[np.int8],
        now: float,
        tick: int,
        state: TickState,
    ) -> None:
        """Enter evaluations made at `now`, in [s] since the epoch."""
        kept = _KeptEvaluations(self.expiry, self.evaluated_at, self.tick, self.sphere, self.bound)
        _record(pairs, contact_times, spheres, bounds, now, tick, kept)
        if self.keeps_certificates:
            self._keep_reference_states(pairs, state)

    def extend(
        self, check: FlaggedCheck, pairs: IntArray, now: float, tick: int, stop_time: float
    ) -> int:
        """Enter what the exact check proves of flagged pairs; the later of two proofs stands.

        Args:
            check: The exact check, in this tick.
            pairs: Those that are flagged. Shape (f,).
            now: In [s] since the epoch.
            tick: Number of the present tick.
            stop_time: In [s]; what could be touched within is measured exactly.

        Returns:
            How many were measured exactly.
        """
        self._fit_reference_states(check.state)
        return check.extend(
            pairs,
            self.pairs,
            self.link_count,
            now,
            tick,
            stop_time,
            KeptCertificates(self.expiry, self.tick, self.bound, self._kept_revision, self._proved),
            self._reference_states,
        )

    def invalidate(self, pairs: IntArray) -> None:
        """Invalidate the certificates of `pairs`."""
        self.expiry[pairs] = -np.inf

    def invalidate_all(self) -> None:
        """Invalidate all certificates: the arm's bounds or state have changed."""
        self._all_invalid = True

    def disturbed(self, state: TickState, revision: IntArray) -> tuple[IntArray, IntArray]:
        """Pairs whose certificates no longer stand on firm ground.

        Returns:
            Pairs to be evaluated at once because a bound of their obstacle grew, it changed while
            refused samples of it may be true, or all are invalid; and pairs whose obstacle broke
            the bounds behind them.
        """
        if not self.keeps_certificates or not len(self.pairs):
            return self.pairs[:0], self.pairs[:0]
        outcomes = self._test(self.pairs, state, revision)
        # The table may have grown for rows that were gone again before they were read.
        known = len(self._seen_revision)
        self._seen_revision[:] = revision[:known]
        grown = self.pairs if self._all_invalid else self.pairs[outcomes == GROWN]
        self._all_invalid = False
        return grown, self.pairs[outcomes == BROKEN]

    def earliest(self, now: float, tick: int) -> tuple[int, float, int]:
        """The pair whose certificate ends first, when that is, and pairs overdue.

        Args:
            now: In [s] since the epoch.
            tick: Number of the present tick.

        Returns:
            Pair number (NOBODY without pairs), the end of its certificate in [s] since the epoch
            (inf without pairs), and how many pairs have neither a certificate in force nor an
            evaluation in this tick.
        """
        pair, expiry, overdue = _earliest(self.pairs, self.expiry, self.tick, now, tick)
        return pair, expiry, overdue

    def compile(self, state: TickState, revision: IntArray) -> None:
        """Run every kernel on no pairs, so that none is compiled in a tick."""
        none, no_times = np.zeros(0, dtype=np.int64), np.zeros(0)
        self.record(none, no_times, none, np.zeros(0, dtype=np.int8), 0.0, 0, state)
        self.earliest(0.0, 0)
        expire(0.0, 0.0)
        if self.keeps_certificates:
            self._test(none, state, revision)

    def _keep_reference_states(self, pairs: IntArray, state: TickState) -> None:
        """Keep the states that certificates made in this tick rest on."""
        self._fit_reference_states(state)
        _keep_reference_states(pairs, self.link_count, state.handle, *self._reference_states)

    def _fit_reference_states(self, state: TickState) -> None:
        """Make room for as many points as obstacles have."""
        width = state.bodies.points.shape[1]
        if width > self._reference_states.points.shape[1]:
            self._reference_states = resize_states(
                self._reference_states, len(self._reference_states.stamp), width
            )

    def _test(self, pairs: IntArray, state: TickState, revision: IntArray) -> NDArray[np.int8]:
        """What newer states did to each pair's certificate. Shape (m,)."""
        outcomes = self._outcomes[: len(pairs)]
        _test_reference_states(
            pairs,
            self.link_count,
            self.tick,
            revision,
            self._seen_revision,
            outcomes,
            state.handle,
            *self._reference_states,
        )
        return outcomes

    def _grow(self, capacity: int) -> None:
        size = capacity * self.link_count
        if size <= len(self.active):
            return
        # What pairs start with is written when they come.
        self.active = extend_rows(self.active, size)
        self.expiry = extend_rows(self.expiry, size)
        self.evaluated_at = extend_rows(self.evaluated_at, size)
        self.tick = extend_rows(self.tick, size)
        self.sphere = extend_rows(self.sphere, size)
        self.bound = extend_rows(self.bound, size)
        self._kept_revision = extend_rows(self._kept_revision, size)
        self._seen_revision = extend_rows(self._seen_revision, capacity)
        if self.keeps_certificates:
            width = self._reference_states.points.shape[1]
            self._reference_states = resize_states(self._reference_states, size, width)
            self._outcomes = np.zeros(size, dtype=np.int8)
            self._proved = np.full(size, np.nan)


class _KeptEvaluations(NamedTuple):
    """What is kept of the last evaluation of each pair, by pair."""

    expiry: FloatArray
    evaluated_at: FloatArray
    ticks: IntArray
    spheres: IntArray
    bounds: NDArray[np.int8]


@kernel
def _record(
    pairs: IntArray,
    contact_times: FloatArray,
    spheres: IntArray,
    bounds: NDArray[np.int8],
    now: float,
    tick: int,
    kept: _KeptEvaluations,
) -> None:
    expiry, evaluated_at, ticks, deciding, resting_on = kept
    for index in range(pairs.shape[0]):
        pair = pairs[index]
        expiry[pair] = expire(now, contact_times[index])
        evaluated_at[pair] = now
        ticks[pair] = tick
        deciding[pair] = spheres[index]
        resting_on[pair] = bounds[index]


@kernel
def _keep_reference_states(
    pairs: IntArray, links: int, handle: Any, *reference_states: Any
) -> None:
    """`keep_reference_state` for many pairs, whose fields cross faster one by one."""
    scene = handle.content
    for pair in pairs:
        keep_reference_state(
            scene.bodies, States(*reference_states), scene.marks, pair // links, pair
        )


@kernel
def _test_reference_states(
    pairs: IntArray,
    links: int,
    ticks: IntArray,
    revision: IntArray,
    seen_revision: IntArray,
    outcomes: NDArray[np.int8],
    handle: Any,
    *reference_states: Any,
) -> None:
    """Fill `outcomes`: UNDISTURBED, GROWN or BROKEN for each pair."""
    scene = handle.content
    marks = scene.marks
    for index in range(pairs.shape[0]):
        pair = pairs[index]
        row = pair // links
        outcomes[index] = UNDISTURBED
        if marks.static[row] or ticks[pair] == NEVER or revision[row] == seen_revision[row]:
            continue
        allowed, grown = allows_reference_state(scene.bodies, States(*reference_states), row, pair)
        if not allowed:
            outcomes[index] = BROKEN
        elif grown or marks.refused[row]:
            # Another state may be true, of which the certificate knows nothing.
            outcomes[index] = GROWN


@kernel
def _earliest(
    pairs: IntArray, expiry: FloatArray, ticks: IntArray, now: float, tick: int
) -> tuple[int, float, int]:
    """Pair with the earliest expiry, that expiry, and how many pairs are overdue."""
    earliest = NOBODY
    soonest = np.inf
    overdue = 0
    for pair in pairs:
        if earliest < 0 or expiry[pair] < soonest:
            earliest = pair
            soonest = expiry[pair]
        if ticks[pair] != tick and not expiry[pair] > now:
            overdue += 1
    return earliest, soonest, overdue
