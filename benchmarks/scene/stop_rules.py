"""Rules that say, tick by tick, whether an arm must stop: side by side, on the same states.

armguard's are monitors as users have them, each with its own settings and its own table; the
others are what they are measured against. Every rule is shown the same samples, as late as the same
camera sends them, and its STOP takes the same time to reach the brakes.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Iterable
from typing import Any, Literal, NamedTuple

import numpy as np

from armguard.bounds import Plan
from armguard.lab.simulation.recordings import MARKER_ERROR
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.settings.separation_rule import HUMAN_SPEED
from armguard.verdict import Effect, Level, Reason, ReasonKind
from scene.clearance import Leaves, is_separate
from scene.example_limits import PATTERNS_OF_REGIONS
from scene.recorded_people import RADII, People
from scene.tied_people import BONES, list_tethers
from scene.touches import find_speed_limits
from scene.working_arm import ACCELERATION_SHARE, Braking, WorkingArm

TRACKING_ERROR, VELOCITY_TRACKING_ERROR = 1e-3, 0.01
"""What the controller states that it may be off its plans by, in [rad] and [rad]/[s]."""
PIECE = 0.01
"""How long a piece lasts before its stop, in [s], or one tick where that is longer."""

LATENCY = 0.002
PERIOD = 0.005
"""Of the ticks that delays are stated for, in [s]; what a coarser grid takes, reaction gives."""


class Setting(NamedTuple):
    """What a rule has to live with."""

    reaction: float
    """From a STOP that has arrived to braking torque, in [s]."""
    camera: float
    """Age of a sample when it arrives, in [s]."""
    bounds: str
    """Name of the bounds on people."""


class Timing(NamedTuple):
    """What passes between a tick and braking torque, in [s]."""

    period: float
    latency: float
    reaction: float

    @property
    def delay(self) -> float:
        """From a verdict to braking torque."""
        return self.latency + self.reaction

    @property
    def response(self) -> float:
        """From a tick to braking torque, if only the next tick says STOP."""
        return self.period + self.delay


def make_timing(setting: Setting, period: float) -> Timing:
    """The same response for every grid: as with a tick of `PERIOD`."""
    return Timing(period, LATENCY, setting.reaction + PERIOD - period)


class Moment(NamedTuple):
    """What rules judge in a tick."""

    now: float
    """On the clock of all rules, in [s]."""
    since: float
    """From the beginning of the recording, in [s]."""
    arm: WorkingArm
    leaves: Leaves
    """Of that arm, placed."""
    gaps: np.ndarray
    """Its real distance from each body, in [m]. Shape (bodies,)."""
    people: People
    counts: bool
    """Whether the arm may set off, and what is said counts; else it rests."""


class Rule:
    """What says whether an arm may go on.

    Args:
        robot: The arm.
        setting: What the rule has to live with.
        period: Of its ticks, in [s].
        name: For tables.
        payload: Of the arm, in [kg]; None: the heaviest that its brakes are stated for.
        clean: Whether it is shown clean data.

    Attributes:
        delay: From its STOP to deceleration, in [s].
        brakes: What the arm's guarantee under that payload.
        holds: Whether its STOPs last until it believes that they are over.
        goes_at_once: Whether an arm that obeys goes on as soon as it may.
        has_scale: Whether it says how fast the arm may go on.
        speed_limit: What joints are to keep to by its last judgement that let the arm go on, in
            [rad]/[s]: a STOP is for the brakes, and takes as long for whoever obeys. Shape (nv,).
        price: Time that the last judgement took, in [s].
        limits: How fast a surface may be that touches each body, in [m]/[s], shape (bodies,); None:
            nothing may be touched.
        cause: Why the last STOP of a monitor began, in short; else empty.
    """

    holds = goes_at_once = has_scale = False
    limits: np.ndarray | None = None
    cause = ""

    def __init__(
        self,
        robot: Robot,
        setting: Setting,
        period: float,
        name: str,
        *,
        payload: float | None = None,
        clean: bool = True,
    ) -> None:
        self.robot, self.setting, self.name, self.clean = robot, setting, name, clean
        self.timing = make_timing(setting, period)
        self.delay = self.timing.delay
        self.brakes = Braking(robot, payload)
        self.speed_limit: np.ndarray | float = np.inf
        self.price = 0.0

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""

    def judge(self, moment: Moment) -> bool:
        """Whether the arm may go on."""
        raise NotImplementedError


class Oracle(Rule):
    """Knows what the person will do, and stops only for what would really happen.

    It says STOP where an arm that goes on until the next tick's STOP takes effect, and brakes then,
    would touch the person before it rests. `touched` is the body, and when in [s] from the tick.
    """

    touched: tuple[int, float] | None = None

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._leaves = Leaves(self.robot)
        self._gain = ACCELERATION_SHARE * self.robot.acceleration_limit * self.timing.response

    def judge(self, moment: Moment) -> bool:
        """Whether the arm may go on."""
        begin = time.perf_counter()
        self.touched = None
        arm, people, response = moment.arm, moment.people, self.timing.response
        fastest = np.abs(arm.v) + self._gain
        closing = people.pace[people.frame(moment.since)] + float(self._leaves.reach @ fastest)
        lasting = response + float(self.brakes.lasting(fastest).max())
        gaps, spent = moment.gaps, 0.0
        if not gaps.min() > closing * lasting:
            arm = copy.copy(arm)
            arm.brakes = self.brakes
            while True:
                if not arm.rests and gaps.min() <= 0.0:
                    self.touched = int(gaps.argmin()), spent
                    break
                going = spent < response - 1e-9
                if arm.rests and not going:
                    break
                # Nothing can happen before both have come so far.
                step = max(float(gaps.min()) / closing, 0.005)
                if going:
                    step = min(step, response - spent)
                arm.step(step, going)
                spent += step
                self._leaves.place(arm.q, arm.v)
                gaps = self._leaves.gaps(people.ends_at(moment.since + spent), RADII)
        self.price = time.perf_counter() - begin
        return self.touched is None


class Separation(Rule):
    """The protective separation distance at its honest best.

    A person walks at 1.6 m/s, and no intrusion distance is added; each sphere moves at its
    measured speed towards the nearest point of the body, and brakes at a constant rate for as long
    as the slowest of the joints that move it takes from its measured speed. Encoders are exact.
    """

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""
        self._sent = people.streams[self.setting.bounds, self.clean].sent
        self._bodies = np.arange(len(RADII))

    def _finds(self, frames: np.ndarray, shown: int) -> np.ndarray:
        """Of which bodies it knows something: those last seen in `frames`. Shape (bodies,)."""
        return frames >= 0

    def judge(self, moment: Moment) -> bool:
        """Whether the arm may go on."""
        begin = time.perf_counter()
        people, leaves, timing = moment.people, moment.leaves, self.timing
        shown = people.frame(moment.since - self.setting.camera)
        frames = self._sent[shown]
        found = self._finds(frames, shown)
        ages = np.where(found, moment.since - frames / people.rate, np.inf)
        lasting = self.brakes.lasting(moment.arm.v)
        stopping = np.where(leaves.moves, lasting, 0.0).max(axis=1)
        apart: bool = is_separate(
            leaves.centers, leaves.velocities, leaves.radius, leaves.link, stopping,
            people.seen[frames, self._bodies], RADII, ages, timing.response, HUMAN_SPEED,
            MARKER_ERROR,
        )  # fmt: skip
        self.price = time.perf_counter() - begin
        return apart


class ForgetfulSeparation(Separation):
    """The same of the bodies in the newest frame alone: what is hidden is not there."""

    def _finds(self, frames: np.ndarray, shown: int) -> np.ndarray:
        return frames == shown


class MonitorRule(Rule):
    """A monitor, whatever its STOP is for.

    Args:
        tied: How the person's bodies are tied to each other: not at all, by the lengths of anybody,
            or by lengths that were measured.
        options: Settings of the monitor beside its delays.
    """

    holds = has_scale = True

    def __init__(
        self,
        robot: Robot,
        setting: Setting,
        period: float,
        name: str,
        *,
        payload: float | None = None,
        clean: bool = True,
        tied: Literal["", "anybody", "measured"] = "",
        **options: Any,
    ) -> None:
        super().__init__(robot, setting, period, name, payload=payload, clean=clean)
        self._tied = tied
        contact_limits = options.get("contact_limits")
        if contact_limits is not None:
            self.limits = find_speed_limits(contact_limits, PATTERNS_OF_REGIONS)
        self._table = Obstacles(regions=None if self.limits is None else PATTERNS_OF_REGIONS)
        self.monitor = Monitor(
            robot,
            self._table,
            rate=1.0 / period,
            latency=self.timing.latency,
            reaction_time=self.timing.reaction,
            payload=payload,
            **options,
        )
        operating = options.get("operating")
        speeds = robot.velocity_limit if operating is None else operating.resolve(robot)[0]
        self._speeds = speeds  # whose share a speed scale is
        self._next, self._begin = 0, 0.0

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""
        self._stream = people.streams[self.setting.bounds, self.clean]
        self._table.remove([name for name in self._table.ids if name])
        if self._tied:
            self._stream = people.jointed[self.setting.bounds]
            for a, b, length in list_tethers(people.bones if self._tied == "measured" else BONES):
                self._table.tether(f"person/{a}", f"person/{b}", length, self._tied)
        self.monitor.reset()
        self._next, self._begin = 0, begin
        self.speed_limit, self.cause = np.inf, HELD

    def judge(self, moment: Moment) -> bool:
        """Whether the arm may go on."""
        shown = moment.people.frame(moment.since - self.setting.camera)
        while self._next <= shown:
            self._stream.publish(self._table, self._next, self._begin)
            self._next += 1
        begin = time.perf_counter()
        safe = self._judge(moment)
        self.price = time.perf_counter() - begin
        return safe

    def _judge(self, moment: Moment) -> bool:
        self.verdict = self.monitor.step(moment.now, *moment.arm.measured)
        if self.verdict.level is Level.STOP:
            self._note_cause(self.verdict.reasons)
            return False
        self.speed_limit = self.verdict.speed_scale * self._speeds
        return True

    def _note_cause(self, reasons: Iterable[Reason]) -> None:
        """Say why this is a STOP; of data as they come, what is wrong with them."""
        if self.clean:
            self.cause = find_cause(reasons)
        elif not any(reason.kind is ReasonKind.HOLD for reason in reasons):
            self.cause = find_fault(reasons)


class ContactTimeRule(MonitorRule):
    """A monitor's contact time against the time in which any arm rests: no braking is looked at."""

    holds = has_scale = False

    def _judge(self, moment: Moment) -> bool:
        super()._judge(moment)
        verdict = self.verdict
        return verdict.complete and verdict.contact_time > verdict.stop_time


