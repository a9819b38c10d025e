"""Classes for users' nodes: `Publisher` for perception and robot, `VerdictReader` for controllers.

Publishers and readers connect, and the monitor binds. So either side can start first, and either
can be restarted. Stamps are seconds of the machine's monotonic clock (`time.monotonic()`), unless
the cell file names another clock for the source.
"""

from __future__ import annotations

import contextlib
import math
import secrets
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Literal, TypeVar

import numpy as np
import zmq
from numpy.typing import ArrayLike

from armguard.exceptions import StreamError
from armguard.messages.answers import (
    decode_answer,
    encode_command,
    encode_plan_verdict,
    encode_reset_verdict,
    encode_verdict,
)
from armguard.messages.command import CommandMessage
from armguard.messages.incoming import (
    AnyMessage,
    CloudMessage,
    GoalMessage,
    GoalPath,
    IgnoreMessage,
    JointsMessage,
    MessageError,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    Values,
    WatchMessage,
    encode,
)
from armguard.streams.addresses import check_address, check_free, explain, remove_file
from armguard.streams.authentication import Authenticator
from armguard.streams.inputs import FRAME_LIMIT, QUEUE_LIMIT
from armguard.streams.keys import Keys, present
from armguard.verdict import Level, PlanVerdict, ResetVerdict, Verdict

_ANSWERS = 16
"""Greatest number of answers to plans and resets that a reader keeps."""

_Answer = TypeVar("_Answer", PlanVerdict, ResetVerdict)

_MESSAGES_AFTER = 64
"""Messages that are looked at for an answer once its time is over, at most."""

_NOBLOCK = int(zmq.NOBLOCK)

_LINGER = 200
"""How long, in [ms], a closing publisher may take to send its last messages."""


def _connect(address: str, kind: int, keys: Keys | None) -> zmq.Socket[bytes]:
    check_address(address, has_keys=keys is not None)
    connection: zmq.Socket[bytes] = zmq.Context.instance().socket(kind)
    connection.set(zmq.SNDHWM, QUEUE_LIMIT)
    connection.set(zmq.RCVHWM, QUEUE_LIMIT)
    connection.set(zmq.LINGER, _LINGER)
    if kind == zmq.XPUB:
        # Nothing waits for a monitor that is not there: it would be old when it arrives.
        connection.set(zmq.IMMEDIATE, 1)
    connection.set(zmq.RECONNECT_IVL, 20)
    connection.set(zmq.RECONNECT_IVL_MAX, 200)
    connection.set(zmq.MAXMSGSIZE, FRAME_LIMIT)
    if keys is not None:
        present(connection, keys)
    try:
        connection.connect(address)
    except zmq.ZMQError as error:
        connection.close()
        raise explain(address, error) from None
    return connection


