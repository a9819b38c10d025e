"""What to draw: turns the feed's messages into the latest values of drawing commands.

Everything that is coloured is coloured by imminence: a cover ball by its most imminent pair, an
obstacle by its most imminent pair, a line by its pair. Of a refused obstacle the last accepted
state is shown, in a colour that the scale does not have.
"""

from __future__ import annotations

from collections.abc import Callable

import coal
import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.view import drawing
from armguard.view.arm import Arm
from armguard.view.buckets import (
    NO_BUCKET_COLOUR,
    REFUSED_COLOUR,
    compute_colours,
    describe_buckets,
    parse_colour,
)
from armguard.view.drawing import Command
from armguard.view.messages import FrameMessage, ObstacleShapes, Pairs, SceneMessage

ROOT = "/armguard"
COVER_OPACITY = 0.2
OBSTACLE_OPACITY = 0.72
HULL_OPACITY = 0.45
ROD_RADIUS = 0.006
_BALL_DIRECTIONS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
)
_BALL_DIRECTIONS /= np.linalg.norm(_BALL_DIRECTIONS, axis=1, keepdims=True)


class Picture:
    """What is drawn of one monitor.

    Args:
        draw: Takes each command; of a key, the latest counts.
        clear: Called before another scene is drawn, to forget all commands.
    """

    def __init__(self, draw: Callable[[Command], None], clear: Callable[[], None]) -> None:
        self._draw = draw
        self._clear = clear
        self._message: SceneMessage | None = None
        self._arm: Arm | None = None
        self._notes: list[str] = []
        self._hulls: dict[bytes, NDArray[np.float64]] = {}

    def draw_scene(self, message: SceneMessage) -> None:
        """Draw what does not change; the repetition of a known scene costs nothing."""
        if message == self._message:
            return
        self._message, self._arm = message, None
        self._hulls = {}
        self._clear()
        self._colours = compute_colours(message.period)
        legend = [
            {"text": text, "colour": colour, "start": start}
            for text, colour, start in describe_buckets(message.period)
        ]
        extra = [
            {"text": "in no watched pair", "colour": NO_BUCKET_COLOUR},
            {"text": "refused: last accepted state", "colour": REFUSED_COLOUR},
        ]
        self._draw(drawing.show("legend", {"steps": legend, "others": extra}))
        try:
            self._arm = Arm(message)
            for command in self._arm.draw():
                self._draw(command)
            self._notes = self._arm.notes
        except ArmguardError as error:
            self._notes = [f"the arm is not drawn: {error}"]

    def draw_frame(self, message: FrameMessage) -> None:
        """Draw one moment; without a scene there is nothing yet to draw it in."""
        if self._message is None:
            return
        notes = list(self._notes)
        if self._arm is not None:
            try:
                self._draw_arm(self._arm, message)
            except ArmguardError as error:
                notes.append(f"the arm is not moved: {error}")
        self._draw_obstacles(message.obstacles)
        self._draw_pairs(message.pairs)
        verdict = message.verdict
        self._draw(
            drawing.show(
                "banner",
                {
                    "robot": self._message.robot,
                    "sequence": message.sequence,
                    "level": verdict.level,
                    "contact_time": verdict.contact_time,
                    "stop_time": verdict.stop_time,
                    "speed_scale": verdict.speed_scale,
                    "link": verdict.link,
                    "obstacle": verdict.obstacle,
                    "complete": verdict.complete,
                    "reasons": verdict.reasons,
                    "load": None if message.load is None else msgspec.to_builtins(message.load),
                    "obstacles": len(message.obstacles.ids),
                    "notes": notes,
                },
            )
        )

    def _draw_arm(self, arm: Arm, message: FrameMessage) -> None:
        if not np.isfinite(message.q).all():
            raise ArmguardError("q", "is not finite")
        arm.place(message.q)
        for path, pose in arm.compute_poses():
            self._draw(drawing.move(path, pose))
        buckets = np.frombuffer(message.sphere_buckets, np.uint8)
        if len(buckets) != len(arm.radii):
            raise ArmguardError(
                "sphere_buckets", f"has {len(buckets)} values", expected=f"{len(arm.radii)}"
            )
        self._draw(
            drawing.draw_balls(
                f"{ROOT}/cover",
                arm.compute_centres(),
                arm.radii,
                self._colours[buckets],
                COVER_OPACITY,
            )
        )

    def _draw_obstacles(self, obstacles: ObstacleShapes) -> None:
        colours = self._colours[obstacles.buckets]
        colours[obstacles.refused] = parse_colour(REFUSED_COLOUR)
        counts, points, radii = obstacles.counts.astype(np.int64), obstacles.points, obstacles.radii
        ends = np.cumsum(counts)
        sound = np.array(
            [
                bool(np.isfinite(points[end - count : end]).all() and 0.0 <= radius < np.inf)
                for end, count, radius in zip(ends, counts, radii, strict=True)
            ],
            dtype=bool,
        )
        owner = np.repeat(np.arange(len(counts)), counts)
        round_ones = sound[owner] & (counts[owner] <= 2)
        self._draw(
            drawing.draw_balls(
                f"{ROOT}/obstacles/balls",
                points[round_ones],
                radii[owner[round_ones]],
                colours[owner[round_ones]],
                OBSTACLE_OPACITY,
            )
        )
        capsules = np.flatnonzero(sound & (counts == 2))
        self._draw(
            drawing.draw_rods(
                f"{ROOT}/obstacles/rods",
                np.stack([points[ends[capsules] - 2], points[ends[capsules] - 1]], axis=1),
                radii[capsules],
                colours[capsules],
                OBSTACLE_OPACITY,
            )
        )
        self._draw_hulls(
            [
                (points[ends[row] - counts[row] : ends[row]], float(radii[row]), colours[row])
                for row in np.flatnonzero(sound & (counts > 2))
            ]
        )

    def _draw_hulls(
        self, hulls: list[tuple[NDArray[np.float32], float, NDArray[np.float32]]]
    ) -> None:
        """Draw boxes and the like; one whose shape and place are known is not computed again."""
        known: dict[bytes, NDArray[np.float64]] = {}
        corners, colours = [np.zeros((0, 3, 3))], [np.zeros((0, 3))]
        for points, radius, colour in hulls:
            key = points.tobytes() + str(radius).encode()
            known[key] = self._hulls[key] if key in self._hulls else _hull(points, radius)
            corners.append(known[key])
            colours.append(np.tile(colour, (3 * len(known[key]), 1)))
        self._hulls = known
        self._draw(
            drawing.draw_surface(
                f"{ROOT}/obstacles/hulls",
                np.concatenate(corners),
                np.concatenate(colours),
                HULL_OPACITY,
            )
        )

    def _draw_pairs(self, pairs: Pairs) -> None:
        sound = np.isfinite(pairs.segments).all(axis=(1, 2))
        segments, colours = pairs.segments[sound], self._colours[pairs.buckets[sound]]
        self._draw(drawing.draw_lines(f"{ROOT}/pairs/lines", segments, colours))
        # The pair that decides the verdict stands out.
        self._draw(
            drawing.draw_rods(
                f"{ROOT}/pairs/first",
                segments[:1],
                np.full(len(segments[:1]), ROD_RADIUS),
                colours[:1],
                1.0,
            )
        )


def _hull(points: NDArray[np.float32], radius: float) -> NDArray[np.float64]:
    """Triangles of the rounded hull, in [m]. Shape (n, 3, 3)."""
    # A flat hull has no inside: too thin a one is drawn a millimetre thick.
    corners = points.astype(np.float64)[:, None] + max(radius, 1e-3) * _BALL_DIRECTIONS
    vertices = coal.StdVec_Vec3s()
    for corner in corners.reshape(-1, 3):
        vertices.append(corner)
    hull = coal.Convex.convexHull(vertices, True, "Qt")
    polygons = [hull.polygons(number) for number in range(hull.num_polygons)]
    indices = np.array([[polygon[0], polygon[1], polygon[2]] for polygon in polygons])
    triangles: NDArray[np.float64] = np.asarray(hull.points())[indices]
    return triangles
