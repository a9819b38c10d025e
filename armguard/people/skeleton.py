"""A person's joints as obstacles: balls and capsules that contain the body, and their tethers.

A body-tracking kit sends positions of some joints (`armguard.bridges.skeletons` reads them). A
`Skeleton` makes body parts from them: hulls of joints, with a radius for flesh and clothes, the
bounds and the region of the part, and tethers between parts. The premises are the lengths and radii
in `proportions` and the bounds in `body_parts`.

A hidden joint is within its segment's length of each visible neighbour. So a part with one visible
end is sent with its other end in the middle of its possible region, and with a position error that
covers this region. The table keeps its earlier state as long as that is more precise. A part
without a visible end is not sent: its possible region grows with its age, and its tethers bound it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.jit.numerics import LENS_ROUNDING
from armguard.obstacles.obstacles import Obstacles
from armguard.people.body_parts import BOUNDS, PartBounds
from armguard.people.proportions import (
    SEGMENTS,
    SHORTEST,
    SOURCE,
    TALLEST,
    THICKNESSES,
)

Array = NDArray[np.float64]

LEARNING_TIME = 2.0
"""Duration of samples without a fault from which lengths of bones are learned, in [s]."""

LONGEST_GAP = 0.2
"""Samples farther apart than this, in [s], belong to different times of learning and moving."""

HISTORY = 12
"""Samples of each part that are kept for velocities."""

_SIDES = ("left", "right")


class Part(NamedTuple):
    """A part of a body: the hull of some points, rounded."""

    points: tuple[str, ...]
    """Names of its points; the hull's order."""
    thickness: str
    """Of `proportions.THICKNESSES`."""
    bounds: str
    """Of `body_parts.BOUNDS`."""
    region: str | None
    """Of `armguard.body_regions`; None: as patterns of ids state."""


def _list_parts() -> dict[str, Part]:
    corners = tuple(f"{side}_{end}" for end in ("shoulder", "hip") for side in _SIDES)
    parts = {
        "head": Part(("head",), "head", "head", "head"),
        "neck": Part(("head", "collar"), "neck", "trunk", "neck"),
        # Chest, abdomen, back and pelvis: which of them is touched is not known.
        "torso": Part(corners, "torso", "trunk", None),
    }
    limbs = (
        ("shoulder", ("shoulder",), "shoulder", "shoulder", "shoulder"),
        ("upper_arm", ("shoulder", "elbow"), "upper_arm", "upper_arm", "upper_arm"),
        # Within the limbs that meet there; hands are tethered to it.
        ("elbow", ("elbow",), "forearm", "elbow", "forearm"),
        ("forearm", ("elbow", "wrist"), "forearm", "forearm", "forearm"),
        ("hand", ("wrist", "knuckles"), "hand", "hand", "hand"),
        ("thigh", ("hip", "knee"), "thigh", "thigh", "thigh"),
        ("shank", ("knee", "ankle"), "shank", "shank", "lower_leg"),
        ("foot", ("ankle", "toe"), "foot", "foot", "foot"),
    )
    for name, points, thickness, bounds, region in limbs:
        for side in _SIDES:
            named = tuple(f"{side}_{point}" for point in points)
            parts[f"{side}_{name}"] = Part(named, thickness, bounds, region)
    return parts


PARTS: Mapping[str, Part] = _list_parts()
"""All parts of a body, by the end of their ids."""

UPPER_BODY = tuple(
    name for name, part in PARTS.items() if part.bounds not in ("thigh", "shank", "foot")
)
"""Parts that are left where legs cannot come near the arm, as behind a table."""


def _list_bones() -> dict[tuple[str, str], str]:
    bones = {("head", "collar"): "neck"}
    bones[("left_shoulder", "right_shoulder")] = "shoulders"
    bones[("left_hip", "right_hip")] = "hips"
    chain = (
        ("shoulder", "elbow", "upper_arm"),
        ("elbow", "wrist", "forearm"),
        ("wrist", "knuckles", "palm"),
        ("shoulder", "hip", "trunk"),
        ("hip", "knee", "thigh"),
        ("knee", "ankle", "shank"),
        ("ankle", "toe", "foot"),
    )
    for side in _SIDES:
        bones |= {(f"{side}_{a}", f"{side}_{b}"): segment for a, b, segment in chain}
    return bones


