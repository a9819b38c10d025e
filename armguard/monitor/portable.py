"""The settings of a monitor and its table, as plain data.

A recording stores them, so that a replay can make the same monitor. The digest of a configuration
is also computed from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio

from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.obstacles.frames import Frame
from armguard.obstacles.sources import Source
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.portable import write_number, write_numbers
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.settings.declarations import read_declarations
from armguard.settings.separation_rule import SeparationRule
from armguard.settings.settings import Settings

FORMS: Mapping[Any, tuple[str, ...]] = {
    pinocchio.SE3: ("rotation", "translation"),
    Frame: ("rotation", "translation", "position_error"),
    OperatingLimits: ("velocity", "acceleration"),
    SeparationRule: SeparationRule.__struct_fields__,
    ContactLimits: ContactLimits.__struct_fields__,
    ContactLimit: ContactLimit.__struct_fields__,
    Source: ("name", "timeout", "required", "on_refusal", "latency", "rate"),
}
"""Attributes that describe a value of these types."""


def describe_settings(monitor: Monitor) -> dict[str, Any]:
    """Describe the settings of a monitor and its table as plain data.

    Raises:
        ArmguardError: The schedule is one of the application's own.
    """
    settings, table = monitor.settings, monitor.obstacles.settings
    return {
        "monitor": {
            name: write_value(getattr(settings, name)) for name in read_declarations(Settings)
        },
        "obstacles": write_value(table._asdict()),
        # For people alone: what was chosen stands among the settings above.
        "choice": None if monitor.choice is None else monitor.choice._asdict(),
    }


def write_value(value: Any) -> Any:
    """A value of a setting as plain data."""
    if type(value) in FORMS:
        return {name: write_value(getattr(value, name)) for name in FORMS[type(value)]}
    if "as_data" in vars(type(value)):  # a schedule of armguard's, not one derived from it
        return value.as_data
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return write_number(value)
        case np.ndarray():
            return write_numbers(value)
        case dict():
            return {name: write_value(one) for name, one in value.items()}
        case list() | tuple():
            return [write_value(one) for one in value]
    raise ArmguardError(
        "schedule",
        f"is a {type(value).__name__} of the application's own",
        expected="one of armguard's schedules: a recording can restore only these",
    )
