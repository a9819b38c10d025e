"""Where a ball of the arm is, how far it can get in a box of joint displacements, and how fast.

With c_j = dp/dq_j at the measured joints, a_j the axis of a joint that turns, and R_j how far the
ball's centre can ever be from it (1 where it slides), no second or third derivative of p by joints
is longer than the R of the most distal of them, and it is 0 where another of them slides.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from armguard_check.intervals import (
    NOWHERE,
    ONE,
    ZERO,
    Interval,
    ProofError,
    Vector,
    add,
    cross,
    dot,
    greatest,
    least,
    length,
    read_list,
    read_vector,
    scale,
    sine_and_cosine,
    total,
)

SKEWNESS = ONE.over(10**9)
"""What axes and rotations that are stated may be off from true ones."""

ROOT_3 = (ONE + ONE + ONE).root()


class Placement(NamedTuple):
    """Of a frame in another one: columns of the rotation, and the origin."""

    columns: tuple[Vector, Vector, Vector]
    origin: Vector

    def turn(self, a: Vector) -> Vector:
        """A vector of the frame, in the other one."""
        return add(*[scale(a[k], self.columns[k]) for k in range(3)])

    def place(self, a: Vector) -> Vector:
        """A point of the frame, in the other one."""
        return add(self.turn(a), self.origin)

    def then(self, other: Placement) -> Placement:
        """Of what is placed by `other` in this frame."""
        x, y, z = map(self.turn, other.columns)
        return Placement((x, y, z), self.place(other.origin))


class Joint(NamedTuple):
    """One joint in the world, as measured."""

    parent: int
    """The joint that carries it; -1: none."""
    slides: bool
    axis: Vector
    frame: Placement
    """Of what it carries."""


def read_joints(joints: list[dict[str, Any]], q: list[Interval]) -> list[Joint]:
    """Place all joints, from the base on."""
    placed: list[Joint] = []
    for number, joint in enumerate(joints):
        parent, numbers = joint["parent"], read_list(joint["placement"], 12)
        if type(parent) is not int or not -1 <= parent < number:
            raise ProofError(f"joint {number} is carried by one that does not come before it")
        x, y, z = ((numbers[k], numbers[3 + k], numbers[6 + k]) for k in range(3))
        fixed = Placement((x, y, z), (numbers[9], numbers[10], numbers[11]))
        axis, slides = read_vector(joint["axis"]), joint["slides"]
        products = dot(x, x), dot(y, y), dot(axis, axis), dot(cross(x, y), z), dot(x, y) + ONE
        if type(slides) is not bool or any(abs(one - ONE).high > SKEWNESS.low for one in products):
            raise ProofError(f"joint {number} is placed by what is no rotation, or has no axis")
        before = fixed if parent < 0 else placed[parent].frame.then(fixed)
        along = before.turn(axis)
        if slides:
            frame = before._replace(origin=add(before.origin, scale(q[number], along)))
        else:
            frame = before.then(Placement(turn_about(axis, q[number]), NOWHERE))
        placed.append(Joint(parent, slides, along, frame))
    return placed


def turn_about(axis: Vector, angle: Interval) -> tuple[Vector, Vector, Vector]:
    """Columns of a rotation, by Rodrigues' formula."""
    sine, cosine = sine_and_cosine(angle)
    columns = []
    for unit in ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE)):
        along = scale((ONE - cosine) * dot(axis, unit), axis)
        columns.append(add(scale(cosine, unit), scale(sine, cross(axis, unit)), along))
    return columns[0], columns[1], columns[2]


class Range(NamedTuple):
    """Displacements that one joint can have from its true position at the stamp."""

    low: Interval
    high: Interval

    @property
    def size(self) -> Interval:
        """The greatest displacement, either way."""
        return greatest(self.high, -self.low, ZERO)


class Mover(NamedTuple):
    """One joint that moves a ball, from the base to the tip."""

    number: int
    slides: bool
    column: Vector
    axis: Vector
    """Of one that turns, else zero."""
    lever: Interval
    error: Interval
    """What its measured position may be off by."""