BONES: Mapping[tuple[str, str], str] = _list_bones()
"""Segments, of `proportions.SEGMENTS`, by the two points that they join."""

_NEIGHBOURS = {
    point: [(b if point == a else a, (a, b)) for a, b in BONES if point in (a, b)]
    for point in {end for bone in BONES for end in bone}
}

_HEAD = (
    (("left_ear", "right_ear"), 0.0),
    (("left_ear",), 0.09),
    (("right_ear",), 0.09),
    *(((joint,), 0.16) for joint in ("head", "nose", "left_eye", "right_eye")),
)
"""What tells where the middle between the ears is, and how far off it that can be, in [m]: half of
a head's breadth, and most of a head's length and the nose (assumed)."""

_KNUCKLES = (
    (("index", "pinky"), 0.0),
    (("index",), 0.06),
    (("pinky",), 0.06),
    (("hand",), 0.08),
)
"""Likewise of the middle between the knuckles: half of a hand's breadth, and half of a palm."""

_ENDS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")
"""Joints of both sides that are points of parts."""

JOINTS = frozenset(
    {
        *(f"{side}_{end}" for side in _SIDES for end in _ENDS),
        *(f"{side}_{end}" for side in _SIDES for ends, _ in _KNUCKLES for end in ends),
        *(joint for joints, _ in _HEAD for joint in joints),
        "neck",
    }
)
"""Names of joints that tell of parts."""

_NECK_ABOVE_COLLAR = 0.15
"""How far a kit's neck can be from the middle between the shoulders, in [m] (assumed)."""


class Tethered(NamedTuple):
    """A tether between two body parts."""

    a: str
    b: str
    length: float
    """[m]."""
    source: str
    """Where the length comes from."""


class Ball(NamedTuple):
    """Region of a point: within a radius around a centre."""

    centre: Array
    """[m]. Shape (3,)."""
    radius: float
    """[m]."""


class PartSink(Protocol):
    """Receiver of obstacles: a table, or a publisher."""

    @property
    def update(self) -> Callable[..., object]:
        """Takes the states of some obstacles; see `armguard.Obstacles.update`."""
        ...


class _Sight(NamedTuple):
    """A sample of a part with all points visible."""

    stamp: float
    points: Array
    error: float