class PieceRule(MonitorRule):
    """A monitor that is shown the next piece of the way, with a stop at its end, again and again.

    A piece lasts until the answer to the next one has arrived, and stops as hard as brakes
    guarantee. An arm that obeys is on it when no other is found safe, so that no reaction time
    enters. It goes on with the first piece that is safe: what is proposed must be done.
    """

    holds = has_scale = False
    goes_at_once = True

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.delay = self.timing.latency

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""
        super().begin(people, begin)
        self._until = -math.inf

    def _judge(self, moment: Moment) -> bool:
        arm, now, timing = moment.arm, moment.now, self.timing
        self.verdict = self.monitor.step(now, *arm.measured)
        if not moment.counts or (arm.braking and not arm.rests):
            self._until = -math.inf
            return not moment.counts
        kinds = {reason.kind for reason in self.verdict.reasons}
        broken_off = {ReasonKind.PLAN_VOID, ReasonKind.PIECE_UNSAFE}
        # Where the arm touches somebody as is permitted, it runs its piece to the end.
        kinds.discard(ReasonKind.IN_CONTACT)
        if kinds & broken_off or any(kind.effect is Effect.STANDING for kind in kinds):
            self._until = -math.inf
        left = self._until - now - timing.latency
        if left > timing.period + 1e-9:
            return True
        ticks = max(1, round(PIECE / timing.period))
        times = np.linspace(0.0, ticks * timing.period + timing.latency, ticks + 2)
        piece = self.monitor.with_stop(make_plan(now, times, *arm.preview(times)))
        answer = self.monitor.commit(piece)
        if answer.safe:
            self._until = now + float(times[-1])
            return True
        self.cause = find_cause(answer.reasons)
        return left > 1e-9


