"""The edge: messages from outside, checked once, become obstacle rows and a joint state.

Nothing raises here and nothing is lost silently: whatever is wrong is counted with its source,
number, field and value, and what can still be used is passed on. Rows that only the obstacle
table can judge (implausible, negative, not finite) are its business and lead to its faults, so
that the verdict knows of them; the edge names their values.

Sources stamp with clocks of their own; here all times become the monitor's.
"""

from __future__ import annotations

import hmac
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.clock import Clock
from armguard.exceptions import ArmguardError
from armguard.messages.incoming import (
    AnyMessage,
    CloudMessage,
    Header,
    IgnoreMessage,
    JointsMessage,
    MessageError,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    WatchMessage,
    count_points,
    decode,
    read_header,
    to_cloud,
    to_mask,
    to_points,
    to_rows,
    to_values,
)
from armguard.obstacles.clouds import VoxelCountError
from armguard.obstacles.obstacles import Obstacles
from armguard.streams.authentication import Authenticator, Right, SenderError
from armguard.streams.faults import FaultLog
from armguard.streams.inputs import BYTE_LIMIT, Input, SocketInput
from armguard.streams.limits import LimitError, MessageAllowance, SourceCountError, SourceLimits
from armguard.verdict import ResetVerdict

_MESSAGES_A_DRAIN = 64
"""Most messages taken from one input in one tick; the rest wait for the next."""

DRAIN_TIME = 5e-3
"""How long taking messages may last in one tick where nothing else is said, in [s]."""

_PAST_STATES = 1000
"""Joint states that are kept for clouds: of the last second, or somewhat more."""

_SOURCES = 256
"""Most sources known at once, so that made-up names cannot fill the memory."""

USUAL_LIMITS = SourceLimits()

_NANOSECOND = 1e-9

HELD_UP = 50e-6
"""Two clocks are compared anew if that took longer, in [s]; usually it takes a few hundred ns."""

_COMPARISONS = 8
"""How often two clocks are compared at most, before the best comparison must do."""

_SUMMED_AT_ONCE = 10_000
"""Most numbers whose products BLAS sums up in the thread that asks. More it shares out among other
threads, and where further processes keep the processors busy, the loop would wait for those."""

_OF_SOURCES = ObstaclesMessage | CloudMessage | RemoveMessage
"""Messages that say whose they are."""

_OF_ARMS = JointsMessage | PlanMessage | IgnoreMessage | WatchMessage
"""Messages that say which arm they are about, where there are several, and whose sender must be one
that speaks for it. A reset names an arm, too; who may send one has a right of its own."""

_FIELDS = (
    "position",
    "velocity",
    "radius",
    "accel",
    "speed",
    "position_error",
    "velocity_error",
)


class StampClock(NamedTuple):
    """Which clock a source stamps with, and how old its measurements are by then."""

    clock: Literal["monotonic", "unix", "arrival"] = "monotonic"
    latency: float = 0.0
    """From measurement to stamp in [s]; for `arrival`, at most, from measurement to arrival."""
    error: float = 0.0
    """What stamps may be off by, either way, in [s]. Obstacles are widened by it; of joint states
    it has to be in the robot's joint errors already."""


MONOTONIC = StampClock()


class OwnPoints(NamedTuple):
    """How points of clouds that are the arm's are told from others."""

    find_others: Callable[[NDArray[np.float64], NDArray[np.float64], str], NDArray[np.bool_]]
    """Which of some points of shape (n, 3), in [m], are not the arm's; given its joint positions,
    in the order of the watched joints, and the name of the points' frame."""
    time_error: float
    """How far apart in time joint state and cloud may be for that, in [s]."""


class JointState(NamedTuple):
    """The arm's state in the order of the watched joints, stamped in the monitor's time."""

    stamp: float
    q: NDArray[np.float64]
    v: NDArray[np.float64]


class OtherArm(NamedTuple):
    """Another arm of the cell, which is an obstacle of the watched one."""

    joints: Sequence[str]
    """Names of its joints, in the order that `publish` takes."""
    publish: Callable[[float, NDArray[np.float64], NDArray[np.float64]], None]
    """Tells the table of obstacles a stamp, in [s], with positions and velocities, each (nv,)."""
    take_plan: Callable[[PlanRequest, float, float], None]
    """Takes a plan that it promises to keep to, until when, in [s] of the monitor's time, and what
    its clock may be off by, in [s]."""


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


