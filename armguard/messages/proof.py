"""What was proved of a verdict, as numbers that another program can check; see docs/proofs.md.

Rows of numbers stand one after another in one list, as recordings have them.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any, Literal

import msgspec

from armguard.messages.incoming import Message


class JointPlace(msgspec.Struct, kw_only=True):
    """How a joint is carried."""

    name: str
    parent: int
    """the joint that carries it, by its place in the list; -1: the base"""
    slides: bool
    """whether it slides; else it turns"""
    axis: list[float]
    """along which it slides, or about which it turns, in its own frame; x, y, z"""
    placement: list[float]
    """of its frame in that of the joint that carries it, or in the world: the rows of the rotation,
    and x, y, z of the origin, [m]"""


class BrakeColumns(msgspec.Struct, kw_only=True):
    """How a joint stops under the payload in force, in rising order of speed; [rad] or [m], [s]."""

    speed: list[float]
    """up to which an entry holds"""
    deceleration: list[float]
    """at each instant, at least; 0 where none is guaranteed"""
    time: list[float]
    """until it rests, at most; infinite where none is stated"""
    distance: list[float]
    """until it rests, at most; infinite where none is stated"""


class TrustedArm(msgspec.Struct, kw_only=True):
    """What is taken on trust of the arm: one number for each joint, in [rad] or [m], and [s]."""

    digest: str
    """sha-256 of all that follows"""
    joints: list[JointPlace]
    """those that are watched"""
    lower: list[float]
    """least positions"""
    upper: list[float]
    """greatest positions"""
    acceleration: list[float]
    """limits on accelerations, braking included"""
    operating_velocity: list[float]
    """how fast joints are at most while they work"""
    operating_acceleration: list[float]
    """with which they speed up at most then"""
    position_error: list[float]
    """what measured positions may be off by"""
    velocity_error: list[float]
    """what measured velocities may be off by"""
    brakes: list[BrakeColumns]
    """how joints stop"""


class CoverBall(msgspec.Struct, kw_only=True):
    """A sphere of a link's cover."""

    node: int
    """its place in the link's tree"""
    center: list[float]
    """in the frame of the joint that carries the link, [m]; x, y, z"""
    radius: float
    """[m]"""
    lever: list[float]
    """how far its centre can ever be from the axis of each joint, [m]; 1 where the joint slides, 0
    where it does not move the link"""


class TrustedCover(msgspec.Struct, kw_only=True):
    """What is taken on trust of a link's cover."""

    digest: str
    """sha-256 of all that follows"""
    link: str
    carrier: int
    """the joint that carries the link, by its place in the arm's list; -1: none"""
    reach: list[float]
    """the ball that the link cannot leave, whatever its joints do; x, y, z in the world and radius,
    [m]"""
    parents: list[int]
    """of each sphere of the link's tree its parent, which owns all that it owns; -1 for the first.
    The spheres that are no one's parent hold the link between them"""
    balls: list[CoverBall]
    """the spheres that take part"""


class ObstacleState(msgspec.Struct, kw_only=True):
    """A state of the obstacle that may be true, with the bounds that hold for it."""

    stamp: float
    """[s] of the monitor's clock"""
    points: list[float]
    """x, y, z of each point in the world, [m]"""
    velocities: list[float]
    """of each point, [m/s]; x, y, z"""
    radius: float
    """around the hull of the points, [m]"""
    position_error: float
    """what points may be off by, [m]"""
    velocity_error: float
    """what velocities may be off by, [m/s]"""
    accel: float
    """bound on the acceleration, [m/s²]"""
    speed: float
    """bound on the speed, [m/s]"""


class Separation(msgspec.Struct, kw_only=True):
    """The directions along which a sphere stays apart from a state of the obstacle."""

    node: int
    """the sphere, by its place in the link's tree; -1: the ball that the link cannot leave"""
    state: int
    """by its place in the list"""
    ends: list[int]
    """nodes of the tube up to which each direction separates, from the one before it on"""
    directions: list[float]
    """unit vectors from the arm to the obstacle; x, y, z of each"""


class ProvedMotion(msgspec.Struct, kw_only=True):
    """Where joints can be from the tick on, and what keeps the link away from the obstacle."""

    told: Literal["never", "this", "next"]
    """when the arm is told to stop: never, or by this verdict, or by the next one"""
    times: list[float]
    """of the tube's nodes, from the tick on, [s]; the last one is what is claimed: no contact
    before it, and if the arm is told to stop, it rests by then"""
    high: list[float]
    """greatest displacements of joints at each node, from where they truly were at the stamp"""
    low: list[float]
    """least displacements, alike"""
    fastest: list[float]
    """greatest velocities from each node on; empty where no contact is permitted"""
    slowest: list[float]
    """least velocities, alike"""
    separations: list[Separation]
    """empty where no separation is claimed"""


class Proof(Message, tag="proof", kw_only=True):
    """What was proved of the pair that decides a verdict; a checker needs nothing else."""

    stamp: float
    """of the joint state, [s] of the monitor's clock"""
    now: float
    """of the tick, [s] of the monitor's clock"""
    sequence: int
    """number of the tick"""
    level: str
    """of the verdict"""
    link: str
    """of the deciding pair"""
    obstacle: str
    """of the deciding pair"""
    q: list[float]
    """measured joint positions, [rad] or [m]"""
    v: list[float]
    """measured joint velocities, [rad/s] or [m/s]"""
    period: float
    """from a tick to the next one, [s]"""
    latency: float
    """from a tick until its verdict is obeyed, [s]"""
    reaction_time: float
    """from then until brakes bite, [s]"""
    margin: float
    """distance that counts as contact, [m]"""
    max_speed: float
    """how fast a surface may be that touches the obstacle, [m/s]; 0: it may not be touched"""
    arm: TrustedArm
    cover: TrustedCover
    states: list[ObstacleState]
    """of the obstacle; each of them may be true"""
    motions: list[ProvedMotion]

    def to_json(self) -> bytes:
        """The proof as a line of JSON, for `python -m armguard_check`."""
        return json.dumps(spell_numbers(msgspec.to_builtins(self))).encode()


def seal(part: TrustedArm | TrustedCover) -> None:
    """Fill the digest of what is taken on trust: the sha-256 of the rest of it, as JSON."""
    plain = spell_numbers(msgspec.to_builtins(part))
    del plain["digest"]
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
    part.digest = hashlib.sha256(text.encode()).hexdigest()


def spell_numbers(value: Any) -> Any:
    """Plain data with words in place of numbers that JSON has not."""
    if isinstance(value, dict):
        return {key: spell_numbers(one) for key, one in value.items()}
    if isinstance(value, list):
        return [spell_numbers(one) for one in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return "NaN" if value != value else ("Infinity" if value > 0.0 else "-Infinity")
    return value
