"""Intervals in fixed point: each result contains every value that its arguments allow."""

from __future__ import annotations

import math
from collections.abc import Callable

BITS = 128
"""Ends of intervals are whole multiples of 2**-BITS."""

MOST_HALVINGS = 16
"""Halvings of an angle before its sine is summed: for angles up to 32,768 rad."""

TERMS = 20
"""Terms of the series of sine and cosine up to 1/2: the next term is below 2**-190."""


LARGEST = 1 << 64
"""Numbers of a proof are smaller, so `UNBOUNDED` exceeds all results from them."""


class ProofError(Exception):
    """Why a proof does not hold."""


def require(holds: bool, why: str) -> None:
    """Refuse the proof unless something holds."""
    if not holds:
        raise ProofError(why)


class Interval:
    """All real numbers from `low` to `high`, both in units of 2**-BITS."""

    __slots__ = ("high", "low")

    def __init__(self, low: int, high: int) -> None:
        self.low = low
        self.high = high

    def __add__(self, other: Interval) -> Interval:
        return Interval(self.low + other.low, self.high + other.high)

    def __sub__(self, other: Interval) -> Interval:
        return Interval(self.low - other.high, self.high - other.low)

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __abs__(self) -> Interval:
        return greatest(self, -self, ZERO)

    def __mul__(self, other: Interval) -> Interval:
        a, b, c, d = self.low, self.high, other.low, other.high
        if a >= 0 and c >= 0:
            return Interval((a * c) >> BITS, -((-b * d) >> BITS))
        products = a * c, a * d, b * c, b * d
        return Interval(min(products) >> BITS, -(-max(products) >> BITS))

    def __truediv__(self, other: Interval) -> Interval:
        require(other.low > 0, "a divisor may be 0")
        low, high = self.low << BITS, self.high << BITS
        return Interval(
            low // (other.high if low >= 0 else other.low),
            -(-high // (other.low if high >= 0 else other.high)),
        )

    def over(self, divisor: int) -> Interval:
        """Divided by a whole number above 0."""
        return Interval(self.low // divisor, -(-self.high // divisor))

    def half(self) -> Interval:
        """Divided by 2."""
        return self.over(2)

    def root(self) -> Interval:
        """Square root; values below 0 count as 0."""
        low, high = max(self.low, 0) << BITS, max(self.high, 0) << BITS
        return Interval(math.isqrt(low), math.isqrt(high) + 1)

    def exceeds(self, other: Interval) -> bool:
        """Whether it is certainly greater."""
        return self.low > other.high

    def covers(self, other: Interval) -> bool:
        """Whether it is certainly not less."""
        return self.low >= other.high


ZERO = Interval(0, 0)
ONE = Interval(1 << BITS, 1 << BITS)
UNBOUNDED = Interval(1 << (BITS + 200), 1 << (BITS + 200))
"""Stands for an infinite bound."""
UNIT = Interval(-1, 1)
"""The error of rounding, or of the rest of a series."""

Vector = tuple[Interval, Interval, Interval]
NOWHERE: Vector = (ZERO, ZERO, ZERO)


def read(value: object, name: str = "a number") -> Interval:
    """A number of a proof, as the real number that it stands for; `name` is for errors."""
    if not (isinstance(value, float | int) and type(value) is not bool and abs(value) < LARGEST):
        raise ProofError(f"{name} is {value!r:.40}, expected a finite number below 2**64")
    top, bottom = value.as_integer_ratio()
    return Interval((top << BITS) // bottom, -((-top << BITS) // bottom))


def read_bound(value: object, name: str = "a bound") -> Interval:
    """A number of a proof, or the words for an infinite one."""
    if value in ("Infinity", "-Infinity"):
        return UNBOUNDED if value == "Infinity" else -UNBOUNDED
    return read(value, name)


def read_size(value: object, name: str, read: Callable[[object, str], Interval] = read) -> Interval:
    """A number of a proof that cannot be below 0."""
    size = read(value, name)
    require(size.low >= 0, f"{name} is {value!r}, expected a number of at least 0")
    return size


def read_list(values: object, count: int, name: str = "a list") -> list[Interval]:
    """So many numbers."""
    if not isinstance(values, list) or len(values) != count:
        raise ProofError(f"{name} is not a list of {count} numbers")
    return [read(value, f"{name}[{place}]") for place, value in enumerate(values)]


def read_vector(values: object, name: str = "a vector") -> Vector:
    """Three numbers."""
    x, y, z = read_list(values, 3, name)
    return x, y, z


def read_vectors(values: list[object], name: str) -> list[Vector]:
    """Vectors whose numbers stand one after another."""
    return [read_vector(values[k : k + 3], name) for k in range(0, len(values), 3)]


def greatest(*values: Interval) -> Interval:
    """The greatest of some numbers."""
    return Interval(max(one.low for one in values), max(one.high for one in values))


def least(*values: Interval) -> Interval:
    """The least of some numbers."""
    return Interval(min(one.low for one in values), min(one.high for one in values))


def total(values: list[Interval]) -> Interval:
    """Their sum."""
    return Interval(sum(one.low for one in values), sum(one.high for one in values))


def dot(a: Vector, b: Vector) -> Interval:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def add(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    x, y, z = (total([one[axis] for one in vectors]) for axis in range(3))
    return x, y, z


def scale(factor: Interval, a: Vector) -> Vector:
    """A vector times a number."""
    return factor * a[0], factor * a[1], factor * a[2]


def combine(factors: list[Interval], vectors: list[Vector]) -> Vector:
    """Sum of vectors, each times its factor."""
    return add(*[scale(factor, one) for factor, one in zip(factors, vectors, strict=True)])


def length(a: Vector) -> Interval:
    """Length of a vector."""
    return dot(a, a).root()


def sine_and_cosine(angle: Interval) -> tuple[Interval, Interval]:
    """Sine and cosine of an angle in [rad], by series for a fraction of it and double angles."""
    halvings = 0
    while abs(angle).high > 1 << (BITS - 1):
        angle = angle.half()
        halvings += 1
        require(halvings <= MOST_HALVINGS, "the angle of a joint is too large")
    square = angle * angle
    sine, cosine = angle + UNIT, ONE + UNIT
    odd, even = angle, ONE
    for term in range(1, TERMS):
        even = -(even * square).over((2 * term - 1) * (2 * term))
        odd = -(odd * square).over(2 * term * (2 * term + 1))
        sine, cosine = sine + odd, cosine + even
    for _ in range(halvings):
        product = sine * cosine
        square = sine * sine
        sine, cosine = product + product, ONE - square - square
    return sine, cosine
