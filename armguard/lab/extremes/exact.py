"""The earliest contact of free bodies, in exact rational arithmetic.

Two bodies on known courses, each of which may stray from its own by half its acceleration bound
times the time squared, could touch once their distance is no more than both may have strayed and
the distance that counts as contact. That is a polynomial of time; its first root is isolated by
Sturm's theorem. Numbers are read as what they are, so there is no rounding to be argued about.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyadd, polyder, polydiv, polymul, polysub, polyval
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray

Polynomial = NDArray[np.object_]
"""Coefficients, which are fractions, the constant first."""

SHORTEST = Fraction(1, 2**30)
"""Where the search for a root begins, in [s]; each step goes twice as far."""

STEPS = 45
"""Halvings of the interval that a root is known to lie in: relatively, or of `SHORTEST`."""


class Course(NamedTuple):
    """A body at its stamp, and what it can do."""

    position: Sequence[float] | FloatArray
    """[m]. Three."""
    velocity: Sequence[float] | FloatArray
    """[m]/[s]. Three."""
    accel: float
    """[m]/[s²]."""
    age: float
    """Now less the stamp, in [s]."""


class FreePair:
    """Two bodies without bounds on their speeds.

    Args:
        first: One.
        second: The other.
        contact_distance: Of their centres, in [m].
    """

    def __init__(self, first: Course, second: Course, contact_distance: float) -> None:
        apart = make_polynomial()
        for axis in range(3):
            along = polysub(_move(second, axis), _move(first, axis))
            apart = polyadd(apart, polymul(along, along))
        reach = polyadd(make_polynomial(contact_distance), polyadd(_stray(first), _stray(second)))
        # Above 0 while they are apart: both sides of distance > reach are positive.
        self._gap = polysub(apart, polymul(reach, reach))
        self._chain = _make_chain(self._gap)

    def is_apart(self, until: float) -> bool:
        """Whether there is no contact at any time from now until then, in [s]."""
        end = Fraction(until)
        return bool(polyval(Fraction(0), self._gap) > 0) and (end == 0 or not self._touches(end))

    def find_contact(self, horizon: float) -> float | None:
        """The first contact in [s], from below and to 13 digits; None if it is beyond the horizon.

        Args:
            horizon: [s].
        """
        if not polyval(Fraction(0), self._gap) > 0:
            return 0.0
        return _bisect(self._touches, horizon)

    def _touches(self, end: Fraction) -> bool:
        """Whether there is a root after 0 and up to `end`."""
        if polyval(end, self._gap) <= 0:
            return True
        return _count_changes(self._chain, Fraction(0)) > _count_changes(self._chain, end)


class HeadOn(NamedTuple):
    """A body that runs straight at one that rests, as fast as it may."""

    distance: float
    """Between them, less what counts as contact, in [m]."""
    pace: float
    """With which it comes, in [m]/[s], no more than `speed`."""
    accel: float
    """[m]/[s²], above 0."""
    speed: float
    """[m]/[s]."""

    def travel(self, t: Fraction) -> Fraction:
        """How far it gets in a time in [s], in [m]."""
        pace, accel = Fraction(self.pace), Fraction(self.accel)
        speeding = min(t, (Fraction(self.speed) - pace) / accel)
        return pace * t + accel * speeding * (t - speeding / 2)

    def is_apart(self, until: float) -> bool:
        """Whether it does not touch before then, in [s]."""
        return self.travel(Fraction(until)) <= Fraction(self.distance)

    def find_contact(self, horizon: float) -> float | None:
        """When it touches, in [s], from below; None if that is beyond the horizon."""
        return _bisect(lambda time: self.travel(time) > Fraction(self.distance), horizon)


def _bisect(touches: Callable[[Fraction], bool], horizon: float) -> float | None:
    """The first time at which something holds from then on, from below; None beyond the horizon."""
    low, high = Fraction(0), SHORTEST
    while not touches(high):
        low, high = high, 2 * high
        if low > horizon:
            return None
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if touches(middle) else (middle, high)
    return float(low)


def make_polynomial(*coefficients: float | Fraction) -> Polynomial:
    """A polynomial of exact coefficients, the constant first; of none, 0."""
    exact: Polynomial = np.array([Fraction(value) for value in coefficients or (0,)], dtype=object)
    return exact


def _move(course: Course, axis: int) -> Polynomial:
    pace = Fraction(float(course.velocity[axis]))
    place = Fraction(float(course.position[axis]))
    return make_polynomial(place + pace * Fraction(course.age), pace)


def _stray(course: Course) -> Polynomial:
    age, half = Fraction(course.age), Fraction(course.accel) / 2
    return make_polynomial(half * age * age, 2 * half * age, half)


def _make_chain(polynomial: Polynomial) -> list[Polynomial]:
    """Sturm's chain: a polynomial, its derivative, and remainders with their signs turned."""
    chain = [polynomial, polyder(polynomial)]
    while any(chain[-1]):
        chain.append(-polydiv(*chain[-2:])[1])
    return chain[:-1]


def _count_changes(chain: list[Polynomial], at: Fraction) -> int:
    """Changes of sign along the chain."""
    signs = [value > 0 for one in chain if (value := polyval(at, one)) != 0]
    return sum(one != other for one, other in itertools.pairwise(signs))
