"""When free bodies could touch at the earliest, in exact rational arithmetic.

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

from armguard.jit.arrays import FloatArray

Polynomial = list[Fraction]
"""Coefficients, the constant first."""

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
        apart: Polynomial = []
        for axis in range(3):
            along = _subtract(_move(second, axis), _move(first, axis))
            apart = _add(apart, _multiply(along, along))
        reach = _add([Fraction(contact_distance)], _add(_stray(first), _stray(second)))
        # Above 0 while they are apart: both sides of distance > reach are positive.
        self._gap = _trim(_subtract(apart, _multiply(reach, reach)))
        self._chain = _make_chain(self._gap)

    def is_apart(self, until: float) -> bool:
        """Whether there is no contact at any time from now until then, in [s]."""
        end = Fraction(until)
        return _evaluate(self._gap, Fraction(0)) > 0 and (end == 0 or not self._touches(end))

    def find_contact(self, horizon: float) -> float | None:
        """The first contact in [s], from below and to 13 digits; None if it is beyond the horizon.

        Args:
            horizon: [s].
        """
        if not _evaluate(self._gap, Fraction(0)) > 0:
            return 0.0
        return _bisect(self._touches, horizon)

    def _touches(self, end: Fraction) -> bool:
        """Whether there is a root after 0 and up to `end`."""
        if _evaluate(self._gap, end) <= 0:
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


def _move(course: Course, axis: int) -> Polynomial:
    pace = Fraction(float(course.velocity[axis]))
    return [Fraction(float(course.position[axis])) + pace * Fraction(course.age), pace]


def _stray(course: Course) -> Polynomial:
    age, half = Fraction(course.age), Fraction(course.accel) / 2
    return [half * age * age, 2 * half * age, half]


def _add(first: Polynomial, second: Polynomial) -> Polynomial:
    size = max(len(first), len(second))
    both = ([*one, *[Fraction(0)] * (size - len(one))] for one in (first, second))
    return [one + other for one, other in zip(*both, strict=True)]


def _subtract(first: Polynomial, second: Polynomial) -> Polynomial:
    return _add(first, [-one for one in second])


def _multiply(first: Polynomial, second: Polynomial) -> Polynomial:
    product = [Fraction(0)] * (len(first) + len(second) - 1)
    for i, one in enumerate(first):
        for j, other in enumerate(second):
            product[i + j] += one * other
    return product


def _trim(polynomial: Polynomial) -> Polynomial:
    while polynomial and polynomial[-1] == 0:
        polynomial = polynomial[:-1]
    return polynomial


def _evaluate(polynomial: Polynomial, at: Fraction) -> Fraction:
    value = Fraction(0)
    for coefficient in reversed(polynomial):
        value = value * at + coefficient
    return value


def _make_chain(polynomial: Polynomial) -> list[Polynomial]:
    """Sturm's chain: a polynomial, its derivative, and remainders with their signs turned."""
    chain = [polynomial]
    derivative = _trim([k * value for k, value in enumerate(polynomial)][1:])
    while derivative:
        chain.append(derivative)
        derivative = _trim([-value for value in _divide(chain[-2], chain[-1])])
    return chain


def _divide(numerator: Polynomial, divisor: Polynomial) -> Polynomial:
    """The remainder."""
    rest = list(numerator)
    while len(rest) >= len(divisor):
        factor, shift = rest[-1] / divisor[-1], len(rest) - len(divisor)
        for k, value in enumerate(divisor):
            rest[shift + k] -= factor * value
        rest = rest[:-1]
    return _trim(rest)


def _count_changes(chain: list[Polynomial], at: Fraction) -> int:
    """Changes of sign along the chain."""
    signs = [value > 0 for one in chain if (value := _evaluate(one, at)) != 0]
    return sum(one != other for one, other in itertools.pairwise(signs))