class Skeleton:
    """One person, as obstacles "person/left_forearm" and so on.

    Args:
        person: Name of the person, in the ids of all parts; distinct from those of others.
        height: Height of the person with shoes, in [m]: lengths are the published ratios to it.
            None: lengths cover any adult.
        learn: Whether to learn bone lengths from samples without a fault, over at least 2 s.
            Tethers then say "learned". Only possible with the table itself as sink.
        parts: Names of `PARTS` to send, if not all can come near the arm. None: all.
        bounds: Acceleration and speed by part of the body.
        source: Name of the source in the table; a publisher has its own.
        frame: Frame of the joints' coordinates.

    Raises:
        ArmguardError: An argument is malformed; the message names it.
    """

    def __init__(
        self,
        person: str = "person",
        *,
        height: float | None = None,
        learn: bool = False,
        parts: Iterable[str] | None = None,
        bounds: Mapping[str, PartBounds] = BOUNDS,
        source: str = "default",
        frame: str = "world",
    ) -> None:
        if not isinstance(person, str) or not person or "/" in person:
            raise ArmguardError("person", f"is {person!r}", expected="a name without '/'")
        if height is not None and not (SHORTEST <= height <= TALLEST):
            raise ArmguardError("height", f"is {height}", expected=f"{SHORTEST:g} to {TALLEST:g} m")
        self.person = person
        self._source, self._frame = source, frame
        self._parts = self._read_parts(parts, bounds)
        self._bounds = bounds
        self._height, self._learn = height, learn
        self._lengths = {bone: self._publish_length(bone) for bone in BONES}
        self._learned: set[tuple[str, str]] = set()
        self._longest: dict[tuple[str, str], float] = {}
        self._learned_for: dict[tuple[str, str], float] = {}
        self._last_seen: dict[tuple[str, str], float] = {}
        self._sights: dict[str, deque[_Sight]] = {
            name: deque(maxlen=HISTORY) for name in self._parts
        }
        self._stated_to: Obstacles | None = None

    @staticmethod
    def _read_parts(
        parts: Iterable[str] | None, bounds: Mapping[str, PartBounds]
    ) -> dict[str, Part]:
        names = list(PARTS) if parts is None else list(parts)
        for name in names:
            if name not in PARTS:
                raise ArmguardError(
                    "parts", f"names {name!r}", expected=f"some of {', '.join(PARTS)}"
                )
            if PARTS[name].bounds not in bounds:
                raise ArmguardError(
                    "bounds", f"has none for {PARTS[name].bounds!r}", expected=f"those of {name}"
                )
        if not names:
            raise ArmguardError("parts", "names none", expected=f"some of {', '.join(PARTS)}")
        return {name: PARTS[name] for name in names}

    @property
    def ids(self) -> list[str]:
        """Ids of all parts to send, including those not seen yet."""
        return [self._name(part) for part in self._parts]

    @property
    def tethers(self) -> list[Tethered]:
        """The tethered parts with their present lengths; also for a cell file.

        A length, in whole millimetres, bounds the distance from every point of one part to the hull
        of the other's points, in both directions.
        """
        found = []
        for a, b in _TETHERS:
            if a not in self._parts or b not in self._parts:
                continue
            bones: set[tuple[str, str]] = set()
            way = max(self._measure_way(a, b, bones), self._measure_way(b, a, bones))
            length = round(1e-3 * math.ceil(1e3 * way), 3)
            found.append(Tethered(self._name(a), self._name(b), length, self._describe(bones)))
        return found

    def update(
        self,
        sink: PartSink,
        stamp: float,
        joints: Mapping[str, ArrayLike],
        position_error: float,
    ) -> None:
        """Sends the parts with a visible joint; without any, a heartbeat.

        Tethers are stated with the first call and after changes of lengths. A publisher cannot send
        tethers: the cell file must state them, as listed by `tethers`.

        Args:
            sink: The table of obstacles, or a publisher.
            stamp: Time of measurement of the joints, in [s].
            joints: Positions of visible joints by name, in [m]; a joint that is missing or not
                finite is hidden. Names are those of `armguard.bridges.skeletons`; others are
                ignored. Shape (3,) each.
            position_error: Greatest distance of each joint from the centre of the body's joint, in
                [m].

        Raises:
            ArmguardError: The call is malformed, or lengths cannot be learned here.
        """
        if not (0.0 <= position_error < math.inf):
            raise ArmguardError(
                "position_error", f"is {position_error}", expected="a number of metres, at least 0"
            )
        table = sink if isinstance(sink, Obstacles) else None
        if self._learn and table is None:
            raise ArmguardError(
                "learn",
                "needs the table of obstacles, which says what was refused",
                remedy="state a height, or update Obstacles itself",
            )
        seen = find_points(joints, position_error)
        places = infer_points(seen, self._lengths)
        if table is not None:
            self._state_tethers(table)
        faults = 0 if table is None else table.fault_count
        self._send(sink, stamp, seen, places)
        if table is not None and self._learn:
            self._learn_lengths(stamp, seen, table.fault_count > faults)

    def remove(self, table: Obstacles) -> None:
        """Removes a person who has left from the table, with all tethers.

        A camera cannot detect that a person has left, since an unseen person may be hidden. So the
        application must decide, for instance if the person was last seen at a door.

        Args:
            table: Table to which the person was sent.
        """
        known = set(table.ids)
        table.remove([id for id in self.ids if id in known])
        for one in self.tethers:
            table.untether(one.a, one.b)
        self._stated_to = None
        for sights in self._sights.values():
            sights.clear()

    def _name(self, part: str) -> str:
        return f"{self.person}/{part}"

    def _send(
        self, sink: PartSink, stamp: float, seen: Mapping[str, Ball], places: Mapping[str, Ball]
    ) -> None:
        """Send the parts with a visible end, in one call for each number of points."""
        groups: dict[tuple[int, bool], list[str]] = {}
        for name, part in self._parts.items():
            if any(point in seen for point in part.points) and all(
                point in places for point in part.points
            ):
                key = len(part.points), part.region is None
                groups.setdefault(key, []).append(name)
        # A publisher has the name of its source already.
        named = {"source": self._source} if isinstance(sink, Obstacles) else {}
        if not groups:
            sink.update([], stamp, np.empty((0, 3)), radius=np.empty(0), **named)
            return
        for (_, by_pattern), names in groups.items():
            parts = [self._parts[name] for name in names]
            points = np.array([[places[end].centre for end in part.points] for part in parts])
            errors = [max(places[end].radius for end in part.points) for part in parts]
            bounds = [self._bounds[part.bounds] for part in parts]
            velocity, velocity_error = np.zeros_like(points), np.empty(len(parts))
            for k, (name, part) in enumerate(zip(names, parts, strict=True)):
                is_whole = all(point in seen for point in part.points)
                sight = _Sight(stamp, points[k], errors[k]) if is_whole else None
                velocity[k], velocity_error[k] = self._estimate_velocity(name, sight, bounds[k])
            sink.update(
                [self._name(name) for name in names],
                stamp,
                points,
                velocity,
                radius=np.array([THICKNESSES[part.thickness].radius for part in parts]),
                accel=np.array([bound.accel for bound in bounds]),
                speed=np.array([bound.speed for bound in bounds]),
                position_error=np.array(errors),
                velocity_error=velocity_error,
                frame=self._frame,
                region=None if by_pattern else [str(part.region) for part in parts],
                **named,
            )

    def _estimate_velocity(
        self, name: str, sight: _Sight | None, bound: PartBounds
    ) -> tuple[Array | float, float]:
        """Velocity from past samples of a part, in [m/s], with a proved error.

        The mean velocity over the last h seconds differs from the present one by at most A h / 2,
        and its two ends may be off by their errors. The h counts whose error is least. A sample
        that bounds and errors do not allow after those before it, as a swapped joint is, ends what
        they tell. Where nothing is known the velocity is 0, with the bound on speed as error.
        """
        unknown = 0.0, bound.speed
        if sight is None:
            return unknown
        sights = self._sights[name]
        if sights and not (0.0 < sight.stamp - sights[-1].stamp <= LONGEST_GAP):
            sights.clear()
        elapsed = sight.stamp - np.array([past.stamp for past in sights])
        off = (sight.error + np.array([past.error for past in sights])) / elapsed
        way = sight.points - np.array([past.points for past in sights]).reshape(
            -1, *sight.points.shape
        )
        means = way / elapsed[:, None, None]
        fastest = np.linalg.norm(means, axis=2).max(axis=1, initial=0.0)
        is_allowed = bool((fastest <= bound.speed + off).all()) and _bends_within(
            sights, sight, bound.accel
        )
        # One sample before proves nothing: it may be the one that jumped. Two have agreed.
        is_known = is_allowed and len(sights) > 1
        if not is_allowed:
            sights.clear()
        sights.append(sight)
        if not is_known:
            return unknown
        errors = 0.5 * bound.accel * elapsed + off
        errors[~(fastest <= bound.speed + errors)] = math.inf
        best = int(np.argmin(errors))
        return (means[best], float(errors[best])) if errors[best] < bound.speed else unknown

    def _publish_length(self, bone: tuple[str, str]) -> float:
        segment = SEGMENTS[BONES[bone]]
        return segment.length if self._height is None else segment.per_height * self._height

    def _describe(self, bones: Iterable[tuple[str, str]]) -> str:
        """Where the lengths of some bones come from."""
        bones = set(bones)
        words = []
        if bones & self._learned:
            words.append(f"learned from {LEARNING_TIME:g} s of samples of {self.person}")
        if bones - self._learned:
            told = "" if self._height is None else f", for {self._height:g} m of height"
            words.append(SOURCE + told)
        return "; ".join(words)

    def _measure_way(self, a: str, b: str, bones: set[tuple[str, str]]) -> float:
        """How far a point of part a can be from the nearest point of part b, in [m]."""
        farthest = 0.0
        for point in PARTS[a].points:
            way, walked = self._find_way(point, PARTS[b].points)
            bones |= walked
            farthest = max(farthest, way)
        return farthest

    def _find_way(self, start: str, goals: Iterable[str]) -> tuple[float, set[tuple[str, str]]]:
        """The shortest way along bones, in [m], and its bones."""
        ways: dict[str, tuple[float, set[tuple[str, str]]]] = {start: (0.0, set())}
        # The collar is no joint: it is in the middle between the shoulders.
        half = 0.5 * self._lengths[("left_shoulder", "right_shoulder")]
        across = ("left_shoulder", "right_shoulder")
        for _ in BONES:  # of which no way has more than there are
            for point, (way, walked) in list(ways.items()):
                steps = [(other, self._lengths[bone], bone) for other, bone in _NEIGHBOURS[point]]
                if point == "collar":
                    steps += [(shoulder, half, across) for shoulder in across]
                if point in across:
                    steps.append(("collar", half, across))
                for other, length, bone in steps:
                    if way + length < ways.get(other, (math.inf, set()))[0]:
                        ways[other] = way + length, walked | {bone}
        return min((ways[goal] for goal in goals), key=lambda way: way[0])

    def _state_tethers(self, table: Obstacles) -> None:
        """State new or changed tethers to a table."""
        if self._stated_to is not table:
            for one in self.tethers:
                table.tether(one.a, one.b, one.length, one.source)
            self._stated_to = table

    def _set_length(self, bone: tuple[str, str], length: float) -> None:
        self._lengths[bone] = length
        self._stated_to = None

    def _learn_lengths(self, stamp: float, seen: Mapping[str, Ball], failed: bool) -> None:
        """Learn bones from samples without a fault; forget what a sample contradicts.

        Both ends are off by their errors at the most, so a bone is no longer than what any sample
        shows and both errors. The longest of all samples counts, or what is published if that is
        less. A sample that shows more than the length and both errors proves it wrong: the
        published one counts again.
        """
        for bone, segment in BONES.items():
            a, b = bone
            if not (SEGMENTS[segment].is_rigid and a in seen and b in seen):
                continue
            shown = float(np.linalg.norm(seen[a].centre - seen[b].centre))
            both = seen[a].radius + seen[b].radius
            last = self._last_seen.get(bone, -math.inf)
            self._last_seen[bone] = stamp
            published = self._publish_length(bone)
            if not (shown <= self._lengths[bone] + both):
                if bone in self._learned:
                    self._learned.discard(bone)
                    self._set_length(bone, published)
                failed_here = True
            else:
                failed_here = failed or not (0.0 < stamp - last <= LONGEST_GAP)
            if failed_here:
                self._longest.pop(bone, None)
                self._learned_for.pop(bone, None)
            if failed:
                continue
            self._longest[bone] = max(self._longest.get(bone, 0.0), shown + both)
            if not failed_here:
                self._learned_for[bone] = self._learned_for.get(bone, 0.0) + stamp - last
            if (
                self._learned_for.get(bone, 0.0) >= LEARNING_TIME
                and bone not in self._learned
                and self._longest[bone] < published
            ):
                self._learned.add(bone)
                self._set_length(bone, self._longest[bone])


