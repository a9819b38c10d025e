"""Scenes and frames to show, and a way to read what would be drawn."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from armguard.view import (
    FrameMessage,
    LinkCover,
    ObstacleShapes,
    Pairs,
    SceneMessage,
    VerdictSummary,
)

PERIOD = 1e-3
JOINTS = tuple(f"panda_joint{number}" for number in range(1, 8))
Q = (0.2, -0.4, 0.1, -2.0, 0.0, 1.7, 0.8)


def make_scene(**changes: Any) -> SceneMessage:
    cover = tuple(
        LinkCover.pack(f"panda_link{number}", joint, [[0.0, 0.0, 0.0, 0.1], [0.0, 0.0, 0.1, 0.08]])
        for number, joint in enumerate(JOINTS, start=1)
    )
    fields = {"robot": "panda", "joints": JOINTS, "cover": cover, "period": PERIOD}
    return SceneMessage(**(fields | changes))


def make_frame(contact_time: float = 0.3, sequence: int = 1, **changes: Any) -> FrameMessage:
    """A frame in which everything is as imminent as `contact_time` says."""
    box = [[x, y, z] for x in (0.4, 0.8) for y in (-0.9, -0.5) for z in (0.2, 0.4)]
    points = np.zeros((3, 8, 3))
    points[0, 0] = (0.9, 0.1, 0.7)
    points[1, :2] = ((0.2, 0.7, 0.2), (0.2, 0.7, 0.9))
    points[2] = box
    fields = {
        "sequence": sequence,
        "now": 0.033 * sequence,
        "q": Q,
        "verdict": VerdictSummary(
            level="STOP" if contact_time < 0.2 else "CLEAR",
            contact_time=contact_time,
            stop_time=0.2,
            link="panda_hand",
            obstacle="hand",
            reasons=("contact possible",),
            effects=("note",),
        ),
        "sphere_times": np.full(14, contact_time, "<f4").tobytes(),
        "obstacles": ObstacleShapes.pack(
            ["hand", "arm", "box"],
            points,
            [0.15, 0.1, 0.0],
            counts=[1, 2, 8],
            times=[contact_time] * 3,
        ),
        "pairs": Pairs.pack([5], [0], [contact_time]),
    }
    return FrameMessage(**(fields | changes))


def read_command(payload: bytes) -> dict[str, Any]:
    """A drawing command as the page would see it, its arrays as NumPy's."""
    return msgspec.msgpack.decode(payload, ext_hook=_read_array)


def _read_array(code: int, data: memoryview) -> np.ndarray:
    return np.frombuffer(data, {0x12: "u1", 0x17: "<f4"}[code])
