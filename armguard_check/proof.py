"""What one proof claims, and whether it holds."""

from __future__ import annotations

import hashlib
import json
from typing import Any, NamedTuple

from armguard_check.arm import Ball, Range, read_joints
from armguard_check.intervals import (
    ONE,
    ZERO,
    Interval,
    ProofError,
    Vector,
    add,
    dot,
    greatest,
    least,
    length,
    read,
    read_bound,
    read_list,
    read_vector,
    scale,
    total,
)
from armguard_check.tube import Side, read_sides

REACH = -1
"""In place of a ball of the cover: what the link cannot leave."""

DELAYS = {"this": ("latency", "reaction_time"), "next": ("period", "latency", "reaction_time")}
"""What adds up to the time until brakes bite, by the verdict that tells the arm to stop."""


class Proved(NamedTuple):
    """What a proof that holds has proved, of the link and the obstacle that it names."""

    contact_time: float
    """No contact before, in [s] from the tick; 0: nothing is claimed."""
    rests: bool
    """Whether the arm surely rests at last, if it is told to stop as the proof says."""
    in_time: bool
    """Whether it then rests, or is slow enough for good, before it can touch the obstacle."""
    arm: str
    """Digest of what is trusted of the arm."""


class Body:
    """One state of the obstacle: a free body, or the hull of some."""

    def __init__(self, state: dict[str, Any], now: Interval) -> None:
        points, velocities = state["points"], state["velocities"]
        self.corners = [
            (read_vector(points[k : k + 3]), read_vector(velocities[k : k + 3]))
            for k in range(0, len(points), 3)
        ]
        self.age = now - read(state["stamp"])
        self.size = read(state["radius"]) + read(state["position_error"])
        self.accel, self.top = read_bound(state["accel"]), read_bound(state["speed"])
        self.error = read_bound(state["velocity_error"])
        bounds = self.size, self.accel, self.top, self.error
        if not self.corners or any(bound.low < 0 for bound in bounds):
            raise ProofError("an obstacle has no points, or a bound below 0")

    def room(self, normal: Vector, center: Vector, start: Interval, end: Interval) -> Interval:
        """Least distance from a point along a unit vector, from a time to another after the tick.

        Displacements are convex in time, so that both ends decide.
        """
        rooms = []
        for point, velocity in self.corners:
            apart = dot(normal, add(point, scale(-ONE, center)))
            closing, pace = -dot(normal, velocity), length(velocity)
            rooms += [apart - self._advance(closing, pace, self.age + t) for t in (start, end)]
        return least(*rooms)

    def _advance(self, closing: Interval, pace: Interval, s: Interval) -> Interval:
        """How far it can come within `s` of its stamp, before it where that is negative."""
        if s.high <= 0:
            closing, s = -closing, -s
        top, accel, error = self.top, self.accel, self.error
        if not (top + error).covers(pace):
            top = pace + error  # it was seen to be faster
        start = least(closing + error, top)
        if not (accel * s).covers(top - start):
            return s * (start + (accel * s).half())
        # Short of the top speed by a triangle at first, if it need not have it at once.
        lost = ZERO if accel.low <= 0 else (top - start) * (top - start) / (accel + accel)
        return top * s - lost


class Tube:
    """Where joints are from a tick on: ranges at nodes, which hold all that is between them."""

    def __init__(self, motion: dict[str, Any], count: int) -> None:
        self.times = read_list(motion["times"], len(motion["times"]))
        self.last = len(self.times) - 1
        rises = all(self.times[k + 1].exceeds(self.times[k]) for k in range(self.last))
        if self.last < 1 or self.times[0].high != 0 or not rises:
            raise ProofError("times of a tube do not rise from its tick on")
        self.high, self.low, self.fast, self.slow = (
            self._read(motion[key], count) for key in ("high", "low", "fastest", "slowest")
        )

    def _read(self, values: list[Any], count: int) -> list[list[Interval]]:
        numbers = read_list(values, len(self.times) * count if values else 0)
        return [numbers[k : k + count] for k in range(0, len(numbers), count)]

    def span(self, first: int, last: int) -> list[Range]:
        """Where joints are from one node to another."""
        nodes = slice(first, last + 1)
        lows, highs = (zip(*rows[nodes], strict=True) for rows in (self.low, self.high))
        return [Range(least(*low), greatest(*high)) for low, high in zip(lows, highs, strict=True)]

    def check(self, sides: list[tuple[Side, Side]], age: Interval, free: Interval | None) -> None:
        """Refuse it unless it holds all that joints can do; `free` is when brakes bite at last.

        A displacement falls at most once and then rises, so that nodes hold what is between them.
        """
        for node, time in enumerate(self.times):
            for joint, both in enumerate(sides):
                ways, paces = (self.high, self.low), (self.fast, self.slow)
                for side, way, pace, sign in zip(both, ways, paces, (ONE, -ONE), strict=True):
                    if not (sign * way[node][joint]).covers(side.highest(age + time, free)):
                        raise ProofError(f"joint {joint} can leave the tube at node {node}")
                    if free is None or not pace:
                        continue
                    if not (sign * pace[node][joint]).covers(side.fastest_from(age + time, free)):
                        raise ProofError(f"joint {joint} can be faster from node {node} on")