class Ball:
    """A ball of the arm's cover.

    Attributes:
        center: As measured.
        size: Its radius, and what the centre may be off by, as joints may be.
    """

    def __init__(
        self,
        joints: list[Joint],
        carrier: int,
        center: Vector,
        radius: Interval,
        lever: list[Interval],
        errors: list[Interval],
    ) -> None:
        self.center = center if carrier < 0 else joints[carrier].frame.place(center)
        self._radius = self.size = radius
        self._movers: list[Mover] = []
        while carrier >= 0:
            joint = joints[carrier]
            column, axis = joint.axis, NOWHERE
            if not joint.slides:
                from_axis = add(self.center, scale(-ONE, joint.frame.origin))
                column, axis = cross(joint.axis, from_axis), joint.axis
            mover = Mover(carrier, joint.slides, column, axis, lever[carrier], errors[carrier])
            # A stated axis is as long as 1 and what rounding has made of it.
            if length(column).exceeds(mover.lever * (ONE + SKEWNESS)):
                raise ProofError(f"a lever is shorter than the ball is from joint {carrier} now")
            self._movers.insert(0, mover)
            self.size += mover.lever * mover.error
            carrier = joint.parent
        if radius.low < 0 or any(one.error.low < 0 for one in self._movers):
            raise ProofError("a radius or an error is below 0")
        ways = [one.error for one in self._movers]
        self._column_errors = [self._reach(k, ways) for k in range(len(ways))]

    def displacement(self, normal: Vector, ranges: list[Range], room: Interval) -> Interval:
        """How far it can get along a unit vector; no sharper than it takes to be below `room`."""
        mine = [ranges[one.number] for one in self._movers]
        found = self._by_levers(normal, mine)
        return found if room.exceeds(found) else least(found, self._by_bends(normal, mine))

    def speed(self, ranges: list[Range], slow: list[Interval], fast: list[Interval]) -> Interval:
        """How fast any point of it can be, with joints within these ranges and velocities."""
        movers = self._movers
        mean = [(fast[one.number] + slow[one.number]).half() for one in movers]
        half = [(fast[one.number] - slow[one.number]).half() for one in movers]
        pace = [abs(m) + h for m, h in zip(mean, half, strict=True)]
        mine = [ranges[one.number] for one in movers]
        shift = [(one.high + one.low).half() for one in mine]
        width = [(r.high - r.low).half() + one.error for r, one in zip(mine, movers, strict=True)]
        size = [r.size + one.error for r, one in zip(mine, movers, strict=True)]
        bend = wide = most = twist = rate = angle = spread = ZERO
        for k, (_, slides, column, _, lever, _) in enumerate(movers):
            # Pairs and triples of which this joint is the most distal.
            second, broad = spread * pace[k] + width[k] * rate, angle * pace[k] + size[k] * rate
            third = angle * (angle * pace[k] + size[k] * (rate + rate))
            if not slides:
                second, broad = second + width[k] * pace[k], broad + size[k] * pace[k]
                third += size[k] * (size[k] * (rate + pace[k]) + angle * (pace[k] + pace[k]))
                twist += angle * pace[k]
            bend += length(column) * second + (lever * third).half()
            wide += lever * broad
            most += lever * pace[k]
            if not slides:
                spread, angle, rate = spread + width[k], angle + size[k], rate + pace[k]
        columns = [one.column for one in movers]
        middle = []
        for j, one in enumerate(movers):
            parts = [one.column]
            for i, other in enumerate(movers):
                near, far = (other, one) if i <= j else (one, other)
                parts.append(scale(shift[i], cross(near.axis, far.column)))
            middle.append(add(*parts))
        by_middle, by_columns = (fastest_sum(one, mean, half) for one in (middle, columns))
        center = least(most, by_middle + bend, by_columns + wide)
        turning = length(add(*[scale(m, one.axis) for one, m in zip(movers, mean, strict=True)]))
        twist += total([h for one, h in zip(movers, half, strict=True) if not one.slides])
        return center + self._radius * least(rate, turning + twist)

    def _reach(self, place: int, ways: list[Interval]) -> Interval:
        """How much a column can change while joints go these ways."""
        changed = ZERO
        for other, mover in enumerate(self._movers):
            both = mover, self._movers[place]
            near, far = both if other <= place else both[::-1]
            if not near.slides:
                changed += far.lever * ways[other]
        return changed

    def _by_levers(self, normal: Vector, ranges: list[Range]) -> Interval:
        """By slopes that start at their own and change as columns do, and never beyond levers."""
        sizes = [one.size for one in ranges]
        found = ZERO
        for place, (mover, (low, high)) in enumerate(zip(self._movers, ranges, strict=True)):
            slope, off = dot(normal, mover.column), self._column_errors[place]
            spread = self._reach(place, sizes)
            rising = find_mean(off + slope, spread, mover.lever)
            falling = find_mean(off - slope, spread, mover.lever)
            ends = [way * rising if way.low > 0 else -way * falling for way in (low, high)]
            found += greatest(*ends)
        return found

    def _by_bends(self, normal: Vector, ranges: list[Range]) -> Interval:
        """By slopes, second derivatives, and what third ones can add."""
        movers = self._movers
        slopes = [dot(normal, one.column) for one in movers]
        bends: list[list[Interval]] = []
        for i in range(len(movers)):
            row = [bends[j][i] for j in range(i)]
            side = cross(normal, movers[i].axis)
            row += [dot(side, movers[j].column) for j in range(i, len(movers))]
            bends.append(row)
        ends = []
        for slope, row, (low, high) in zip(slopes, bends, ranges, strict=True):
            pairs = [(h * one.low, h * one.high) for h, one in zip(row, ranges, strict=True)]
            if (slope + total([least(*pair) for pair in pairs])).low >= 0:
                low = high
            elif (slope + total([greatest(*pair) for pair in pairs])).high <= 0:
                high = low
            ends.append((low, high))
        found = wide = ZERO
        for place, (mover, one) in enumerate(zip(movers, ranges, strict=True)):
            pairs = [(h * a, h * b) for h, (a, b) in zip(bends[place], ends, strict=True)]
            rise, fall = total([greatest(*p) for p in pairs]), total([least(*p) for p in pairs])
            moved = [
                w * (slopes[place] + (rise if w.low > 0 else fall).half()) for w in ends[place]
            ]
            found += greatest(*moved)
            wider = one.size + ROOT_3 * mover.error
            third = (wide * wide).half()
            if not mover.slides:
                third += wider * (wide.half() + wider.over(6))
                wide += wider
            found += one.size * self._column_errors[place] + mover.lever * wider * third
        return found


def find_mean(slope: Interval, spread: Interval, lever: Interval) -> Interval:
    """Mean over s in [0, 1] of min(slope + s spread, lever), or more."""
    slope, spread = Interval(slope.high, slope.high), Interval(spread.high, spread.high)
    lever = Interval(lever.high, lever.high)
    slope = greatest(slope, -lever)
    if slope.covers(lever):
        return lever
    if lever.covers(slope + spread):
        return slope + spread.half()
    missing = lever - slope
    return lever - missing * missing / (spread + spread)


def fastest_sum(vectors: list[Vector], mean: list[Interval], half: list[Interval]) -> Interval:
    """The greatest length of a sum of vectors with factors within `half` of `mean`, or more."""
    middle = add(*[scale(factor, vector) for factor, vector in zip(mean, vectors, strict=True)])
    parts = [scale(factor, vector) for factor, vector in zip(half, vectors, strict=True)]
    square = dot(middle, middle)
    for place, part in enumerate(parts):
        along = abs(dot(middle, part)) + total([abs(dot(part, one)) for one in parts[:place]])
        square += dot(part, part) + along + along
    return square.root()