class Edge:
    """Takes messages from inputs and hands what they say to the obstacle table.

    Args:
        obstacles: The table.
        joints: Names of the watched joints, in the order of `q` and `v`.
        clock: The monitor's clock.
        faults: Where faults are counted.
        stamp_clocks: How sources stamp; those not named here, with the monotonic clock.
        joint_clock: How joint states are stamped; not by arrival.
        joint_timeout: At the start, joint states older than this, in [s], are dropped: a sender
            that was there before hands over what has waited.
        speed: Speed bound of obstacles that bring none and that no pattern of the table's fits, in
            [m/s]; for sources without a clock.
        accel: Acceleration bound of obstacles that bring none and that no pattern of the table's
            fits, in [m/s²]; for sources without a clock.
        reset_token: What a message must carry that asks for a reset, or for contact to be wanted;
            without one, none is obeyed.
        limits: How much sources may send; those not named here, as `SourceLimits` has it.
        own_points: How points that are the arm's are told from others; None: no clouds are taken.
        drain_time: How long a drain may last, in [s], in equal parts for its inputs. One message
            of each is taken whatever it takes, and the one at which the time ends is finished.
        arm: Name of the watched arm, where a cell has several: then joint states, plans, requests
            that contact be wanted and their ends, and resets have to say whose they are.
        others: By name, the other arms of the cell; their joint states are stamped as its own.
        monotonic: Reads the clock of `monotonic` stamps, in [s].
        unix: Reads the clock of `unix` stamps, in [s].
    """

    def __init__(
        self,
        obstacles: Obstacles,
        joints: Sequence[str],
        clock: Clock,
        faults: FaultLog,
        *,
        stamp_clocks: Mapping[str, StampClock] | None = None,
        joint_clock: StampClock = MONOTONIC,
        joint_timeout: float = math.inf,
        speed: float = math.inf,
        accel: float = math.inf,
        reset_token: str | None = None,
        limits: Mapping[str, SourceLimits] | None = None,
        own_points: OwnPoints | None = None,
        drain_time: float = DRAIN_TIME,
        arm: str = "",
        others: Mapping[str, OtherArm] | None = None,
        monotonic: Callable[[], float] = time.monotonic,
        unix: Callable[[], float] = time.time,
    ) -> None:
        self.faults = faults
        self.received = 0
        """Messages taken, good and bad."""
        self.cut_short = 0
        """How often an input was left before it was found empty; the rest waited for a tick."""
        self.joint_state: JointState | None = None
        """The newest joint state that could be read; None before the first that is fresh."""
        self.dropped_age = math.nan
        """How old the last joint state was that was dropped as a backlog, in [s]; nan: none was."""
        self.plans: list[PlanRequest] = []
        """Plans that came in the last drain, oldest first."""
        self.exemptions: list[ExemptionRequest] = []
        """What was asked in the last drain about contact that is wanted, oldest first."""
        self.reset_requested = False
        """Whether a reset with the right token came; the loop that obeys it sets it back."""
        self.reset_verdicts: list[tuple[int, ResetVerdict]] = []
        """Answers to the resets of the last drain that want one, by number, oldest first."""
        start, machine, gap = _compare(clock, monotonic, 0.0)
        self.offset = machine - start
        """Machine's monotonic clock minus the monitor's, in [s]; never too small."""
        # Of one process's own clock the closest of many tries is off by the reading itself.
        self.offset_error = gap if gap > HELD_UP else 0.0
        """What `offset` is too large by, in [s], where the process was held up at every try."""
        self._obstacles = obstacles
        self._joints = JointOrder(joints)
        self._arm = arm
        self._others = dict(others or {})
        self._other_orders = {name: JointOrder(one.joints) for name, one in self._others.items()}
        self._other_watches = {name: SequenceWatch() for name in self._others}
        self._clock = clock
        self._unix = unix
        self._stamp_clocks = dict(stamp_clocks or {})
        self._joint_clock = joint_clock
        self._clock_difference = joint_clock.error + HELD_UP
        self._speed = speed
        self._accel = accel
        self._reset_token = reset_token
        self._limits = dict(limits or {})
        self._own_points = own_points
        self._past: deque[JointState] = deque(maxlen=_PAST_STATES)
        if own_points is not None:
            obstacles.prepare_clouds()
        self._drain_time = drain_time
        self._accounts: dict[str, SourceAccount] = {}
        self._joint_watch = SequenceWatch()
        self._start = start
        self._emptied: dict[Input, float] = {}
        self._arrived_after = start
        self._now = start
        self._keeps_joint_state = False
        self._joint_timeout = joint_timeout
        self._newest: JointState | None = None
        self._awaits_fresh = True
        self._has_joints = False

    def drain(self, inputs: Sequence[Input]) -> float:
        """Take what has arrived, up to a bound on the work of one tick; never blocks or raises.

        The bound of each input is a number of messages, their length and its part of the time.

        Inputs must be opened after the edge is made: arrival is counted from then on.

        Returns:
            When this ended, in [s] of the monitor's clock; at the start, the joint state is fresh
            at this time.
        """
        is_emptied = False
        now = self._now = self._clock.now()
        self._keeps_joint_state = False
        self.plans = []
        self.exemptions = []
        self.reset_verdicts = []
        self._admit_clients(inputs)
        for source in inputs:
            # Whatever is taken now arrived since this input was last found empty.
            self._arrived_after = self._emptied.get(source, self._start)
            size = 0
            until = now + self._drain_time / len(inputs)
            self._has_joints = False
            for _ in range(_MESSAGES_A_DRAIN):
                try:
                    data = source.receive()
                    if data is None:
                        self._arrived_after = self._now
                        is_emptied = is_emptied or self._has_joints
                        break
                    self.received += 1
                    size += len(data)
                    self._read(data, source)
                except MessageError as error:
                    # What a message says of itself may be wrong; its key is not.
                    sender = source.sender if isinstance(source, SocketInput) else None
                    self.faults.add(error.kind, sender or error.source, error.sequence, str(error))
                now = self._clock.now()
                if size > BYTE_LIMIT or not now < until:
                    self.cut_short += 1
                    break
            else:
                self.cut_short += 1
            self._emptied[source] = self._arrived_after
        now = self._clock.now()
        self._settle_joint_state(now, is_emptied=is_emptied)
        return now

    def _admit_clients(self, inputs: Iterable[Input]) -> None:
        """Let in who asks for it and may be, a few a tick, and count who may not."""
        for source in inputs:
            if isinstance(source, SocketInput) and (ended := source.limit_connections()):
                problem = "has as many connections as may be; one too many was ended"
                self.faults.add("connections", source.address, None, problem, ended)
        guarded = (source.authenticator for source in inputs if isinstance(source, SocketInput))
        # The inputs of a run have one authenticator, which answers once for all of them.
        for authenticator in {one for one in guarded if one is not None}:
            authenticator.answer()
            for error, times in authenticator.take_refused():
                self.faults.add(error.kind, error.source, None, str(error), times)

    def _read(self, data: bytes, source: Input) -> None:
        """Take one message if its sender may send it; raise MessageError if not."""
        sender, authenticator = None, None
        if isinstance(source, SocketInput):
            sender, authenticator = source.sender, source.authenticator
        self._check_limits(data, sender, authenticator)
        message = decode(data)
        if authenticator is not None:
            self._check_sender(message, sender, authenticator)
        self._take(message)

    def _settle_joint_state(self, now: float, *, is_emptied: bool) -> None:
        """Decide whether the newest joint state is one to go by, or part of a backlog.

        Args:
            now: The present, in [s].
            is_emptied: Whether joint states came in this drain, and nothing waits behind them. In
                the middle of a backlog a first one would leave a gap to the next.
        """
        newest = self._newest
        # What is not finite is no backlog: the monitor refuses it by its name.
        is_stale = newest is not None and now - newest.stamp > self._joint_timeout
        if self.reset_requested and is_stale:
            # The monitor would refuse this state right after its reset; the next one begins anew.
            self._awaits_fresh, self._newest = True, None
        elif self._awaits_fresh and is_emptied and newest is not None:
            if is_stale:
                self._drop(newest.stamp, now, None)
                self._newest = None
            else:
                self._awaits_fresh = False
        self.joint_state = None if self._awaits_fresh else self._newest

    def _drop(self, stamp: float, now: float, sequence: int | None) -> None:
        """Count a joint state that waited for the start, or was sent late, in [s]."""
        self.dropped_age = now - stamp
        problem = (
            f"joint state is {self.dropped_age:.3g} s old, expected at most "
            f"{self._joint_timeout:.3g} s; dropped until one is fresh"
        )
        self.faults.add("backlog", "joints", sequence, problem)

    def _check_sender(
        self, message: AnyMessage, sender: str | None, authenticator: Authenticator
    ) -> None:
        """Raise SenderError if the key of a message's sender does not entitle to send it.

        Args:
            message: What was sent.
            sender: Client whose key it came with.
            authenticator: Knows what clients may do.
        """
        right: Right = "joints"
        if isinstance(message, _OF_SOURCES):
            right = "obstacles"
        elif isinstance(message, ResetMessage):
            right = "reset"
        if sender is None or not authenticator.may(sender, right):
            found = f"one of {sender!r}, which may not send {right}"
            raise SenderError(
                "message", found, f"a client that may: {right!r}", sender or "unknown"
            )
        if isinstance(message, _OF_ARMS) and not authenticator.may_speak_for(sender, message.arm):
            found = f"{message.arm!r} in a message with the key of {sender!r}"
            raise SenderError("arm", found, f"one of the arms of {sender!r}", sender)
        if isinstance(message, _OF_SOURCES) and message.source != sender:
            found = f"{message.source!r} in a message with the key of {sender!r}"
            error = SenderError("source", found, repr(sender), sender, message.seq)
            self._tell_verdict(error)
            raise error

    def _check_limits(
        self, data: bytes, sender: str | None, authenticator: Authenticator | None
    ) -> None:
        """Raise LimitError if a message takes its source beyond its size or rate.

        That is known before it is decoded, so that what is refused costs next to nothing.

        Args:
            data: What was sent.
            sender: Client whose key it came with; None where there are no keys.
            authenticator: Knows what clients may do; None: there are no keys.
        """
        size = len(data)
        if authenticator is None:
            header = read_header(data)
        elif sender is None or not authenticator.may(sender, "obstacles"):
            return
        elif not authenticator.may(sender, "joints") and size > self._limit(sender).message_size:
            # Too long, whatever it says: it need not be read at all.
            header = Header("obstacles", sender)
        else:
            header = read_header(data)
        if header is None or header.type not in ("obstacles", "cloud", "remove"):
            return
        source = sender or header.source
        limits = self._limit(source)
        account = self._find_account(source, header.seq)
        if not account.allowance.take(self._now):
            found = "one more than a second may bring"
            expected = f"max_message_rate, {limits.message_rate:g} a second at most"
        elif size > limits.message_size:
            found = f"{size} bytes long"
            expected = f"max_message_size, {limits.message_size} at most"
        else:
            return
        if header.source == source:
            # It was refused, and is not lost.
            self._follow(account.watch, source, header.seq)
        error = LimitError("message", found, expected, source, header.seq)
        self._tell_verdict(error)
        raise error

    def _check_obstacles(self, message: ObstaclesMessage) -> None:
        """Raise LimitError if a message takes its source beyond its number of obstacles."""
        limits = self._limit(message.source)
        count = self._count_obstacles(message, limits.obstacles)
        if count > limits.obstacles:
            found = f"one by which {message.source!r} has {count} obstacles"
            expected = f"max_obstacles, {limits.obstacles} at most"
            error = LimitError("message", found, expected, message.source, message.seq)
            self._tell_verdict(error)
            raise error

    def _check_cloud(self, message: CloudMessage) -> None:
        """Raise LimitError if a cloud has too many points, or none is taken here.

        How many voxels it makes is not known yet: the table counts them before it takes any.
        """
        source, limits = message.source, self._limit(message.source)
        points = count_points(message.points)
        if self._own_points is None:
            found, expected = "a cloud", "obstacles: [clouds] in the cell file lets clouds be taken"
        elif points > limits.points:
            found, expected = f"one of {points} points", f"max_points, {limits.points} at most"
        else:
            return
        error = LimitError("message", found, expected, source, message.seq)
        self._tell_verdict(error)
        raise error

    def _limit(self, source: str) -> SourceLimits:
        """How much a source may send."""
        return self._limits.get(source, USUAL_LIMITS)

    def _find_account(self, source: str, sequence: int | None) -> SourceAccount:
        """What is kept of a source; raises SourceCountError for one too many."""
        account = self._accounts.get(source)
        if account is None:
            if len(self._accounts) >= _SOURCES:
                raise SourceCountError(
                    "source", "refused", f"at most {_SOURCES} sources", source, sequence
                )
            allowance = MessageAllowance(self._limit(source).message_rate, self._now)
            account = self._accounts[source] = SourceAccount(SequenceWatch(), allowance)
        return account

    def _count_obstacles(self, message: ObstaclesMessage, most: int) -> int:
        """How many obstacles a source has with a message; not counted closely up to `most`."""
        count = len(message.ids)
        if message.snapshot:
            return count
        count += self._obstacles.count_of(message.source)
        # Those that the table has already are looked up only where that decides.
        return count if count <= most else self._obstacles.count_of(message.source, message.ids)

    def _tell_verdict(self, error: MessageError) -> None:
        """Let the verdict know of a refused message: what it would have told is not known."""
        problem = f"{error.value}; expected {error.expected}"
        self._obstacles.leave_malformed(error.source, error.field, problem, self._now)

    def _take(self, message: AnyMessage) -> None:
        if isinstance(message, JointsMessage):
            if message.arm in self._others:
                self._follow(self._other_watches[message.arm], message.arm, message.seq)
                self._take_other_joints(message)
            else:
                self._follow(self._joint_watch, "joints", message.seq)
                self._take_joints(message)
        elif isinstance(message, PlanMessage) and message.ask == "share":
            self._take_shared_plan(message)
        elif (
            isinstance(message, PlanMessage | IgnoreMessage | WatchMessage | ResetMessage)
            and message.arm in self._others
        ):
            # Senders may tell all monitors of a cell; that of the other arm takes it.
            pass
        elif isinstance(message, PlanMessage):
            self.plans.append(self._read_plan(message, self._joints))
        elif isinstance(message, _OF_SOURCES):
            self._check_not_arm(message)
            account = self._find_account(message.source, message.seq)
            self._follow(account.watch, message.source, message.seq)
            if isinstance(message, ObstaclesMessage):
                self._check_obstacles(message)
                self._take_obstacles(message)
            elif isinstance(message, CloudMessage):
                self._check_cloud(message)
                self._take_cloud(message)
            else:
                self._take_removal(message)
        elif isinstance(message, IgnoreMessage):
            self._take_exemption(message)
        elif isinstance(message, WatchMessage):
            self._take_end(message)
        else:
            self._take_reset(message)

    def _take_end(self, message: WatchMessage) -> None:
        """Hand on that an exemption is to end."""
        try:
            self._check_arm(message)
        except MessageError as error:
            self.faults.add("malformed", "exemptions", message.number, str(error))
            return
        self.exemptions.append(ExemptionRequest(message.number, is_end=True))

    def _take_reset(self, message: ResetMessage) -> None:
        """Hand on a reset that names the watched arm, and has the token of this run."""
        problem = "token is not the one of this run"
        if self._reset_token is None:
            problem = "this run was started without --reset-token, and obeys none"
        try:
            self._check_arm(message)
            is_obeyed = self._is_token(message.token)
        except MessageError as error:
            is_obeyed, problem = False, str(error)
        if message.number is not None:
            verdict = ResetVerdict(is_obeyed, "" if is_obeyed else problem)
            self.reset_verdicts.append((message.number, verdict))
        if not is_obeyed:
            self.faults.add("reset refused", "unknown", None, problem)
            return
        self.reset_requested = True
        # A reset ends what was asked for a time, and is obeyed before all requests.
        self.exemptions = [one for one in self.exemptions if one.until is None]

    def _is_token(self, token: str) -> bool:
        known = self._reset_token
        return known is not None and hmac.compare_digest(token.encode(), known.encode())

    def _take_exemption(self, message: IgnoreMessage) -> None:
        """Hand on what is asked; what cannot be read, or has no token, is counted."""
        if not self._is_token(message.token):
            problem = "token is not the one of this run"
            self.faults.add("ignore refused", "exemptions", message.number, problem)
            return
        zone, until = None, message.until
        try:
            self._check_arm(message)
            if message.zone is not None:
                size = len(message.zone)
                size = size // 24 if isinstance(message.zone, bytes) else size
                zone = to_rows("zone", message.zone, size, 3)
        except MessageError as error:
            self.faults.add("malformed", "exemptions", message.number, str(error))
            return
        if until is not None:
            # As that of a plan: a time to come, which no latency has made old.
            until, _ = self._to_monitor_time(until, self._joint_clock._replace(latency=0.0))
            until -= self._joint_clock.error
        self.exemptions.append(
            ExemptionRequest(
                message.number,
                is_end=False,
                link=message.link,
                ids=message.ids,
                source=message.source,
                until=until,
                zone=zone,
            )
        )

    def _follow(self, watch: SequenceWatch, source: str, sequence: int | None) -> None:
        for kind, times, problem in watch.follow(sequence):
            self.faults.add(kind, source, sequence, problem, times)

    def _take_obstacles(self, message: ObstaclesMessage) -> None:
        source, sequence = message.source, message.seq
        fields = {field: getattr(message, field) for field in _FIELDS}
        clock = self._stamp_clocks.get(source, MONOTONIC)
        stamp, gap = self._to_monitor_time(message.stamp, clock)
        counted = False
        try:
            fields = _unpack(fields, len(message.ids))
            self._name_unusable(source, sequence, {"stamp": message.stamp, **fields})
            window = clock.error + gap
            if window > 0.0:
                self._widen(fields, window, message.ids)
        except MessageError as error:
            # Handed on as it came: the table refuses it too, and so the verdict knows of it.
            self.faults.add("malformed", source, sequence, str(error))
            counted = True
        try:
            self._obstacles.update(
                message.ids,
                stamp,
                source=source,
                frame=message.frame,
                snapshot=message.snapshot,
                **fields,
            )
        except ArmguardError as error:
            if not counted:
                self.faults.add("refused", source, sequence, str(error))

    def _take_cloud(self, message: CloudMessage) -> None:
        source, sequence = message.source, message.seq
        clock = self._stamp_clocks.get(source, MONOTONIC)
        stamp, gap = self._to_monitor_time(message.stamp, clock)
        window = clock.error + gap
        try:
            points = to_cloud("points", message.points)
            occupied = None
            if message.occupied is not None:
                occupied = to_mask("occupied", message.occupied, len(points))
        except MessageError as error:
            self._tell_verdict(MessageError(error.field, error.value, error.expected, source))
            self.faults.add("malformed", source, sequence, str(error))
            return
        named = {"stamp": message.stamp, "origin": message.origin, "points": points}
        self._name_unusable(source, sequence, named)
        fields: dict[str, Any] = {field: getattr(message, field, None) for field in _FIELDS}
        fields["velocity_error"] = 0.0
        if window > 0.0:
            self._widen(fields, window, ["voxel"])
        others = self._find_others(points, message, stamp, window)
        if others is not None:
            occupied = others if occupied is None else occupied & others
        try:
            self._obstacles.update_cloud(
                source,
                stamp,
                points,
                message.origin,
                message.voxel,
                occupied=occupied,
                position_error=float(np.max(fields["position_error"])),
                accel=message.accel,
                speed=message.speed,
                frame=message.frame,
                snapshot=message.snapshot,
                limit=self._limit(source).obstacles,
            )
        except ArmguardError as error:
            kind = LimitError.kind if isinstance(error, VoxelCountError) else "refused"
            self.faults.add(kind, source, sequence, str(error))

    def _find_others(
        self, points: NDArray[np.float64], message: CloudMessage, stamp: float, window: float
    ) -> NDArray[np.bool_] | None:
        """Which points are not the arm's; None where it is not known where the arm was: all count.

        Args:
            points: Of the cloud, in [m]. Shape (n, 3).
            message: The cloud.
            stamp: When it was measured, in [s] of the monitor's time.
            window: What that may be off by, in [s].
        """
        own = self._own_points
        assert own is not None, "clouds are taken"
        if not len(points):
            return None
        problem = "no joint state has come; expected one, to tell the arm's points from others"
        # A camera takes some time to hand over what it saw: the arm was elsewhere then.
        state = min(self._past, key=lambda one: abs(one.stamp - stamp), default=None)
        if state is not None:
            apart = abs(state.stamp - stamp) + window
            if apart <= own.time_error:
                try:
                    return own.find_others(points, state.q, message.frame)
                except ArmguardError as error:
                    problem = str(error)
            else:
                problem = (
                    f"joint state is {apart:.3g} s away from the cloud, expected at most "
                    f"{own.time_error:.3g} s; the arm's points count as others"
                )
        self.faults.add("arm not taken out", message.source, message.seq, problem)
        return None

    def _take_removal(self, message: RemoveMessage) -> None:
        clock = self._stamp_clocks.get(message.source, MONOTONIC)
        # A removal that looks older than it is removes less.
        stamp, _ = self._to_monitor_time(message.stamp, clock)
        try:
            self._obstacles.remove(message.ids, stamp=stamp, source=message.source)
        except ArmguardError as error:
            self.faults.add("refused", message.source, message.seq, str(error))

    def _take_joints(self, message: JointsMessage) -> None:
        try:
            self._check_arm(message)
            order = self._joints.find(message.names)
            q = to_values("q", message.q, len(message.names))[order]
            v = to_values("v", message.v, len(message.names))[order]
        except MessageError as error:
            self.faults.add("malformed", "joints", message.seq, str(error))
            return
        named = {"stamp": message.stamp, "q": q, "v": v}
        usable = self._name_unusable("joints", message.seq, named)
        stamp, gap = self._to_monitor_time(message.stamp, self._joint_clock)
        if not gap <= HELD_UP:
            # Joint states have no errors of their own that could be widened.
            problem = f"clocks were compared within {gap:.3g} s; expected {HELD_UP:.3g} s at most"
            self.faults.add("clocks held up", "joints", message.seq, problem)
            return
        self._has_joints = True
        if self._awaits_fresh:
            now = self._clock.now()
            if now - stamp > self._joint_timeout:
                self._drop(stamp, now, message.seq)
                return
        last = self._newest
        if last is not None and stamp < last.stamp:
            problem = f"stamp is {message.stamp!r}, {last.stamp - stamp:.3g} s before the last one"
            self.faults.add("stamp went back", "joints", message.seq, problem)
        if not self._keeps_joint_state:
            self._newest = JointState(stamp, q, v)
        if usable and self._own_points is not None:
            self._past.append(JointState(stamp, q, v))
        # An impossible state must be seen by the monitor, even if a good one follows at once.
        self._keeps_joint_state = self._keeps_joint_state or not usable

    def _take_shared_plan(self, message: PlanMessage) -> None:
        """Hand on what another arm promises; what cannot be taken narrows nothing, and is said."""
        arm = message.arm
        if arm and arm == self._arm:
            # Its own monitor goes by what it is asked, and what it sees.
            return
        if arm not in self._others:
            expected = f"one of {', '.join(map(repr, self._others)) or 'several arms in the cell'}"
            error = MessageError("arm", repr(arm) if arm else "missing", expected)
            self.faults.add("malformed", "plans", message.number, str(error))
            return
        request = self._read_plan(message, self._other_orders[arm])
        if request.problem:
            return
        if self._joint_clock.clock == "arrival":
            problem = 'needs stamps: with clock = "arrival" nobody knows until when it is promised'
            self.faults.add("plan refused", arm, message.number, problem)
            return
        # A time to come, which no latency has made old.
        clock = self._joint_clock._replace(latency=0.0)
        told = math.nan if message.until is None else message.until
        until, gap = self._to_monitor_time(told, clock)
        # Joint states, which are tested against the plan, may be that much younger than they look.
        clock_error = self._joint_clock.latency + self._clock_difference + gap
        try:
            self._others[arm].take_plan(request, until, clock_error)
        except ArmguardError as error:
            self.faults.add("plan refused", arm, message.number, str(error))

    def _read_plan(self, message: PlanMessage, joints: JointOrder) -> PlanRequest:
        """A plan in the order of an arm's joints; what cannot be read is said, and counted."""
        names, count = message.names, len(message.names)
        try:
            if message.ask != "share":
                self._check_arm(message)
            order = joints.find(names)
            size = len(message.times)
            size = size // 8 if isinstance(message.times, bytes) else size
            times = to_values("times", message.times, size)
            q = to_rows("q", message.q, size, count)[:, order]
            v = to_rows("v", message.v, size, count)[:, order]
            fields = {"tracking_error": _read_errors(message, "tracking_error", order)}
            if message.velocity_tracking_error is not None:
                field = "velocity_tracking_error"
                fields[field] = _read_errors(message, field, order)
        except MessageError as error:
            self.faults.add("malformed", "plans", message.number, str(error))
            return PlanRequest(message.ask, message.number, str(error))
        # Joint states may be measured before their stamps; a plan says where the arm will be.
        clock = self._joint_clock._replace(latency=0.0)
        stamp, gap = self._to_monitor_time(message.stamp, clock)
        problem = ""
        if not gap <= HELD_UP:
            problem = f"clocks were compared within {gap:.3g} s; expected {HELD_UP:.3g} s at most"
            self.faults.add("clocks held up", "plans", message.number, problem)
        return PlanRequest(message.ask, message.number, problem, stamp, times, q, v, **fields)

    def _check_arm(
        self, message: JointsMessage | PlanMessage | IgnoreMessage | WatchMessage | ResetMessage
    ) -> None:
        """Raise MessageError if a message does not name the watched arm as the cell has it."""
        if message.arm != self._arm:
            found = repr(message.arm) if message.arm else "missing"
            known = ", ".join(map(repr, (self._arm, *self._others)))
            expected = f"one of {known}" if self._arm else "none: the cell has one arm"
            raise MessageError("arm", found, expected)

    def _check_not_arm(self, message: ObstaclesMessage | CloudMessage | RemoveMessage) -> None:
        """Raise MessageError if obstacles come in the name of another arm."""
        if message.source in self._others:
            found, source = f"{message.source!r}, which is an arm", message.source
            error = MessageError("source", found, "its joint states alone", source, message.seq)
            self._tell_verdict(error)
            raise error

    def _take_other_joints(self, message: JointsMessage) -> None:
        """Tell the table a joint state of another arm; the drain's bounds bound this work, too."""
        arm, size = message.arm, len(message.names)
        try:
            order = self._other_orders[arm].find(message.names)
            q = to_values("q", message.q, size)[order]
            v = to_values("v", message.v, size)[order]
        except MessageError as error:
            self.faults.add("malformed", arm, message.seq, str(error))
            self._obstacles.leave_malformed(arm, "joint state", str(error), self._now)
            return
        named = {"stamp": message.stamp, "q": q, "v": v}
        self._name_unusable(arm, message.seq, named)
        stamp, gap = self._to_monitor_time(message.stamp, self._joint_clock)
        now = self._clock.now()
        if stamp > now:
            # A state bounds what follows it, not what was before: none is of the future. What the
            # clocks are off by is in its errors; of more, nothing is known of when it was measured.
            problem, allowed = f"stamp is {stamp - now:.3g} s ahead", self._clock_difference
            if not stamp - now <= allowed:
                problem += f", expected at most the clock error, {allowed:.3g} s"
                self.faults.add("stamp ahead", arm, message.seq, problem)
                self._obstacles.leave_malformed(arm, "joint state", problem, now)
                return
            self.faults.add("stamp ahead", arm, message.seq, f"{problem}; counted as measured now")
            stamp = now
        if not gap <= HELD_UP:
            problem = f"clocks were compared within {gap:.3g} s; expected {HELD_UP:.3g} s at most"
            self.faults.add("clocks held up", arm, message.seq, problem)
            return
        # Each, not the newest alone: what one of them breaks, the next may hide.
        try:
            self._others[arm].publish(stamp, q, v)
        except ArmguardError as error:
            self.faults.add("refused", arm, None, str(error))

    def _name_unusable(
        self, source: str, sequence: int | None, named: Mapping[str, object]
    ) -> bool:
        """Count values that are not finite; refusing them is the business of table and monitor."""
        usable = True
        for field, values in named.items():
            if values is None or (type(values) is float and math.isfinite(values)):
                continue
            array = np.asarray(values, float)
            # The sum of their squares is finite only if all are, and found in less than half the
            # time.
            if array.size <= _SUMMED_AT_ONCE and math.isfinite(np.vdot(array, array)):
                continue
            # Bounds may be infinite: that says that there is none.
            good = ~np.isnan(array) if field in ("accel", "speed") else np.isfinite(array)
            if good.all():
                continue
            place = np.unravel_index(int(np.argmin(good)), good.shape)
            index = f"[{', '.join(str(int(i)) for i in place)}]" if place else ""
            problem = f"{field}{index} is {array[place]}; expected a finite number"
            self.faults.add("not finite", source, sequence, problem)
            usable = False
        return usable

    def _to_monitor_time(self, stamp: float, clock: StampClock) -> tuple[float, float]:
        """A stamp in the monitor's time, never too new, and what it may be too old by, in [s]."""
        if clock.clock == "monotonic":
            return stamp - self.offset - clock.latency, self.offset_error
        if clock.clock == "unix":
            # Compared anew each time: the machine's date may be set while we run.
            now, unix, gap = _compare(self._clock, self._unix, HELD_UP)
            # The difference of two dates first: it is exact, as that of a date and `now` is not.
            return now + (stamp - unix) - clock.latency, gap
        # Of several that arrived together the later ones must not look simultaneous.
        self._arrived_after += _NANOSECOND
        arrival = self._arrived_after - clock.latency
        # It may have arrived since the drain began, which takes its time.
        return arrival, self._clock.now() - arrival

    def _widen(self, fields: dict[str, Any], window: float, ids: Sequence[str]) -> None:
        """Add what a body can do between its stamp and the measurement, `window` [s] at most."""
        known_accel, known_speed = self._obstacles.bounds.find(ids, self._accel, self._speed)
        speed = np.asarray(known_speed if fields["speed"] is None else fields["speed"])
        accel = np.asarray(known_accel if fields["accel"] is None else fields["accel"])
        position_error = np.asarray(fields["position_error"])
        velocity_error = np.asarray(fields["velocity_error"])
        velocity = fields["velocity"]
        is_broken: Any = False
        if velocity is not None:
            fastest = np.linalg.norm(velocity, axis=-1)
            fastest = fastest.max(axis=-1) if fastest.ndim > 1 else fastest
            # Without a bound on speed it is as fast as it was measured, and what it gains.
            gained = fastest + velocity_error + np.where(accel < math.inf, accel, 0.0) * window
            speed = np.where((speed == math.inf) & (accel < math.inf), gained, speed)
            # A speed that breaks its bound must not pass because of the wider error.
            is_broken = fastest - velocity_error > speed  # NaN is for the table to refuse
            speed = np.where(is_broken, fastest + velocity_error, speed)
        with np.errstate(invalid="ignore"):
            # What is negative stays so, for the table to refuse.
            fields["position_error"] = np.where(
                position_error < 0.0, position_error, position_error + speed * window
            )
            # Without a bound on acceleration velocities do not matter, however well known.
            is_wider = ~np.asarray(is_broken) & (velocity_error >= 0.0) & (accel < math.inf)
            fields["velocity_error"] = np.where(
                is_wider, velocity_error + accel * window, velocity_error
            )


