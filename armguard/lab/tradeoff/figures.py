"""Figures of each setting: price, caution, tightness, lateness, misses.

Each setting is compared with the finest one on the ticks that both have, so settings of another
rate can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.lab.tradeoff.contestant import Track
from armguard.lab.tradeoff.truth import Contact
from armguard.verdict import Level

Array = NDArray[np.float64]


class Figures(NamedTuple):
    """Of one setting. Shares are of time; what there is not is NaN."""

    tick_p50: float
    """Of a step, in [µs] of processor time; so are the next two."""
    tick_p99: float
    tick_max: float
    intake_p50: float
    """Of a message, in [µs]."""
    core: float
    """Share of one core that steps and messages take at this rate."""
    evaluated: float
    """Evaluations in a tick, on average."""
    evaluated_max: float
    tight_finest: float
    """Contact time over that of the finest setting, in the median; and"""
    tight_finest_p5: float
    """in the worst twentieth of the ticks."""
    stop: float
    """Share of STOP."""
    slow: float
    """Share of SLOW."""
    aware: float
    """Share of AWARE."""
    work_lost: float
    """Share of the path that an arm loses if it obeys the speed scale."""
    same_level: float
    """Share of ticks with the level of the finest setting."""
    late_p50: float
    """From the finest setting's STOP until this one's, in [ms]."""
    late_max: float
    missed: float
    """Contacts before their contact time, or without a STOP in time."""


def compute_figures(
    track: Track,
    finest: Track,
    intake: Sequence[float],
    contacts: Sequence[Contact],
    response: float,
) -> Figures:
    """All figures of a setting.

    Args:
        track: Of the setting.
        finest: Of what it is held against, over the same time.
        intake: What its messages took, in [s].
        contacts: What really happened.
        response: Until a STOP of the next tick takes effect, in [s].
    """
    if not len(track.time):
        return Figures(*[math.nan] * len(Figures._fields))
    own, other = match_ticks(track.time, finest.time)
    pairs = track.contact_time[own], finest.contact_time[other]
    known = np.isfinite(pairs[1]) & (pairs[1] > 0.0)
    tight = np.minimum(pairs[0][known], 1e3) / pairs[1][known]
    late = find_lateness(track, finest)
    rate = (len(track.time) - 1) / (track.time[-1] - track.time[0]) if len(track.time) > 1 else 0.0
    seconds = len(track.time) / rate if rate else math.nan
    spent = 1e6 * track.spent
    return Figures(
        tick_p50=float(np.median(spent)),
        tick_p99=float(np.percentile(spent, 99)),
        tick_max=float(spent.max()),
        intake_p50=1e6 * float(np.median(intake)) if len(intake) else math.nan,
        core=(float(track.spent.sum()) + float(np.sum(intake))) / seconds,
        evaluated=float(track.evaluated.mean()),
        evaluated_max=float(track.evaluated.max()),
        tight_finest=_median(tight),
        tight_finest_p5=float(np.percentile(tight, 5)) if len(tight) else math.nan,
        stop=float((track.level == Level.STOP).mean()),
        slow=float((track.level == Level.SLOW).mean()),
        aware=float((track.level == Level.AWARE).mean()),
        work_lost=float(1.0 - track.pace.mean()),
        same_level=float((track.level[own] == finest.level[other]).mean()),
        late_p50=1e3 * _median(late),
        late_max=1e3 * float(np.max(late)) if len(late) else math.nan,
        missed=float(count_missed(track, contacts, response)),
    )


def match_ticks(times: Array, others: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Places of the ticks that two have in common, to within a microsecond."""
    _, own, other = np.intersect1d(
        np.round(1e6 * times).astype(np.int64),
        np.round(1e6 * others).astype(np.int64),
        assume_unique=True,
        return_indices=True,
    )
    return own, other


def find_lateness(track: Track, finest: Track) -> list[float]:
    """Time from each first STOP of the finest setting to this setting's STOP, in [s].

    It is 0 if this setting stopped before. If the finest setting's STOP ends first, its duration
    counts.
    """
    stops = finest.level == Level.STOP
    begins = np.flatnonzero(stops & ~np.concatenate([[True], stops[:-1]]))
    ends = np.flatnonzero(~stops & np.concatenate([[False], stops[:-1]]))
    late = []
    for begin in begins:
        after = ends[ends > begin]
        end = after[0] if len(after) else len(stops) - 1
        first, last = finest.time[begin], finest.time[end]
        place = _at(track, first)
        there = track.level[place:] == Level.STOP
        found = track.time[place + int(there.argmax())] if there.any() else math.inf
        late.append(max(0.0, min(found, last) - first))
    return late


def count_missed(track: Track, contacts: Sequence[Contact], response: float) -> int:
    """Contacts before a setting's contact time, or without a STOP in time.

    Bodies that broke their bounds and ticks before a body's first message do not count.
    """
    missed = 0
    for contact in contacts:
        before = (track.time < contact.time - 1e-9) & (track.time >= contact.first_seen)
        if contact.is_beyond or not before.any():
            continue
        promised = track.time[before] + track.contact_time[before]
        is_late = bool((promised > contact.time + 1e-9).any())
        last = np.flatnonzero(before & (track.time <= contact.time - response + 1e-9))
        is_unstopped = bool(len(last)) and track.level[last[-1]] != Level.STOP
        missed += is_late or is_unstopped
    return missed


def find_front(prices: Sequence[float], caution: Sequence[float]) -> list[int]:
    """Places of the settings that no other is both cheaper than and no more cautious than."""
    order = sorted(range(len(prices)), key=lambda place: (prices[place], caution[place]))
    front: list[int] = []
    least = math.inf
    for place in order:
        if caution[place] < least:
            front.append(place)
            least = caution[place]
    return front


def _at(track: Track, time: float) -> int:
    """The last tick at a time, or the first of all."""
    return max(int(np.searchsorted(track.time, time + 1e-9)) - 1, 0)


def _median(values: Sequence[float] | Array) -> float:
    return float(np.median(values)) if len(values) else math.nan