class Publisher(contextlib.AbstractContextManager["Publisher"]):
    """Sends obstacles or joint states to a running monitor; never blocks.

    Args:
        address: Address of the monitor's input.
        source: Name of the source of the obstacles; each source must have only one publisher.
        keys: Keys of this client, if the monitor requires keys; `source` must be the client's name
            in the cell file.

    Raises:
        StreamError: The address cannot be used; beyond this machine it can be with keys only.
    """

    def __init__(self, address: str, source: str = "default", keys: Keys | None = None) -> None:
        self.source = source
        self._sequence = 0
        self._joints_sequence = 0
        # All readers see all answers: no number is another publisher's, or that of an earlier life.
        self._plans = time.monotonic_ns()
        self._exemptions = self._resets = self._goals = self._plans
        self._connected = False
        # XPUB publishes as PUB does, and tells when a monitor begins to listen.
        self._socket = _connect(address, zmq.XPUB, keys)

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] until a monitor is connected; returns whether one is.

        Messages published before are lost, as with any publisher. A monitor is connected from its
        first tick on.
        """
        if not self._connected and self._socket.poll(int(1000 * timeout)):
            self._socket.recv()
            self._connected = True
        return self._connected

    def update(
        self,
        ids: Sequence[str],
        stamp: float,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        radius: ArrayLike | None = None,
        accel: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        position_error: ArrayLike = 0.0,
        velocity_error: ArrayLike = 0.0,
        frame: str = "world",
        snapshot: bool = False,
        region: str | Sequence[str] | None = None,
    ) -> None:
        """Send states of obstacles, as for `Obstacles.update`; without ids, a heartbeat.

        Args:
            ids: Names of the obstacles. Length n.
            stamp: Time of measurement, in [s].
            position: Centres of balls, shape (n, 3), or points of hulls, shape (n, k, 3), in [m].
            velocity: Velocities of these points in [m/s], shape as of `position`; None: unknown.
            radius: Radius in [m], one for all or shape (n,); required if there are ids.
            accel: Bounds on acceleration in [m/s²], one or shape (n,); None: the cell's.
            speed: Bounds on speed in [m/s], one or shape (n,); None: the cell's.
            position_error: Greatest error of positions, in [m], one or shape (n,).
            velocity_error: Greatest error of velocities, in [m/s], one or shape (n,).
            frame: Name of the frame of these coordinates.
            snapshot: Whether the message shows all that the source sees: absent ids are removed.
            region: Region of a body, one for all or one for each; None: the cell's.

        Raises:
            StreamError: If shapes do not fit the number of ids.
        """
        names, count = list(ids), len(ids)
        self._sequence += 1
        self._send(
            ObstaclesMessage(
                ids=names,
                stamp=float(stamp),
                source=self.source,
                seq=self._sequence,
                frame=frame,
                snapshot=snapshot,
                position=_pack_points("position", position, count),
                velocity=None if velocity is None else _pack_points("velocity", velocity, count),
                radius=_pack_values("radius", radius, count),
                accel=_pack_values("accel", accel, count),
                speed=_pack_values("speed", speed, count),
                position_error=_pack_values("position_error", position_error, count) or 0.0,
                velocity_error=_pack_values("velocity_error", velocity_error, count) or 0.0,
                region=region if region is None or isinstance(region, str) else list(region),
            )
        )

    def cloud(
        self,
        points: ArrayLike,
        stamp: float,
        origin: ArrayLike,
        voxel: float = 0.05,
        *,
        occupied: ArrayLike | None = None,
        position_error: float = 0.0,
        accel: float | None = None,
        speed: float | None = None,
        frame: str = "world",
        snapshot: bool = False,
    ) -> None:
        """Send a cloud, as for `Obstacles.update_cloud`; a cloud without points is a heartbeat.

        The monitor removes the arm's own points. Send all other points, including those that are
        not obstacles: their rays show empty space.

        Args:
            points: End points of rays, in [m]. Shape (n, 3).
            stamp: Time of measurement, in [s].
            origin: Origin of the rays, the camera's centre, in [m]. Shape (3,).
            voxel: Edge of the voxels, in [m], the same in all clouds.
            occupied: Points that become obstacles; None: all. Bool, shape (n,).
            position_error: Greatest error of points, in [m].
            accel: Bound on acceleration, in [m/s²]; None: the cell's for the id "voxel".
            speed: Bound on speed, in [m/s]; None: the cell's for the id "voxel".
            frame: Name of the frame of points and origin.
            snapshot: Whether this cloud shows all that the source sees: its other obstacles are
                removed.

        Raises:
            StreamError: If shapes do not fit each other.
        """
        ends = np.ascontiguousarray(points, "<f8")
        if ends.size == 0:
            ends = np.zeros((0, 3))
        begin = np.asarray(origin, float)
        mask = None if occupied is None else np.asarray(occupied, np.bool_)
        for field, array, shape in (
            ("points", ends, (len(ends), 3)),
            ("origin", begin, (3,)),
            ("occupied", mask, (len(ends),)),
        ):
            if array is not None and array.shape != shape:
                raise StreamError(field, f"has shape {array.shape}", expected=str(shape))
        x, y, z = begin.tolist()
        self._sequence += 1
        self._send(
            CloudMessage(
                stamp=float(stamp),
                origin=(x, y, z),
                points=ends.tobytes(),
                source=self.source,
                seq=self._sequence,
                frame=frame,
                voxel=float(voxel),
                occupied=None if mask is None else mask.tobytes(),
                position_error=float(position_error),
                accel=None if accel is None else float(accel),
                speed=None if speed is None else float(speed),
                snapshot=snapshot,
            )
        )

    def remove(self, ids: Sequence[str], stamp: float) -> None:
        """Report that these obstacles have left the cell, at `stamp` [s]."""
        self._sequence += 1
        self._send(RemoveMessage(list(ids), float(stamp), self.source, self._sequence))

    def joints(
        self,
        stamp: float,
        names: Sequence[str],
        q: ArrayLike,
        v: ArrayLike,
        arm: str = "",
    ) -> None:
        """Send a joint state.

        Args:
            stamp: Time of measurement, in [s].
            names: Names of the joints, in any order. Length n.
            q: Positions, in [rad] or [m]. Shape (n,).
            v: Velocities, in [rad/s] or [m/s]. Shape (n,).
            arm: Name of the arm, in a cell with several arms; empty in a cell with one arm.

        Raises:
            StreamError: If lengths do not fit the number of names.
        """
        self._joints_sequence += 1
        positions = _pack("q", q, (len(names),))
        velocities = _pack("v", v, (len(names),))
        self._send(
            JointsMessage(
                float(stamp),
                list(names),
                positions,
                velocities,
                self._joints_sequence,
                arm,
            )
        )

    def plan(
        self,
        ask: Literal["commit"],
        stamp: float,
        names: Sequence[str],
        times: ArrayLike,
        q: ArrayLike,
        v: ArrayLike,
        tracking_error: ArrayLike,
        velocity_tracking_error: ArrayLike | None = None,
        arm: str = "",
    ) -> int:
        """Ask whether the arm may follow a plan; see `Plan` and `Monitor.commit`.

        The answer is published among the verdicts: `VerdictReader.answer` waits for it.

        Args:
            ask: "commit": the plan is a piece that contains its own stop.
            stamp: Time of the first sample, in [s] on the clock of the joint states.
            names: Names of the joints, in any order. Length n.
            times: Times of the samples, counted from `stamp`, in [s]; from 0 up. Shape (k,).
            q: Positions, in [rad] or [m]. Shape (k, n).
            v: Velocities, in [rad/s] or [m/s]. Shape (k, n).
            tracking_error: Greatest distance of joints from it, in [rad] or [m], one or shape (n,).
            velocity_tracking_error: The same for velocities, one or shape (n,).
            arm: Name of the arm, in a cell with several arms; empty in a cell with one arm.

        Returns:
            The plan's number, which the answer carries.

        Raises:
            StreamError: `ask` is unknown, or shapes do not fit the numbers of names and times.
        """
        if ask != "commit":
            raise StreamError("ask", f"is {ask!r}", expected='"commit"')
        errors = tracking_error, velocity_tracking_error
        return self._send_plan(ask, stamp, names, (times, q, v), errors, arm)

    def share_plan(
        self,
        arm: str,
        until: float,
        stamp: float,
        names: Sequence[str],
        times: ArrayLike,
        q: ArrayLike,
        v: ArrayLike,
        tracking_error: ArrayLike,
        velocity_tracking_error: ArrayLike,
    ) -> None:
        """Share a plan of an arm with the monitors of other arms; see `ArmObstacles.take_plan`.

        From `stamp` to `until`, the arm must only follow the plan, on time or slower, or stop. This
        cannot be revoked. Share only plans that the arm's own monitor has allowed. There is no
        answer.

        Args:
            arm: Name of the arm.
            until: Time until which the arm follows the plan, in [s] on the clock of the joint
                states.
            stamp: Time of the first sample, on the same clock, in [s].
            names: Names of the joints, in any order. Length n.
            times: Times of the samples, counted from `stamp`, in [s]; from 0 up. Shape (k,).
            q: Positions, in [rad] or [m]. Shape (k, n).
            v: Velocities, in [rad/s] or [m/s]. Shape (k, n).
            tracking_error: Greatest distance of joints from it, in [rad] or [m], one or shape (n,).
            velocity_tracking_error: The same for velocities, one or shape (n,).

        Raises:
            StreamError: If shapes do not fit the numbers of names and times.
        """
        self._send_plan(
            "share",
            stamp,
            names,
            (times, q, v),
            (tracking_error, velocity_tracking_error),
            arm,
            float(until),
        )

    def _send_plan(
        self,
        ask: Literal["commit", "share"],
        stamp: float,
        names: Sequence[str],
        samples: tuple[ArrayLike, ArrayLike, ArrayLike],
        errors: tuple[ArrayLike, ArrayLike | None],
        arm: str,
        until: float | None = None,
    ) -> int:
        """Send a plan with its tracking errors; returns its number."""
        self._plans += 1
        times, q, v = samples
        tracking_error, velocity_tracking_error = errors
        count, instants = len(names), np.asarray(times, float)
        shape = (len(instants) if instants.ndim else 0, count)
        self._send(
            PlanMessage(
                ask,
                self._plans,
                float(stamp),
                list(names),
                _pack("times", instants, shape[:1]),
                _pack("q", q, shape),
                _pack("v", v, shape),
                _pack_values("tracking_error", tracking_error, count) or 0.0,
                _pack_values("velocity_tracking_error", velocity_tracking_error, count),
                arm,
                until,
            )
        )
        return self._plans

    def goal(
        self,
        until: float,
        names: Sequence[str],
        *,
        paths: Sequence[tuple[ArrayLike, ArrayLike | None]] | None = None,
        velocity: ArrayLike | None = None,
        chunk: ArrayLike | None = None,
        arm: str = "",
    ) -> int:
        """Send a shield its goal from now on: exactly one of paths, a velocity and a chunk.

        Commands carry the number of the newest accepted goal, and of the newest refused one:
        `VerdictReader.command`.

        Args:
            until: Time in [s] on the clock of the joint states. A goal that arrives later is
                refused, and a velocity ends then.
            names: Names of the joints, in any order. Length n.
            paths: Positions, in [rad] or [m], shape (k, n), and their times, in [s], shape (k,), or
                None for the fastest timing. The shield chooses one of several paths.
            velocity: Joint velocities to keep, in [rad/s] or [m/s]. Shape (n,).
            chunk: The next positions of a policy, in [rad] or [m]. Shape (k, n).
            arm: Name of the arm, in a cell with several arms; empty in a cell with one arm.

        Returns:
            The goal's number.

        Raises:
            StreamError: If shapes do not fit the number of names.
        """
        count = len(names)
        offered = None
        if paths is not None:
            offered = [
                GoalPath(
                    _pack("q of a path", q, (len(np.asarray(q)), count)),
                    None if times is None else _pack("times", times, (len(np.asarray(q)),)),
                )
                for q, times in paths
            ]
        self._goals += 1
        self._send(
            GoalMessage(
                self._goals,
                float(until),
                list(names),
                offered,
                None if velocity is None else _pack("velocity", velocity, (count,)),
                None if chunk is None else _pack("chunk", chunk, (len(np.asarray(chunk)), count)),
                arm,
            )
        )
        return self._goals

    def ignore(
        self,
        token: str,
        link: str,
        ids: str,
        source: str | None = None,
        *,
        until: float | None = None,
        zone: ArrayLike | None = None,
        arm: str = "",
    ) -> int:
        """Request an exemption for wanted contact; see `Monitor.ignore`.

        A note in verdicts names the pairs that are not watched. The run counts refused requests,
        and prints them on standard error.

        Args:
            token: Token of the run, as for a reset.
            link: Name of a link; "*" is any.
            ids: Pattern of obstacle ids.
            source: Source to which the pattern is restricted; None: all sources.
            until: Time at which wanted contact ends, in [s] on the clock of the joint states.
            zone: Corners of the region in which contact is wanted, in [m]. Shape (k, 3).
            arm: Name of the arm, in a cell with several arms; empty in a cell with one arm.

        Returns:
            The exemption's number, for `watch`.

        Raises:
            StreamError: If the zone is not of that shape.
        """
        corners = None
        if zone is not None:
            count = len(np.atleast_1d(np.asarray(zone, float)))
            corners = _pack("zone", zone, (count, 3))
        self._exemptions += 1
        time = None if until is None else float(until)
        self._send(IgnoreMessage(self._exemptions, token, link, ids, source, time, corners, arm))
        return self._exemptions

    def watch(self, number: int, arm: str = "") -> None:
        """Request the end of an exemption.

        Args:
            number: Number that `ignore` returned.
            arm: Name of the arm, in a cell with several arms; empty in a cell with one arm.
        """
        self._send(WatchMessage(number, arm))

    def reset(self, token: str, arm: str = "") -> int:
        """Request the end of a latched STOP; the monitor accepts only the token of its run.

        A cause that persists latches again at once. The answer is published among the verdicts:
        `VerdictReader.reset_answer` waits for it.

        Args:
            token: Of the run.
            arm: Name of the arm whose monitor to reset, in a cell with several arms; empty in a
                cell with one arm.

        Returns:
            The reset's number, which the answer carries.
        """
        self._resets += 1
        self._send(ResetMessage(token, arm, self._resets))
        return self._resets

    def _send(self, message: AnyMessage) -> None:
        self._socket.send(encode(message), zmq.NOBLOCK)

    def close(self) -> None:
        """Close; messages in transit get 0.2 s to arrive."""
        self._socket.close()

    def __exit__(self, *_: object) -> None:
        self.close()


def _pack(field: str, values: ArrayLike, *shapes: tuple[int, ...]) -> bytes:
    array = np.ascontiguousarray(values, "<f8")
    if array.shape not in shapes:
        raise StreamError(
            field, f"has shape {array.shape}", expected=" or ".join(str(shape) for shape in shapes)
        )
    return array.tobytes()


def _pack_points(field: str, points: ArrayLike, count: int) -> bytes:
    if count == 0:
        return b""
    array = np.asarray(points, float)
    middle = array.shape[1:2] if array.ndim == 3 else ()
    return _pack(field, array, (count, *middle, 3))


def _pack_values(field: str, values: ArrayLike | None, count: int) -> Values | None:
    if values is None or np.ndim(values) == 0:
        return None if values is None else float(np.asarray(values))
    return _pack(field, values, (count,))


class VerdictPublisher:
    """Sends verdicts to all readers without waiting: a slow reader misses some.

    Args:
        address: Address to bind, to which readers connect.
        offset: Machine's monotonic clock minus the monitor's, in [s].
        authenticator: Authenticates readers; None: no keys.
        as_json: Whether verdicts and answers are JSON objects, not msgpack maps.
        configuration: Digest of the monitor's configuration, for each verdict; None: none is sent.
        arm: Name of the monitor's arm, for each verdict and command; empty in a cell with one.

    Raises:
        StreamError: The address cannot be used.
    """

    def __init__(
        self,
        address: str,
        offset: float,
        authenticator: Authenticator | None = None,
        *,
        as_json: bool = False,
        configuration: str | None = None,
        arm: str = "",
    ) -> None:
        check_address(address, has_keys=authenticator is not None)
        check_free(address)
        self._offset = offset
        self._configuration = configuration
        self._run = secrets.token_hex(8)
        self._arm = arm
        self._as_json = as_json
        self._authenticator = authenticator
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        if authenticator is not None:
            context = authenticator.context
        self._socket: zmq.Socket[bytes] = context.socket(zmq.PUB)
        # The last verdict of all is to arrive; a reader that takes none cannot delay the end.
        self._socket.set(zmq.LINGER, _LINGER)
        if authenticator is not None:
            # Answers to resets are for those that may reset.
            authenticator.guard(self._socket, ["verdicts", "reset"])
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self._socket.close()
            raise explain(address, error) from None
        self.address = self._socket.get_string(zmq.LAST_ENDPOINT)

    def publish(self, verdict: Verdict) -> None:
        """Send one verdict and answer handshakes of readers; never blocks."""
        if self._authenticator is not None:
            self._authenticator.answer()
        data = encode_verdict(
            verdict,
            self._offset,
            configuration=self._configuration,
            run=self._run,
            arm=self._arm,
            as_json=self._as_json,
        )
        self._socket.send(data, _NOBLOCK)

    def command(self, command: CommandMessage) -> None:
        """Send one command, in the monitor's own time; never blocks."""
        data = encode_command(
            command, self._offset, run=self._run, arm=self._arm, as_json=self._as_json
        )
        self._socket.send(data, _NOBLOCK)

    def answer(self, number: int, verdict: PlanVerdict | ResetVerdict) -> None:
        """Send the answer to a plan or a reset, by its number; never blocks."""
        if isinstance(verdict, ResetVerdict):
            data = encode_reset_verdict(number, verdict, as_json=self._as_json)
        else:
            data = encode_plan_verdict(number, verdict, as_json=self._as_json)
        self._socket.send(data, zmq.NOBLOCK)

    def close(self) -> None:
        """Unbind and close."""
        if not self._socket.closed:
            remove_file(self.address)
        self._socket.close()


