"""Turns the feed's messages into drawing commands.

Bodies and lines have the colour of their bucket of imminence, or of their level if a page requests
it. A cover ball and an obstacle are coloured by their most imminent pair, a line by its pair. A
refused obstacle is shown at its last accepted state, with edges.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Generator, Iterator

import coal
import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.view import drawing
from armguard.view.arm import Arm
from armguard.view.buckets import BUCKET_COUNT, compute_buckets
from armguard.view.colours import (
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    INK,
    LEVELS,
    PALE,
    PROVED,
    REFUSED,
    STILL,
    THEMES,
    UNWATCHED,
    Paints,
    choose_paints,
    compute_palette,
    describe_levels,
    find_levels,
)
from armguard.view.drawing import Command, Labels, Look
from armguard.view.figure import draw_legs
from armguard.view.messages import FrameMessage, ObstacleShapes, Pairs, SceneMessage
from armguard.view.ribbon import lay_ribbon
from armguard.view.segments import connect
from armguard.view.stopping import StoppingVolume

Array = NDArray[np.float64]
Drawing = Generator[Command, None, Array]
"""Commands that draw objects, followed by those that place them."""

ROOT = "/armguard"
COVER_OPACITY = 0.28
OBSTACLE_OPACITY = 0.72
HULL_OPACITY = 0.45
FIRST_RADIUS, NEAR_RADIUS = 0.006, 0.0025
NEAR_PAIRS = 10
"""Number of pairs whose lines are drawn as rods; other lines are faint."""
FAINT = 0.22
GHOST_OPACITY = 0.25
RIBBON_OPACITY = 0.9
RIBBON = 0.06
"""Width of the drawn path of a plan, in [m]."""
SOME, MANY = 40, 200
"""Numbers of obstacles above which each is drawn solid with fewer triangles, and with the
fewest."""
OUTSIDE = 0.002
"""Relative enlargement of a drawn body for each bucket below the last."""
FRAMED_WITHIN = 8.0
"""Greatest distance from the arm's base at which a moving obstacle stays in the picture, in [m]."""
BASE = 0.12
"""Radius around the arm's base that stays in the picture, in [m]."""
AXIS = 0.12
"""Length of the axes of a sensor's frame, in [m]."""

_BALL_DIRECTIONS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
)
_BALL_DIRECTIONS /= np.linalg.norm(_BALL_DIRECTIONS, axis=1, keepdims=True)
_NO_BALLS = np.zeros((0, 4))


