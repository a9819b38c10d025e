"""An arm that a shield moves beside one recorded person."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from armguard.bounds.planned.curve import evaluate_curve
from armguard.lab.simulation import JointTrajectory
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import OperatingLimits, Robot
from armguard.settings.contact_limits import ContactLimits
from armguard.shield import Command, MotionLimits, Path, Shield
from scene.clearance import Leaves
from scene.example_limits import PATTERNS_OF_REGIONS
from scene.recorded_people import NAMES, RADII, People, Stream
from scene.stop_rules import (
    LATENCY,
    TRACKING_ERROR,
    VELOCITY_TRACKING_ERROR,
    Setting,
    make_timing,
)
from scene.touches import Touch, TouchLog, find_speed_limits

LISTEN = 0.5
"""For which the arm rests at first, in [s]."""

SAMPLE = 0.02
"""Of the trajectory that the shield is told, in [s]."""

CLOSE_STEPS = 10
"""In which an arm that follows exactly is looked at from step to step."""

SHORTEST = 1e-4
"""Between samples of which a jerk is taken, in [s]: of closer ones it is rounding."""

SLOWEST = 1e-9
"""Of joints that move, in [rad]/[s]: what is slower is rounding."""

REVERSAL = 0.05
"""Of the fastest joint's speed limit: smaller changes of speed are none."""


class Following(NamedTuple):
    """How well an arm follows commands, as it is stated to a monitor."""

    latency: float
    """After which it follows one, at most, in [s]."""
    position: np.ndarray | float
    """How far joints are off it at most, in [rad]; one number, or shape (nv,)."""
    velocity: np.ndarray | float
    """Alike, in [rad]/[s]."""


EXACTLY = Following(LATENCY, TRACKING_ERROR, VELOCITY_TRACKING_ERROR)
"""What is stated of an arm that follows commands exactly."""


class Contact(NamedTuple):
    """A moving arm that touches a body."""

    body: str
    since: float
    """When it does so first, since the beginning of the recording, in [s]."""
    broken: str
    """Which premise was broken then or shortly before; empty: none."""


class Shielded(NamedTuple):
    """What became of a shield beside one recording."""

    ticks: int
    progress: float
    """Along its path, in [s] of the trajectory's own time."""
    progress_free: float
    """The same while no body is inside the arm's cover."""
    free: int
    """Ticks of such time."""
    rests: int
    """How often the arm came to rest before the end of its path."""
    rests_free: int
    """Those of them in such time."""
    hard_stops: int
    """How often it began its hardest stop while it moved."""
    reversals: int
    """How often it went over from speeding up to slowing down."""
    jerk: float
    """Greatest, as a share of its limit."""
    contacts: tuple[Contact, ...]
    """While it moved."""
    prices: np.ndarray
    """Of steps, in [s]. Shape (ticks,)."""
    touches: tuple[Touch, ...]
    """Of an arm with contact limits."""

    @property
    def missed(self) -> int:
        """How many contacts there were while all premises held."""
        return sum(not contact.broken for contact in self.contacts)

    @property
    def beyond(self) -> int:
        """How many other contacts there were."""
        return len(self.contacts) - self.missed


class Follower(Protocol):
    """An arm that follows commands, as well as it does."""

    looks: int
    """How often it is looked at in a step."""
    leaves: Leaves
    """Its cover, placed where it truly is."""
    state: tuple[np.ndarray, np.ndarray]
    """Where it truly is, and how fast, in [rad] and [rad]/[s]. Shape (nv,) each."""
    measured: tuple[np.ndarray, np.ndarray]
    """The same as its encoders have it."""
    moves: bool
    """Whether it does more than rest."""
    is_off: bool
    """Whether it is farther off its command than is stated."""

    def start(self, q: np.ndarray) -> None:
        """Rest somewhere, in [rad]. Shape (nv,)."""

    def take(self, command: Command, now: float) -> None:
        """Follow another command, which was answered at a time in [s]."""

    def advance(self, until: float) -> None:
        """Move on until a time in [s]."""

    def find_gaps(self, ends: np.ndarray) -> np.ndarray:
        """Distance from each body, 0 or less in contact, in [m]. Shape (bodies,).

        Args:
            ends: Of each body's axis, in [m]. Shape (bodies, 2, 3).
        """


