"""The feed of the view: the messages from a monitor to its views.

There are three messages, in msgpack. A `SceneMessage` has what does not change: robot, placement,
cover. It is repeated, so that a view that attaches late also gets it. A `FrameMessage` is one
moment. A `StatusMessage` describes a monitor before its first or after its last moment. Arrays are
packed little-endian bytes, because the loop of the monitor makes 30 frames a second.
`decode_message` checks each received message once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.view.buckets import BUCKET_COUNT

FEED_VERSION = 2
"""Version of the feed; increases when an older view could misread a message."""

IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class FeedVersionError(ArmguardError):
    """The monitor is newer than this view."""


def _pack(values: ArrayLike, dtype: str) -> bytes:
    return np.ascontiguousarray(values, dtype=dtype).tobytes()


def _unpack(field: str, dtype: str, *shape: int) -> Any:
    """A property that unpacks a field into an array."""
    return property(lambda self: np.frombuffer(getattr(self, field), dtype).reshape(shape or -1))


class LinkCover(msgspec.Struct, frozen=True):
    """The cover spheres of one link.

    Attributes:
        link: Name of the link.
        joint: Name of the joint that moves it; the spheres are in that joint's frame.
        packed: x, y, z, radius, in [m]; float32.
    """

    link: str
    joint: str
    packed: bytes

    @classmethod
    def pack(cls, link: str, joint: str, spheres: ArrayLike) -> LinkCover:
        """Pack `spheres`: x, y, z, radius, in [m]. Shape (n, 4)."""
        return cls(link, joint, _pack(spheres, "<f4"))

    spheres = _unpack("packed", "<f4", -1, 4)
    """x, y, z, radius, in [m]. Shape (n, 4)."""


class StoppingRule(msgspec.Struct, frozen=True, kw_only=True):
    """Data to compute where the arm can be until it is at rest.

    Attributes:
        robot: The robot as plain data, in JSON (`armguard.robot.portable`).
        response_time: Time until the next verdict is obeyed, in [s].
        reaction_time: Time from a STOP to braking torque, in [s].
        velocity: Operating velocities of the joints, in [rad]/[s] or [m]/[s].
        acceleration: Operating accelerations of the joints, in [rad]/[s²] or [m]/[s²].
        payload: Greatest payload, in [kg].
    """

    robot: bytes
    response_time: float
    reaction_time: float
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    payload: float


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """Facts for a view that the monitor does not know.

    Attributes:
        urdf: Path of the URDF of a robot that armguard does not know; the view reads its meshes.
        package_dirs: Folders in which its `package://` names are looked up.
        reset_address: Address at which the monitor reads resets; empty: from standard input only.
        obeys_reset: Whether it obeys a reset that carries its token.
        arm: Name of the arm that a reset must carry; empty in a cell with one arm.
        is_recorded: Whether frames come from a recording. Then every frame is kept, since no tick
            waits, and each STOP can be explained.
        recording: File of the run's recording; empty: none.
        configuration: Digest of the monitor's configuration; empty: unknown.
    """

    urdf: str = ""
    package_dirs: tuple[str, ...] = ()
    reset_address: str = ""
    obeys_reset: bool = False
    arm: str = ""
    is_recorded: bool = False
    recording: str = ""
    configuration: str = ""


class SceneMessage(Origin, frozen=True, tag="scene", kw_only=True):
    """What does not change while the monitor runs.

    Attributes:
        robot: Name of the robot: one that armguard knows, unless `urdf` is given.
        joints: Watched joints, in the order of `FrameMessage.q`.
        base: Pose of the URDF's root in the world, a homogeneous matrix in row-major order.
        cover: The arm's spheres; their order is that of `FrameMessage.sphere_times`.
        period: One tick of the monitor, in [s]: the unit of the buckets.
        slow_margin: Margin beyond the stop time, in [s], below which the level is SLOW.
        aware_margin: Margin beyond the stop time, in [s], below which the level is AWARE.
        levels: The levels of the cover's tree, coarsest first; each covers the whole arm.
        sensors: Frames that obstacles are measured in: name and pose in the world, row-major.
        stopping: How the arm stops; None: unknown.
        version: Version of the feed.
    """

    robot: str
    joints: tuple[str, ...]
    cover: tuple[LinkCover, ...]
    period: float
    base: tuple[float, ...] = IDENTITY
    slow_margin: float = 0.1
    aware_margin: float = 0.3
    levels: tuple[tuple[LinkCover, ...], ...] = ()
    sensors: tuple[tuple[str, tuple[float, ...]], ...] = ()
    stopping: StoppingRule | None = None
    version: int = FEED_VERSION


class StatusMessage(msgspec.Struct, frozen=True, tag="status", kw_only=True):
    """State of a monitor that has no moment to show.

    Attributes:
        text: In words, such as "compiling kernel 12 of about 220".
        is_over: Whether no moment will follow.
        version: Version of the feed.
    """

    text: str
    is_over: bool = False
    version: int = FEED_VERSION


class VerdictSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The part of a verdict that the view shows.

    Attributes:
        level: Name of the level: STOP, SLOW, AWARE or CLEAR.
        contact_time: Earliest contact from now, in [s].
        stop_time: Time that the arm needs to stop, in [s].
        speed_scale: Share of its speed that the arm may use, 0 to 1.
        link: Link of the pair that decides; empty if none.
        obstacle: Obstacle of that pair.
        complete: Whether every pair was evaluated in time.
        reasons: Reasons of the verdict, in words.
        effects: What each reason does to the level: "note", "standing" or "latched".
        since: Time at which this level began, in [s] of the monitor; None: unknown.
        cause: Cause of its beginning, in words; empty if it is latched or unknown.
        rises_at: The earliest time at which a level that is held may rise, in [s] of the monitor;
            None: it is not held.
        harm_time: Earliest contact from now that no contact limit permits, in [s]; None: no contact
            limits.
        contact_speed: Greatest speed of contact before the arm is at rest, in [m/s]; None: no
            contact limits.
        proved_until: Latest time at which the arm is at rest if it follows its committed piece, in
            [s] of the monitor; None: it is on no proved piece.
    """

    level: str
    contact_time: float
    stop_time: float
    speed_scale: float = 0.0
    link: str = ""
    obstacle: str = ""
    complete: bool = True
    reasons: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    since: float | None = None
    cause: str = ""
    rises_at: float | None = None
    harm_time: float | None = None
    contact_speed: float | None = None
    proved_until: float | None = None


class CommandSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Summary of a shield's command.

    Attributes:
        scale: Pace of the arm as a fraction of the requested pace, 0 to 1.
        reason: Why it is slower, in words; empty if it is not.
        progress: Progress of the arm on its path, 0 to 1.
        is_proved: Whether the motion is proved until rest; if not, the arm must brake.
    """

    scale: float
    reason: str
    progress: float
    is_proved: bool


class Load(msgspec.Struct, frozen=True, kw_only=True):
    """Load of the monitor.

    Attributes:
        ticks: Ticks so far.
        late: How many of them came late.
        evaluated: Contact-time evaluations in the last one.
        p50: Median duration of a tick, in [s].
        p99: 99th percentile of the duration of a tick, in [s].
    """

    ticks: int
    late: int
    evaluated: int
    p50: float
    p99: float


class SourceReport(msgspec.Struct, frozen=True, kw_only=True):
    """State of a source.

    Attributes:
        name: Name of the source; "robot" sends joint states.
        age: Age of its last message, in [s]; None: it never sent one.
        rate: Rate of its messages during about the last second, in [Hz]; None: not known yet.
        timeout: Greatest permitted age, in [s]; None: no timeout.
    """

    name: str
    age: float | None
    rate: float | None = None
    timeout: float | None = None


class Latch(msgspec.Struct, frozen=True, kw_only=True):
    """A reason that holds a STOP until a reset.

    Attributes:
        reason: The reason in words.
        since: Time at which it was first reported, in [s] of the monitor.
        remedy: What to do about it, in words.
    """

    reason: str
    since: float
    remedy: str = ""


class Balls(msgspec.Struct, frozen=True):
    """Centres and radii.

    Attributes:
        packed: x, y, z, radius in the world, in [m]; float32.
    """

    packed: bytes = b""

    @classmethod
    def pack(cls, balls: ArrayLike) -> Balls:
        """Pack `balls`: x, y, z, radius, in [m]. Shape (n, 4)."""
        return cls(_pack(balls, "<f4"))

    values = _unpack("packed", "<f4", -1, 4)
    """x, y, z, radius, in [m]. Shape (n, 4)."""


class ObstacleShapes(msgspec.Struct, frozen=True):
    """Shapes of the obstacles in one frame, each the hull of up to 8 points, rounded by a radius.

    Attributes:
        ids: Their names.
        packed_counts: Number of points of each; uint8.
        packed_points: All points in the world, flat, in [m]; float32.
        packed_radii: In [m]; float32.
        packed_refused: 1 where its latest state was refused; uint8.
        packed_times: Contact time of its most imminent pair, in [s]; float32.
        packed_statics: 1 for a static, 2 for an entrance, else 0; uint8.
    """

    ids: tuple[str, ...] = ()
    packed_counts: bytes = b""
    packed_points: bytes = b""
    packed_radii: bytes = b""
    packed_refused: bytes = b""
    packed_times: bytes = b""
    packed_statics: bytes = b""

    @classmethod
    def pack(
        cls,
        ids: Sequence[str],
        points: ArrayLike,
        radii: ArrayLike,
        *,
        counts: ArrayLike | None = None,
        refused: ArrayLike | None = None,
        times: ArrayLike | None = None,
        statics: ArrayLike | None = None,
        entrances: ArrayLike | None = None,
    ) -> ObstacleShapes:
        """Pack the obstacles of one frame.

        Args:
            ids: Names. Length n.
            points: In the world, in [m]; of each row the first `counts` are used.
                Shape (n, 3) or (n, k, 3).
            radii: In [m]. Shape (n,).
            counts: Points of each obstacle; None: all of k. Shape (n,).
            refused: Whether its latest state was refused; None: none. Shape (n,).
            times: Contact time of its most imminent pair, in [s]; None: never. Shape (n,).
            statics: Whether it is static; None: none is. Shape (n,).
            entrances: Whether it is an entrance; None: none is. An entrance must also be static.
                Shape (n,).
        """
        number = len(ids)
        stands = np.zeros(number, dtype="u1")
        for value, chosen in ((1, statics), (2, entrances)):
            if chosen is not None:
                stands[np.asarray(chosen, dtype=np.bool_)] = value
        rows = np.asarray(points, dtype="<f4")
        width = rows.size // (3 * number) if number else 0
        rows = rows.reshape(number, width, 3)
        used = np.full(number, width) if counts is None else np.asarray(counts)
        return cls(
            tuple(ids),
            _pack(used, "u1"),
            rows[np.arange(width) < used[:, None]].tobytes(),
            _pack(radii, "<f4"),
            _pack(np.zeros(number) if refused is None else refused, "u1"),
            _pack(np.full(number, np.inf) if times is None else times, "<f4"),
            stands.tobytes(),
        )

    points = _unpack("packed_points", "<f4", -1, 3)
    """Points of all obstacles, in [m]. Shape (sum of counts, 3)."""
    radii = _unpack("packed_radii", "<f4")
    """In [m]. Shape (n,)."""
    times = _unpack("packed_times", "<f4")
    """Contact time of the most imminent pair of each, in [s]. Shape (n,)."""

    @property
    def counts(self) -> NDArray[np.int64]:
        """Points of each obstacle. Shape (n,)."""
        return np.frombuffer(self.packed_counts, "u1").astype(np.int64)

    @property
    def owners(self) -> NDArray[np.int64]:
        """Number of each point's obstacle. Shape (sum of counts,)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @property
    def bodies(self) -> list[NDArray[np.float64]]:
        """Points of each obstacle, in [m]. Shape (count, 3) each."""
        return np.split(self.points.astype(np.float64), np.cumsum(self.counts))[:-1]

    @property
    def refused(self) -> NDArray[np.bool_]:
        """Whether the latest state of each was refused. Shape (n,)."""
        return np.frombuffer(self.packed_refused, "u1") > 0

    @property
    def statics(self) -> NDArray[np.bool_]:
        """Whether each is static, as entrances are. Shape (n,)."""
        return np.frombuffer(self.packed_statics, "u1") > 0

    @property
    def entrances(self) -> NDArray[np.bool_]:
        """Whether each is an entrance. Shape (n,)."""
        return np.frombuffer(self.packed_statics, "u1") == 2