class VerdictReader(contextlib.AbstractContextManager["VerdictReader"]):
    """Receives verdicts, for a controller. The controller must brake on STOP, and on silence.

    Times of the verdicts are seconds of the machine's monotonic clock. Messages that are malformed
    or of another version are counted in `refused`, and otherwise count as silence.

    Args:
        address: Address of the monitor's verdicts.
        keys: Keys of this client, if the monitor requires keys.

    Attributes:
        command: The newest command of a shield received so far; None before the first. The
            controller must follow it if it joins the present motion (`CommandMessage.joins`).
            Otherwise the controller must follow the present motion to its end.

    Raises:
        StreamError: The address cannot be used; beyond this machine it can be with keys only.
    """

    def __init__(self, address: str, keys: Keys | None = None) -> None:
        self.address = address
        self.refused = 0
        self.command: CommandMessage | None = None
        self._last: Verdict | None = None
        self._answers: deque[tuple[int, PlanVerdict | ResetVerdict]] = deque(maxlen=_ANSWERS)
        self._socket = _connect(address, zmq.SUB, keys)
        self._socket.subscribe(b"")

    def latest(self, timeout: float = 0.0) -> Verdict | None:
        """The newest verdict received so far; None before the first.

        Waits up to `timeout` [s], and only if nothing new has arrived.
        """
        if self._socket.poll(int(1000 * timeout)):
            # A sender that never pauses must not hold the reader.
            for _ in range(QUEUE_LIMIT):
                if not self._receive():
                    break
        return self._last

    def answer(self, number: int, timeout: float = 0.0) -> PlanVerdict | None:
        """The answer to a plan; None if there is none yet. Also receives verdicts.

        Args:
            number: Number that `Publisher.plan` returned.
            timeout: How long to wait for it, in [s].
        """
        return self._find_answer(PlanVerdict, number, timeout)

    def reset_answer(self, number: int, timeout: float = 0.0) -> ResetVerdict | None:
        """The answer to a reset; None if there is none yet. Also receives verdicts.

        Args:
            number: Number that `Publisher.reset` returned.
            timeout: How long to wait for it, in [s].
        """
        return self._find_answer(ResetVerdict, number, timeout)

    def _find_answer(self, kind: type[_Answer], number: int, timeout: float) -> _Answer | None:
        until = time.monotonic() + timeout
        after = 0
        while True:
            for answered, verdict in self._answers:
                if answered == number and isinstance(verdict, kind):
                    return verdict
            left = until - time.monotonic()
            # What waits already is looked at, but a sender that never pauses must not hold us.
            after += left <= 0.0
            if after > _MESSAGES_AFTER or not self._socket.poll(max(0, math.ceil(1000 * left))):
                return None
            self._receive()

    def silent(self, now: float | None = None) -> bool:
        """Whether no verdict is valid at `now` (default: the present)."""
        if now is None:
            now = time.monotonic()
        return self._last is None or not now <= self._last.valid_until

    def speed_scale(self, now: float | None = None) -> float:
        """The permitted speed scale, 0 to 1: 0 in STOP, and after `valid_until`.

        Uses what `latest` has received; receives nothing itself.
        """
        if self._last is None or self.silent(now) or self._last.level is Level.STOP:
            return 0.0
        scale = self._last.speed_scale
        return scale if 0.0 <= scale <= 1.0 else 0.0

    def _receive(self) -> bool:
        try:
            parts = self._socket.recv_multipart(zmq.NOBLOCK)
        except zmq.Again:
            return False
        try:
            received = decode_answer(parts[0])
        except MessageError:
            self.refused += 1
            return True
        if isinstance(received, Verdict):
            self._last = received
        elif isinstance(received, CommandMessage):
            self.command = received
        else:
            self._answers.append(received)
        return True

    def __iter__(self) -> Iterator[Verdict]:
        """Iterate over all verdicts, without end; waits for each."""
        while True:
            before = self._last
            self._socket.poll()
            self._receive()
            if self._last is not None and self._last is not before:
                yield self._last

    def close(self) -> None:
        """Disconnect."""
        self._socket.close()

    def __exit__(self, *_: object) -> None:
        self.close()
