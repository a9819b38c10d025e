"""Requests in messages, which the loop answers: plans, goals, wanted contact, resets."""

from __future__ import annotations

import dataclasses
import hmac
import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import (
    IgnoreMessage,
    MessageError,
    PlanMessage,
    ResetMessage,
    WatchMessage,
    to_rows,
    to_values,
)
from armguard.streams.goal_intake import GoalRequest
from armguard.streams.intake import Intake
from armguard.streams.joint_intake import JointOrder
from armguard.streams.stamp_clocks import HELD_UP, StampClock
from armguard.verdict import ResetVerdict


class PlanRequest(NamedTuple):
    """What a controller asks about its plan, in the order of the watched joints."""

    ask: Literal["commit", "share"]
    number: int
    """Of the plan, as its sender counts."""
    problem: str
    """What makes it unusable, in words; empty: nothing, and all below is there."""
    stamp: float = math.nan
    """When the arm is at the first sample, in [s] of the monitor's time."""
    times: NDArray[np.float64] = np.zeros(0)
    """Of the samples, in [s] from `stamp`. Shape (k,)."""
    q: NDArray[np.float64] = np.zeros((0, 0))
    """[rad] or [m]. Shape (k, nv)."""
    v: NDArray[np.float64] = np.zeros((0, 0))
    """[rad/s] or [m/s]. Shape (k, nv)."""
    tracking_error: NDArray[np.float64] = np.zeros(0)
    """[rad] or [m]. Shape (nv,)."""
    velocity_tracking_error: NDArray[np.float64] | None = None
    """[rad/s] or [m/s]. Shape (nv,); None where the sender does not say."""


class ExemptionRequest(NamedTuple):
    """What a sender asks about contact that it wants for the time being."""

    number: int
    """Of the exemption, as its sender counts."""
    is_end: bool
    """Whether it is to end; then nothing else is said."""
    link: str = ""
    """Name of a link; "*" is any."""
    ids: str = ""
    """Pattern of obstacle ids."""
    source: str | None = None
    """Whose obstacles alone are meant."""
    until: float | None = None
    """Until when, in [s] of the monitor's time, never too late; None: the zone decides."""
    zone: NDArray[np.float64] | None = None
    """Where, as corners in [m], shape (k, 3); None: anywhere."""


@dataclasses.dataclass
class Requests:
    """What was asked in the last drain."""

    plans: list[PlanRequest] = dataclasses.field(default_factory=list)
    """Plans, oldest first."""
    goals: list[GoalRequest] = dataclasses.field(default_factory=list)
    """What a shield was asked to do, oldest first."""
    exemptions: list[ExemptionRequest] = dataclasses.field(default_factory=list)
    """What was asked about contact that is wanted, oldest first."""
    reset_verdicts: list[tuple[int, ResetVerdict]] = dataclasses.field(default_factory=list)
    """Answers to the resets that want one, by number, oldest first."""
    is_reset: bool = False
    """Whether a reset with the right token came; the loop that obeys it sets it back."""

    def begin_drain(self) -> None:
        """Forget what was asked in the drain before; a reset that was not obeyed stays."""
        if self.plans or self.goals or self.exemptions or self.reset_verdicts:
            self.plans, self.goals, self.exemptions, self.reset_verdicts = [], [], [], []


class PlanReader:
    """Reads plans.

    Args:
        intake: Where faults are counted, and times.
        clock: How joint states are stamped, and so plans.
    """

    def __init__(self, intake: Intake, clock: StampClock) -> None:
        self._intake = intake
        # Joint states may be measured before their stamps; a plan says where the arm will be.
        self._clock = clock._replace(latency=0.0)

    def read(self, message: PlanMessage, joints: JointOrder) -> PlanRequest:
        """A plan in the order of an arm's joints; what cannot be read is said, and counted.

        Args:
            message: The plan.
            joints: Of the arm that it is about; unless it is shared, that is the watched one.
        """
        names, count = message.names, len(message.names)
        try:
            if message.ask != "share":
                self._intake.check_arm(message)
            order = joints.find(names)
            size = len(message.times)
            size = size // 8 if isinstance(message.times, bytes) else size
            times = to_values("times", message.times, size)
            q = to_rows("q", message.q, count, size)[:, order]
            v = to_rows("v", message.v, count, size)[:, order]
            fields = {"tracking_error": _read_errors(message, "tracking_error", order)}
            if message.velocity_tracking_error is not None:
                field = "velocity_tracking_error"
                fields[field] = _read_errors(message, field, order)
        except MessageError as error:
            self._intake.faults.add("malformed", "plans", message.number, str(error))
            return PlanRequest(message.ask, message.number, str(error))
        stamp, gap = self.translate(message.stamp)
        problem = ""
        if not gap <= HELD_UP:
            problem = self._intake.count_hold_up(gap, "plans", message.number)
        return PlanRequest(message.ask, message.number, problem, stamp, times, q, v, **fields)

    def translate(self, stamp: float) -> tuple[float, float]:
        """A time to come, which no latency has made old; as `StampTimes.translate`."""
        return self._intake.times.translate(stamp, self._clock)


