"""Bounds on acceleration and speed of body parts, and the part of an obstacle by its id.

They are percentiles of observed motions, not limits of what people can do: a blow, a fall or a
throw at full strength is faster. Those of legs are assumed. If a bound is broken, the table reports
it and uses the observed values from then on, but earlier proofs did not hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import NamedTuple

from armguard.exceptions import ArmguardError

_SOURCE = (
    "five motion captures of people who hand over, hammer, stack, throw and pick beside an arm"
    " (github.com/JakobThumm/human-robot-animations, commit 4a177d17), 76 s at 100 Hz:"
    " docs/people.md"
)


class PartBounds(NamedTuple):
    """Bounds on the motion of one body part, and the share of samples within them."""

    accel: float
    """In [m]/[s]²."""
    speed: float
    """In [m]/[s]."""
    percentile: float
    """Least percentage of clean samples within both bounds; 0: assumed, not measured."""
    source: str
    """Source of the measurement."""


def _bound(accel: float, speed: float) -> PartBounds:
    return PartBounds(accel, speed, 99.9, _SOURCE)


_ASSUMED = "assumed: a foot at three times the speed of walking; legs were not tracked"
_THIGH = PartBounds(30.0, 3.0, 0.0, _ASSUMED)
_FOOT = PartBounds(60.0, 5.0, 0.0, _ASSUMED)

_ELBOW = _bound(30.0, 2.0)
_HAND = _bound(41.0, 3.5)

BOUNDS: Mapping[str, PartBounds] = MappingProxyType(
    {
        "head": _bound(5.0, 1.6),
        "trunk": _bound(7.0, 1.6),
        "shoulder": _bound(6.0, 1.6),
        "elbow": _ELBOW,
        "hand": _HAND,
        # The hull of two joints: its points are mixtures of both ends, and no wilder than the
        # wilder of them.
        "upper_arm": _ELBOW,
        "forearm": _HAND,
        "thigh": _THIGH,
        "shank": _FOOT,
        "foot": _FOOT,
    }
)
"""Bounds by part. "shoulder" and "elbow" are the joints; limbs have those of their farther end."""

_NAMES = {
    "head": "head",
    "collar": "trunk",
    "chest": "trunk",
    "torso": "trunk",
    "trunk": "trunk",
    "hip": "trunk",
    "pelvis": "trunk",
    "shoulder": "upper_arm",
    "upper_arm": "upper_arm",
    "elbow": "forearm",
    "lower_arm": "forearm",
    "forearm": "forearm",
    "wrist": "hand",
    "hand": "hand",
    "thigh": "thigh",
    "knee": "shank",
    "shank": "shank",
    "lower_leg": "shank",
    "ankle": "foot",
    "foot": "foot",
}

PATTERNS: Mapping[str, str] = MappingProxyType(
    {
        pattern: part
        for name, part in _NAMES.items()
        for pattern in (name, f"*[!a-zA-Z]{name}")  # "left_hand", but no "secondhand"
    }
)
"""Parts by pattern of ids, as in `fnmatch`, upper and lower case being different.

A body that is named after a joint may reach to the next joint outwards, as capsules do: by these
patterns "left_shoulder" has the bounds of an upper arm, "left_elbow" those of a forearm. Where it
is a ball around the joint, patterns of your own can say so.
"""


def find_bounds(id: str, patterns: Mapping[str, str] = PATTERNS) -> PartBounds | None:
    """Bounds of the part of a body that an obstacle's id names.

    Args:
        id: Id of the obstacle.
        patterns: Parts by pattern of ids; the first matching pattern counts.

    Returns:
        The part's bounds; None if no pattern matches.

    Raises:
        ArmguardError: That pattern has a part that is not in `BOUNDS`.
    """
    for pattern, part in patterns.items():
        if fnmatchcase(id, pattern):
            return _get_part(pattern, part)
    return None


def list_bounds(patterns: Mapping[str, str] = PATTERNS) -> list[tuple[str, float, float]]:
    """Patterns of ids, accelerations in [m]/[s]² and speeds in [m]/[s], for `Obstacles`.

    Args:
        patterns: Parts by pattern of ids, in the order in which they are to be tried.

    Raises:
        ArmguardError: A part is not in `BOUNDS`; the message names it and its pattern.
    """
    return [(pattern, *_get_part(pattern, part)[:2]) for pattern, part in patterns.items()]


def _get_part(pattern: str, part: str) -> PartBounds:
    if part not in BOUNDS:
        raise ArmguardError(
            f"pattern {pattern!r}", f"names part {part!r}", expected=f"one of {', '.join(BOUNDS)}"
        )
    return BOUNDS[part]
