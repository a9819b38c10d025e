"""The feed of the view: what a monitor tells it.

Two messages in msgpack: a `SceneMessage` says what does not change (robot, placement, cover) and
is repeated, so that a view that attaches late gets it as well; a `FrameMessage` is one moment.
Arrays travel as packed little-endian bytes, because thirty frames a second are made within the
loop of the monitor. Anything that arrives is checked once, in `decode_message`.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.view.buckets import NO_BUCKET

IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def _pack(values: ArrayLike, dtype: str) -> bytes:
    return np.ascontiguousarray(values, dtype=dtype).tobytes()


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

    @property
    def spheres(self) -> NDArray[np.float32]:
        """x, y, z, radius, in [m]. Shape (n, 4)."""
        return np.frombuffer(self.packed, "<f4").reshape(-1, 4)


class SceneMessage(msgspec.Struct, frozen=True, tag="scene", kw_only=True):
    """What does not change while the monitor runs.

    Attributes:
        robot: Name of the robot: one that armguard knows, unless `urdf` is given.
        joints: Watched joints, in the order of `FrameMessage.q`.
        base: Pose of the URDF's root in the world, a homogeneous matrix in row-major order.
        cover: The arm's spheres; their order is that of `FrameMessage.sphere_buckets`.
        period: One tick of the monitor, in [s]: the unit of the buckets.
        urdf: Path of a URDF that armguard does not come with; the view itself reads its meshes.
        package_dirs: Folders in which its `package://` names are looked up.
        locked: Where joints that are not watched rest, in [rad] or [m]; those not named: at zero.
    """

    robot: str
    joints: tuple[str, ...]
    cover: tuple[LinkCover, ...]
    period: float
    base: tuple[float, ...] = IDENTITY
    urdf: str = ""
    package_dirs: tuple[str, ...] = ()
    locked: dict[str, float] = {}


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
    """

    level: str
    contact_time: float
    stop_time: float
    speed_scale: float = 0.0
    link: str = ""
    obstacle: str = ""
    complete: bool = True
    reasons: tuple[str, ...] = ()


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


class ObstacleShapes(msgspec.Struct, frozen=True):
    """Shapes of the obstacles in one frame, each the hull of up to 8 points, rounded by a radius.

    Attributes:
        ids: Their names.
        packed_counts: Points of each; uint8.
        packed_points: All points in a row, in the world, in [m]; float32.
        packed_radii: In [m]; float32.
        packed_refused: 1 where its latest state was refused; uint8.
        packed_buckets: Bucket of its most imminent pair; uint8.
    """

    ids: tuple[str, ...] = ()
    packed_counts: bytes = b""
    packed_points: bytes = b""
    packed_radii: bytes = b""
    packed_refused: bytes = b""
    packed_buckets: bytes = b""

    @classmethod
    def pack(
        cls,
        ids: Sequence[str],
        points: ArrayLike,
        radii: ArrayLike,
        *,
        counts: ArrayLike | None = None,
        refused: ArrayLike | None = None,
        buckets: ArrayLike | None = None,
    ) -> ObstacleShapes:
        """Pack the obstacles of one frame.

        Args:
            ids: Names. Length n.
            points: In the world, in [m]; of each row the first `counts` are used.
                Shape (n, 3) or (n, k, 3).
            radii: In [m]. Shape (n,).
            counts: Points of each obstacle; None: all of k. Shape (n,).
            refused: Whether its latest state was refused; None: none. Shape (n,).
            buckets: Bucket of its most imminent pair; None: `NO_BUCKET`. Shape (n,).
        """
        number = len(ids)
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
            _pack(np.full(number, NO_BUCKET) if buckets is None else buckets, "u1"),
        )

    @property
    def counts(self) -> NDArray[np.uint8]:
        """Points of each obstacle. Shape (n,)."""
        return np.frombuffer(self.packed_counts, "u1")

    @property
    def points(self) -> NDArray[np.float32]:
        """Points of all obstacles, in [m]. Shape (sum of counts, 3)."""
        return np.frombuffer(self.packed_points, "<f4").reshape(-1, 3)

    @property
    def radii(self) -> NDArray[np.float32]:
        """In [m]. Shape (n,)."""
        return np.frombuffer(self.packed_radii, "<f4")

    @property
    def refused(self) -> NDArray[np.bool_]:
        """Whether the latest state of each was refused. Shape (n,)."""
        return np.frombuffer(self.packed_refused, "u1").astype(np.bool_)

    @property
    def buckets(self) -> NDArray[np.uint8]:
        """Bucket of the most imminent pair of each. Shape (n,)."""
        return np.frombuffer(self.packed_buckets, "u1")


