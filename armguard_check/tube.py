"""Where joints can be, and how fast: what their limits allow from a measured state.

A joint speeds up by no more than `speeding` up to `top`, and slows down by no more than `accel`. It
stays between its stops; where it may have reached one it may have been thrown back from there, by
`accel`. From the bite of its brakes on, at any time up to `free` from its stamp, it gets no faster
and does not turn round, and it stops as the entry of its brakes for its greatest speed says.
Upwards and downwards are mirror images, so all of this is said of one of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from armguard_check.intervals import (
    ZERO,
    Interval,
    ProofError,
    greatest,
    least,
    read,
    read_bound,
)


class Stop(NamedTuple):
    """How a joint stops from a speed."""

    speed: Interval
    deceleration: Interval
    time: Interval
    distance: Interval

    def rest_time(self, speed: Interval) -> Interval:
        """When it rests after the bite, at most."""
        if speed.high <= 0:
            return ZERO
        if self.deceleration.low > 0:
            return least(self.time, speed / self.deceleration)
        return self.time

    def way(self, speed: Interval, s: Interval) -> Interval:
        """How far it gets within `s` of the bite, from a speed of at least 0."""
        moving = least(s, self.time)
        ways = [speed * moving, self.distance]
        if self.deceleration.low > 0:
            until = least(moving, speed / self.deceleration)
            ways.append(until * (speed - (self.deceleration * until).half()))
        return least(*ways)


class Side(NamedTuple):
    """What bounds one joint one way, which is called up here."""

    start: Interval
    """Its greatest velocity at the stamp."""
    accel: Interval
    speeding: Interval
    top: Interval
    room: Interval
    """How far it is to its stop ahead, at most."""
    room_behind: Interval
    """How far its stop behind is at the least, and at least 0."""
    behind: Interval
    """When it can have got to that first."""
    stops: list[Stop]

    def velocity(self, s: Interval) -> Interval:
        """The greatest that it can have `s` after its stamp, while it is free."""
        start, turn = turn_round(self.start, self.accel, self.speeding, self.top)
        fastest = least(self.top, start + self.speeding * s)
        if turn is not None:
            before = start + self.accel * s
            after = least(self.top, self.speeding * greatest(s - turn, ZERO))
            fastest = before if turn.covers(s) else after
        if not self.behind.covers(s):
            thrown = least(self.top, self.accel * greatest(s - self.behind, ZERO))
            fastest = greatest(fastest, thrown)
        return fastest

    def displacement(self, s: Interval) -> Interval:
        """The greatest after `s`, while it is free, before it is clipped."""
        start, turn = turn_round(self.start, self.accel, self.speeding, self.top)
        if turn is None:
            highest = advance(start, self.speeding, self.top, s)
        elif turn.covers(s):
            highest = s * (start + (self.accel * s).half())
        else:
            after = advance(ZERO, self.speeding, self.top, greatest(s - turn, ZERO))
            highest = after + (start * turn).half()
        if not self.behind.covers(s):
            since = greatest(s - self.behind, ZERO)
            thrown = advance(ZERO, self.accel, self.top, since) - self.room_behind
            highest = greatest(highest, thrown)
        return highest

    def find_stop(self, speed: Interval) -> Stop:
        """How it stops from a speed; refused beyond the range of its brakes."""
        for stop in self.stops:
            if stop.speed.covers(speed):
                return stop
        raise ProofError("a joint can be faster at the bite than its brakes are stated for")

    def highest(self, s: Interval, free: Interval | None) -> Interval:
        """The greatest displacement from the truth at the stamp, `s` after it."""
        if free is None or free.covers(s):
            return least(self.room, self.displacement(s))
        begin = least(self.room, self.displacement(free))
        speed, since = self.velocity(free), s - free
        if speed.high > 0:
            way = self.find_stop(speed).way(greatest(speed, ZERO), since)
        else:
            until = least(since, -speed / self.accel)
            way = until * (speed + (self.accel * until).half())
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


def turn_round(
    start: Interval, accel: Interval, speeding: Interval, top: Interval
) -> tuple[Interval, Interval | None]:
    """The start that counts, and when a joint turns round; None: it does not, or no harder."""
    start = least(start, top)
    return start, -start / accel if start.high < 0 and accel.exceeds(speeding) else None


def advance(start: Interval, accel: Interval, top: Interval, s: Interval) -> Interval:
    """How far a body gets that starts at most at `top` and speeds up to that."""
    if s.covers((top - start) / accel):
        return top * s - (top - start) * (top - start) / (accel + accel)
    # Without the top speed it gets no less far.
    return s * (start + (accel * s).half())


def arrive(start: Interval, accel: Interval, top: Interval, way: Interval) -> Interval:
    """When that body can have gone a way above 0, at the earliest."""
    root = (start * start + (accel + accel) * way).root()
    time = (way + way) / (start + root) if start.low >= 0 else (root - start) / accel
    ramp = (top - start) / accel
    if not time.covers(ramp):
        return time
    return ramp + (way - ((start + top) * ramp).half()) / top


def find_arrival(
    start: Interval, accel: Interval, speeding: Interval, top: Interval, room: Interval
) -> Interval:
    """When a joint can first be at a stop that is `room` ahead at the least."""
    if room.low <= 0:
        return ZERO
    start, turn = turn_round(start, accel, speeding, top)
    if turn is None:
        return arrive(start, speeding, top, room)
    return turn + arrive(ZERO, speeding, top, room - (start * turn).half())


def read_sides(arm: dict[str, Any], joint: int, q: Interval, v: Interval) -> tuple[Side, Side]:
    """What bounds a joint upwards and downwards."""
    error, slack = read(arm["position_error"][joint]), read(arm["velocity_error"][joint])
    accel = read(arm["acceleration"][joint])
    speeding = read(arm["operating_acceleration"][joint])
    top = greatest(read(arm["operating_velocity"][joint]), abs(v))
    above, below = read_bound(arm["upper"][joint]) - q, q - read_bound(arm["lower"][joint])
    if min(error.low, slack.low) < 0 or min(accel.low, speeding.low) <= 0:
        raise ProofError(f"limits of joint {joint} are unusable")
    names = "speed", "deceleration", "time", "distance"
    columns = [map(read_bound, arm["brakes"][joint][name]) for name in names]
    stops = [Stop(*entry) for entry in zip(*columns, strict=True)]
    if any(number.low < 0 for stop in stops for number in stop):
        raise ProofError(f"brakes of joint {joint} are unusable")

    def read_side(v: Interval, ahead: Interval, behind: Interval) -> Side:
        # It may be nearer to its stop than it is measured.
        behind, ahead = greatest(behind - error, ZERO), greatest(ahead, ZERO) + error
        arrival = find_arrival(slack - v, accel, speeding, top, behind)
        return Side(v + slack, accel, speeding, top, ahead, behind, arrival, stops)

    return read_side(v, above, below), read_side(-v, below, above)
