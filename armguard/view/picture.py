"""What to draw: turns the feed's messages into the latest values of drawing commands.

Everything that is coloured has the colour of its bucket of imminence, or, where a page asks for it,
of the level that its contact time earns: a cover ball by its most imminent pair, an obstacle by its
most imminent pair, a line by its pair. Of a refused obstacle the last accepted state is shown, with
edges.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable

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
from armguard.view.segments import connect
from armguard.view.stopping import StoppingVolume

Array = NDArray[np.float64]

ROOT = "/armguard"
COVER_OPACITY = 0.28
OBSTACLE_OPACITY = 0.72
HULL_OPACITY = 0.45
FIRST_RADIUS, NEAR_RADIUS = 0.006, 0.0025
NEAR_PAIRS = 10
"""Pairs whose lines are rods; the others' are faint."""
FAINT = 0.22
SOME, MANY = 40, 200
"""Obstacles beyond which each is drawn solid and with fewer triangles, and with the fewest."""
OUTSIDE = 0.002
"""How much larger than it is a body is drawn for each bucket below the last, as a share."""
FRAMED_WITHIN = 8.0
"""How far from the arm's base a moving obstacle may be to be kept in the picture, in [m]."""
BASE = 0.12
"""How much around the arm's base is kept in the picture, in [m]."""
AXIS = 0.12
"""Length of the axes of a sensor's frame, in [m]."""

_BALL_DIRECTIONS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
)
_BALL_DIRECTIONS /= np.linalg.norm(_BALL_DIRECTIONS, axis=1, keepdims=True)