_ALONG_LIMBS = (
    ("shoulder", "upper_arm"),
    ("shoulder", "elbow"),
    ("shoulder", "forearm"),
    ("shoulder", "hand"),
    ("upper_arm", "elbow"),
    ("upper_arm", "forearm"),
    ("elbow", "forearm"),
    ("elbow", "hand"),
    ("forearm", "hand"),
    ("thigh", "shank"),
    ("shank", "foot"),
)
_TETHERS = (
    ("head", "neck"),
    ("neck", "torso"),
    *(("neck", f"{side}_shoulder") for side in _SIDES),
    *((f"{side}_{a}", f"{side}_{b}") for side in _SIDES for a, b in _ALONG_LIMBS),
    *(("torso", f"{side}_thigh") for side in _SIDES),
)
"""Parts that are tethered, no part to more than `MOST_TETHERS` others."""


def _bends_within(sights: deque[_Sight], sight: _Sight, accel: float) -> bool:
    """Whether a sample can come after the two before it, within a bound on acceleration and errors.

    With h1 and h2 between the three and r = h2 / h1: |x2 - x1 - r (x1 - x0)| is at most
    A h2 (h1 + h2) / 2 and the errors, as they count there.
    """
    if len(sights) < 2:
        return True
    before, last = sights[-2], sights[-1]
    earlier, later = last.stamp - before.stamp, sight.stamp - last.stamp
    ratio = later / earlier
    bend = sight.points - last.points - ratio * (last.points - before.points)
    errors = sight.error + (1.0 + ratio) * last.error + ratio * before.error
    room = 0.5 * accel * later * (earlier + later) + errors
    return float(np.linalg.norm(bend, axis=-1).max()) <= room


