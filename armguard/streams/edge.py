"""The edge: checks messages from outside once, and converts them to obstacles and joint states.

Nothing raises here and nothing is lost silently: each fault is counted with its source, number,
field and value, and the usable rest is passed on. The obstacle table judges rows (implausible,
negative, not finite), and its faults are reported in the verdict; the edge reports their values.

Each message is decoded once, charged to its source, and passed to the handler of its type. A long
message is charged before it is decoded, by its header alone; a malformed one also by its header.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from armguard.clock import Clock
from armguard.messages.incoming import (
    CloudMessage,
    GoalMessage,
    Header,
    IgnoreMessage,
    JointsMessage,
    MessageError,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    WatchMessage,
    decode,
    read_header,
)
from armguard.obstacles.obstacles import Obstacles
from armguard.streams.authentication import Authenticator, check_sender
from armguard.streams.cloud_intake import CloudIntake, OwnPoints
from armguard.streams.faults import FaultLog
from armguard.streams.goal_intake import GoalReader
from armguard.streams.inputs import BYTE_LIMIT, Input, InputWatch, SocketInput
from armguard.streams.intake import ArmMessage, Intake
from armguard.streams.joint_intake import JointIntake
from armguard.streams.obstacle_intake import ObstacleIntake
from armguard.streams.other_arm_intake import OtherArm, OtherArmIntake
from armguard.streams.requests import PlanReader, Requests, TokenReader
from armguard.streams.source_accounts import (
    SourceAccount,
    SourceAccounts,
    SourceLimits,
    SourceMessage,
)
from armguard.streams.stamp_clocks import MONOTONIC, StampClock, StampTimes

_MESSAGES_A_DRAIN = 64
"""Greatest number of messages read from one input in one tick; the rest wait for the next tick."""

DRAIN_TIME = 5e-3
"""Default for the longest time in which one tick reads messages, in [s]."""

_DECODED_AT_ONCE = 4096
"""Longest message, in bytes, that is decoded before it is charged to its source. That takes about a
millisecond at most; of 4 MiB of empty lists it would take a second, and reading the header 6 ms."""

_TAGS_OF_SOURCES = frozenset(("obstacles", "cloud", "remove"))
"""Types of messages, as they are named there, that are charged to the source that they name."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EdgeSettings:
    """What an edge has to know of its cell."""

    stamp_clocks: Mapping[str, StampClock] = dataclasses.field(default_factory=dict)
    """How sources stamp; those not named here, with the monotonic clock."""
    joint_clock: StampClock = MONOTONIC
    """How joint states of all arms are stamped; those of the watched one not by arrival."""
    joint_timeout: float = math.inf
    """At the start, joint states older than this, in [s], are dropped: a sender that was there
    before hands over what has waited."""
    speed: float = math.inf
    """Speed bound of obstacles that bring none and that no pattern of the table's fits, in [m/s];
    for sources without a clock."""
    accel: float = math.inf
    """Acceleration bound of obstacles that bring none and that no pattern of the table's fits, in
    [m/s²]; for sources without a clock."""
    reset_token: str | None = None
    """What a message must carry that asks for a reset, or for contact to be wanted; without one,
    none is obeyed."""
    limits: Mapping[str, SourceLimits] = dataclasses.field(default_factory=dict)
    """How much sources may send; those not named here, as `SourceLimits` has it."""
    own_points: OwnPoints | None = None
    """Removes the arm's own points from clouds; None: clouds are refused."""
    drain_time: float = DRAIN_TIME
    """How long a drain may last, in [s], in equal parts for its inputs. One message of each is
    taken whatever it takes, and the one at which the time ends is finished."""
    arm: str = ""
    """Name of the watched arm, where a cell has several: then joint states, plans, goals, requests
    that contact be wanted and their ends, and resets have to say whose they are."""
    others: Mapping[str, OtherArm] = dataclasses.field(default_factory=dict)
    """By name, the other arms of the cell."""
    monotonic: Callable[[], float] = time.monotonic
    """Reads the clock of `monotonic` stamps, in [s]."""
    unix: Callable[[], float] = time.time
    """Reads the clock of `unix` stamps, in [s]."""


