"""What reaches a monitor and its table without a message of the wire; recordings hold it too."""

from __future__ import annotations

from armguard.messages.incoming import Message


class StaticObstacle(Message, tag="static", kw_only=True):
    """An obstacle that stands still for ever, or an entrance."""

    id: str
    position: bytes
    """x, y, z of each point in [m], packed float64."""
    radius: float
    """[m]; of an entrance, with what it was widened by."""
    speed: float | None = None
    """Of what comes out of an entrance, in [m/s]; nothing else has one."""
    accel: float | None = None
    """Of what comes out of an entrance, in [m/s²]; nothing else has one."""


class TetherStated(Message, tag="tether", kw_only=True):
    """Two obstacles are tethered from now on, or by another length than before."""

    a: str
    b: str
    length: float
    """[m]."""
    source: str
    """Where the length comes from."""


class TetherEnded(Message, tag="untether", kw_only=True):
    """Two obstacles are not tethered any more."""

    a: str
    b: str


class MalformedCall(Message, tag="malformed_call", kw_only=True):
    """A call on the table of obstacles of which nothing could be taken."""

    source: str
    offender: str
    problem: str
    stamp: float
    """[s]; NaN where the call had none."""


class PromiseBroken(Message, tag="promise_broken", kw_only=True):
    """Another arm broke what was promised of it."""

    source: str
    """Name of the arm."""
    joint: str
    problem: str
    stamp: float
    """Of the joint state that shows it, in [s]."""


class DroppedPoints(Message, tag="dropped_points", kw_only=True):
    """How many points of a cloud could not be used, or none."""

    source: str
    stamp: float
    """Of the cloud, in [s]."""
    points: int
    dropped: int


class FaultsTaken(Message, tag="faults_taken"):
    """The application took the faults of obstacles, so the monitor does not report them."""


class Payload(Message, tag="payload", kw_only=True):
    """What the arm carries at most from the next step on."""

    payload: float
    """[kg]."""