def find_points(joints: Mapping[str, ArrayLike], position_error: float) -> dict[str, Ball]:
    """Where the points are that parts are made of, as far as joints were seen that tell of them.

    Args:
        joints: Positions by name, in [m]. Shape (3,) each.
        position_error: Of each joint, in [m].

    Raises:
        ArmguardError: A position is no point.
    """
    seen: dict[str, Array] = {}
    for name, position in joints.items():
        try:
            point = np.asarray(position, dtype=np.float64)
        except (TypeError, ValueError):
            point = np.empty(0)
        if point.shape != (3,):
            raise ArmguardError(
                f"joint {name!r}", "is no point", expected="x, y and z, in [m]: shape (3,)"
            )
        if np.isfinite(point).all():
            seen[name] = point
    found: dict[str, Ball] = {}
    for side in _SIDES:
        for end in _ENDS:
            name = f"{side}_{end}"
            if name in seen:
                found[name] = Ball(seen[name], position_error)
        for ends, off in _KNUCKLES:
            names = [f"{side}_{end}" for end in ends]
            if _add_mean(found, f"{side}_knuckles", seen, names, off + position_error):
                break
    for joints_of_head, off in _HEAD:
        if _add_mean(found, "head", seen, joints_of_head, off + position_error):
            break
    shoulders = [f"{side}_shoulder" for side in _SIDES]
    if not _add_mean(found, "collar", seen, shoulders, position_error):
        _add_mean(found, "collar", seen, ["neck"], _NECK_ABOVE_COLLAR + position_error)
    return found


