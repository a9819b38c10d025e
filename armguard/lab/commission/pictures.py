"""Pictures of what commissioning found, as PNG files; Matplotlib is asked for here only."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.lab.commission.findings import Findings
from armguard.lab.commission.stops import LEAD_IN

_COLUMNS = 2
_SIZE = (5.0, 2.8)
"""Of one panel, in inches."""


def draw(found: Findings, folder: Path) -> list[Path]:
    """Write the pictures for which there is something to show; their paths.

    Args:
        found: What was found.
        folder: Where they go; it is there.

    Raises:
        ArmguardError: Matplotlib is missing, or a file cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ArmguardError(
            "pictures", "need Matplotlib", remedy="pip install 'armguard[plot]'"
        ) from None
    written = []
    for name, joints, draw_panel in (
        ("stops.png", list(found.brakes), _draw_stops),
        ("stopping.png", list(found.brakes), _draw_stopping),
        ("velocities.png", list(found.limits), _draw_velocities),
    ):
        if not joints:
            continue
        rows = math.ceil(len(joints) / _COLUMNS)
        figure = Figure((_COLUMNS * _SIZE[0], rows * _SIZE[1]), layout="constrained")
        panels = np.ravel(figure.subplots(rows, _COLUMNS, squeeze=False))
        for panel, joint in zip(panels, joints, strict=False):
            draw_panel(panel, found, joint)
            panel.set_title(joint, fontsize=9)
        for panel in panels[len(joints) :]:
            panel.set_axis_off()
        path = folder / name
        try:
            figure.savefig(path)
        except OSError as error:
            raise ArmguardError(str(path), f"cannot be written ({error.strerror})") from None
        written.append(path)
    return written


def _draw_stops(panel: Any, found: Findings, name: str) -> None:
    """Speed of a joint after each STOP, with the longest response."""
    seen, joint = found.seen, found.seen.robot.joints.index(name)
    longest = 0.0
    for stop in (one for one in found.stops if one.joint == name):
        end = stop.response + 1.5 * stop.stopping_time
        inside = (seen.stamps >= stop.told - LEAD_IN) & (seen.stamps <= stop.told + end)
        panel.plot(1e3 * (seen.stamps[inside] - stop.told), np.abs(seen.v[inside, joint]))
        longest = max(longest, stop.response)
    panel.axvline(0.0, color="red", linewidth=0.8)
    panel.axvline(1e3 * longest, color="black", linestyle=":", linewidth=0.8)
    panel.set_xlabel("since STOP [ms]; dotted: slows down at the latest")
    panel.set_ylabel("speed")


def _draw_stopping(panel: Any, found: Findings, name: str) -> None:
    """Stopping times by speed, each stop and the entries that cover them."""
    stops = [one for one in found.stops if one.joint == name]
    panel.plot([one.speed for one in stops], [1e3 * one.stopping_time for one in stops], "o")
    before = 0.0
    for entry in found.brakes[name]:
        panel.hlines(1e3 * entry.stopping_time, before, entry.speed, color="black")
        before = entry.speed
    panel.set_xlim(left=0.0)
    panel.set_ylim(bottom=0.0)
    panel.set_xlabel("speed; lines: what [[brakes]] states")
    panel.set_ylabel("stopping time [ms]")


def _draw_velocities(panel: Any, found: Findings, name: str) -> None:
    """How often a joint was how fast, and the limit that it kept to."""
    seen, joint = found.seen, found.seen.robot.joints.index(name)
    panel.hist(np.abs(seen.v[:, joint]), bins=60, log=True)
    panel.axvline(found.limits[name].velocity, color="black", linestyle=":", linewidth=0.8)
    panel.set_xlabel("speed; dotted: kept to")
    panel.set_ylabel("joint states")