def _read_errors(message: PlanMessage, field: str, order: NDArray[np.int64]) -> NDArray[np.float64]:
    """One tracking error a watched joint, whether there is one for all or one for each."""
    values, count = getattr(message, field), len(message.names)
    if isinstance(values, float):
        return np.full(len(order), values)
    return to_values(field, values, count)[order]


class TokenReader:
    """Takes resets and what is asked about contact that is wanted.

    Args:
        intake: Where faults are counted, and times.
        requests: Where it is noted what was asked.
        clock: How joint states are stamped.
        token: What a message must carry that asks for a reset, or for contact to be wanted; without
            one, none is obeyed.
    """

    def __init__(
        self,
        intake: Intake,
        requests: Requests,
        clock: StampClock,
        token: str | None,
    ) -> None:
        self._intake = intake
        self._requests = requests
        self._clock_error = clock.error
        # The end of an exemption is a time to come, which no latency has made old.
        self._clock = clock._replace(latency=0.0)
        self._token = token

    def take_exemption(self, message: IgnoreMessage) -> None:
        """Hand on what is asked; what cannot be read, or has no token, is counted."""
        faults, number = self._intake.faults, message.number
        if not self._is_token(message.token):
            problem = "token is not that of this run"
            faults.add("ignore refused", "exemptions", number, problem)
            return
        zone, until = None, message.until
        try:
            self._intake.check_arm(message)
            if message.zone is not None:
                zone = to_rows("zone", message.zone, 3, of="coordinates")
        except MessageError as error:
            faults.add("malformed", "exemptions", number, str(error))
            return
        if until is not None:
            until = self._intake.times.translate(until, self._clock)[0] - self._clock_error
        self._requests.exemptions.append(
            ExemptionRequest(
                number,
                is_end=False,
                link=message.link,
                ids=message.ids,
                source=message.source,
                until=until,
                zone=zone,
            )
        )

    def take_end(self, message: WatchMessage) -> None:
        """Hand on that an exemption is to end."""
        try:
            self._intake.check_arm(message)
        except MessageError as error:
            self._intake.faults.add("malformed", "exemptions", message.number, str(error))
            return
        self._requests.exemptions.append(ExemptionRequest(message.number, is_end=True))

    def take_reset(self, message: ResetMessage) -> None:
        """Hand on a reset that names the watched arm, and has the token of this run."""
        requests, problem = self._requests, "token is not that of this run"
        if self._token is None:
            problem = "this run was started without --reset-token, and refuses all resets"
        try:
            self._intake.check_arm(message)
            is_obeyed = self._is_token(message.token)
        except MessageError as error:
            is_obeyed, problem = False, str(error)
        if message.number is not None:
            verdict = ResetVerdict(is_obeyed, "" if is_obeyed else problem)
            requests.reset_verdicts.append((message.number, verdict))
        if not is_obeyed:
            self._intake.faults.add("reset refused", "unknown", None, problem)
            return
        requests.is_reset = True
        # A reset ends what was asked for a time, and is obeyed before all requests.
        requests.exemptions = [one for one in requests.exemptions if one.until is None]
        # Nor does an arm set off after it because of what was asked before.
        requests.goals = []

    def _is_token(self, token: str) -> bool:
        known = self._token
        return known is not None and hmac.compare_digest(token.encode(), known.encode())
