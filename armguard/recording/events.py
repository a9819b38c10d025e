"""Content of a recording: messages of the wire, and further events.

Stamps are in the monitor's time, and arrays are packed as on the wire. `json_form` says how
messages stand in the file.
"""

from __future__ import annotations

import msgspec

from armguard.messages.answers import PlanVerdictMessage, VerdictMessage
from armguard.messages.events import (
    DroppedPoints,
    FaultsTaken,
    MalformedCall,
    Payload,
    PromiseBroken,
    StaticObstacle,
    TetherEnded,
    TetherStated,
)
from armguard.messages.incoming import (
    IgnoreMessage,
    JointsMessage,
    Message,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    WatchMessage,
)
from armguard.messages.proof import Proof

FORMAT = 4
"""Format of recordings; a reader refuses other formats."""


class JointState(JointsMessage, tag="joints", kw_only=True):
    """A joint state, and when it was judged."""

    now: float
    """Time of the tick, in [s]."""


class MalformedState(Message, tag="malformed_state"):
    """Arguments of a step that are not arrays of numbers."""

    stamp: float
    """[s]."""
    subject: str
    """Which of them."""
    problem: str
    """The problem, and what was expected."""
    now: float
    """Time of the tick, in [s]."""


class MalformedPlan(Message, tag="malformed_plan"):
    """An argument of `commit` that is no readable plan."""

    subject: str
    """The plan, or one of its fields."""
    problem: str
    """The problem, and what was expected."""


class Link(msgspec.Struct):
    """A link of the arm."""

    name: str
    data: str = ""
    """As JSON: what `armguard.robot.portable.describe_bodies` says of it; empty: as before."""


class BodiesChanged(Message, tag="bodies", kw_only=True):
    """Something was attached to the arm, or taken off."""

    revision: int
    links: list[Link]


class Gap(Message, tag="gap", kw_only=True):
    """Messages that were lost here, because the writer process was too slow."""

    events: int
    seconds: float


class Time(msgspec.Struct):
    """A time as viewers of recordings have it."""

    sec: int
    nsec: int


class Log(msgspec.Struct, kw_only=True):
    """A line for people, such as one about a message that could not be used."""

    timestamp: Time
    level: int
    message: str
    name: str = "armguard"
    file: str = ""
    line: int = 0


Event = msgspec.Struct
"""A message of a recording."""

TOPICS: dict[type[Event], str] = {
    JointState: "joint_state",
    MalformedState: "malformed_states",
    ObstaclesMessage: "obstacles",
    StaticObstacle: "statics",
    RemoveMessage: "removals",
    MalformedCall: "malformed_calls",
    PromiseBroken: "broken_promises",
    DroppedPoints: "dropped_points",
    FaultsTaken: "faults_taken",
    Payload: "payload",
    IgnoreMessage: "ignored_pairs",
    WatchMessage: "watched_pairs",
    ResetMessage: "resets",
    PlanMessage: "plans",
    MalformedPlan: "malformed_plans",
    PlanVerdictMessage: "plan_verdicts",
    VerdictMessage: "verdict",
    Proof: "proofs",
    BodiesChanged: "bodies",
    Gap: "gaps",
    Log: "log",
    TetherStated: "tethers",
    TetherEnded: "ended_tethers",
}
"""Where each kind of message stands, below `PREFIX`."""

PREFIX = "/armguard/"

KINDS = tuple(TOPICS)

NUMBERS = {kind: number for number, kind in enumerate(KINDS)}
"""Places in `KINDS`."""


def schema_name(kind: type[Event]) -> str:
    """Name of the schema of a kind of message."""
    return "foxglove.Log" if kind is Log else f"armguard.{kind.__name__}"