def _add_mean(
    found: dict[str, Ball], name: str, seen: Mapping[str, Array], joints: Iterable[str], off: float
) -> bool:
    """Add the middle of some joints, if all of them were seen."""
    names = list(joints)
    if not all(joint in seen for joint in names):
        return False
    found[name] = Ball(np.mean([seen[joint] for joint in names], axis=0), off)
    return True


def infer_points(
    seen: Mapping[str, Ball], lengths: Mapping[tuple[str, str], float]
) -> dict[str, Ball]:
    """Where all points are, as far as bones from seen ones lead to them.

    Args:
        seen: Points that were seen, with their errors.
        lengths: Of all bones, in [m].

    Returns:
        The seen points, and balls that hidden ones cannot be outside of. Where balls around two
        neighbours have nothing in common, some premise is wrong, and nothing is said of the point.
    """
    places = dict(seen)
    across = [places[f"{side}_shoulder"] for side in _SIDES if f"{side}_shoulder" in places]
    if "collar" not in places and across:
        half = 0.5 * lengths[("left_shoulder", "right_shoulder")]
        places["collar"] = Ball(across[0].centre, across[0].radius + half)
    # Neighbours of seen points, then neighbours of these.
    for _ in range(2):
        known = dict(places)
        for point, neighbours in _NEIGHBOURS.items():
            if point in known:
                continue
            balls = [
                Ball(known[other].centre, known[other].radius + lengths[bone])
                for other, bone in neighbours
                if other in known
            ]
            ball = _meet(balls)
            if ball is not None:
                places[point] = ball
    return places


def _meet(balls: list[Ball]) -> Ball | None:
    """A ball around what two of these balls have in common; None where that is nothing."""
    balls = sorted(balls, key=lambda ball: ball.radius)[:2]
    if len(balls) < 2:
        return balls[0] if balls else None
    small, large = balls
    way = large.centre - small.centre
    distance = float(np.linalg.norm(way))
    if not distance <= small.radius + large.radius:
        return None
    if distance <= LENS_ROUNDING:
        return small
    # Both spheres meet in a circle, so far from the smaller one's centre. If the circle is between
    # the centres, the ball around it contains what the balls have in common.
    squares = (small.radius - large.radius) * (small.radius + large.radius)
    off = 0.5 * (distance + squares / distance)
    if not 0.0 < off < distance:
        return small
    square = small.radius**2
    radius = math.sqrt(max(0.0, square - off**2) + LENS_ROUNDING * square)
    if not radius < small.radius:
        return small
    return Ball(small.centre + off / distance * way, radius)