class Pairs(msgspec.Struct, frozen=True):
    """Imminent pairs of one frame, the most imminent first.

    Attributes:
        packed_links: Number of each link, in the order of `SceneMessage.cover`; uint16.
        packed_obstacles: Number of each obstacle, in the order of the frame's; uint16.
        packed_times: Contact time of each, in [s]; float32.
        packed_buckets: Number of pairs in each bucket, 0 to 15; uint32. Empty: unknown.
    """

    packed_links: bytes = b""
    packed_obstacles: bytes = b""
    packed_times: bytes = b""
    packed_buckets: bytes = b""

    @classmethod
    def pack(
        cls,
        links: ArrayLike,
        obstacles: ArrayLike,
        times: ArrayLike,
        buckets: ArrayLike | None = None,
    ) -> Pairs:
        """Pack pairs: `links`, `obstacles` and `times` in [s], shape (m,); `buckets`, (16,)."""
        return cls(
            _pack(links, "<u2"),
            _pack(obstacles, "<u2"),
            _pack(times, "<f4"),
            b"" if buckets is None else _pack(buckets, "<u4"),
        )

    links = _unpack("packed_links", "<u2")
    """Number of each link. Shape (m,)."""
    obstacles = _unpack("packed_obstacles", "<u2")
    """Number of each obstacle. Shape (m,)."""
    times = _unpack("packed_times", "<f4")
    """Contact time of each, in [s]. Shape (m,)."""
    buckets = _unpack("packed_buckets", "<u4")
    """Number of pairs in each bucket. Shape (16,), or (0,) if unknown."""


