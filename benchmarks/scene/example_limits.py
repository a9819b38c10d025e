"""Contact limits for recorded people: an example, made of figures that the literature quotes.

The figures are those quoted for ISO/TS 15066: quasi-static force, stiffness and effective mass by
region; an impact may press twice as hard. Public sources contradict each other, and nobody should
take these for a cell of their own.
"""

from __future__ import annotations

from typing import Literal

from armguard.people.body_parts import PATTERNS
from armguard.settings.contact_limits import ContactLimit, ContactLimits

SOURCE = "an example: figures quoted for ISO/TS 15066"

FIGURES = {
    "hand": (140.0, 75e3, 0.6),
    "forearm": (160.0, 40e3, 2.0),
    "upper_arm": (150.0, 30e3, 3.0),
    "chest": (140.0, 25e3, 40.0),
}
"""Force in [N], stiffness in [N]/[m] and mass in [kg]."""

PersonSpeed = float | Literal["own"]
"""What limits count of a person's own speed, in [m]/[s], or "own"."""

_REGIONS = {
    "head": "head", "trunk": "chest", "upper_arm": "upper_arm", "forearm": "forearm",
    "hand": "hand",
}  # fmt: skip
"""By part of the body. The chest has the strictest of the limits quoted for the trunk."""

PATTERNS_OF_REGIONS = {
    pattern: _REGIONS[part] for pattern, part in PATTERNS.items() if part in _REGIONS
}
"""Regions by pattern of ids, as `Obstacles` takes them."""


def make_limits(person_speed: PersonSpeed = "own") -> ContactLimits:
    """Of all regions but the head, which may never be touched."""
    return ContactLimits(
        {
            region: ContactLimit(
                force=force, transient_force=2.0 * force, stiffness=stiffness, body_mass=mass,
                source=SOURCE, person_speed=person_speed,
            )
            for region, (force, stiffness, mass) in FIGURES.items()
        }
    )  # fmt: skip


LIMITS = make_limits()
"""For what the arm does to a part at rest."""
