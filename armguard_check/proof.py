"""Checks the claims of one proof."""

from __future__ import annotations

import hashlib
import json
from typing import Any, NamedTuple

from armguard_check.arm import Ball, read_joints
from armguard_check.intervals import (
    ONE,
    ProofError,
    length,
    read,
    read_list,
    read_size,
    read_vectors,
    require,
    scale,
    total,
)
from armguard_check.obstacle import Body
from armguard_check.tube import Tube, read_sides

REACH = -1
"""Instead of a ball of the cover: the ball that the link cannot leave."""

DELAYS = {"this": ("latency", "reaction_time"), "next": ("period", "latency", "reaction_time")}
"""Settings whose sum is the time until brakes engage, by the verdict that stops the arm."""


LEVELS = "STOP", "SLOW", "AWARE", "CLEAR"


class Proved(NamedTuple):
    """Results of a valid proof about the link and the obstacle that it names."""

    contact_time: float
    """No contact before, in [s] from the tick; 0: nothing is claimed."""
    rests: bool
    """Whether the arm certainly comes to rest after the STOP of the proof."""
    in_time: bool
    """Whether it then rests, or is slow enough for good, before it can touch the obstacle."""
    arm: str
    """Digest of the trusted data of the arm."""
    cover: str
    """Digest of the trusted data of the link's cover."""


def digest(part: dict[str, Any]) -> str:
    """The sha-256 of what is trusted, as JSON with sorted keys, but for the digest itself."""
    stated = {key: value for key, value in part.items() if key != "digest"}
    text = json.dumps(stated, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def verify(proof: dict[str, Any]) -> Proved:
    """Check a proof.

    Raises:
        ProofError: It does not hold, or is malformed.
    """
    try:
        return _Check(proof).run()
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise ProofError(f"it is malformed ({type(error).__name__}: {error!s:.99})") from None


class _Check:
    """The check of one proof."""

    def __init__(self, proof: dict[str, Any]) -> None:
        self.proof, self.arm, self.cover = proof, proof["arm"], proof["cover"]
        for name, part in (("arm", self.arm), ("cover", self.cover)):
            require(digest(part) == part["digest"], f"the {name} does not have the stated digest")
        require(self.cover["link"] == proof["link"], "its cover belongs to another link")
        require(proof["level"] in LEVELS, f"level is none of {LEVELS}")
        count, carrier = len(self.arm["joints"]), self.cover["carrier"]
        q, v = (read_list(proof[key], count, key) for key in ("q", "v"))
        now = read(proof["now"], "now")
        self.age = now - read(proof["stamp"], "stamp")
        require(self.age.low >= 0, "the joint state is newer than its tick")
        names = "margin", "max_speed", *DELAYS["next"]
        self.sizes = {name: read_size(proof[name], name) for name in names}
        self.sides = [read_sides(self.arm, j, q[j], v[j]) for j in range(count)]
        self.bodies = [Body(state, now) for state in proof["states"]]
        require(bool(self.bodies), "the obstacle has no state")
        is_carried = type(carrier) is int and -1 <= carrier < count
        require(is_carried, "no joint of the arm carries the link")
        self.parents = self.cover["parents"]
        is_tree = all(type(one) is int and -1 <= one < k for k, one in enumerate(self.parents))
        require(bool(self.parents) and is_tree, "the link's balls are no tree")
        joints, (*center, radius) = read_joints(self.arm, q), self.cover["reach"]
        reach = {"center": center, "radius": radius, "lever": [0.0] * count}
        self.balls = {one["node"]: Ball(joints, carrier, one) for one in self.cover["balls"]}
        self.balls[REACH] = Ball(joints, -1, reach)

    def run(self) -> Proved:
        contact_time, rests, in_time = 0.0, False, False
        for motion in self.proof["motions"]:
            told, separations = motion["told"], motion["separations"]
            self.tube = Tube(motion, len(self.sides))
            self.brakes = told != "never"
            self.check_tube(told)
            for one in separations:
                self.check_separation(one)
            if separations:
                self.check_cover(separations)
            rests = rests or self.brakes
            in_time = in_time or (self.brakes and bool(separations))
            if separations and not self.brakes:
                contact_time = max(contact_time, motion["times"][-1])
        require(rests or contact_time > 0, "it claims nothing")
        return Proved(contact_time, rests, in_time, self.arm["digest"], self.cover["digest"])

    def check_tube(self, told: str) -> None:
        """Refuse a tube that joints can leave or, after a STOP, that ends too early."""
        if not self.brakes:
            self.tube.check(self.sides, self.age, None)
            return
        is_this = self.proof["level"] == "STOP"
        require((told == "this") == is_this, "another verdict stops the arm")
        bite = total([self.sizes[name] for name in DELAYS[told]])
        self.tube.check(self.sides, self.age, self.age + bite)
        for side in (side for both in self.sides for side in both):
            speed = side.velocity(self.age + bite)
            rests = bite + side.find_stop(speed).rest_time(speed)
            require(
                self.tube.times[-1].covers(rests), "the arm may not be at rest by the tube's end"
            )

    def check_separation(self, one: dict[str, Any]) -> None:
        """Refuse directions that do not separate, or a ball that is too fast after them."""
        node, ball, body = one["node"], self.balls[one["node"]], self.bodies[one["state"]]
        first, directions = 0, read_vectors(one["directions"], "directions")
        for last, normal in zip(one["ends"], directions, strict=True):
            rises = type(last) is int and first < last <= self.tube.last
            require(rises, "nodes of a separation are not increasing")
            unit = scale(ONE / length(normal), normal)
            room = body.room(unit, ball.center, self.tube.times[first], self.tube.times[last])
            room -= ball.size + body.size + self.sizes["margin"]
            separates = room.exceeds(ball.displacement(unit, self.tube.span(first, last), room))
            require(separates, f"a direction does not separate ball {node} by node {last}")
            first = last
        if first < self.tube.last:
            limit = self.sizes["max_speed"]
            # What the link cannot leave is no part of it, and says nothing of its speed.
            may_be_slow = self.brakes and bool(self.tube.fast) and node != REACH and limit.low > 0
            require(may_be_slow, f"the separation of ball {node} ends before its tube")
            ranges = self.tube.span(first, self.tube.last)
            speed = ball.speed(ranges, self.tube.slow[first], self.tube.fast[first])
            require(limit.covers(speed), f"ball {node} can be too fast from node {first} on")

    def check_cover(self, separations: list[dict[str, Any]]) -> None:
        """Refuse separations that do not cover a part of the link, or a state."""
        said, parents = {(one["node"], one["state"]) for one in separations}, self.parents
        for state in range(len(self.bodies)):
            for leaf in set(range(len(parents))) - set(parents):
                node = leaf
                while node >= 0 and (node, state) not in said:
                    node = parents[node]
                is_said = node >= 0 or (REACH, state) in said
                require(is_said, f"no separation covers a part of the link, in ball {leaf}")