class FrameMessage(msgspec.Struct, frozen=True, tag="frame", kw_only=True):
    """One moment.

    Attributes:
        sequence: Number of the tick; 0 while there is no joint state to judge.
        now: Time of the monitor, in [s].
        q: Joint positions, in [rad] or [m]. Length of `SceneMessage.joints`.
        verdict: The verdict.
        wall: Time of day, in [s] since 1970; 0: unknown.
        v: Joint velocities, in [rad]/[s] or [m]/[s]; empty if unknown.
        arm_age: Age of the joint state, in [s].
        load: Load of the monitor; None: unknown.
        sphere_times: Least contact time of each cover sphere, in [s]; float32.
        obstacles: The obstacles in the cell.
        omitted: Number of further, less imminent obstacles that are left out.
        pairs: The imminent pairs.
        sources: States of the sources.
        latches: Reasons that hold a STOP until a reset.
        refused_resets: Number of refused resets so far.
        obeyed_resets: Number of obeyed resets so far.
        reach: Balls that the most imminent obstacle can reach until the arm is at rest.
        plan: Rest of the newest plan: joint positions, float32, in rows of q.
        path: Rest of the shield's path beyond the plan, in the same form.
        command: Command of the shield that moves the arm; None: the arm is only watched.
        explanation: Explanation of the verdict in lines; empty if none was requested.
    """

    sequence: int
    now: float
    q: tuple[float, ...]
    verdict: VerdictSummary
    wall: float = 0.0
    v: tuple[float, ...] = ()
    arm_age: float = 0.0
    load: Load | None = None
    sphere_times: bytes = b""
    obstacles: ObstacleShapes = ObstacleShapes()
    omitted: int = 0
    pairs: Pairs = Pairs()
    sources: tuple[SourceReport, ...] = ()
    latches: tuple[Latch, ...] = ()
    refused_resets: int = 0
    obeyed_resets: int = 0
    reach: Balls = Balls()
    plan: bytes = b""
    path: bytes = b""
    command: CommandSummary | None = None
    explanation: tuple[str, ...] = ()