class Picture:
    """What is drawn of one monitor.

    Args:
        draw: Takes each command; of a key, the latest counts.
        clear: Called before another scene is drawn, to forget all commands.
        floor: Height of the floor, in [m].
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
        self._message: SceneMessage | None = None
        self._arm: Arm | None = None
        self._volume: StoppingVolume | str | None = None
        self._notes: list[str] = []
        self._hulls: dict[bytes, Array] = {}

    @property
    def scene(self) -> SceneMessage | None:
        """What was drawn last."""
        return self._message

    def draw_scene(self, message: SceneMessage) -> bool:
        """Draw what does not change; whether it was another scene than before."""
        if message == self._message:
            return False
        self._message, self._arm, self._volume = message, None, None
        self._hulls = {}
        self._clear()
        self._margins = message.slow_margin, message.aware_margin
        legend = {
            "levels": describe_levels(self._margins),
            "others": [
                {"sign": "◇", "text": "refused: last accepted state", "paint": REFUSED},
                {
                    "sign": "▫",
                    "text": "stands still (greyer)",
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
        """Draw one moment; without a scene there is nothing yet to draw it in."""
        for command in self.compute_frame(message, with_volume=with_volume):
            self._draw(command)

    def compute_frame(self, message: FrameMessage, *, with_volume: bool = False) -> list[Command]:
        """The commands that draw one moment; none without a scene.

        Args:
            message: The moment.
            with_volume: Whether to draw where the arm can be until it rests.
        """
        if self._message is None:
            return []
        commands: list[Command] = []
        notes = list(self._notes)
        cover = np.zeros((0, 4))
        if self._arm is not None:
            try:
                cover = self._draw_arm(self._arm, message, commands)
            except ArmguardError as error:
                notes.append(f"the arm is not moved: {error}")
            else:
                self._draw_plan(self._arm, message, commands)
        volume = self._find_volume(message, notes) if with_volume else np.zeros((0, 4))
        paints = Paints.of(INK, len(volume))
        commands.append(drawing.draw_balls(f"{ROOT}/volume", volume, paints, Look(0.1)))
        legs = self._draw_obstacles(message, commands)
        segments = self._draw_pairs(message, cover, commands)
        self._draw_reach(message, commands)
        for limit, detail in ((MANY, "the least"), (SOME, "less")):
            if len(message.obstacles.ids) > limit:
                notes.append(f"more than {limit} obstacles: each is drawn with {detail} detail")
                break
        if message.omitted:
            notes.append(
                f"{message.omitted} more obstacles, less imminent than these, are watched and not "
                "drawn"
            )
        commands.append(self._aim(message, cover, segments, legs))
        commands.append(self._describe(message, notes))
        return commands

    def _paint(self, times: NDArray[np.float32], message: FrameMessage) -> Paints:
        assert self._message is not None, "paints a scene's frame"
        verdict = message.verdict
        return choose_paints(
            times, self._message.period, verdict.stop_time, self._margins, verdict.level
        )

    def _draw_sensors(self, message: SceneMessage) -> None:
        lines = []
        for _, pose in message.sensors:
            matrix = np.array(pose).reshape(4, 4)
            lines += [(matrix[:3, 3], matrix[:3, 3] + AXIS * matrix[:3, k]) for k in range(3)]
        axes = np.tile(np.array([AXIS_X, AXIS_Y, AXIS_Z], np.uint8), len(message.sensors))
        axes_paints = Paints(axes, axes)
        self._draw(drawing.draw_lines(f"{ROOT}/sensors/axes", np.array(lines), axes_paints))
        balls = [[*np.array(pose).reshape(4, 4)[:3, 3], 0.02] for _, pose in message.sensors]
        self._draw(
            drawing.draw_balls(
                f"{ROOT}/sensors/origins",
                np.array(balls),
                Paints.of(INK, len(balls)),
                Look(),
                Labels([f"frame {name}" for name, _ in message.sensors]),
            )
        )

    def _draw_arm(self, arm: Arm, message: FrameMessage, commands: list[Command]) -> Array:
        assert self._message is not None, "an arm has a scene"
        if not np.isfinite(message.q).all():
            raise ArmguardError("q", "is not finite")
        arm.place(message.q)
        commands += [drawing.move(path, pose) for path, pose in arm.compute_poses()]
        for number, level in enumerate(arm.compute_levels()):
            paints = Paints.of(UNWATCHED, len(level))
            path = f"{ROOT}/tree/{number}"
            commands.append(drawing.draw_balls(path, level, paints, Look(0.35)))
        cover = arm.compute_cover()
        times = np.frombuffer(message.sphere_times, "<f4")
        if len(times) != len(cover):
            raise ArmguardError(
                "sphere_times", f"has {len(times)} values", expected=f"{len(cover)}"
            )
        links = self._message.cover
        commands.append(
            drawing.draw_balls(
                f"{ROOT}/cover",
                cover,
                self._paint(times, message),
                Look(COVER_OPACITY, _count_segments(len(cover))),
                Labels([links[number].link for number in arm.links], times),
            )
        )
        return cover

    def _draw_plan(self, arm: Arm, message: FrameMessage, commands: list[Command]) -> None:
        """The way that the arm was told to go, and the arm at its end."""
        rows = np.frombuffer(message.plan, "<f4").reshape(-1, max(len(message.q), 1))
        end, path = np.zeros((0, 4)), np.zeros((0, 2, 3))
        if len(rows) and np.isfinite(rows).all():
            tips = []
            for row in rows:
                arm.place(tuple(row.tolist()))
                end = arm.compute_cover()
                tips.append(end[-1, :3])
            path = np.stack([tips[:-1], tips[1:]], axis=1)
            arm.place(message.q)
        ghost = drawing.draw_balls(f"{ROOT}/plan/ghost", end, Paints.of(INK, len(end)), Look(0.12))
        way = drawing.draw_lines(f"{ROOT}/plan/path", path, Paints.of(INK, len(path)), 0.8)
        commands += [ghost, way]

    def _find_volume(self, message: FrameMessage, notes: list[str]) -> Array:
        assert self._message is not None, "asked for with a scene alone"
        try:
            if self._volume is None:
                self._volume = StoppingVolume(self._message)
            if isinstance(self._volume, str):
                raise ArmguardError("the stopping volume", self._volume)
            return self._volume.compute(message)
        except ArmguardError as error:
            if self._volume is None:
                self._volume = str(error)
            notes.append(f"the stopping volume is not drawn: {error}")
            return np.zeros((0, 4))

    def _draw_obstacles(self, message: FrameMessage, commands: list[Command]) -> Array:
        """Draw what is in the cell; the lines of the legs that a person has for the eye."""
        obstacles = message.obstacles
        paints = self._paint(obstacles.times, message)
        lifeless = obstacles.statics & ~obstacles.entrances
        for some in paints:
            some[lifeless] += STILL
            some[obstacles.refused] = REFUSED
        counts, points, radii = obstacles.counts.astype(np.int64), obstacles.points, obstacles.radii
        ends = np.cumsum(counts)
        sound = find_sound(obstacles)
        owner = np.repeat(np.arange(len(counts)), counts)
        # Solid bodies are drawn once, translucent ones twice.
        opacity = OBSTACLE_OPACITY if len(counts) <= SOME else 1.0
        look = Look(opacity, _count_segments(len(counts)))

        stands = {0: "", 1: " (stands still)", 2: " (entrance: somebody may come in here)"}

        def label(rows: NDArray[np.int64]) -> Labels:
            names = [
                obstacles.ids[row]
                + stands[obstacles.packed_statics[row]]
                + (" (refused)" if obstacles.refused[row] else "")
                for row in rows
            ]
            return Labels(names, obstacles.times[rows])

        # Where parts of a body meet, the more imminent one lies outside, and is seen in one piece.
        assert self._message is not None, "draws a scene's frame"
        buckets = compute_buckets(obstacles.times, self._message.period).astype(np.int64)
        outer = radii * (1.0 + OUTSIDE * (BUCKET_COUNT - 1 - buckets))
        balls = np.column_stack([points, outer[owner]])
        for group, chosen in (
            ("obstacles", ~obstacles.statics),
            ("statics", obstacles.statics),
        ):
            those = sound & chosen
            places = np.flatnonzero(those[owner] & (counts[owner] <= 2))
            commands.append(
                drawing.draw_balls(
                    f"{ROOT}/{group}/balls",
                    balls[places],
                    paints.take(owner[places]),
                    look,
                    label(owner[places]),
                )
            )
            capsules = np.flatnonzero(those & (counts == 2))
            commands.append(
                drawing.draw_rods(
                    f"{ROOT}/{group}/rods",
                    np.stack([points[ends[capsules] - 2], points[ends[capsules] - 1]], axis=1),
                    outer[capsules],
                    paints.take(capsules),
                    look,
                    label(capsules),
                )
            )
            hulls = np.flatnonzero(those & (counts > 2))
            commands.append(self._draw_hulls(group, obstacles, hulls, paints, label(hulls)))
        edged = balls[(sound & obstacles.refused)[owner]]
        edged[:, 3] *= 1.02
        commands.append(
            drawing.draw_balls(
                f"{ROOT}/refused",
                edged,
                Paints.of(INK, len(edged)),
                Look(0.5, segments=10, is_wire=True),
            )
        )
        first = points[ends - counts].astype(np.float64) if len(counts) else np.zeros((0, 3))
        legs = draw_legs(dict(zip(obstacles.ids, first, strict=True)), self._floor)
        commands.append(
            drawing.draw_rods(
                f"{ROOT}/figure",
                legs,
                np.full(len(legs), 0.02),
                Paints.of(PALE, len(legs)),
                Look(0.35),
                Labels(["legs: drawn for the eye, watched by nothing"] * len(legs)),
            )
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
        """Draw boxes and the like; one whose shape and place are known is not computed again."""
        ends = np.cumsum(obstacles.counts.astype(np.int64))
        known: dict[bytes, Array] = {}
        corners, owners = [np.zeros((0, 3, 3))], []
        for row in rows:
            points = obstacles.points[ends[row] - obstacles.counts[row] : ends[row]]
            radius = float(obstacles.radii[row])
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

    def _draw_pairs(self, message: FrameMessage, cover: Array, commands: list[Command]) -> Array:
        segments, times = self._find_segments(message, cover)
        paints = self._paint(times, message)
        for path, chosen, radius in (
            ("first", slice(0, 1), FIRST_RADIUS),
            ("near", slice(1, NEAR_PAIRS), NEAR_RADIUS),
        ):
            some = segments[chosen]
            commands.append(
                drawing.draw_rods(
                    f"{ROOT}/pairs/{path}",
                    some,
                    np.full(len(some), radius),
                    paints.take(chosen),
                    Look(),
                )
            )
        rest = slice(NEAR_PAIRS, None)
        path = f"{ROOT}/pairs/rest"
        commands.append(drawing.draw_lines(path, segments[rest], paints.take(rest), FAINT))
        return segments

    def _find_segments(
        self, message: FrameMessage, cover: Array
    ) -> tuple[Array, NDArray[np.float32]]:
        """Lines of the pairs whose both ends are somewhere, and the contact time of each."""
        pairs: Pairs = message.pairs
        segments, times = [], []
        if self._arm is not None and len(cover):
            obstacles, sound = message.obstacles, find_sound(message.obstacles)
            ends = np.cumsum(obstacles.counts.astype(np.int64))
            for link, row, time in zip(pairs.links, pairs.obstacles, pairs.times, strict=True):
                balls = cover[self._arm.links == link]
                if not (sound[row] and len(balls)):
                    continue
                points = obstacles.points[ends[row] - obstacles.counts[row] : ends[row]]
                radius = float(obstacles.radii[row])
                segments.append(connect(balls, points.astype(np.float64), radius))
                times.append(time)
        return np.array(segments).reshape(-1, 2, 3), np.array(times, dtype=np.float32)

    def _draw_reach(self, message: FrameMessage, commands: list[Command]) -> None:
        balls = message.reach.values[np.isfinite(message.reach.values).all(axis=1)]
        first = message.obstacles.times[0] if len(message.obstacles.times) else 0.0
        paints = self._paint(np.full(len(balls), first, np.float32), message)
        commands.append(drawing.draw_balls(f"{ROOT}/reach", balls, paints, Look(0.14)))

    def _aim(self, message: FrameMessage, cover: Array, segments: Array, legs: Array) -> Command:
        """What the camera is to keep in the picture: balls in the world, in [m]."""
        assert self._message is not None, "aims at a scene"
        obstacles = message.obstacles
        counts = obstacles.counts.astype(np.int64)
        owner = np.repeat(np.arange(len(counts)), counts)
        base = np.array(self._message.base).reshape(4, 4)[:3, 3]
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
        """What the panels say."""
        assert self._message is not None, "describes a scene's frame"
        verdict = message.verdict
        own = find_levels([verdict.contact_time], verdict.stop_time, self._margins, verdict.level)
        content = {
            **msgspec.structs.asdict(verdict),
            "sequence": message.sequence,
            "now": message.now,
            "wall": message.wall,
            "contact_level": LEVELS[int(own[0])],
            "load": message.load,
            "obstacles": len(message.obstacles.ids) + message.omitted,
            "sources": message.sources,
            "latches": message.latches,
            "buckets": message.pairs.buckets.tolist(),
            "explanation": message.explanation,
            "asking": self._tell_how_to_ask(message),
            "has_plan": bool(message.plan),
            "notes": notes,
        }
        return drawing.show("banner", content)

    def _tell_how_to_ask(self, message: FrameMessage) -> str:
        """The command that explains a STOP; empty where the page does, or there is nothing to.

        An explanation takes as long as dozens of ticks, and needs all that led to the moment: a
        running monitor has neither the time nor anybody who could ask in its place.
        """
        assert self._message is not None, "tells of a scene's frame"
        verdict, scene = message.verdict, self._message
        if verdict.level != LEVELS[0] or verdict.since is None or scene.is_recorded:
            return ""
        if message.explanation or not math.isfinite(verdict.since):
            return ""
        file = shlex.quote(scene.recording) if scene.recording else "FILE"
        # Rounded down: the first tick from there on is the one that said STOP.
        return f"armguard replay {file} --explain {math.floor(1e3 * verdict.since) / 1e3:.3f}"


def _count_segments(count: int) -> int:
    """Of how many flat pieces each of so many bodies is made, all around."""
    return 24 if count <= SOME else 12 if count <= MANY else 8


def find_sound(obstacles: ObstacleShapes) -> NDArray[np.bool_]:
    """Which obstacles are somewhere, and can be drawn. Shape (n,)."""
    counts = obstacles.counts.astype(np.int64)
    if not len(counts):
        return np.zeros(0, dtype=np.bool_)
    finite = np.isfinite(obstacles.points).all(axis=1)
    whole = np.logical_and.reduceat(finite, np.cumsum(counts) - counts)
    sound: NDArray[np.bool_] = whole & (obstacles.radii >= 0.0) & (obstacles.radii < np.inf)
    return sound


def _hull(points: NDArray[np.float32], radius: float) -> Array:
    """Triangles of the rounded hull, in [m]. Shape (n, 3, 3)."""
    # A flat hull has no inside: too thin a one is drawn a millimetre thick.
    corners = points.astype(np.float64)[:, None] + max(radius, 1e-3) * _BALL_DIRECTIONS
    vertices = coal.StdVec_Vec3s()
    for corner in corners.reshape(-1, 3):
        vertices.append(corner)
    hull = coal.Convex.convexHull(vertices, True, "Qt")
    polygons = [hull.polygons(number) for number in range(hull.num_polygons)]
    indices = np.array([[polygon[0], polygon[1], polygon[2]] for polygon in polygons])
    triangles: Array = np.asarray(hull.points())[indices]
    return triangles
