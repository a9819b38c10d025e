"""What a monitor and its table were made with, as plain data, and made anew with changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio

from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.monitor.settings import REMOVED, SCALE_RISE
from armguard.obstacles.frames import Frame
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.sources import Source
from armguard.pairs.scene import ADVANCES
from armguard.pairs.separation_margin import SeparationRule
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.portable import read_numbers, write_number, write_numbers
from armguard.robot.robot import Robot
from armguard.scheduling.paper.daa import DaaSchedule
from armguard.scheduling.paper.full import DistanceSchedule, FullSchedule
from armguard.scheduling.schedule import DEADLINE, Schedule

_PLAIN = (
    "reaction_time",
    "latency",
    "slow_margin",
    "aware_margin",
    "rise_delay",
    "scale_rise",
    "source_timeout",
    "joint_timeout",
    "margin",
    "max_staleness",
    "rate",
    "payload",
)
"""Settings of a monitor that are one number each."""

_WORDS = ("motion", "leave")
_WHOLE = ("budget",)


def describe_settings(monitor: Monitor) -> dict[str, Any]:
    """What a monitor and its table were made with, as plain data.

    Raises:
        ArmguardError: The schedule is one of the application's own.
    """
    settings, table = monitor.settings, monitor.obstacles.settings
    operating, separation = settings.operating, settings.separation
    return {
        "monitor": {
            **{name: write_number(getattr(settings, name)) for name in _PLAIN},
            **{name: getattr(settings, name) for name in _WORDS},
            "schedule": _describe_schedule(settings.schedule),
            "budget": settings.budget,
            "ignore": [list(entry) for entry in settings.ignore],
            "certify": bool(settings.certify),
            "base_placement": {
                "rotation": write_numbers(settings.base_placement.rotation),
                "translation": write_numbers(settings.base_placement.translation),
            },
            "operating": operating
            and {
                name: None if limits is None else write_numbers(limits)
                for name, limits in (
                    ("velocity", operating.velocity),
                    ("acceleration", operating.acceleration),
                )
            },
            "separation": separation and dict(separation._asdict()),
        },
        "obstacles": {
            "accel": write_number(table.accel),
            "speed": write_number(table.speed),
            "extent": write_number(table.extent),
            "sources": None
            if table.sources is None
            else [
                {
                    "name": source.name,
                    "timeout": source.timeout,
                    "required": source.required,
                    "on_refusal": source.on_refusal,
                    "latency": source.latency,
                    "rate": source.rate,
                }
                for source in table.sources
            ],
            "frames": {
                name: {
                    "rotation": write_numbers(frame.rotation),
                    "translation": write_numbers(frame.translation),
                    "position_error": frame.position_error,
                }
                for name, frame in table.frames.items()
            },
            "bounds": [
                [pattern, write_number(accel), write_number(speed)]
                for pattern, accel, speed in table.bounds
            ],
        },
        # For people alone: what was chosen stands among the settings above.
        "choice": None if monitor.choice is None else monitor.choice._asdict(),
    }


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
    )


def make_monitor(data: Mapping[str, Any], robot: Robot, obstacles: Obstacles) -> Monitor:
    """A monitor from the data of `describe_settings`; errors as of `make_obstacles`."""
    base, operating, separation = data["base_placement"], data["operating"], data["separation"]
    schedule = data["schedule"]
    if data.get("advances", ADVANCES) != ADVANCES:
        raise ArmguardError(
            "advances", f"is {data['advances']!r}", expected=f"{ADVANCES}, as always"
        )
    # Recordings of earlier versions do not have all that there is now: then it was as by default.
    data = {"leave": "never", "scale_rise": SCALE_RISE, **data}
    words: dict[str, Any] = {name: str(data[name]) for name in _WORDS}
    numbers: dict[str, Any] = {name: float(data[name]) for name in _PLAIN}
    return Monitor(
        robot,
        obstacles,
        **numbers,
        **words,
        schedule=schedule
        if isinstance(schedule, str)
        else DaaSchedule(float(schedule["period"]), schedule["law"], schedule["sort"]),
        budget=data["budget"],
        ignore=[tuple(entry) for entry in data["ignore"]],
        certify=bool(data["certify"]),
        base_placement=pinocchio.SE3(
            read_numbers(base["rotation"]), read_numbers(base["translation"])
        ),
        operating=operating
        and OperatingLimits(
            **{
                name: None if limits is None else read_numbers(limits)
                for name, limits in operating.items()
            }
        ),
        separation=separation and SeparationRule(**separation),
    )


def change_settings(data: dict[str, Any], changes: Mapping[str, str], robot: Robot) -> None:
    """Put other settings in place of some of those of `describe_settings`.

    Args:
        data: Is changed.
        changes: By name, as text: numbers, or words where a setting is one. `operating.velocity`
            and `operating.acceleration` are fractions of the robot's limits, as in a cell file;
            `bounds.speed` and `bounds.accel` those of obstacles whose messages give none.
        robot: Whose limits.

    Raises:
        ArmguardError: There is no such setting, or its value is not of its kind.
    """
    known = [*_PLAIN, *_WORDS, "schedule", *_WHOLE, "operating", "operating.velocity"]
    known += ["operating.acceleration", "bounds.speed", "bounds.accel"]
    for name, text in changes.items():
        if name in _WORDS or name == "schedule":
            data["monitor"][name] = text
        elif name in _PLAIN:
            data["monitor"][name] = _read_number(name, text)
        elif name in _WHOLE:
            number = _read_number(name, text)
            if not number.is_integer():
                raise ArmguardError(name, f"is {text!r}", expected="a whole number")
            data["monitor"][name] = int(number)
        elif name == "operating":
            data["monitor"][name] = _choose_operating(text, robot)
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
    limits = OperatingLimits.published(robot)
    return {
        "velocity": write_numbers(np.asarray(limits.velocity)),
        "acceleration": write_numbers(np.asarray(limits.acceleration)),
    }


def _read_number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise ArmguardError(name, f"is {text!r}", expected="a number")
    return number


def _describe_schedule(schedule: Schedule | None) -> Any:
    if schedule is None:
        return DEADLINE
    if type(schedule) is DaaSchedule:
        return {"period": schedule.period, "law": schedule.law, "sort": schedule.sort}
    if type(schedule) is FullSchedule:
        return "full"
    if type(schedule) is DistanceSchedule:
        return "distance"
    raise ArmguardError(
        "schedule",
        f"is a {type(schedule).__name__} of the application's own",
        expected="one of armguard's, which alone can be made anew from a recording",
    )