Message = SceneMessage | FrameMessage | StatusMessage


# NumPy's scalars are numbers as well.
_encoder = msgspec.msgpack.Encoder(enc_hook=np.generic.item)
_decoder = msgspec.msgpack.Decoder(Message)


def encode_message(message: Message) -> bytes:
    """Encode a message for the wire."""
    return _encoder.encode(message)


def decode_message(payload: bytes) -> Message:
    """Read and check a message.

    Raises:
        ArmguardError: The message is malformed or inconsistent, or is of a later version of the
            feed.
    """
    try:
        message: Message = _decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        _check_version(_read_version(payload))
        raise ArmguardError("feed message", str(error)) from error
    if not isinstance(message, FrameMessage):
        _check_version(message.version)
    for name, sound in _check_sizes(message):
        if not sound:
            raise ArmguardError("feed message", f"{name} does not have the size it should have")
    return message


def _read_version(payload: bytes) -> int:
    """Version of the feed in a message of unknown form; 0 without a version."""
    try:
        found = msgspec.msgpack.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return 0
    version = found.get("version") if isinstance(found, dict) else None
    return version if isinstance(version, int) else 0


def _check_version(version: int) -> None:
    if version > FEED_VERSION:
        raise FeedVersionError(
            "feed",
            f"is of version {version}, which this view cannot read",
            expected=f"version {FEED_VERSION}",
            remedy="start the view with the armguard version of the monitor",
        )


def _check_sizes(message: Message) -> list[tuple[str, bool]]:
    if isinstance(message, StatusMessage):
        return []
    if isinstance(message, SceneMessage):
        covers = [*message.cover, *(link for level in message.levels for link in level)]
        return [
            ("period", 0.0 < message.period < np.inf),
            ("base", len(message.base) == 16),
            ("sensors", all(len(pose) == 16 for _, pose in message.sensors)),
            *((f"cover of {link.link}", len(link.packed) % 16 == 0) for link in covers),
        ]
    obstacles, pairs = message.obstacles, message.pairs
    number, width = len(obstacles.ids), max(4 * len(message.q), 1)
    return [
        ("v", len(message.v) in (0, len(message.q))),
        ("sphere_times", len(message.sphere_times) % 4 == 0),
        ("plan", len(message.plan) % width == 0),
        ("path", len(message.path) % width == 0),
        ("reach", len(message.reach.packed) % 16 == 0),
        ("obstacles.counts", len(obstacles.packed_counts) == number),
        ("obstacles.counts", bool(np.all(obstacles.counts > 0))),
        ("obstacles.points", len(obstacles.packed_points) == 12 * len(obstacles.owners)),
        ("obstacles.radii", len(obstacles.packed_radii) == 4 * number),
        ("obstacles.refused", len(obstacles.packed_refused) == number),
        ("obstacles.times", len(obstacles.packed_times) == 4 * number),
        ("obstacles.statics", len(obstacles.packed_statics) == number),
        ("pairs.links", 2 * len(pairs.packed_links) == len(pairs.packed_times)),
        ("pairs.obstacles", 2 * len(pairs.packed_obstacles) == len(pairs.packed_times)),
        ("pairs.obstacles", len(pairs.packed_obstacles) % 2 == 0),
        ("pairs.obstacles", bool(np.all(pairs.obstacles < number))),
        ("pairs.buckets", len(pairs.packed_buckets) in (0, 4 * BUCKET_COUNT)),
    ]
