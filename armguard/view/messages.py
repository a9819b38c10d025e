"""The feed of the view: what a monitor tells it.

Three messages in msgpack: a `SceneMessage` says what does not change (robot, placement, cover) and
is repeated, so that a view that attaches late gets it as well; a `FrameMessage` is one moment; a
`StatusMessage` says what a monitor does that has no moments yet, or no more.
Arrays travel as packed little-endian bytes, because thirty frames a second are made within the
loop of the monitor. Anything that arrives is checked once, in `decode_message`.
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
"""Goes up when a view that was made before could misread what is told now."""

IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class FeedVersionError(ArmguardError):
    """The monitor is newer than this view."""


def _pack(values: ArrayLike, dtype: str) -> bytes:
    return np.ascontiguousarray(values, dtype=dtype).tobytes()


def _unpack(field: str, dtype: str, *shape: int) -> Any:
    """A property: what a packed field holds, as an array."""
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
    """What a view needs to find where the arm can be until it rests.

    Attributes:
        robot: The robot as plain data, in JSON (`armguard.robot.portable`).
        response_time: Until the next verdict is obeyed, in [s].
        reaction_time: From a STOP to braking torque, in [s].
        velocity: What joints keep to, in [rad]/[s] or [m]/[s].
        acceleration: With which they speed up at most, in [rad]/[s²] or [m]/[s²].
        payload: What the arm carries at most, in [kg].
    """

    robot: bytes
    response_time: float
    reaction_time: float
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    payload: float


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """What a view cannot know from the monitor alone.

    Attributes:
        urdf: Path of a URDF that armguard does not come with; the view itself reads its meshes.
        package_dirs: Folders in which its `package://` names are looked up.
        reset_address: Where the monitor takes a reset; empty: from its standard input alone.
        obeys_reset: Whether it obeys one that brings its token.
        arm: Which arm a reset has to name; empty where the cell has one.
        is_recorded: Whether frames come from a recording, each to be kept and none to be dropped;
            then no tick waits, and each STOP can be explained.
        recording: File to which this run is recorded; empty: to none.
        configuration: Digest of what the monitor was made with; empty: it is not told.
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
        slow_margin: Beyond the stopping time, in [s]: SLOW below.
        aware_margin: Beyond the stopping time, in [s]: AWARE below.
        levels: The levels of the cover's tree, coarsest first; each covers the whole arm.
        sensors: Frames that obstacles are measured in: name and pose in the world, row-major.
        stopping: How the arm stops; None where that is not told.
        version: Of the feed.
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
    """What a monitor does while it has no moment to show.

    Attributes:
        text: In words, such as "compiling kernel 12 of about 220".
        is_over: Whether no moment will follow.
        version: Of the feed.
    """

    text: str
    is_over: bool = False
    version: int = FEED_VERSION


