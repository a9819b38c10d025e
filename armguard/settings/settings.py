"""The settings of a monitor: each of them once, with its unit, default, meaning and range.

All else reads this record: the monitor's keywords, the tables of a cell file, recordings and the
changes of a replay, trials that choose settings, and the reference pages.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np
import pinocchio
from msgspec import Meta

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
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
    """Ticks per second, in [Hz]."""
    schedule: ScheduleName | Schedule = "deadline"
    """What a tick evaluates: what is due, all, or the paper's pairs too."""
    motion: Annotated[
        Literal["joint", "planned", "isotropic"], Meta(examples=["joint", "isotropic"])
    ] = "joint"
    """Motion bounds: joint limits; these and committed pieces; free points, far more cautious."""
    leave: Literal["never", "any"] = "never"
    """Whether joints can leave a committed piece and brake at any moment.
    Only with `motion = "planned"`."""
    max_staleness: Annotated[
        float, Meta(ge=0.0, lt=1.0, examples=[0.0, 0.02, 0.05, 0.1, 0.25, 0.5])
    ] = 0.1
    """Share by which an old contact time can be shorter than a new one."""
    budget: Annotated[int, Meta(gt=0, examples=[16, 64, 256, 1024])] | None = None
    """Evaluations per tick and per stop decision.
    Left out: no limit."""
    reaction_time: Threshold = 0.02
    """Time from a STOP to braking torque, in [s]."""
    latency: Threshold = 0.002
    """Time to compute and transport a verdict, tick lateness included, in [s]."""
    slow_margin: Threshold = 0.1
    """SLOW if contact is possible this soon after the stop time, in [s]."""
    aware_margin: Threshold = 0.3
    """AWARE if contact is possible this soon after the stop time, in [s]."""
    rise_delay: Threshold = 0.3
    """Time that a level is held after its last cause or a reset, and a refused sample counts, in
    [s]."""
    scale_rise: Annotated[Positive, Meta(extra={"table": "thresholds"})] = 1.0
    """Greatest rise of the speed scale, in [1/s]."""
    source_timeout: Threshold = 0.2
    """Default `timeout` of sources and greatest lead of their stamps, in [s]."""
    joint_timeout: Threshold | None = None
    """Longest step, age, or unchanged stamp of joint states, in [s]; beyond it STOP until a reset.
    Left out: 0.1, or 5 ticks if longer."""
    margin: Annotated[NotNegative, Meta(extra={"table": "bounds"})] = 0.0
    """Distance that counts as contact, in [m]."""
    payload: Annotated[NotNegative | None, Meta(extra={"table": "", "may_be_infinite": True})] = (
        None
    )
    """Greatest carried mass, tool included, in [kg]; it selects the entry of the brakes table. Left
    out: the heaviest entry."""
    operating: Annotated[OperatingLimits | Literal["published"] | None, OWN_PLACE] = None
    """Limits that the controller enforces while the arm works; armguard tests them at every joint
    state. `"published"`: those of the robot's description, from published sources. Left out: the
    robot's limits."""
    base_placement: Annotated[pinocchio.SE3 | None, OWN_PLACE] = None
    """Pose of the robot's base in the world. Left out: the identity."""
    ignore: Annotated[Iterable[Sequence[str]], OWN_PLACE] = ()
    """Unwatched pairs, as (link, pattern of obstacle ids); "*" matches any. A pattern that has
    matched no obstacle yet is a STOP that names it. A third element names a source: then only its
    obstacles are ignored, and they can come later, as in ("panda_hand", "workpiece*", "camera")."""
    contact_limits: Annotated[ContactLimits | None, OWN_PLACE] = None
    """Regions of the body that a surface of the arm may touch, and at which speed; not with `motion
    = "isotropic"`. Left out: nothing may be touched while the arm moves."""
    separation: Annotated[SeparationRule | None, OWN_PLACE] = None
    """Rule for the separation distance, whose margin each verdict then carries. It evaluates every
    pair in every tick."""
    certify: Annotated[bool, OWN_PLACE] = False
    """Whether each verdict carries a certificate of its deciding pair, for free bodies. It takes a
    fraction of a millisecond per tick."""

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

    def tabulate_contact_limits(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """As `ContactLimits.tabulate`; four empty arrays: no contact is permitted."""
        if self.contact_limits is None:
            return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0)
        return self.contact_limits.tabulate()

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
