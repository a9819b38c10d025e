"""Makes a monitor and its table from data of `armguard.monitor.portable`, with changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import pinocchio

from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.monitor.portable import write_value
from armguard.monitor.settings import read_settings
from armguard.obstacles.broken_bounds import BODY_LIMITS
from armguard.obstacles.frames import Frame
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.sources import Source
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.portable import read_numbers, write_numbers
from armguard.robot.robot import Robot
from armguard.scheduling.paper.daa import DaaSchedule
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.settings.declarations import Declaration, read_declarations
from armguard.settings.schedule import Schedule
from armguard.settings.separation_rule import SeparationRule
from armguard.settings.settings import REMOVED, Settings

READERS: Mapping[Any, Callable[[Mapping[str, Any]], Any]] = {
    pinocchio.SE3: lambda data: pinocchio.SE3(
        read_numbers(data["rotation"]), read_numbers(data["translation"])
    ),
    OperatingLimits: lambda data: OperatingLimits(
        **{name: limits and read_numbers(limits) for name, limits in data.items()}
    ),
    Schedule: lambda data: DaaSchedule(float(data["period"]), data["law"], data["sort"]),
    SeparationRule: lambda data: SeparationRule(**data),
    ContactLimits: lambda data: ContactLimits(
        {region: ContactLimit(**limit) for region, limit in data["by_region"].items()}
    ),
}
"""Constructors of the types of settings that are not plain."""

LIMITS = "contact_limits"

OWN_WORDS = ("operating", LIMITS)
"""Settings that are not plain, but that a word can change."""


def make_obstacles(data: Mapping[str, Any]) -> Obstacles:
    """An empty table from the data of `describe_settings`.

    Raises:
        ArmguardError: A setting is out of range.
        KeyError: One is missing.
        TypeError: One is of another kind.
        ValueError: One is no number.
    """
    frames = {}
    for name, entry in data["frames"].items():
        rotation = read_numbers(entry["rotation"])
        frames[name] = frame = Frame(
            rotation, read_numbers(entry["translation"]), float(entry["position_error"])
        )
        # To be made orthonormal once more would change its last digits.
        frame.rotation = rotation
    sources = data["sources"]
    return Obstacles(
        accel=float(data["accel"]),
        speed=float(data["speed"]),
        sources=None if sources is None else [Source(**source) for source in sources],
        frames=frames,
        extent=float(data["extent"]),
        bounds=[(str(row[0]), float(row[1]), float(row[2])) for row in data["bounds"]],
        # Recordings of before there were regions have none.
        regions=data.get("regions"),
        # Recordings of before there were limits have none.
        body_limits=data.get("body_limits", BODY_LIMITS),
    )


def make_monitor(data: Mapping[str, Any], robot: Robot, obstacles: Obstacles) -> Monitor:
    """A monitor from the data of `describe_settings`; errors as of `make_obstacles`."""
    return Monitor(robot, obstacles, make_settings(data))


def make_settings(data: Mapping[str, Any]) -> Settings:
    """Settings of a monitor from the data of `describe_settings`; errors as of `make_obstacles`."""
    values = {
        name: _read(declared, data[name])
        for name, declared in read_declarations(Settings).items()
        # Recordings of before there were contact limits have none.
        if name in data or name != LIMITS
    }
    return read_settings(None, {**data, **values})


def change_settings(data: dict[str, Any], changes: Mapping[str, str], robot: Robot) -> None:
    """Put other settings in place of some of those of `describe_settings`.

    Args:
        data: Is changed.
        changes: By name, as text: numbers, or words where a setting is one. `operating.velocity`
            and `operating.acceleration` are fractions of the robot's limits, as in a cell file;
            `bounds.speed` and `bounds.accel` those of obstacles whose messages give none.
            `contact_limits` can only be taken away, by "none".
        robot: Whose limits.

    Raises:
        ArmguardError: There is no such setting, or its value is not of its kind.
    """
    declarations = read_declarations(Settings)
    plain = [one for one in declarations.values() if one.plain_type not in (None, bool)]
    known = [*(one.name for one in plain), "operating.velocity"]
    known += ["operating.acceleration", "bounds.speed", "bounds.accel", LIMITS]
    for name, text in changes.items():
        if name in known and name in declarations and name not in OWN_WORDS:
            data["monitor"][name] = _read_text(declarations[name], text)
        elif name == "operating":
            data["monitor"][name] = _choose_operating(text, robot)
        elif name == LIMITS:
            if text != "none":
                raise ArmguardError(name, f"is {text!r}", expected='"none"')
            data["monitor"][name] = None
        elif name.startswith("operating.") and name in known:
            key = name.removeprefix("operating.")
            limits = OperatingLimits.fraction(robot, **{key: _read_number(name, text)})
            before = data["monitor"]["operating"] or {"velocity": None, "acceleration": None}
            values = write_numbers(getattr(limits, key))
            data["monitor"]["operating"] = {**before, key: values}
        elif name.startswith("bounds.") and name in known:
            data["obstacles"][name.removeprefix("bounds.")] = _read_number(name, text)
        else:
            raise ArmguardError(
                f"setting {name!r}",
                "is not known",
                expected=f"one of {', '.join(known)}",
                remedy=REMOVED.get(name, ""),
            )


def _choose_operating(text: str, robot: Robot) -> dict[str, Any] | None:
    if text == "none":
        return None
    if text != "published":
        raise ArmguardError("operating", f"is {text!r}", expected='"published" or "none"')
    published: dict[str, Any] = write_value(OperatingLimits.published(robot))
    return published


def _read_number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise ArmguardError(name, f"is {text!r}", expected="a number")
    return number


def _read(declaration: Declaration, data: Any) -> Any:
    """The value of a setting from plain data."""
    if isinstance(data, Mapping):
        for kind in declaration.kinds:
            if kind in READERS:
                return READERS[kind](data)
        raise TypeError(f"{declaration.name} is a table")
    return float(data) if data == "Infinity" else data


def _read_text(declaration: Declaration, text: str) -> float | str:
    """The value that a text states for a plain setting."""
    if not declaration.is_number:
        return text
    number = _read_number(declaration.name, text)
    if float in declaration.kinds:
        return number
    if not number.is_integer():
        raise ArmguardError(declaration.name, f"is {text!r}", expected="a whole number")
    return int(number)
