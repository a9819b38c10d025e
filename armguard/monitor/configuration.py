"""A short digest of everything that verdicts depend on, except the inputs of a running monitor.

Two monitors with the same digest give the same verdicts on the same inputs, if their processors
compute alike. The digest covers the exact bits of numbers, and names without their order. It does
not depend on the paths of files, the name of a robot's folder, the order of keys in a file, the
notation of a number, or the machine.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
import numpy as np

from armguard.monitor.monitor import Monitor
from armguard.monitor.portable import describe_settings
from armguard.monitor.provenance import describe_software
from armguard.robot.portable import describe_contents

LENGTH = 16
"""Number of hexadecimal digits of a digest."""

_OF_THE_MACHINE = ("machine", "processor", "processor_features")


def digest_configuration(monitor: Monitor, cell: Any = None) -> str:
    """The digest of a monitor's configuration, in 16 hexadecimal digits.

    It covers the robot as it is (joints, limits, errors, brakes, links, covers, attached bodies),
    all settings of the monitor and its table of obstacles, the present statics, tethers and
    exemptions, and the versions of armguard and its numerical libraries.

    Args:
        monitor: The monitor before its first step.
        cell: Further plain data to include, such as a cell file's settings of streams.

    Raises:
        ArmguardError: The schedule is the application's own, which armguard cannot describe.
    """
    return digest_data(describe_configuration(monitor, cell))


def describe_configuration(monitor: Monitor, cell: Any = None) -> dict[str, Any]:
    """The content of the digest as plain data; see `digest_configuration`."""
    settings = describe_settings(monitor)
    del settings["choice"]  # what was chosen stands among the settings
    sources = settings["obstacles"]["sources"]
    if sources is not None:
        settings["obstacles"]["sources"] = {source["name"]: source for source in sources}
    settings["monitor"]["ignore"] = sort_data(settings["monitor"]["ignore"])
    software = describe_software()
    for name in _OF_THE_MACHINE:
        del software[name]
    return {
        "software": software,
        "robot": describe_contents(monitor.robot),
        "settings": settings,
        "payload": monitor.payload,
        "places": _describe_places(monitor),
        "tethers": sorted(
            [*sorted((one.a, one.b)), one.length] for one in monitor.obstacles.tethers
        ),
        "exemptions": sort_data(
            [*one.pair, one.until, None if one.zone is None else one.zone.points.tolist()]
            for one in monitor.exemptions
        ),
        "cell": cell,
    }


def digest_data(data: Any) -> str:
    """The digest of plain data."""
    return hashlib.sha256(_encode(data)).hexdigest()[:LENGTH]


def sort_data(entries: Iterable[Any]) -> list[Any]:
    """Plain data whose order means nothing, in an order of their own."""
    return sorted(entries, key=_encode)


def normalise(value: Any) -> Any:
    """Convert plain data to a form with a unique JSON text.

    A number becomes "n" followed by its bits, for integers and floats alike. A text becomes "s"
    followed by itself.

    Raises:
        TypeError: It is not plain data.
    """
    match value:
        case None | bool():
            return value
        case int() | float():
            return f"n{_write_number(value)}"
        case str():
            return f"s{value}"
        case Mapping():
            return {str(name): normalise(one) for name, one in value.items()}
        case list() | tuple():
            return [normalise(one) for one in value]
    raise TypeError(f"no plain data: {value!r}")


def _encode(data: Any) -> bytes:
    return msgspec.json.encode(normalise(data), order="deterministic")


def _write_number(value: float) -> str:
    return str(value) if isinstance(value, int) and abs(value) > 2**53 else float(value).hex()


def _describe_places(monitor: Monitor) -> dict[str, Any]:
    """The statics and entrances, by id."""
    table, ids = monitor.obstacles.table, monitor.obstacles.ids
    return {
        ids[row]: [
            table.points[row, : table.point_count[row]].tolist(),
            float(table.radius[row]),
            [float(table.speed[row]), float(table.accel[row])]
            if monitor.obstacles.is_entrance(row)
            else None,
        ]
        for row in np.flatnonzero(table.alive & table.static).tolist()
    }