class Edge:
    """Reads messages from inputs, and passes each to the handler of its type.

    Args:
        obstacles: The table.
        joints: Names of the watched joints, in the order of `q` and `v`.
        clock: The monitor's clock.
        faults: Where faults are counted.
        settings: What there is to know of the cell.

    Attributes:
        faults: As above.
        times: The clocks that sources stamp with.
        joints: Joint states of the watched arm.
        requests: What was asked of the monitor in the last drain.
        received: Messages taken, good and bad.
        cut_short: How often an input was left before it was found empty; the rest waited for a
            tick.
    """

    def __init__(
        self,
        obstacles: Obstacles,
        joints: Sequence[str],
        clock: Clock,
        faults: FaultLog,
        settings: EdgeSettings | None = None,
    ) -> None:
        cell = settings or EdgeSettings()
        self.faults = faults
        self.received = self.cut_short = 0
        self.requests = Requests()
        self.times = StampTimes(clock, cell.monotonic, cell.unix)
        self._drain_time = cell.drain_time
        self._intake = intake = Intake(obstacles, faults, self.times, cell.arm, cell.others)
        self._accounts = SourceAccounts(intake, cell.limits, cell.stamp_clocks)
        stamped, keeps_past = cell.joint_clock, cell.own_points is not None
        self.joints = JointIntake(intake, joints, stamped, cell.joint_timeout, keeps_past)
        self._plans = PlanReader(intake, stamped)
        self._goals = GoalReader(intake, stamped)
        self._others = {
            name: OtherArmIntake(intake, name, arm, stamped, self._plans)
            for name, arm in cell.others.items()
        }
        bodies = ObstacleIntake(intake, cell.accel, cell.speed)
        bounds = cell.accel, cell.speed
        clouds = CloudIntake(intake, bounds, cell.own_points, self.joints.past)
        tokens = TokenReader(intake, self.requests, stamped, cell.reset_token)
        self._source_handlers: dict[type, Callable[[Any, SourceAccount], None]] = {
            ObstaclesMessage: bodies.take,
            CloudMessage: clouds.take,
            RemoveMessage: bodies.take_removal,
        }
        self._handlers: dict[type, Callable[[Any], None]] = {
            JointsMessage: self._take_joints if self._others else self.joints.take,
            PlanMessage: self._take_plan,
            GoalMessage: self._of_this_arm(self._take_goal),
            IgnoreMessage: self._of_this_arm(tokens.take_exemption),
            WatchMessage: self._of_this_arm(tokens.take_end),
            ResetMessage: self._of_this_arm(tokens.take_reset),
        }
        self._watch = InputWatch(faults)
        self._arrived_after: dict[Input, float] = {}
        """When the next message of an input had not arrived yet, in [s], where that is earlier than
        the beginning of the last drain."""

    def drain(self, inputs: Sequence[Input]) -> float:
        """Read the arrived messages, up to a bound on the work of one tick; never blocks or raises.

        The bound of each input is a number of messages, their length and its part of the time.

        Inputs must be opened after the edge is made: arrival is counted from then on.

        Returns:
            When the last input was left, in [s] of the monitor's clock, or when this began where
            none had messages; at the start, the joint state is fresh at this time.
        """
        times, joints = self.times, self.joints
        last, now = times.drain_start, times.now()
        times.drain_start = now
        self.requests.begin_drain()
        for source in self._watch.attend(inputs):
            self._arrived_after[source] = times.start
        is_emptied = False
        for source in inputs:
            # Others than sockets do not know whether they are empty.
            socket = source if isinstance(source, SocketInput) else None
            if socket is not None and not socket.is_unread:
                continue
            # Whatever is taken now arrived since this input was last found empty.
            times.arrived_after = self._arrived_after.pop(source, last)
            joints.has_come = False
            until = now + self._drain_time / len(inputs)
            if self._take_messages(source, socket, until):
                is_emptied = is_emptied or joints.has_come
            else:
                self.cut_short += 1
                self._arrived_after[source] = times.arrived_after
            now = times.now()
        joints.settle(now, is_emptied=is_emptied, is_reset=self.requests.is_reset)
        return now

    def _take_messages(self, source: Input, socket: SocketInput | None, until: float) -> bool:
        """Take the messages of one input, up to its bounds.

        Args:
            source: The input.
            socket: The same, if it is a socket.
            until: When its part of the drain's time is over, in [s].

        Returns:
            Whether the input was found empty.
        """
        size = 0
        for _ in range(_MESSAGES_A_DRAIN):
            try:
                data = source.receive()
                if data is None:
                    return True
                self.received += 1
                size += len(data)
                self._read(data, socket)
            except MessageError as error:
                if error.hides_obstacles:
                    self._intake.tell_verdict(error)
                # What a message says of itself may be wrong; its key is not.
                sender = None if socket is None else socket.sender
                self.faults.add(error.kind, sender or error.source, error.sequence, str(error))
            if socket is not None and not socket.is_unread:
                return True
            if size > BYTE_LIMIT or not self.times.now() < until:
                break
        return False

    def _read(self, data: bytes, socket: SocketInput | None) -> None:
        """Take one message if its sender may send it; raise MessageError if not."""
        size, sender, authenticator = len(data), None, None
        if socket is not None:
            sender, authenticator = socket.sender, socket.authenticator
        if authenticator is not None:
            self._check_size(size, sender, authenticator)
        account = None
        is_long = size > _DECODED_AT_ONCE
        if is_long:
            account = self._charge_by_header(data, sender, authenticator)
        try:
            message: Any = decode(data)
        except MessageError:
            if not is_long:
                self._charge_by_header(data, sender, authenticator)
            raise
        kind = type(message)
        handle = self._source_handlers.get(kind)
        if handle is not None and not is_long:
            account = self._charge(message, size, sender, authenticator)
        if authenticator is not None:
            check_sender(message, sender, authenticator)
        if handle is None:
            self._handlers[kind](message)
            return
        assert account is not None, "of a message without one, the sender is refused"
        try:
            if message.source in self._others:
                raise MessageError(
                    "source", f"{message.source!r}, which is an arm", "its joint states alone"
                )
            account.numbers.follow(message.seq)
            handle(message, account)
        except MessageError as error:
            error.source, error.sequence = message.source, message.seq
            error.hides_obstacles = True
            raise

    def _check_size(self, size: int, sender: str | None, authenticator: Authenticator) -> None:
        """Raise LimitError if a message is too long for its sender, whatever it says.

        Of a client that may send joint states as well, the type of the message decides.
        """
        if (
            sender is not None
            and authenticator.may(sender, "obstacles")
            and not authenticator.may(sender, "joints")
            and size > self._accounts.limits_of(sender).message_size
        ):
            self._accounts.charge(sender, size, None)

    def _charge_by_header(
        self, data: bytes, sender: str | None, authenticator: Authenticator | None
    ) -> SourceAccount | None:
        """As `_charge`, for a message that was not decoded; one without a header costs nothing."""
        header = read_header(data)
        if header is None or header.type not in _TAGS_OF_SOURCES:
            return None
        return self._charge(header, len(data), sender, authenticator)

    def _charge(
        self,
        message: SourceMessage | Header,
        size: int,
        sender: str | None,
        authenticator: Authenticator | None,
    ) -> SourceAccount | None:
        """Raise LimitError if a message takes its source beyond its size or rate.

        Returns:
            What is kept of its source. With keys that is the source of the sender's key, whatever
            the message says; None where that may send no obstacles.
        """
        payer = message.source if authenticator is None else sender
        if payer is None or (authenticator and not authenticator.may(payer, "obstacles")):
            return None
        return self._accounts.charge(payer, size, message.seq, message.source)

    def _of_this_arm(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """A handler that leaves what names another arm to the monitor of that arm."""

        def handle(message: ArmMessage) -> None:
            # Senders may tell all monitors of a cell; that of the other arm takes it.
            if message.arm not in self._others:
                take(message)

        return handle

    def _take_joints(self, message: JointsMessage) -> None:
        other = self._others.get(message.arm)
        if other is None:
            self.joints.take(message)
        else:
            other.take_joints(message)

    def _take_goal(self, message: GoalMessage) -> None:
        self.requests.goals.append(self._goals.read(message, self.joints.order))

    def _take_plan(self, message: PlanMessage) -> None:
        """Note a request about a plan, or pass on the shared plan of another arm."""
        arm, other = message.arm, self._others.get(message.arm)
        if message.ask != "share":
            if other is None:
                self.requests.plans.append(self._plans.read(message, self.joints.order))
        elif other is not None:
            other.take_shared_plan(message)
        elif not arm or arm != self._intake.watched:
            # The watched arm's own promise is not for its own monitor, which goes by what it sees.
            known = ", ".join(map(repr, self._others)) or "several arms in the cell"
            error = MessageError("arm", repr(arm) if arm else "missing", f"one of {known}")
            self.faults.add("malformed", "plans", message.number, str(error))
