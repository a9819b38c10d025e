"""What ties the recorded bodies of one person to each other: lengths between tracked points.

A tether counts from both its ends: no point of either body is farther than its length from the
other's hull. So one between a hand and an upper arm would have to be as long as a whole arm. The
tracked elbows and shoulders are therefore bodies of their own, and limbs are tied to these. They
are balls within the limbs that meet there, which adds nothing to where the person is.

Markers are not where joints are. Published lengths between joints hold for limbs all the same; from
the head to the collar, 0.49 m here, they do not, and nothing ties the head.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from armguard.lab.simulation.bodies import BODIES, POINTS, Body
from armguard.people.proportions import SEGMENTS

SIDES = ("left", "right")

Bone = tuple[str, str]
"""Names of two tracked points."""


def _on_both_sides(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The same with either side in place of each star."""
    return [tuple(name.replace("*", side) for name in names) for side in SIDES]


_LENGTHS = (
    ("collar", "*_shoulder", 0.5 * SEGMENTS["shoulders"].length),
    ("*_shoulder", "*_elbow", SEGMENTS["upper_arm"].length),
    ("*_elbow", "*_hand", SEGMENTS["forearm"].length + SEGMENTS["palm"].length),
)

BONES: dict[Bone, float] = {("collar", "hip"): SEGMENTS["trunk"].length} | {
    (a, b): length for *names, length in _LENGTHS for a, b in _on_both_sides(tuple(names))
}
"""How far apart two points of anybody are at the most, in [m]."""

_RADII = {body.name: body.radius for body in BODIES}

JOINTS = tuple(
    Body(f"{side}_{joint}_joint", (f"{side}_{joint}",), _RADII[f"{side}_{joint}"])
    for side in SIDES
    for joint in ("shoulder", "elbow")
)
"""Balls within the limbs that meet at a joint."""

_LIMBS = (
    ("*_shoulder_joint", "collar", "collar", "*_shoulder"),
    ("*_elbow_joint", "*_shoulder_joint", "*_shoulder", "*_elbow"),
    ("*_shoulder", "*_shoulder_joint", "*_shoulder", "*_elbow"),
    ("*_shoulder", "*_elbow_joint", "*_shoulder", "*_elbow"),
    ("*_elbow", "*_elbow_joint", "*_elbow", "*_hand"),
    ("*_elbow", "*_hand", "*_elbow", "*_hand"),
    ("*_hand", "*_elbow_joint", "*_elbow", "*_hand"),
)

_TIED = [
    ("hip", "collar", "collar", "hip"),
    *(names for limb in _LIMBS for names in _on_both_sides(limb)),
]
"""Two bodies that are tied, and the bone that is as long as they can be apart."""


def measure_bones(points: np.ndarray, is_clean: np.ndarray, error: float) -> dict[Bone, float]:
    """Lengths of one person: the longest between clean samples, and both errors, in whole cm.

    Args:
        points: Tracked, in [m]. Shape (frames, 9, 3).
        is_clean: Which of them count. Shape (frames, 9).
        error: Of each, in [m].
    """
    lengths = {}
    for a, b in BONES:
        one, other = POINTS.index(a), POINTS.index(b)
        both = is_clean[:, one] & is_clean[:, other]
        longest = np.linalg.norm(points[both, one] - points[both, other], axis=1).max()
        lengths[a, b] = 1e-2 * math.ceil(1e2 * (float(longest) + 2.0 * error))
    return lengths


def list_tethers(bones: Mapping[Bone, float]) -> list[tuple[str, str, float]]:
    """Names of two bodies that are tied, and how far apart they are at the most, in [m].

    Args:
        bones: Lengths in [m].
    """
    return [(one, other, bones[a, b]) for one, other, a, b in _TIED]
