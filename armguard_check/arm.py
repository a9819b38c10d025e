"""Place, displacement and speed of a ball of the arm in a box of joint displacements.

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
    Vector,
    add,
    combine,
    cross,
    dot,
    greatest,
    least,
    length,
    read_list,
    read_size,
    read_vector,
    require,
    scale,
    sine_and_cosine,
    total,
)
from armguard_check.tube import Range

SKEWNESS = ONE.over(10**12)
"""Rounding allowance of stated axes and rotations."""

ROOT_3 = (ONE + ONE + ONE).root()


class Placement(NamedTuple):
    """Pose of a frame in another frame: columns of the rotation, and the origin."""

    columns: tuple[Vector, Vector, Vector]
    origin: Vector

    def turn(self, a: Vector) -> Vector:
        """A vector of the frame, in the other one."""
        return combine(list(a), list(self.columns))

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
    """Number of the joint that carries it; -1: none."""
    slides: bool
    axis: Vector
    frame: Placement
    """Of what it carries."""
    error: Interval
    """What its measured position may be off by."""


def read_joints(arm: dict[str, Any], q: list[Interval]) -> list[Joint]:
    """Place all joints, from the base on."""
    placed: list[Joint] = []
    for number, joint in enumerate(arm["joints"]):
        parent, slides, axis = joint["parent"], joint["slides"], read_vector(joint["axis"], "axis")
        is_carried = type(parent) is int and -1 <= parent < number
        require(is_carried, f"joint {number} is carried by one that does not come before it")
        require(type(slides) is bool, f"joint {number} neither slides nor turns")
        numbers = read_list(joint["placement"], 12, "placement")
        x, y, z = ((numbers[k], numbers[3 + k], numbers[6 + k]) for k in range(3))
        skew = add(cross(x, y), scale(-ONE, z))
        skewness = *skew, dot(x, y), dot(x, x) - ONE, dot(y, y) - ONE
        require(are_small(*skewness), f"the placement of joint {number} is no rotation")
        require(are_small(dot(axis, axis) - ONE), f"the axis of joint {number} is no unit vector")
        fixed = Placement((x, y, z), (numbers[9], numbers[10], numbers[11]))
        before = fixed if parent < 0 else placed[parent].frame.then(fixed)
        along = before.turn(axis)
        if slides:
            frame = before._replace(origin=add(before.origin, scale(q[number], along)))
        else:
            frame = before.then(Placement(turn_about(axis, q[number]), NOWHERE))
        error = read_size(arm["position_error"][number], f"position_error of joint {number}")
        placed.append(Joint(parent, slides, along, frame, error))
    return placed


def are_small(*numbers: Interval) -> bool:
    """Whether all are 0 but for rounding."""
    return all(SKEWNESS.covers(abs(one)) for one in numbers)


def turn_about(axis: Vector, angle: Interval) -> tuple[Vector, Vector, Vector]:
    """Columns of a rotation, by Rodrigues' formula."""
    sine, cosine = sine_and_cosine(angle)

    def turn(unit: Vector) -> Vector:
        along = scale((ONE - cosine) * dot(axis, unit), axis)
        return add(scale(cosine, unit), scale(sine, cross(axis, unit)), along)

    return turn((ONE, ZERO, ZERO)), turn((ZERO, ONE, ZERO)), turn((ZERO, ZERO, ONE))


class Mover(NamedTuple):
    """A joint that moves a ball, in the order from base to tip."""

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
        size: Its radius plus the error of its centre from joint errors.
    """

    def __init__(self, joints: list[Joint], carrier: int, ball: dict[str, Any]) -> None:
        center = read_vector(ball["center"], "center of a ball")
        lever = read_list(ball["lever"], len(joints), "lever")
        self.center = center if carrier < 0 else joints[carrier].frame.place(center)
        self._radius = self.size = read_size(ball["radius"], "radius of a ball")
        self._movers: list[Mover] = []
        while carrier >= 0:
            parent, slides, axis, frame, error = joints[carrier]
            from_axis = add(self.center, scale(-ONE, frame.origin))
            column, turns = (axis, NOWHERE) if slides else (cross(axis, from_axis), axis)
            mover = Mover(carrier, slides, column, turns, lever[carrier], error)
            # A stated axis is as long as 1 and what rounding has made of it.
            is_short = length(column).exceeds(mover.lever * (ONE + SKEWNESS))
            require(not is_short, f"a lever is shorter than the ball is from joint {carrier} now")
            self._movers.insert(0, mover)
            self.size += mover.lever * error
            carrier = parent
        ways, movers = [one.error for one in self._movers], self._movers
        places = range(len(movers))
        self._second = [
            [cross(movers[min(i, j)].axis, movers[max(i, j)].column) for j in places]
            for i in places
        ]
        """Second derivatives of the centre, by each two joints."""
        self._column_errors = [self._reach(k, ways) for k in places]

    def displacement(self, normal: Vector, ranges: list[Range], room: Interval) -> Interval:
        """How far it can get along a unit vector; no more exact than needed to be below `room`."""
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
        middle = [add(c, combine(shift, row)) for c, row in zip(columns, self._second, strict=True)]
        by_middle, by_columns = (fastest_sum(one, mean, half) for one in (middle, columns))
        center = least(most, by_middle + bend, by_columns + wide)
        turning = length(combine(mean, [one.axis for one in movers]))
        twist += total([h for one, h in zip(movers, half, strict=True) if not one.slides])
        return center + self._radius * least(rate, turning + twist)

    def _reach(self, place: int, ways: list[Interval]) -> Interval:
        """How much a column can change for these joint displacements."""
        changed = ZERO
        for other, way in enumerate(ways):
            if not self._movers[min(place, other)].slides:
                changed += self._movers[max(place, other)].lever * way
        return changed

    def _by_levers(self, normal: Vector, ranges: list[Range]) -> Interval:
        """Bound by slopes that change as columns do and never exceed levers."""
        sizes, found = [one.size for one in ranges], ZERO
        for place, (mover, (low, high)) in enumerate(zip(self._movers, ranges, strict=True)):
            slope, off = dot(normal, mover.column), self._column_errors[place]
            spread = self._reach(place, sizes)
            rising = find_mean(off + slope, spread, mover.lever)
            falling = find_mean(off - slope, spread, mover.lever)
            ends = [way * rising if way.high > 0 else -way * falling for way in (low, high)]
            found += greatest(*ends)
        return found

    def _by_bends(self, normal: Vector, ranges: list[Range]) -> Interval:
        """Bound by slopes, second derivatives, and a bound on third derivatives."""
        movers = self._movers
        slopes = [dot(normal, one.column) for one in movers]
        bends = [[dot(normal, one) for one in row] for row in self._second]
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
            bent = ((w, (rise if w.high > 0 else fall).half()) for w in ends[place])
            found += greatest(*[w * (slopes[place] + bend) for w, bend in bent])
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
    middle, square = combine(mean, vectors), ZERO
    parts = [scale(factor, vector) for factor, vector in zip(half, vectors, strict=True)]
    for place, part in enumerate(parts):
        along = abs(dot(middle, part)) + total([abs(dot(part, one)) for one in parts[:place]])
        square += dot(part, part) + along + along
    return (dot(middle, middle) + square).root()
