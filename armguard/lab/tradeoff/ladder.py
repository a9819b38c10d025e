"""The ladder: choices, axis by axis, and the settings that a study runs.

Not the whole product: one axis at a time around the default.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from armguard.cover.cover import DEFAULT_PROTRUSION, Cover
from armguard.exceptions import ArmguardError
from armguard.robot.operating_limits import PUBLISHED
from armguard.settings.declarations import read_declarations
from armguard.settings.settings import Settings

DEFAULT, FINEST = "default", "finest"
"""Names of two settings: what a user has who chooses nothing, and what the rest is held against."""

AUTO = "auto"
"""Name of another, and of its axis: what `Monitor.auto` chooses by a trial of its own."""

OPERATING = "operating"
"""Name of an axis of premises rather than of choices: what the controller is said to keep to."""


class Rung(NamedTuple):
    """One choice on one axis."""

    axis: str
    value: str
    """As it is called."""
    monitor: Mapping[str, Any] = {}  # nobody writes to it
    """Settings of the monitor; a schedule of the paper's is ("daa", partition law)."""
    level: int | None = None
    """Of the cover's tree, the finest that is used; None: all."""
    protrusion: float | None = None
    """Of a cover that is fitted for this, in [m]; None: the robot's own."""

    def __str__(self) -> str:
        return f"{self.axis} {self.value}"


class Setting(NamedTuple):
    """What one contestant runs with: the rungs in which it differs from the default."""

    name: str
    rungs: tuple[Rung, ...] = ()

    @property
    def axis(self) -> str:
        """Of a setting that differs in one axis; else empty."""
        is_one = len(self.rungs) == 1 and self.name not in (DEFAULT, FINEST)
        return self.rungs[0].axis if is_one else ""

    def monitor(self, usual: Mapping[str, Any]) -> dict[str, Any]:
        """Keywords of `Monitor`, given those of the default."""
        settings = dict(usual)
        for rung in self.rungs:
            settings.update(rung.monitor)
        return settings

    @property
    def is_choice(self) -> bool:
        """Whether it can be chosen: on the same premises."""
        return not any(rung.axis == OPERATING for rung in self.rungs)


def _list_numbers() -> dict[str, list[Rung]]:
    """By setting that is a number, what its record has as examples."""
    return {
        one.name: [_step(one.name, value) for value in one.examples]
        for one in read_declarations(Settings).values()
        if one.is_number and one.examples
    }


def _step(axis: str, value: float) -> Rung:
    unit = " Hz" if axis == "rate" else ""
    number = f"{value:,}" if isinstance(value, int) else f"{value:g}"
    return Rung(axis, f"{number}{unit}", {axis: value})


def _daa(law: str) -> Rung:
    return Rung("schedule", f"daa, {law}", {"schedule": ("daa", law)})


AXES: dict[str, list[Rung]] = {
    OPERATING: [
        Rung(OPERATING, "none", {"operating": None}),
        Rung(OPERATING, "published", {"operating": PUBLISHED}),
    ],
    "cover": [
        *(Rung("cover", f"level {level}", level=level) for level in range(4)),
        *(Rung("cover", f"{mm} mm", protrusion=1e-3 * mm) for mm in (80, 40, 10)),
    ],
    "motion": [
        Rung("motion", "isotropic", {"motion": "isotropic"}),
    ],
    "schedule": [
        Rung("schedule", "full", {"schedule": "full"}),
        _daa("powers"),
        _daa("fibonacci"),
    ],
    **_list_numbers(),
}
"""By name, what can be chosen instead of the default."""

FULL = AXES["schedule"][0]
MOST_REFINED = 150
"""Spheres of an arm whose cover is still fitted more finely: others would take many minutes."""

FINER = ("cover 10 mm",)
"""Rungs of the finest setting, where their axes are asked for."""


def check_axes(names: Sequence[str]) -> list[str]:
    """The axes that were asked for, in the order of `AXES`, then `AUTO`; all where none is named.

    Raises:
        ArmguardError: There is no such axis.
    """
    known = [*AXES, AUTO]
    for name in names:
        if name not in known:
            raise ArmguardError(
                "--axis", f"{name!r} is no axis", expected=f"some of {', '.join(known)}"
            )
    return [name for name in known if name in names or not names]


def list_settings(axes: Iterable[str], cover: Cover, usual: Mapping[str, Any]) -> list[Setting]:
    """The default, the finest, and each rung by itself.

    Args:
        axes: Which of `AXES`; what is chosen by a trial is not listed here.
        cover: The robot's own.
        usual: Keywords of the default's monitor: rungs that say the same are left out.
    """
    levels = max(cover.levels(link) for link in cover.links)
    rungs = [
        rung
        for axis in axes
        for rung in AXES.get(axis, ())
        if (rung.level is None or rung.level < levels - 1) and not _is_usual(rung, usual)
    ]
    finest = [
        FULL, *(rung for rung in rungs if str(rung) in FINER and not takes_long(rung, cover))
    ]  # fmt: skip
    if "budget" in usual:
        finest.append(Rung("budget", "none", {"budget": None}))
    return [
        Setting(DEFAULT),
        Setting(FINEST, tuple(finest)),
        *(Setting(str(rung), (rung,)) for rung in rungs),
    ]


def _is_usual(rung: Rung, usual: Mapping[str, Any]) -> bool:
    """Whether a rung equals the default."""
    if rung.axis == OPERATING:
        # Limits that a cell states stand in the place of those that are published.
        return (rung.monitor["operating"] is None) == (usual.get("operating") is None)
    declared = read_declarations(Settings)
    return bool(rung.monitor) and all(
        usual.get(name, declared[name].default) == value for name, value in rung.monitor.items()
    )


def takes_long(rung: Rung, cover: Cover) -> bool:
    """Whether fitting the cover of a rung would take many minutes for an arm with such a cover."""
    is_finer = rung.protrusion is not None and rung.protrusion < DEFAULT_PROTRUSION
    return is_finer and sum(len(cover.spheres(link)) for link in cover.links) > MOST_REFINED