def digest(part: dict[str, Any]) -> str:
    """The sha-256 of what is trusted, as JSON with sorted keys, but for the digest itself."""
    stated = {key: value for key, value in part.items() if key != "digest"}
    text = json.dumps(stated, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def verify(proof: dict[str, Any]) -> Proved:
    """Find out what a proof proves.

    Raises:
        ProofError: It does not hold, or is none.
    """
    try:
        return _Check(proof).run()
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise ProofError(f"it is malformed ({type(error).__name__}: {error})") from None


class _Check:
    """The check of one proof."""

    def __init__(self, proof: dict[str, Any]) -> None:
        self.proof, self.arm, self.cover = proof, proof["arm"], proof["cover"]
        if any(digest(part) != part["digest"] for part in (self.arm, self.cover)):
            raise ProofError("what is trusted has another digest")
        count = len(self.arm["joints"])
        q, v = (read_list(proof[key], count) for key in ("q", "v"))
        now = read(proof["now"])
        self.age = now - read(proof["stamp"])
        self.sides = [read_sides(self.arm, j, q[j], v[j]) for j in range(count)]
        self.bodies = [Body(state, now) for state in proof["states"]]
        self.margin, self.max_speed = read(proof["margin"]), read(proof["max_speed"])
        if not self.bodies or min(self.age.low, self.margin.low, self.max_speed.low) < 0:
            raise ProofError("there is no obstacle, or a number below 0")
        joints, carrier = read_joints(self.arm["joints"], q), self.cover["carrier"]
        if type(carrier) is not int or not -1 <= carrier < count:
            raise ProofError("the link is carried by no joint")
        errors = read_list(self.arm["position_error"], count)
        self.balls: dict[object, Ball] = {}
        for ball in self.cover["balls"]:
            center, lever = read_vector(ball["center"]), read_list(ball["lever"], count)
            made = Ball(joints, carrier, center, read(ball["radius"]), lever, errors)
            self.balls[ball["node"]] = made
        x, y, z, radius = read_list(self.cover["reach"], 4)
        self.balls[REACH] = Ball(joints, -1, (x, y, z), radius, [], errors)

    def run(self) -> Proved:
        contact_time, rests, in_time = 0.0, False, False
        for motion in self.proof["motions"]:
            self.tube = Tube(motion, len(self.sides))
            self.brakes = motion["told"] != "never"
            self.check_tube(motion["told"])
            rests = rests or self.brakes
            for one in motion["separations"]:
                self.check_separation(one)
            if not motion["separations"]:
                continue
            self.check_cover(motion["separations"])
            in_time = in_time or self.brakes
            if not self.brakes:
                contact_time = max(contact_time, motion["times"][-1])
        if not rests and contact_time == 0:
            raise ProofError("it claims nothing")
        return Proved(contact_time, rests, in_time, self.arm["digest"])

    def check_tube(self, told: str) -> None:
        """Refuse a tube that joints can leave; of an arm told to stop, one that ends too early."""
        if not self.brakes:
            self.tube.check(self.sides, self.age, None)
            return
        if (told == "this") != (self.proof["level"] == "STOP"):
            raise ProofError("the arm is told to stop by another verdict than this level says")
        bite = total([greatest(read(self.proof[name]), ZERO) for name in DELAYS[told]])
        self.tube.check(self.sides, self.age, self.age + bite)
        for side in (side for both in self.sides for side in both):
            speed = side.velocity(self.age + bite)
            if not self.tube.times[-1].covers(bite + side.find_stop(speed).rest_time(speed)):
                raise ProofError("the arm need not rest by the end of the tube")

    def check_separation(self, one: dict[str, Any]) -> None:
        """Refuse directions that do not separate, or a ball that is too fast after them."""
        ball, body = self.balls[one["node"]], self.bodies[one["state"]]
        first = 0
        for place, last in enumerate(one["ends"]):
            if type(last) is not int or not first < last <= self.tube.last:
                raise ProofError("nodes of a separation do not rise")
            normal = read_vector(one["directions"][3 * place : 3 * place + 3])
            unit = scale(ONE / length(normal), normal)
            room = body.room(unit, ball.center, self.tube.times[first], self.tube.times[last])
            room -= ball.size + body.size + self.margin
            if not room.exceeds(ball.displacement(unit, self.tube.span(first, last), room)):
                where = f"ball {one['node']} from node {first} to {last}"
                raise ProofError(f"a direction does not separate {where}")
            first = last
        if first == self.tube.last:
            return
        may_be_slow = self.brakes and self.tube.fast and self.max_speed.low > 0
        # What the link cannot leave is no part of it, and says nothing of its speed.
        if one["node"] == REACH or not may_be_slow:
            raise ProofError(f"what is said of ball {one['node']} ends before its tube")
        ranges = self.tube.span(first, self.tube.last)
        speed = ball.speed(ranges, self.tube.slow[first], self.tube.fast[first])
        if not self.max_speed.covers(speed):
            raise ProofError(f"ball {one['node']} can be too fast from node {first} on")

    def check_cover(self, separations: list[dict[str, Any]]) -> None:
        """Refuse separations that say nothing of a part of the link, or of a state."""
        parents = self.cover["parents"]
        if not parents or any(parent >= node for node, parent in enumerate(parents)):
            raise ProofError("the link's balls are no tree")
        said = {(one["node"], one["state"]) for one in separations}
        for state in range(len(self.bodies)):
            for leaf in set(range(len(parents))) - set(parents):
                node = leaf
                while node >= 0 and (node, state) not in said:
                    node = parents[node]
                if node < 0 and (REACH, state) not in said:
                    raise ProofError(f"nothing is said of a part of the link, in ball {leaf}")