def _compare(
    clock: Clock, other: Callable[[], float], good_enough: float
) -> tuple[float, float, float]:
    """Read two clocks together: the monitor's, the other, and what the first may be too early by.

    Whatever holds this process up between two readings makes them differ. The monitor's clock is
    read before the other and after it: the earlier reading makes stamps older, never newer, and
    older by the gap at most. Of several tries the closest counts.

    Args:
        clock: The monitor's.
        other: Reads the other one, in [s].
        good_enough: A gap, in [s], that needs no further try.
    """
    closest = 0.0, 0.0, math.inf
    for _ in range(_COMPARISONS):
        before = clock.now()
        reading = other()
        gap = clock.now() - before
        if gap < closest[2]:
            closest = before, reading, gap
        if gap <= good_enough:
            break
    return closest


def _read_errors(message: PlanMessage, field: str, order: NDArray[np.int64]) -> NDArray[np.float64]:
    """One tracking error a watched joint, whether there is one for all or one for each."""
    values, count = getattr(message, field), len(message.names)
    if isinstance(values, float):
        return np.full(len(order), values)
    return to_values(field, values, count)[order]


def _unpack(fields: Mapping[str, Any], count: int) -> dict[str, Any]:
    """The fields of `count` obstacles as arrays; None and single numbers stay as they are."""
    arrays: dict[str, Any] = {}
    for field, value in fields.items():
        if value is None or isinstance(value, float):
            arrays[field] = value
        elif field in ("position", "velocity"):
            arrays[field] = to_points(field, value, count)
        else:
            arrays[field] = to_values(field, value, count)
    return arrays