class ExactArm:
    """Is where its command has it, and as large as its cover.

    Args:
        leaves: That cover.
    """

    looks = CLOSE_STEPS
    is_off = False

    def __init__(self, leaves: Leaves) -> None:
        self.leaves = leaves

    def start(self, q: np.ndarray) -> None:
        """Rest somewhere, in [rad]. Shape (nv,)."""
        self.state = q, np.zeros(len(q))

    def take(self, command: Command, now: float) -> None:
        """Follow another command."""
        self._command = command

    def advance(self, until: float) -> None:
        """Move on until a time in [s]."""
        self.state = place_at(self._command, until)
        self.leaves.place(*self.state)

    @property
    def measured(self) -> tuple[np.ndarray, np.ndarray]:
        """Where it is, and how fast, in [rad] and [rad]/[s]. Shape (nv,) each."""
        return self.state

    @property
    def moves(self) -> bool:
        """Whether a joint moves."""
        return bool(np.abs(self.state[1]).max() > SLOWEST)

    def find_gaps(self, ends: np.ndarray) -> np.ndarray:
        """Distance of its cover from each body, in [m]. Shape (bodies,)."""
        return self.leaves.gaps(ends, RADII)


class Mover(Protocol):
    """What moves an arm beside people, by their samples and its own joint states."""

    setting: Setting
    clean: bool
    limits: MotionLimits
    speed_limits: np.ndarray
    """How fast a surface may be that touches each body, in [m]/[s]. Shape (bodies,)."""

    @property
    def progress(self) -> float:
        """How far the arm has come on its path, of 1."""

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""

    def set_path(self, path: Path) -> None:
        """Follow a path from now on."""

    def listen(self, since: float) -> None:
        """Take what is seen of people until a time, in [s] since the recording began."""

    def step(self, since: float, q: np.ndarray, v: np.ndarray) -> Command:
        """The motion to follow from that time on."""


class ShieldMover:
    """A monitor and a shield, which serve one case after the other.

    Args:
        robot: The arm.
        setting: What it has to live with.
        period: Of its steps, in [s].
        operating: Limits of the arm's motion.
        jerk: Limit of it, in [rad]/[s³].
        look_ahead: In [s].
        contact_limits: What may be touched; None: nothing.
        following: How well the arm follows commands.
    """

    clean = True

    def __init__(
        self,
        robot: Robot,
        setting: Setting,
        period: float,
        operating: OperatingLimits,
        jerk: float,
        look_ahead: float,
        *,
        contact_limits: ContactLimits | None = None,
        following: Following = EXACTLY,
    ) -> None:
        self.setting = setting
        self.speed_limits = np.zeros(len(RADII))
        if contact_limits is not None:
            self.speed_limits = find_speed_limits(contact_limits, PATTERNS_OF_REGIONS)
        timing = make_timing(setting, period)
        self._table = Obstacles(regions=None if contact_limits is None else PATTERNS_OF_REGIONS)
        monitor = Monitor(
            robot,
            self._table,
            rate=1.0 / period,
            latency=following.latency,
            reaction_time=timing.reaction,
            motion="planned",
            operating=operating,
            contact_limits=contact_limits,
        )
        self._shield = Shield(
            monitor,
            jerk=jerk,
            rate=1.0 / period,
            look_ahead=look_ahead,
            tracking_error=following.position,
            velocity_tracking_error=following.velocity,
        )
        self.limits = self._shield.limits
        self.set_path = self._shield.set_path

    @property
    def progress(self) -> float:
        """How far the arm has come on its path, of 1."""
        return self._shield.progress

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""
        self._people, self._begin, self._sent = people, begin, 0
        self._stream = people.streams[self.setting.bounds, self.clean]
        self._table.remove([name for name in self._table.ids if name])
        self._shield.reset()

    def listen(self, since: float) -> None:
        """Take what is seen of people until a time, in [s] since the recording began."""
        shown = self._people.frame(since - self.setting.camera)
        while self._sent <= shown:
            self._stream.publish(self._table, self._sent, self._begin)
            self._sent += 1

    def step(self, since: float, q: np.ndarray, v: np.ndarray) -> Command:
        """The motion to follow from that time on."""
        return self._shield.step(self._begin + since, q, v)


