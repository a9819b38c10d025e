"""Single evaluations at the extremes, against exact arithmetic."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from armguard.contact import earliest_contact_pair
from armguard.lab.extremes.exact import Course, FreePair, HeadOn
from armguard.lab.extremes.report import EXACT, SOUND, UNSOUND, Line

DECADES = (-6, -3, 0, 3, 6)
LATEST = 1e9
"""Contacts that are later are not compared, in [s]."""

COUNT, REPEATS = 50, 200
"""Of the cases of a line, and how often each is evaluated to be timed."""


class Case(NamedTuple):
    """Arguments of `earliest_contact_pair`, and what they come to exactly."""

    arguments: dict[str, Any]
    exact: FreePair | HeadOn


class Evaluations(NamedTuple):
    """A line of single evaluations."""

    group: str
    name: str
    make: Callable[[np.random.Generator], Case]
    """Draws a case."""

    def measure(self, seed: int, count: int = COUNT) -> Line:
        """Evaluate so many cases."""
        random = np.random.default_rng(seed)
        return _measure(self.group, self.name, [self.make(random) for _ in range(count)])


def list_evaluations() -> list[Evaluations]:
    """All lines."""
    return [Evaluations(*one) for one in _list_groups()]


def _list_groups() -> Iterator[tuple[str, str, Callable[[np.random.Generator], Case]]]:
    for decade in DECADES:
        make = functools.partial(make_free, accel=10.0**decade)
        yield "acceleration of a body", f"1e{decade} m/s²", make
    for decade in DECADES:
        make = functools.partial(make_head_on, speed=10.0**decade)
        yield "speed bound of a body", f"1e{decade} m/s", make
    for radius in (1e-6, 1e-3, 0.1, 10.0):
        yield "radius", f"{radius:g} m", functools.partial(make_free, radius=radius)
    for away in (0.0, 1e3, 1e6):
        make = functools.partial(make_free, away=away)
        yield "distance of both from the origin", f"{away:g} m", make
    for age in (0.0, 1.0, 60.0, 3600.0):
        yield "age of a state", f"{age:g} s", functools.partial(make_free, age=age)


def make_free(
    random: np.random.Generator,
    *,
    accel: float = 10.0,
    radius: float = 0.1,
    away: float = 0.0,
    age: float = 0.0,
) -> Case:
    """Two bodies anywhere, apart by as much as their states' ages ask for."""
    first_accel = accel * random.uniform(0.0, 1.0)
    stray = 0.5 * (accel + first_accel) * age * age
    direction = random.normal(size=3)
    direction /= np.linalg.norm(direction)
    pace = 10.0 ** random.uniform(-2.0, 1.0)
    gap = 10.0 ** random.uniform(-3.0, 1.0) + stray + 4.0 * pace * age
    origin = away * np.array([0.8, -0.6, 0.0])
    first = Course(origin + random.normal(size=3), pace * random.normal(size=3), first_accel, age)
    place = np.asarray(first.position) + (gap + radius) * direction
    second = Course(place, pace * random.normal(size=3), accel, age)
    arguments = {
        "p1": first.position, "v1": first.velocity, "a1": first_accel, "s1": math.inf,
        "p2": second.position, "v2": second.velocity, "a2": accel, "s2": math.inf,
        "contact_distance": radius, "age1": age, "age2": age,
    }  # fmt: skip
    return Case(arguments, FreePair(first, second, radius))


def make_head_on(random: np.random.Generator, speed: float) -> Case:
    """A body that comes straight along x at one that rests."""
    distance = float(10.0 ** random.uniform(-3.0, 1.0))
    pace, accel = speed * float(random.uniform(0.0, 1.0)), float(10.0 ** random.uniform(-1.0, 2.0))
    arguments = {
        "p1": [0.0, 0.0, 0.0], "v1": [0.0, 0.0, 0.0], "a1": 0.0, "s1": 0.0,
        "p2": [distance, 0.0, 0.0], "v2": [-pace, 0.0, 0.0], "a2": accel, "s2": speed,
        "contact_distance": 0.0, "age1": 0.0, "age2": 0.0,
    }  # fmt: skip
    return Case(arguments, HeadOn(distance, pace, accel, speed))


def _measure(group: str, name: str, cases: list[Case]) -> Line:
    stacked = {key: np.array([case.arguments[key] for case in cases]) for key in cases[0].arguments}
    found = earliest_contact_pair(**stacked, advances=100)
    unsound, ratios = 0, []
    for case, contact_time in zip(cases, found.tolist(), strict=True):
        within = min(contact_time, LATEST)
        unsound += not (contact_time >= 0.0 and (within == 0.0 or case.exact.is_apart(within)))
        contact = case.exact.find_contact(LATEST)
        if contact is not None and contact > 0.0:
            ratios.append(contact_time / contact)
    many: dict[str, Any] = {
        key: np.repeat(values, REPEATS, axis=0) for key, values in stacked.items()
    }
    begin = time.thread_time()
    earliest_contact_pair(**many)
    price = 1e6 * (time.thread_time() - begin) / (REPEATS * len(cases))
    note = f"{len(cases)} cases {EXACT}"
    if unsound:
        note = f"{unsound} of {note}"
    return Line(
        group,
        name,
        UNSOUND if unsound else SOUND,
        float(np.median(ratios)) if ratios else math.nan,
        min(ratios, default=math.nan),
        price,
        note,
    )