class VerdictSummary(msgspec.Struct, frozen=True, kw_only=True):
    """What the banner of the view says.

    Attributes:
        level: Name of the level: STOP, SLOW, AWARE or CLEAR.
        contact_time: Earliest contact from now, in [s].
        stop_time: Time that the arm needs to stop, in [s].
        speed_scale: Share of its speed that the arm may use, 0 to 1.
        link: Link of the pair that decides; empty if none.
        obstacle: Obstacle of that pair.
        complete: Whether every pair was evaluated in time.
        reasons: What the verdict rests on, in plain words.
        effects: What each reason does to the level: "note", "standing" or "latched".
        since: When this level was taken on, in [s] of the monitor; None: not told.
        cause: What it began with, in plain words; empty where it is latched, or not told.
        rises_at: The earliest time at which a level that is held may rise, in [s] of the monitor;
            None: it is not held.
        harm_time: Earliest contact from now that no contact limit permits, in [s]; None: no limits
            are stated.
        contact_speed: How fast an obstacle could be touched before the arm rests, in [m/s]; None:
            no limits are stated.
        proved_until: When the arm rests at the latest, if it follows the proved piece that it is
            on, in [s] of the monitor; None: it is on none.
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
    """What a shield commands.

    Attributes:
        scale: How fast the arm goes, of what was asked for, 0 to 1.
        reason: Why it is slower, in plain words; empty: it is not.
        progress: How far the arm has come on its path, 0 to 1.
        is_proved: Whether the motion is proved to its rest; else the arm is to brake.
    """

    scale: float
    reason: str
    progress: float
    is_proved: bool


class Load(msgspec.Struct, frozen=True, kw_only=True):
    """How hard the monitor works.

    Attributes:
        ticks: Ticks so far.
        late: How many of them came late.
        evaluated: Contact-time evaluations in the last one.
        p50: Half of the ticks took no longer, in [s].
        p99: 99 of a hundred took no longer, in [s].
    """

    ticks: int
    late: int
    evaluated: int
    p50: float
    p99: float


class SourceReport(msgspec.Struct, frozen=True, kw_only=True):
    """How a source of states is heard.

    Attributes:
        name: Of the source; "robot" is what tells joint states.
        age: Of what it told last, in [s]; None: it was never heard.
        rate: How many messages came in the last second or so, in [Hz]; None: not known yet.
        timeout: How old that may be, in [s]; None: as old as it likes.
    """

    name: str
    age: float | None
    rate: float | None = None
    timeout: float | None = None


class Latch(msgspec.Struct, frozen=True, kw_only=True):
    """A reason that holds a STOP until a reset.

    Attributes:
        reason: In plain words.
        since: When it was first told, in [s] of the monitor.
        remedy: What to do about it, in plain words.
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
        packed_counts: Points of each; uint8.
        packed_points: All points in a row, in the world, in [m]; float32.
        packed_radii: In [m]; float32.
        packed_refused: 1 where its latest state was refused; uint8.
        packed_times: Contact time of its most imminent pair, in [s]; float32.
        packed_statics: 1 where it stands still for ever, 2 where it is an entrance; uint8.
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
            statics: Whether it stands still for ever; None: none does. Shape (n,).
            entrances: Whether it is a region out of which a body may come at any moment; None: none
                is. Each stands still as well. Shape (n,).
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
        """Whether each stands still for ever, as entrances do. Shape (n,)."""
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
        packed_buckets: How many pairs sit in each bucket, 0 to 15; uint32. Empty: not told.
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
    """How many pairs sit in each bucket. Shape (16,), or (0,) where that is not told."""


class FrameMessage(msgspec.Struct, frozen=True, tag="frame", kw_only=True):
    """One moment.

    Attributes:
        sequence: Number of the tick; 0 while there is no joint state to judge.
        now: Time of the monitor, in [s].
        q: Joint positions, in [rad] or [m]. Length of `SceneMessage.joints`.
        verdict: What the monitor says.
        wall: Time of day, in [s] since 1970; 0 where that is not told.
        v: Joint velocities, in [rad]/[s] or [m]/[s]; empty where they are not told.
        arm_age: Of the joint state, in [s].
        load: How hard the monitor works; None where that is not known.
        sphere_times: Soonest contact of each cover sphere, in [s]; float32.
        obstacles: What is in the cell.
        omitted: How many obstacles, less imminent than those, are left out.
        pairs: The imminent pairs.
        sources: How the sources of states are heard.
        latches: What holds a STOP until a reset.
        refused_resets: How many resets were refused so far.
        obeyed_resets: How many resets were obeyed so far.
        reach: Where the most imminent obstacle can be when the arm has come to rest.
        plan: Where the arm is going as it was told: joint positions, float32, in rows of q.
        path: Where it is asked to go beyond that, alike.
        command: Of the shield that moves the arm; None: it is only watched.
        explanation: Why the verdict is as it is, in lines; empty where nothing was asked.
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
    """A message as it goes over the wire."""
    return _encoder.encode(message)


def decode_message(payload: bytes) -> Message:
    """Read and check a message.

    Raises:
        ArmguardError: It is malformed, contradicts itself, or is of a later version of the feed.
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
    """Version of the feed that a message of unknown form states, 0 if it states none."""
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
            remedy="start the view of the armguard that the monitor is of",
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