def play(
    mover: Mover,
    arm: Follower,
    people: People,
    trajectory: JointTrajectory,
    period: float,
    begin: float,
    seconds: float,
    clock: Callable[[], float] = time.perf_counter,
) -> Shielded:
    """One case: the arm rests while it listens, and then follows its trajectory.

    Args:
        mover: What moves it.
        arm: That is moved.
        people: Who is beside it.
        trajectory: What it is asked to follow.
        period: Of steps, in [s].
        begin: Of the recording, on the mover's clock, in [s].
        seconds: How long it works at most.
        clock: By which steps are timed, in [s].
    """
    people.reset()
    mover.begin(people, begin)
    stream = people.streams[mover.setting.bounds, mover.clean]
    last = float(trajectory.stops[trajectory.stops <= trajectory.duration * (1.0 + 1e-9)][-1])
    times = np.linspace(0.0, last, math.ceil(last / SAMPLE) + 1)
    path = Path(np.array([trajectory.sample(one)[0] for one in times]), times)
    log = TouchLog(mover.speed_limits) if mover.speed_limits.any() else None
    touching = np.zeros(len(RADII), dtype=bool)
    arm.start(trajectory.sample(0.0)[0])
    before, was_at_rest, was_hard, heading = 0.0, True, False, 1.0
    counts = dict.fromkeys(("ticks", "free", "rests", "rests_free", "hard_stops"), 0)
    reversals = 0
    progress_free, extreme, jerk = 0.0, 0.0, 0.0
    contacts: list[Contact] = []
    prices = []
    duration = min((len(people.ends) - 1) / people.rate, seconds + LISTEN)
    for tick in range(int(duration / period)):
        since = tick * period
        if tick == round(LISTEN / period):
            mover.set_path(path)
        mover.listen(since)
        started = clock()
        command = mover.step(since, *arm.measured)
        prices.append(clock() - started)
        arm.take(command, begin + since)
        is_free = True
        for look in range(1, arm.looks + 1):
            at = since + look * period / arm.looks
            arm.advance(begin + at)
            people.advance(at, period / arm.looks, arm.leaves)
            _, v = arm.state
            moves = arm.moves
            frame, ends = people.frame(at), people.ends_at(at)
            is_free &= bool(arm.leaves.gaps(ends, RADII).min() > 0.0)
            inside = ~(arm.find_gaps(ends) > 0.0)
            for body in np.flatnonzero(inside & moves & ~touching).tolist():
                broken = _name_broken(arm, people, stream, frame, body)
                contacts.append(Contact(NAMES[body], at, broken))
            touching = inside & moves
            if log is not None:
                doubted = stream.broke[frame] | people.is_filled[frame]
                log.follow(at, period / arm.looks, arm.leaves, ends, doubted)
        if since < LISTEN:
            continue
        came = mover.progress * last
        rests = not moves and mover.progress < 1.0
        begins_hard = not command.is_new and not was_hard and moves
        counts["ticks"] += 1
        counts["free"] += is_free
        counts["rests"] += rests and not was_at_rest
        counts["rests_free"] += rests and not was_at_rest and is_free
        counts["hard_stops"] += begins_hard
        progress_free += (came - before) * is_free
        pace = float((np.abs(v) / mover.limits.velocity).max())
        if heading * (pace - extreme) > 0.0:
            extreme = pace
        elif abs(pace - extreme) > REVERSAL:
            reversals += heading > 0.0
            heading, extreme = -heading, pace
        lasting = np.diff(command.times)
        changes = np.abs(np.diff(command.a, axis=0))[lasting > SHORTEST]
        changes /= lasting[lasting > SHORTEST, None]
        jerk = max(jerk, float((changes / mover.limits.jerk).max(initial=0.0)))
        before, was_at_rest, was_hard = came, rests, not command.is_new
    return Shielded(
        counts["ticks"], before, progress_free, counts["free"], counts["rests"],
        counts["rests_free"], counts["hard_stops"], reversals, jerk, tuple(contacts),
        np.array(prices), () if log is None else log.touches,
    )  # fmt: skip


def _name_broken(arm: Follower, people: People, stream: Stream, frame: int, body: int) -> str:
    """Which premise was broken at a frame or shortly before; empty: none."""
    if arm.is_off:
        return "the arm was farther off its command than is stated"
    if people.is_filled[frame, body]:
        return "the body was hidden"
    return "the body had broken its bounds" if stream.broke[frame, body] else ""


def place_at(command: Command, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a command has the arm, as fast as a driver finds it."""
    begin = float(command.times[0])
    q, v = np.empty(command.q.shape[1]), np.empty(command.q.shape[1])
    evaluate_curve(command.times - begin, command.q, command.v, time - begin, q, v)
    return q, v