class Picture:
    """The picture of one monitor.

    Args:
        draw: Called with each command; a later command with the same key replaces it.
        clear: Called before another scene is drawn, to drop all commands.
        floor: Height of the floor, in [m].

    Attributes:
        scene: The scene drawn last; None before the first.
    """

    def __init__(
        self,
        draw: Callable[[Command], None],
        clear: Callable[[], None],
        floor: float = 0.0,
    ) -> None:
        self._draw = draw
        self._clear = clear
        self._floor = floor
        self.scene: SceneMessage | None = None
        self._arm: Arm | None = None
        self._volume: StoppingVolume | str | None = None
        self._notes: list[str] = []
        self._hulls: dict[bytes, Array] = {}

    def draw_scene(self, message: SceneMessage) -> bool:
        """Draw what does not change; returns whether the scene is a new one."""
        if message == self.scene:
            return False
        self.scene = self._scene = message
        self._arm = self._volume = None
        self._hulls = {}
        self._clear()
        self._margins = message.slow_margin, message.aware_margin
        legend = {
            "levels": describe_levels(self._margins),
            "others": [
                {"sign": "◇", "text": "refused: last accepted state", "paint": REFUSED},
                {
                    "sign": "▫",
                    "text": "static (greyer)",
                    "paint": STILL + BUCKET_COUNT // 2,
                },
            ],
            "palette": {name: drawing.pack_floats(compute_palette(name)) for name in THEMES},
            "buckets": BUCKET_COUNT,
            "robot": message.robot,
            "period": message.period,
            "margins": self._margins,
            "floor": self._floor,
            "links": [cover.link for cover in message.cover],
            "tree": [sum(len(link.spheres) for link in level) for level in message.levels],
            "sensors": [name for name, _ in message.sensors],
            "is_recorded": message.is_recorded,
            "is_being_recorded": bool(message.recording),
            "configuration": message.configuration,
            "has_volume": message.stopping is not None,
            "obeys_reset": message.obeys_reset,
            "reset_address": message.reset_address,
        }
        self._draw(drawing.show("legend", legend))
        self._draw_sensors(message)
        try:
            self._arm = Arm(message)
            for command in self._arm.draw():
                self._draw(command)
            self._notes = self._arm.notes
        except ArmguardError as error:
            self._notes = [f"the arm is not drawn: {error}"]
        return True

    def draw_frame(self, message: FrameMessage, *, with_volume: bool = False) -> None:
        """Draw one moment; does nothing without a scene."""
        # All are made before the first is drawn: a moment is drawn whole, or not at all.
        for command in list(self.compute_frame(message, with_volume=with_volume)):
            self._draw(command)

    def compute_frame(
        self, message: FrameMessage, *, with_volume: bool = False
    ) -> Iterator[Command]:
        """The commands that draw one moment; none without a scene.

        Args:
            message: The moment.
            with_volume: Whether to draw the volume in which the arm can be until it is at rest.
        """
        if self.scene is None:
            return
        notes = list(self._notes)
        cover = _NO_BALLS
        if self._arm is not None:
            try:
                cover = yield from self._draw_arm(self._arm, message)
            except ArmguardError as error:
                notes.append(f"the arm is not moved: {error}")
            else:
                yield from self._draw_plan(self._arm, message)
        volume = self._find_volume(message, notes) if with_volume else _NO_BALLS
        paints = Paints.of(INK, len(volume))
        yield drawing.draw_balls(f"{ROOT}/volume", volume, paints, Look(0.1))
        legs = yield from self._draw_obstacles(message)
        segments = yield from self._draw_pairs(message, cover)
        yield self._draw_reach(message)
        for limit, detail in ((MANY, "the least"), (SOME, "less")):
            if len(message.obstacles.ids) > limit:
                notes.append(f"more than {limit} obstacles: each is drawn with {detail} detail")
                break
        if message.omitted:
            notes.append(
                f"{message.omitted} more obstacles, less imminent than these, are watched and not "
                "drawn"
            )
        yield self._aim(message, cover, segments, legs)
        yield self._describe(message, notes)

    def _paint(self, times: NDArray[np.float32], message: FrameMessage) -> Paints:
        verdict = message.verdict
        return choose_paints(
            times, self._scene.period, verdict.stop_time, self._margins, verdict.level
        )

    def _draw_sensors(self, message: SceneMessage) -> None:
        poses = np.array([pose for _, pose in message.sensors]).reshape(-1, 4, 4)
        origins = poses[:, :3, 3]
        starts = np.repeat(origins, 3, axis=0)
        ends = starts + AXIS * poses[:, :3, :3].transpose(0, 2, 1).reshape(-1, 3)
        axes = np.tile(np.array([AXIS_X, AXIS_Y, AXIS_Z], np.uint8), len(poses))
        lines = np.stack([starts, ends], axis=1)
        self._draw(drawing.draw_lines(f"{ROOT}/sensors/axes", lines, Paints(axes, axes)))
        self._draw(
            drawing.draw_balls(
                f"{ROOT}/sensors/origins",
                np.column_stack([origins, np.full(len(poses), 0.02)]),
                Paints.of(INK, len(poses)),
                Look(),
                Labels([f"frame {name}" for name, _ in message.sensors]),
            )
        )

    def _draw_arm(self, arm: Arm, message: FrameMessage) -> Drawing:
        if not np.isfinite(message.q).all():
            raise ArmguardError("q", "is not finite")
        arm.place(message.q)
        for mesh, pose in arm.compute_poses():
            yield drawing.move(mesh, pose)
        for number, level in enumerate(arm.compute_levels()):
            paints = Paints.of(UNWATCHED, len(level))
            path = f"{ROOT}/tree/{number}"
            yield drawing.draw_balls(path, level, paints, Look(0.35))
        cover = arm.compute_cover()
        times = np.frombuffer(message.sphere_times, "<f4")
        if len(times) != len(cover):
            raise ArmguardError(
                "sphere_times", f"has {len(times)} values", expected=f"{len(cover)}"
            )
        links = self._scene.cover
        yield drawing.draw_balls(
            f"{ROOT}/cover",
            cover,
            self._paint(times, message),
            Look(COVER_OPACITY, _count_segments(len(cover))),
            Labels([links[number].link for number in arm.links], times),
        )
        return cover

    def _draw_plan(self, arm: Arm, message: FrameMessage) -> Iterator[Command]:
        """Draw the path of the plan, the arm at its end, and the rest of the shield's path."""
        tips, end = _follow(arm, message.plan, len(message.q))
        ribbon = lay_ribbon(tips, RIBBON)
        ahead, _ = _follow(arm, message.path, len(message.q))
        arm.place(message.q)
        paints = Paints.of(PROVED, len(end))
        yield drawing.draw_balls(f"{ROOT}/plan/ghost", end, paints, Look(GHOST_OPACITY))
        paints = Paints.of(PROVED, len(ribbon))
        # The arm would hide most of it.
        yield drawing.draw_surface(
            f"{ROOT}/plan/ribbon",
            ribbon,
            [1] * len(ribbon),
            paints,
            RIBBON_OPACITY,
            is_on_top=True,
        )
        path = np.stack([ahead[:-1], ahead[1:]], axis=1)
        yield drawing.draw_rods(
            f"{ROOT}/plan/path",
            path,
            np.full(len(path), NEAR_RADIUS),
            Paints.of(INK, len(path)),
            Look(),
        )

    def _find_volume(self, message: FrameMessage, notes: list[str]) -> Array:
        try:
            if self._volume is None:
                self._volume = StoppingVolume(self._scene)
            if isinstance(self._volume, str):
                raise ArmguardError("the stopping volume", self._volume)
            return self._volume.compute(message)
        except ArmguardError as error:
            if self._volume is None:
                self._volume = str(error)
            notes.append(f"the stopping volume is not drawn: {error}")
            return _NO_BALLS

    def _draw_obstacles(self, message: FrameMessage) -> Drawing:
        """Draw the obstacles; returns the lines of a person's legs, which are for display only."""
        obstacles = message.obstacles
        paints = self._paint(obstacles.times, message)
        lifeless = obstacles.statics & ~obstacles.entrances
        for some in paints:
            some[lifeless] += STILL
            some[obstacles.refused] = REFUSED
        counts, owner, bodies = obstacles.counts, obstacles.owners, obstacles.bodies
        sound = find_sound(obstacles)
        # Solid bodies are drawn once, translucent ones twice.
        opacity = OBSTACLE_OPACITY if len(counts) <= SOME else 1.0
        look = Look(opacity, _count_segments(len(counts)))

        stands = {0: "", 1: " (static)", 2: " (entrance: a body can appear here)"}

        def label(rows: NDArray[np.int64]) -> Labels:
            names = [
                obstacles.ids[row]
                + stands[obstacles.packed_statics[row]]
                + (" (refused)" if obstacles.refused[row] else "")
                for row in rows
            ]
            return Labels(names, obstacles.times[rows])

        # Where parts of a body meet, the more imminent one lies outside, and is seen in one piece.
        buckets = compute_buckets(obstacles.times, self._scene.period).astype(np.int64)
        outer = obstacles.radii * (1.0 + OUTSIDE * (BUCKET_COUNT - 1 - buckets))
        balls = np.column_stack([obstacles.points, outer[owner]])
        for group, chosen in (
            ("obstacles", ~obstacles.statics),
            ("statics", obstacles.statics),
        ):
            those = sound & chosen
            places = np.flatnonzero(those[owner] & (counts[owner] <= 2))
            yield drawing.draw_balls(
                f"{ROOT}/{group}/balls",
                balls[places],
                paints.take(owner[places]),
                look,
                label(owner[places]),
            )
            capsules = np.flatnonzero(those & (counts == 2))
            yield drawing.draw_rods(
                f"{ROOT}/{group}/rods",
                np.array([bodies[row] for row in capsules]),
                outer[capsules],
                paints.take(capsules),
                look,
                label(capsules),
            )
            hulls = np.flatnonzero(those & (counts > 2))
            yield self._draw_hulls(group, obstacles, hulls, paints, label(hulls))
        edged = balls[(sound & obstacles.refused)[owner]]
        edged[:, 3] *= 1.02
        yield drawing.draw_balls(
            f"{ROOT}/refused",
            edged,
            Paints.of(INK, len(edged)),
            Look(0.5, segments=10, is_wire=True),
        )
        first = {id: body[0] for id, body in zip(obstacles.ids, bodies, strict=True)}
        legs = draw_legs(first, self._floor)
        yield drawing.draw_rods(
            f"{ROOT}/figure",
            legs,
            np.full(len(legs), 0.02),
            Paints.of(PALE, len(legs)),
            Look(0.35),
            Labels(["legs: for display only, not watched"] * len(legs)),
        )
        return legs

    def _draw_hulls(
        self,
        group: str,
        obstacles: ObstacleShapes,
        rows: NDArray[np.int64],
        paints: Paints,
        labels: Labels,
    ) -> Command:
        """Draw hulls such as boxes; a hull with unchanged shape and place is not computed again."""
        bodies = obstacles.bodies
        known: dict[bytes, Array] = {}
        corners, owners = [np.zeros((0, 3, 3))], []
        for row in rows:
            points, radius = bodies[row], float(obstacles.radii[row])
            key = points.tobytes() + str(radius).encode()
            known[key] = self._hulls[key] if key in self._hulls else _hull(points, radius)
            corners.append(known[key])
            owners.append(len(known[key]))
        # Bounded, and enough for two frames and both groups.
        self._hulls = known | dict(list(self._hulls.items())[: 2 * len(known) + 64])
        return drawing.draw_surface(
            f"{ROOT}/{group}/hulls",
            np.concatenate(corners),
            owners,
            paints.take(rows),
            HULL_OPACITY,
            labels,
        )

    def _draw_pairs(self, message: FrameMessage, cover: Array) -> Drawing:
        segments, times = self._find_segments(message, cover)
        paints = self._paint(times, message)
        for path, chosen, radius in (
            ("first", slice(0, 1), FIRST_RADIUS),
            ("near", slice(1, NEAR_PAIRS), NEAR_RADIUS),
        ):
            some = segments[chosen]
            yield drawing.draw_rods(
                f"{ROOT}/pairs/{path}",
                some,
                np.full(len(some), radius),
                paints.take(chosen),
                Look(),
            )
        rest = slice(NEAR_PAIRS, None)
        path = f"{ROOT}/pairs/rest"
        yield drawing.draw_lines(path, segments[rest], paints.take(rest), FAINT)
        return segments

    def _find_segments(
        self, message: FrameMessage, cover: Array
    ) -> tuple[Array, NDArray[np.float32]]:
        """Lines of the pairs with known ends, and the contact time of each."""
        pairs: Pairs = message.pairs
        segments, times = [], []
        if self._arm is not None and len(cover):
            obstacles, sound = message.obstacles, find_sound(message.obstacles)
            bodies = obstacles.bodies
            for link, row, time in zip(pairs.links, pairs.obstacles, pairs.times, strict=True):
                balls = cover[self._arm.links == link]
                if not (sound[row] and len(balls)):
                    continue
                segments.append(connect(balls, bodies[row], float(obstacles.radii[row])))
                times.append(time)
        return np.array(segments).reshape(-1, 2, 3), np.array(times, dtype=np.float32)

    def _draw_reach(self, message: FrameMessage) -> Command:
        balls = message.reach.values[np.isfinite(message.reach.values).all(axis=1)]
        first = message.obstacles.times[0] if len(message.obstacles.times) else 0.0
        paints = self._paint(np.full(len(balls), first, np.float32), message)
        return drawing.draw_balls(f"{ROOT}/reach", balls, paints, Look(0.14))

    def _aim(self, message: FrameMessage, cover: Array, segments: Array, legs: Array) -> Command:
        """Balls in the world that the camera must keep in the picture, in [m]."""
        obstacles = message.obstacles
        owner = obstacles.owners
        base = np.array(self._scene.base).reshape(4, 4)[:3, 3]
        near = np.linalg.norm(obstacles.points - base, axis=1) < FRAMED_WITHIN
        moving = (find_sound(obstacles) & ~obstacles.statics)[owner] & near
        bodies = np.column_stack([obstacles.points, obstacles.radii[owner]])[moving]
        if len(legs):
            # Both ends of each line of a leg, with a foot's breadth around.
            ends = legs.reshape(-1, 3)
            bodies = np.concatenate([bodies, np.column_stack([ends, np.full(len(ends), 0.05)])])
        content = {
            "arm": drawing.pack_floats(np.concatenate([cover, [[*base, BASE]]])),
            "bodies": drawing.pack_floats(bodies),
            "pair": drawing.pack_floats(segments[:1]),
        }
        return drawing.show("camera", content)

    def _describe(self, message: FrameMessage, notes: list[str]) -> Command:
        """The content of the panels."""
        verdict = message.verdict
        harm_time = verdict.contact_time if verdict.harm_time is None else verdict.harm_time
        times = verdict.contact_time, harm_time
        own = find_levels(times, verdict.stop_time, self._margins, verdict.level)
        content = {
            **msgspec.structs.asdict(verdict),
            "sequence": message.sequence,
            "now": message.now,
            "wall": message.wall,
            "contact_level": LEVELS[int(own[0])],
            "harm_level": LEVELS[int(own[1])],
            "load": message.load,
            "obstacles": len(message.obstacles.ids) + message.omitted,
            "sources": message.sources,
            "latches": message.latches,
            "buckets": message.pairs.buckets.tolist(),
            "explanation": message.explanation,
            "asking": self._tell_how_to_ask(message),
            "has_plan": bool(message.plan),
            "command": message.command,
            "notes": notes,
        }
        return drawing.show("banner", content)

    def _tell_how_to_ask(self, message: FrameMessage) -> str:
        """The command that explains a STOP; empty if the page explains it, or if nothing needs it.

        An explanation takes as long as dozens of ticks, and needs the history of the moment. A
        running monitor does not have this time, so the replay of its recording explains the STOP.
        """
        verdict, scene = message.verdict, self._scene
        if verdict.level != LEVELS[0] or verdict.since is None or scene.is_recorded:
            return ""
        if message.explanation or not math.isfinite(verdict.since):
            return ""
        file = shlex.quote(scene.recording) if scene.recording else "FILE"
        # Rounded down: the first tick from there on is the one that said STOP.
        return f"armguard replay {file} --explain {math.floor(1e3 * verdict.since) / 1e3:.3f}"


