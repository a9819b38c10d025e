"""The regions of a body that contact limits speak of.

A region is what an obstacle's message, or a pattern of ids, says of an obstacle: which part of a
person it is. Contact limits are stated by region.
"""

from __future__ import annotations

REGIONS = (
    "head",
    "face",
    "neck",
    "chest",
    "abdomen",
    "back",
    "pelvis",
    "shoulder",
    "upper_arm",
    "forearm",
    "hand",
    "thigh",
    "lower_leg",
    "foot",
)
"""All regions."""

NUMBERS = {region: number for number, region in enumerate(REGIONS, 1)}
"""Numbers of the regions; 0 stands for no region."""

NEVER_TOUCHED = frozenset({"head", "face", "neck"})
"""Regions that may never be touched, whatever is stated."""
