"""Positions and velocities of joints: the tube of a proof, and the bounds from their limits.

A joint speeds up by no more than `speeding` up to `top`, and slows down by no more than `accel`. It
stays between its stops; a stop that it may have reached can push it back, by `accel`. Its brakes
engage at any time up to `free` from its stamp. Then it neither accelerates nor reverses, and stops
as the entry of its brakes for its greatest speed states. Both directions are mirror images, so the
code describes one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from armguard_check.intervals import (
    ONE,
    ZERO,
    Interval,
    ProofError,
    greatest,
    least,
    read,
    read_bound,
    read_list,
    read_size,
    require,
)

ERRORS = "position_error", "velocity_error"
LIMITS = *ERRORS, "operating_velocity", "acceleration", "operating_acceleration"
"""Numbers of each joint, as the arm has them."""


class Range(NamedTuple):
    """Displacements that one joint can have from its true position at the stamp."""

    low: Interval
    high: Interval

    @property
    def size(self) -> Interval:
        """The greatest displacement, either way."""
        return greatest(self.high, -self.low, ZERO)


class Stop(NamedTuple):
    """How a joint stops from a speed."""

    speed: Interval
    deceleration: Interval
    time: Interval
    distance: Interval

    def rest_time(self, speed: Interval) -> Interval:
        """Greatest time from braking to rest."""
        if speed.high <= 0:
            return ZERO
        if self.deceleration.low > 0:
            return least(self.time, speed / self.deceleration)
        return self.time

    def way(self, speed: Interval, s: Interval) -> Interval:
        """How far it gets within `s` of braking, from a speed of at least 0."""
        moving = least(s, self.time)
        ways = [speed * moving, self.distance]
        if self.deceleration.low > 0:
            until = least(moving, speed / self.deceleration)
            ways.append(until * (speed - (self.deceleration * until).half()))
        return least(*ways)


class Free(NamedTuple):
    """A joint with its greatest acceleration in one direction, without a stop."""

    start: Interval
    """Its greatest velocity at first, at most `top`."""
    accel: Interval
    speeding: Interval
    top: Interval

    @property
    def turn(self) -> Interval | None:
        """When it reverses, by `accel`; None: it does not, or `speeding` equals `accel`."""
        is_back = self.start.high < 0 and self.accel.exceeds(self.speeding)
        return -self.start / self.accel if is_back else None

    def velocity(self, s: Interval) -> Interval:
        """The greatest after `s`."""
        if self.turn is None:
            return least(self.top, self.start + self.speeding * s)
        if self.turn.covers(s):
            return self.start + self.accel * s
        return least(self.top, self.speeding * greatest(s - self.turn, ZERO))

    def displacement(self, s: Interval) -> Interval:
        """The greatest after `s`."""
        if self.turn is None:
            return advance(self.start, self.speeding, self.top, s)
        if self.turn.covers(s):
            return advance(self.start, self.accel, self.top, s)
        since = greatest(s - self.turn, ZERO)
        return advance(ZERO, self.speeding, self.top, since) + (self.start * self.turn).half()

    def arrival(self, way: Interval) -> Interval:
        """Earliest time at which it can have moved this far."""
        if way.low <= 0:
            return ZERO
        if self.turn is None:
            return arrive(self.start, self.speeding, self.top, way)
        way -= (self.start * self.turn).half()
        return self.turn + arrive(ZERO, self.speeding, self.top, way)


def advance(start: Interval, accel: Interval, top: Interval, s: Interval) -> Interval:
    """How far a body gets that starts at most at `top` and speeds up to that."""
    if s.covers((top - start) / accel):
        return top * s - (top - start) * (top - start) / (accel + accel)
    # Without the top speed it gets no less far.
    return s * (start + (accel * s).half())


def arrive(start: Interval, accel: Interval, top: Interval, way: Interval) -> Interval:
    """Earliest time at which that body can have moved a distance above 0."""
    root = (start * start + (accel + accel) * way).root()
    time = (way + way) / (start + root) if start.low >= 0 else (root - start) / accel
    ramp = (top - start) / accel
    if not time.covers(ramp):
        return time
    return ramp + (way - ((start + top) * ramp).half()) / top


class Side(NamedTuple):
    """Bounds of one joint in one direction, here called up."""

    free: Free
    thrown: Free
    """From its stop behind, once it can have got there."""
    room: Interval
    """How far it is to its stop ahead, at most."""
    room_behind: Interval
    """How far its stop behind is at the least, and at least 0."""
    behind: Interval
    """Earliest time at which it can have reached that stop."""
    stops: list[Stop]

    def velocity(self, s: Interval) -> Interval:
        """The greatest that it can have `s` after its stamp, while it is free."""
        fastest, since = self.free.velocity(s), greatest(s - self.behind, ZERO)
        is_early = self.behind.covers(s)
        return fastest if is_early else greatest(fastest, self.thrown.velocity(since))

    def displacement(self, s: Interval) -> Interval:
        """The greatest after `s`, while it is free, before it is clipped."""
        highest, since = self.free.displacement(s), greatest(s - self.behind, ZERO)
        thrown = self.thrown.displacement(since) - self.room_behind
        return highest if self.behind.covers(s) else greatest(highest, thrown)

    def find_stop(self, speed: Interval) -> Stop:
        """How it stops from a speed; refused beyond the range of its brakes."""
        for stop in self.stops:
            if stop.speed.covers(speed):
                return stop
        raise ProofError("a joint can be faster at braking than any stated entry of its brakes")

    def highest(self, s: Interval, free: Interval | None) -> Interval:
        """The greatest displacement from the truth at the stamp, `s` after it."""
        if free is None or free.covers(s):
            return least(self.room, self.displacement(s))
        begin = least(self.room, self.displacement(free))
        speed, since = self.velocity(free), s - free
        if speed.high > 0:
            way = self.find_stop(speed).way(greatest(speed, ZERO), since)
        else:
            until = least(since, -speed / self.free.accel)
            way = until * (speed + (self.free.accel * until).half())
        # One that has come to its stop behind it stays there.
        return least(self.room, greatest(begin + way, -self.room_behind))

    def fastest_from(self, s: Interval, free: Interval) -> Interval:
        """The greatest velocity from `s` on, of a joint that brakes by `free`."""
        speed = self.velocity(free)
        if speed.high <= 0:
            return ZERO
        stop, since = self.find_stop(speed), s - free
        if since.covers(stop.rest_time(speed)):
            return ZERO
        return greatest(speed - stop.deceleration * greatest(since, ZERO), ZERO)


def read_sides(arm: dict[str, Any], joint: int, q: Interval, v: Interval) -> tuple[Side, Side]:
    """Bounds of a joint upwards and downwards."""

    def size(value: object, name: str, read: Callable[[object, str], Interval] = read) -> Interval:
        return read_size(value, f"{name} of joint {joint}", read)

    error, slack, operating, accel, speeding = (size(arm[key][joint], key) for key in LIMITS)
    require(min(accel.low, speeding.low) > 0, f"an acceleration of joint {joint} is 0")
    lower, upper = (read_bound(arm[key][joint], key) for key in ("lower", "upper"))
    require(upper.covers(lower), f"lower of joint {joint} is above its upper")
    brakes, top = arm["brakes"][joint], greatest(operating, abs(v))
    columns = [[size(one, key, read_bound) for one in brakes[key]] for key in Stop._fields]
    stops = [Stop(*entry) for entry in zip(*columns, strict=True)]
    are_possible = all(accel.covers(stop.deceleration) for stop in stops)
    require(are_possible, f"brakes of joint {joint} are stronger than its acceleration")
    thrown = Free(ZERO, accel, accel, top)

    def read_side(v: Interval, ahead: Interval, behind: Interval) -> Side:
        # It may be nearer to its stop than it is measured.
        behind, ahead = greatest(behind - error, ZERO), greatest(ahead, ZERO) + error
        free, back = (Free(least(one + slack, top), accel, speeding, top) for one in (v, -v))
        return Side(free, thrown, ahead, behind, back.arrival(behind), stops)

    return read_side(v, upper - q, q - lower), read_side(-v, q - lower, upper - q)


class Tube:
    """Ranges of joints from a tick on, at nodes; they also hold between nodes.

    Attributes:
        times: Of the nodes, from the tick on.
        last: The last node.
        fast: Greatest velocities from each node on, by joint; nothing where none are stated.
        slow: Least velocities from each node on, by joint.
    """

    def __init__(self, motion: dict[str, Any], count: int) -> None:
        self.times = read_list(motion["times"], len(motion["times"]), "times")
        self.last = len(self.times) - 1
        rises = all(self.times[k + 1].exceeds(self.times[k]) for k in range(self.last))
        is_whole = self.last > 0 and self.times[0].high == 0
        require(is_whole and rises, "times of a tube do not increase from its tick on")
        rows = []
        for name in ("high", "low", "fastest", "slowest"):
            size = len(self.times) * count if motion[name] else 0
            numbers = read_list(motion[name], size, name)
            rows.append([numbers[k : k + count] for k in range(0, size, count)])
        self._high, self._low, self.fast, self.slow = rows

    def span(self, first: int, last: int) -> list[Range]:
        """Ranges of joints from one node to another."""
        nodes = slice(first, last + 1)
        lows, highs = (zip(*rows[nodes], strict=True) for rows in (self._low, self._high))
        return [Range(least(*low), greatest(*high)) for low, high in zip(lows, highs, strict=True)]

    def check(self, sides: list[tuple[Side, Side]], age: Interval, free: Interval | None) -> None:
        """Refuse it unless it contains all possible motions of the joints.

        A displacement falls at most once and then rises, so nodes bound all values between them.

        Args:
            sides: Bounds of each joint.
            age: Time of the tick, from the stamp of the joint state on.
            free: Latest time at which brakes engage, from that stamp; None: never.
        """
        for node, time in enumerate(self.times):
            for joint, both in enumerate(sides):
                ways, paces = (self._high, self._low), (self.fast, self.slow)
                for side, way, pace, sign in zip(both, ways, paces, (ONE, -ONE), strict=True):
                    is_held = (sign * way[node][joint]).covers(side.highest(age + time, free))
                    require(is_held, f"joint {joint} can leave the tube at node {node}")
                    if free is not None and pace:
                        fastest = side.fastest_from(age + time, free)
                        is_held = (sign * pace[node][joint]).covers(fastest)
                        require(is_held, f"joint {joint} can be faster from node {node} on")
