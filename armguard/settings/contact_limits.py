"""Contact limits as a user states them: which parts of a body a slow surface may touch.

A body part of mass m that a surface strikes at speed v takes up at most ½ m v² in its tissue,
however heavy the arm is. So each limit, however it is stated, becomes a limit on the speed of the
surface that touches. docs/contact_limits.md has the model, and where numbers can be found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import msgspec
import numpy as np

from armguard.body_regions import NEVER_TOUCHED, NUMBERS, REGIONS
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import SUM_ROUNDING
from armguard.settings.declarations import NotNegative, Positive, check_fields

_HEAD, _BODY, _ARM, _HAND, _LEG, _FOOT = 0.3, 0.5, 0.12, 0.1, 0.18, 0.12

GAPS: Mapping[str, float] = {
    "head": _HEAD, "face": _HEAD, "neck": _HEAD,
    "chest": _BODY, "abdomen": _BODY, "back": _BODY, "pelvis": _BODY, "shoulder": _BODY,
    "upper_arm": _ARM, "forearm": _ARM, "hand": _HAND,
    "thigh": _LEG, "lower_leg": _LEG, "foot": _FOOT,
}  # fmt: skip
"""The least gap that does not crush a part, in [m], by region: those of ISO 13854 for head, body,
arm, hand, leg and foot [Gaps]_. Where less is left, the part can be clamped."""

THICKNESSES: Mapping[str, float] = {
    "head": 0.1, "face": 0.1, "neck": 0.08,
    "chest": 0.12, "abdomen": 0.12, "back": 0.12, "pelvis": 0.12, "shoulder": 0.06,
    "upper_arm": 0.05, "forearm": 0.03, "hand": 0.01,
    "thigh": 0.08, "lower_leg": 0.05, "foot": 0.015,
}  # fmt: skip
"""How thick a part is at its thinnest place, in [m], by region: assumed, for small adults, fingers
and toes included. Smaller values make more of an arm's own links count as what can clamp it."""