def _follow(arm: Arm, packed: bytes, joints: int) -> tuple[Array, Array]:
    """Path of the arm's end, shape (n, 3), and the cover at the last position; in [m].

    Args:
        arm: The arm, which is moved.
        packed: Joint positions, float32, in rows.
        joints: Number of joints in a row.
    """
    rows = np.frombuffer(packed, "<f4").reshape(-1, max(joints, 1))
    if not (len(rows) and np.isfinite(rows).all()):
        return np.zeros((0, 3)), _NO_BALLS
    tips = []
    for row in rows:
        arm.place(tuple(row.tolist()))
        cover = arm.compute_cover()
        tips.append(cover[-1, :3])
    return np.array(tips), cover


def _count_segments(count: int) -> int:
    """Number of flat pieces around each body, by the number of bodies."""
    return 24 if count <= SOME else 12 if count <= MANY else 8


def find_sound(obstacles: ObstacleShapes) -> NDArray[np.bool_]:
    """Whether each obstacle has a finite place and can be drawn. Shape (n,)."""
    finite = np.isfinite(obstacles.points).all(axis=1)
    whole = np.logical_and.reduceat(finite, np.cumsum(obstacles.counts) - obstacles.counts)
    sound: NDArray[np.bool_] = whole & (obstacles.radii >= 0.0) & (obstacles.radii < np.inf)
    return sound


def _hull(points: Array, radius: float) -> Array:
    """Triangles of the rounded hull, in [m]. Shape (n, 3, 3)."""
    # A flat hull has no inside: too thin a one is drawn a millimetre thick.
    corners = points[:, None] + max(radius, 1e-3) * _BALL_DIRECTIONS
    vertices = coal.StdVec_Vec3s()
    for corner in corners.reshape(-1, 3):
        vertices.append(corner)
    hull = coal.Convex.convexHull(vertices, True, "Qt")
    polygons = map(hull.polygons, range(hull.num_polygons))
    indices = np.array([[polygon[0], polygon[1], polygon[2]] for polygon in polygons])
    triangles: Array = np.asarray(hull.points())[indices]
    return triangles