HELD = "held"
"""The cause of a STOP that lasts although nothing calls for it any more."""


PAIR_KINDS = ReasonKind.CONTACT, ReasonKind.CONTACT_FORBIDDEN, ReasonKind.PLAN_UNSAFE
"""Of reasons whose subjects name a link and an obstacle."""


def find_cause(reasons: Iterable[Reason]) -> str:
    """Why an arm has to stop, in short: the obstacle that could be touched, or what else it is."""
    for reason in reasons:
        if reason.kind is ReasonKind.HOLD:
            return HELD
        if reason.kind in PAIR_KINDS:
            return reason.subject.rpartition(" and ")[2]
        if reason.subject == "last step":
            return reason.detail.removeprefix("was a STOP: ").partition(":")[0]
        return reason.kind.text
    return "unknown"


FAULT_KINDS = (
    ReasonKind.WIDENED_BOUNDS,
    ReasonKind.REFUSED_ALTERNATIVE,
    ReasonKind.HIDDEN,
    ReasonKind.LATE_DATA,
    ReasonKind.LATE_DATA_UNKNOWN,
)
PLAIN = "plain"
FAULTS = (*(kind.text for kind in FAULT_KINDS), PLAIN)
"""What a STOP can rest on where data are as they come; plain: on none of these faults."""


def find_fault(reasons: Iterable[Reason]) -> str:
    """Which fault of the data a STOP rests on: the first of `FAULTS` that is named."""
    kinds = {reason.kind for reason in reasons}
    return next((kind.text for kind in FAULT_KINDS if kind in kinds), PLAIN)


def make_plan(stamp: float, times: np.ndarray, q: np.ndarray, v: np.ndarray) -> Plan:
    """A plan of samples, as closely followed as the arm here says that it is."""
    errors = np.full((2, q.shape[1]), TRACKING_ERROR)
    errors[1] = VELOCITY_TRACKING_ERROR
    return Plan(stamp, times, q, v, *errors)