class JointOrder:
    """Where an arm's joints are among the names of a message.

    Args:
        joints: Names of the joints, in the order of `q` and `v`.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._names: list[str] | None = None
        self._order: NDArray[np.int64] = np.zeros(0, np.int64)

    def find(self, names: list[str]) -> NDArray[np.int64]:
        """Where each joint is in `names`; remembered, since senders keep their order. (nv,).

        Raises:
            MessageError: A joint is missing, or named twice.
        """
        if names != self._names:
            missing = [joint for joint in self._joints if names.count(joint) != 1]
            if missing:
                found = "named twice" if missing[0] in names else "missing"
                raise MessageError("names", f"without {missing[0]!r} ({found})", "each joint once")
            self._order = np.array([names.index(joint) for joint in self._joints])
            self._names = names
        return self._order


class SequenceWatch:
    """Follows the numbers of one source."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._left: int | None = None

    def follow(self, sequence: int | None) -> list[tuple[str, int, str]]:
        """Take the number of the next message.

        Args:
            sequence: The number; None where the sender does not count.

        Returns:
            Faults as (kind, how many, in words); mostly none.
        """
        if sequence is None:
            return []
        last, self._last = self._last, sequence
        if last is None or sequence == last + 1:
            return []
        if self._left is not None and sequence == self._left + 1:
            self._left = last
            problem = f"seq is {sequence} after {last}, and both go on; expected one publisher"
            return [("two publishers", 1, problem)]
        if sequence > last:
            lost = sequence - last - 1
            return [("lost", lost, f"seq is {sequence} after {last}: {lost} messages lost")]
        # The track that was left may be taken up again: then there are two publishers.
        self._left = last
        problem = f"seq is {sequence} after {last}; a publisher that started anew, or a second one"
        return [("sequence went back", 1, problem)]


class SourceAccount(NamedTuple):
    """What is kept of each source that has sent."""

    watch: SequenceWatch
    allowance: MessageAllowance
