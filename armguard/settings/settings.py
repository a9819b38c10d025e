"""The settings of a monitor: each of them once, with its unit, default, meaning and range.

All else reads this record: the monitor's keywords, the tables of a cell file, recordings and the
changes of a replay, trials that choose settings, and the reference pages.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Literal

import msgspec
import pinocchio
from msgspec import Meta

from armguard.exceptions import ArmguardError
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.robot.robot import Robot
from armguard.settings.contact_limits import ContactLimits
from armguard.settings.declarations import NotNegative, Positive, check_fields
from armguard.settings.schedule import DEADLINE, Schedule, ScheduleName
from armguard.settings.separation_rule import SeparationRule

Threshold = Annotated[NotNegative, Meta(extra={"table": "thresholds"})]
OWN_PLACE = Meta(extra={"table": ""})
"""Of a setting that no table of a cell file simply repeats: it has a form of its own there."""

MOST_EVALUATIONS = 2**62
"""A budget that nothing exceeds."""


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of a `Monitor`.

    A monitor takes such a record, as `Monitor(robot, obstacles, settings)`, or the same names as
    keywords, as `Monitor(robot, obstacles, rate=500.0)`. A cell file states them in the tables
    `[monitor]`, `[thresholds]`, `[bounds]` and `[robot]`.

    Raises:
        ArmguardError: A value is of another kind, out of range, infinite or NaN, or two of them do
            not go together.
    """

    rate: Annotated[Positive, Meta(examples=[100.0, 200.0, 500.0, 2000.0])] = 1000.0
    """Ticks a second, in [Hz]."""
    schedule: ScheduleName | Schedule = "deadline"
    """What is evaluated in a tick: `"deadline"` (what falls due), `"full"` (everything) or `"daa"`
    (what the paper's schedule names as well). In Python also a `Schedule` of your own."""
    motion: Annotated[
        Literal["joint", "planned", "isotropic"], Meta(examples=["joint", "isotropic"])
    ] = "joint"
    """How the arm's possible motion is bounded: `"joint"` (by its joints' limits, and a STOP only
    where braking after the next tick could be too late), `"planned"` (the same, and the controller
    commits pieces of its path) or `"isotropic"` (points of the arm as free bodies: cheaper, and far
    more cautious)."""
    leave: Literal["never", "any"] = "never"
    """When joints may leave a committed piece and brake by themselves, as at an emergency stop or
    without power: `"never"`, or each at `"any"` moment. For `motion = "planned"` only: pieces are
    then proved safe for that too, and refused more often."""
    max_staleness: Annotated[
        float, Meta(ge=0.0, lt=1.0, examples=[0.0, 0.02, 0.05, 0.1, 0.25, 0.5])
    ] = 0.1
    """By which share an old answer may look shorter than a fresh one, below 1."""
    budget: Annotated[int, Meta(gt=0, examples=[16, 64, 256, 1024])] | None = None
    """Evaluations in a tick after which no further obstacle is begun; what misses its deadline is a
    STOP. Each question of the stop decision may spend as many; where they do not suffice, the
    answer is the cautious one, and a reason says so. For `schedule = "deadline"` only. Left out:
    no limit."""
    reaction_time: Threshold = 0.02
    """From a STOP to braking torque, in [s]."""
    latency: Threshold = 0.002
    """Time to compute and transport a verdict, including the lateness of a tick, in [s]."""
    slow_margin: Threshold = 0.1
    """SLOW if contact could come within this time after the stop time, in [s]."""
    aware_margin: Threshold = 0.3
    """AWARE if contact could come within this time after the stop time, in [s]."""
    rise_delay: Threshold = 0.3
    """How long a level is held after its last cause, after a reset as well, in [s]. A refused
    sample, which may be true, counts for as long."""
    scale_rise: Annotated[Positive, Meta(extra={"table": "thresholds"})] = 1.0
    """By how much the speed scale rises in a second, at most, in [1/s], so that an arm that follows
    it moves smoothly. It falls at once."""
    source_timeout: Threshold = 0.2
    """How long a source without a timeout of its own can be silent before the verdict is STOP, and
    how far its stamps may be ahead, in [s]."""
    joint_timeout: Threshold | None = None
    """Longest step between two joint states, oldest state that is believed, and longest time
    without a new stamp, in [s]. What is longer or older is a STOP until a reset. Left out: 0.1, or
    5 ticks if that is longer."""
    margin: Annotated[NotNegative, Meta(extra={"table": "bounds"})] = 0.0
    """Distance that counts as contact, in [m]."""
    payload: Annotated[NotNegative | None, Meta(extra={"table": "", "may_be_infinite": True})] = (
        None
    )
    """Greatest mass that the arm carries, tool included, in [kg]; it decides which entry of the
    brakes counts. Left out: the heaviest that they are stated for."""
    operating: Annotated[OperatingLimits | Literal["published"] | None, OWN_PLACE] = None
    """What the controller keeps to while the arm works, enforced by it and tested here at every
    joint state; `"published"`: what the robot's description has from published sources. Left out:
    the robot's limits."""
    base_placement: Annotated[pinocchio.SE3 | None, OWN_PLACE] = None
    """Placement of the robot's base in the world. Left out: at the origin."""
    ignore: Annotated[Iterable[Sequence[str]], OWN_PLACE] = ()
    """Pairs not to be watched, as (link, pattern of obstacle ids); "*" is any. A pattern that has
    fitted no obstacle yet is a STOP that names it. With a third element, the name of one of the
    obstacles' sources, only what that source reports is ignored, and may come later:
    ("panda_hand", "workpiece*", "camera")."""
    contact_limits: Annotated[ContactLimits | None, OWN_PLACE] = None
    """Which regions of a body a surface of the arm may touch, and at which speed; not with
    `motion = "isotropic"`. Left out: nothing may be touched while the arm moves."""
    separation: Annotated[SeparationRule | None, OWN_PLACE] = None
    """Attach to each verdict the margin of the speed-and-separation distance by this rule; it
    evaluates every pair in every tick."""
    certify: Annotated[bool, OWN_PLACE] = False
    """Attach to each verdict a certificate of the pair that decides it, by free bodies; takes a
    fraction of a millisecond a tick."""

    def __post_init__(self) -> None:
        check_fields(self)
        if isinstance(self.ignore, Iterator):
            # It gives its pairs once, and a record makes any number of monitors.
            msgspec.structs.force_setattr(self, "ignore", tuple(self.ignore))
        if self.leave != "never" and not self.with_plans:
            raise ArmguardError(
                "leave", f"is {self.leave!r}", expected='"never" unless motion="planned"'
            )
        if self.permits_contact and not self.with_joints:
            raise ArmguardError(
                "contact_limits",
                'are given beside motion="isotropic"',
                expected='motion="joint" or "planned"',
                remedy="free bodies may keep their speed for ever, so none is ever slow enough",
            )
        if self.budget is not None:
            if not self.by_deadline:
                raise ArmguardError(
                    "budget", "is given", expected='schedule="deadline", which alone keeps to one'
                )
            # More than compiled code can count is as good as no limit.
            msgspec.structs.force_setattr(self, "budget", min(self.budget, MOST_EVALUATIONS))

    @property
    def period(self) -> float:
        """Of ticks, in [s]."""
        return 1.0 / self.rate

    @property
    def response_time(self) -> float:
        """Until the verdict after the present one is obeyed, in [s]: period and latency."""
        return self.period + self.latency

    @property
    def braking_delay(self) -> float:
        """From a tick until its STOP brakes, in [s]: response time and reaction time."""
        return self.response_time + self.reaction_time

    @property
    def longest_joint_step(self) -> float:
        """What `joint_timeout` says, or its default for this rate, in [s]."""
        given = self.joint_timeout
        return max(0.1, 5.0 * self.period) if given is None else given

    @property
    def by_deadline(self) -> bool:
        """Whether obstacles are evaluated by their deadlines, rather than pairs by a schedule."""
        return isinstance(self.schedule, str) and self.schedule == DEADLINE

    @property
    def with_joints(self) -> bool:
        """Whether joint and braking bounds are used."""
        return self.motion != "isotropic"

    @property
    def with_plans(self) -> bool:
        """Whether the controller commits pieces of its path, and has them judged."""
        return self.motion == "planned"

    @property
    def permits_contact(self) -> bool:
        """Whether contact limits are stated."""
        return self.contact_limits is not None

    @property
    def has_operating(self) -> bool:
        """Whether operating limits are stated."""
        return self.operating is not None

    def put_in_force(self, robot: Robot) -> LimitsInForce:
        """What a robot's joints keep to while it works, and how they stop under its payload.

        Raises:
            ArmguardError: The operating limits do not fit the robot, or the payload its brakes.
        """
        return LimitsInForce(robot, self.operating, self.payload)

    @property
    def fresh_share(self) -> float:
        """What an answer is worth at least when it is as stale as it may look, of itself."""
        return 1.0 - self.max_staleness


_COMMIT = 'with motion="planned" the controller commits pieces that carry their own stop'
REMOVED = {
    "stop": _COMMIT,
    "path_deceleration": _COMMIT,
    "advances": "leave it out: an evaluation takes as many steps as it needs, up to 8",
}
"""Settings of earlier versions, and what replaces them."""

CHOSEN = ("motion", "max_staleness", "budget")
"""Settings that a trial chooses, unless they are given."""