class ContactLimit(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What contact with a region of the body is permitted, stated in one of three ways.

    These are `speed`; or `energy` and `body_mass`; or `force`, `stiffness` and `body_mass`, which
    stand for the energy force² / (2 stiffness), or of the `transient_force` if that is stated. 0 is
    "never". Only a limit with `force` and `stiffness` permits contact where the part can be
    clamped.

    Raises:
        ArmguardError: A number is negative, infinite or NaN, the source is missing, or the limit is
            stated in none of the three ways, in part, or in more than one.
    """

    speed: NotNegative | None = None
    """Greatest speed of a touching surface, in [m/s]. Left out: follows from the others."""
    energy: NotNegative | None = None
    """Greatest energy in the tissue, in [J]."""
    force: NotNegative | None = None
    """Greatest force, in [N]; without it a part that can be clamped may not be touched."""
    transient_force: NotNegative | None = None
    """Greatest impact force where the part can move away, in [N]. Left out: `force`."""
    stiffness: Positive | None = None
    """Tissue stiffness, in [N/m]; high is cautious. Left out: needed with `force`."""
    body_mass: Positive | None = None
    """Effective mass of the part, in [kg]; high is cautious. Left out: needed with `energy` or
    `force`."""
    source: str = ""
    """Origin of the numbers. Left out: needed."""
    person_speed: NotNegative | Literal["own"] = "own"
    """Speed of the part, in [m/s], to which the arm adds; `"own"`: the part counts as at rest."""
    gap: NotNegative | None = None
    """Distance to anything below which the part can be clamped, in [m]. Left out: by ISO 13854."""
    thickness: NotNegative | None = None
    """Least thickness of the part, in [m]. Left out: assumed."""

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.source.strip():
            raise ArmguardError(
                "source", f"is {self.source!r}", expected="where the numbers come from, in words"
            )
        given = [name for name in _WAYS if getattr(self, name) is not None]
        if len(given) != 1:
            first, *others = given or _WAYS
            offender = others[0] if given else first
            problem = (
                f"is given beside {first}" if given else f"is missing, like {' and '.join(others)}"
            )
            raise ArmguardError(offender, problem, expected=f"exactly one of {', '.join(_WAYS)}")
        (way,) = given
        for name in ("stiffness", "body_mass"):
            if (getattr(self, name) is not None) != (name in _WAYS[way]):
                problem = "is missing" if name in _WAYS[way] else "is given"
                needed = " and ".join((way, *_WAYS[way]))
                raise ArmguardError(name, f"{problem} beside {way}", expected=f"{needed} alone")
        if self.transient_force is not None and not (
            self.force is not None and self.transient_force >= self.force
        ):
            raise ArmguardError(
                "transient_force",
                f"is {self.transient_force:g} N",
                expected="at least `force`, which must be given",
            )
        if not (math.isfinite(self.max_speed) and math.isfinite(self.max_way)):
            raise ArmguardError(
                way, f"comes to {self.max_speed:g} m/s", expected="numbers with a finite quotient"
            )

    @property
    def impact_speed(self) -> float:
        """How fast a surface may be that strikes the part while it is at rest, in [m/s]."""
        if self.speed is not None:
            return float(self.speed)
        mass = float(self.body_mass or math.nan)
        if self.energy is not None:
            speed = math.sqrt(2.0 * self.energy / mass)
        else:
            # √(2 E / m) with E = F² / (2 k).
            stiffness = float(self.stiffness or math.nan)
            force = float(self.transient_force or self.force or 0.0)
            speed = force / (math.sqrt(stiffness) * math.sqrt(mass))
        return speed * (1.0 - SUM_ROUNDING)

    @property
    def max_speed(self) -> float:
        """How fast a surface may be that touches the part, in [m/s]; 0: never.

        With v for what a part at rest may be struck by, and the person's speed p, it is the speed w
        for which (w + p)² − p² = v²: √(p² + v²) − p, which is v²/(√(p² + v²) + p).
        """
        struck = self.impact_speed
        if self.person_speed == "own" or not struck > 0.0:
            return struck
        own = float(self.person_speed)
        return struck * (struck / (math.hypot(own, struck) + own)) * (1.0 - SUM_ROUNDING)

    @property
    def max_way(self) -> float:
        """How far a surface may still go that presses a clamped part, in [m]; 0: never."""
        if self.force is None or self.stiffness is None:
            return 0.0
        return self.force / self.stiffness * (1.0 - SUM_ROUNDING)


_WAYS: Mapping[str, tuple[str, ...]] = {
    "speed": (),
    "energy": ("body_mass",),
    "force": ("stiffness", "body_mass"),
}
"""What a limit is stated by, and what it needs besides."""


class ContactLimits(msgspec.Struct, frozen=True):
    """Limits by region of the body; a region without one may never be touched.

    `ContactLimits({"hand": ContactLimit(speed=0.5, source="risk assessment of cell 7")})`. Regions
    are those of `armguard.body_regions`. Head, face and neck may never be touched, whatever is
    stated, so a limit above 0 is refused for them.

    Raises:
        ArmguardError: A region is unknown, or has no `ContactLimit`, or one that it cannot have.
    """

    by_region: Mapping[str, ContactLimit]
    """The limit of each region that has one."""

    def __post_init__(self) -> None:
        if not isinstance(self.by_region, Mapping):
            raise ArmguardError(
                "contact_limits", f"is {self.by_region!r}", expected="limits by region"
            )
        for region, limit in self.by_region.items():
            if region not in NUMBERS:
                raise ArmguardError(
                    "contact_limits",
                    f"names the region {region!r}",
                    expected=f"one of {', '.join(REGIONS)}",
                )
            where = f"contact_limits.{region}"
            if not isinstance(limit, ContactLimit):
                raise ArmguardError(where, f"is {limit!r}", expected="a ContactLimit")
            if region in NEVER_TOUCHED and limit.max_speed > 0.0:
                raise ArmguardError(
                    where,
                    f"permits contact at {limit.max_speed:g} m/s",
                    expected="0, or no limit: head, face and neck may never be touched",
                )
        msgspec.structs.force_setattr(self, "by_region", dict(self.by_region))

    def tabulate(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """What the limits come to, by number of region, with the defaults of each region.

        Returns:
            `max_speed` in [m/s] and `max_way` in [m] of `ContactLimit`, 0 where nothing is
            permitted; `gap` and `thickness` in [m]. Number 0 is no region. Shapes (regions + 1,).
        """
        count = len(REGIONS) + 1
        max_speed, max_way, thickness = (np.zeros(count) for _ in range(3))
        gap = np.full(count, np.inf)
        for region, limit in self.by_region.items():
            number = NUMBERS[region]
            max_speed[number], max_way[number] = limit.max_speed, limit.max_way
            gap[number] = GAPS[region] if limit.gap is None else limit.gap
            thickness[number] = THICKNESSES[region] if limit.thickness is None else limit.thickness
        return max_speed, max_way, gap, thickness

    def describe(self, regions: int, *, by: Literal["max_speed", "max_way"] = "max_speed") -> str:
        """The strictest limit of a set of regions, in words, with its source.

        Args:
            regions: Set of numbers of regions: number k adds 2**k to it.
            by: By what it is the strictest.
        """
        limits = [
            (getattr(limit, by), region, limit.source)
            for region, limit in self.by_region.items()
            if (regions >> NUMBERS[region]) & 1
        ]
        if not limits:
            return "no limit"
        _, region, source = min(limits)
        return f"{region}: {source}"

    def describe_permitted(self, regions: int) -> str:
        """What contact with an obstacle of a set of regions is permitted, in words.

        Args:
            regions: As for `describe`.
        """
        stated = [
            self.by_region.get(region) for region in REGIONS if (regions >> NUMBERS[region]) & 1
        ]
        limits = [limit for limit in stated if limit is not None and limit.max_speed > 0.0]
        if not limits or len(limits) < len(stated) or regions & 1:
            return self.describe_never(regions)
        speed = min(limit.max_speed for limit in limits)
        way = min(limit.max_way for limit in limits)
        return (
            f"at most {speed:.3g} m/s and, where it can be clamped, {1e3 * way:.3g} mm of way are "
            f"permitted ({self.describe(regions)})"
        )

    def describe_never(self, regions: int) -> str:
        """Why an obstacle with a set of regions may never be touched, in words."""
        for region, number in NUMBERS.items():
            limit = self.by_region.get(region)
            if (regions >> number) & 1 and (limit is None or not limit.max_speed > 0.0):
                source = "no limit is stated for it" if limit is None else limit.source
                return f"may never be touched ({region}: {source})"
        return "may never be touched: its region is not stated"
