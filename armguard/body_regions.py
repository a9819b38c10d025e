"""The body regions for which contact limits are stated.

The region of an obstacle is the part of a person that it represents. An obstacle's message or a
pattern of ids states it. Contact limits are stated by region.
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
"""Regions that may never be touched, whatever limits are stated."""