class Pairs(msgspec.Struct, frozen=True):
    """Imminent pairs of one frame, the most imminent first.

    Attributes:
        packed_segments: Point on the arm, point on the obstacle, in [m]; float32.
        packed_buckets: Bucket of each pair; uint8.
    """

    packed_segments: bytes = b""
    packed_buckets: bytes = b""

    @classmethod
    def pack(cls, segments: ArrayLike, buckets: ArrayLike) -> Pairs:
        """Pack `segments`, in [m], shape (m, 2, 3), and `buckets`, shape (m,)."""
        return cls(_pack(segments, "<f4"), _pack(buckets, "u1"))

    @property
    def segments(self) -> NDArray[np.float32]:
        """Point on the arm, point on the obstacle, in [m]. Shape (m, 2, 3)."""
        return np.frombuffer(self.packed_segments, "<f4").reshape(-1, 2, 3)

    @property
    def buckets(self) -> NDArray[np.uint8]:
        """Bucket of each pair. Shape (m,)."""
        return np.frombuffer(self.packed_buckets, "u1")


class FrameMessage(msgspec.Struct, frozen=True, tag="frame", kw_only=True):
    """One moment.

    Attributes:
        sequence: Number of the tick.
        now: Time of the monitor, in [s].
        q: Joint positions, in [rad] or [m]. Length of `SceneMessage.joints`.
        verdict: What the monitor says.
        sphere_buckets: Bucket of each cover sphere's most imminent pair; uint8.
        load: How hard the monitor works; None where that is not known.
        obstacles: What is in the cell.
        pairs: The imminent pairs.
    """

    sequence: int
    now: float
    q: tuple[float, ...]
    verdict: VerdictSummary
    load: Load | None = None
    sphere_buckets: bytes = b""
    obstacles: ObstacleShapes = ObstacleShapes()
    pairs: Pairs = Pairs()


Message = SceneMessage | FrameMessage


def _plain(value: object) -> object:
    """NumPy's scalars are numbers as well."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot be told to a view")


_encoder = msgspec.msgpack.Encoder(enc_hook=_plain)
_decoder = msgspec.msgpack.Decoder(Message)


def encode_message(message: Message) -> bytes:
    """A message as it goes over the wire."""
    return _encoder.encode(message)


def decode_message(payload: bytes) -> Message:
    """Read and check a message.

    Raises:
        ArmguardError: It is malformed or contradicts itself.
    """
    try:
        message: Message = _decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ArmguardError("feed message", str(error)) from error
    for name, sound in _check_sizes(message):
        if not sound:
            raise ArmguardError("feed message", f"{name} does not have the size it should have")
    return message


def _check_sizes(message: Message) -> list[tuple[str, bool]]:
    if isinstance(message, SceneMessage):
        return [("period", 0.0 < message.period < np.inf), ("base", len(message.base) == 16)] + [
            (f"cover of {link.link}", len(link.packed) % 16 == 0) for link in message.cover
        ]
    obstacles, pairs = message.obstacles, message.pairs
    number = len(obstacles.ids)
    return [
        ("obstacles.counts", len(obstacles.packed_counts) == number),
        ("obstacles.counts", bool(np.all(obstacles.counts > 0))),
        ("obstacles.points", len(obstacles.packed_points) == 12 * int(obstacles.counts.sum())),
        ("obstacles.radii", len(obstacles.packed_radii) == 4 * number),
        ("obstacles.refused", len(obstacles.packed_refused) == number),
        ("obstacles.buckets", len(obstacles.packed_buckets) == number),
        ("pairs.segments", len(pairs.packed_segments) == 24 * len(pairs.packed_buckets)),
    ]
