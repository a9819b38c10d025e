"""Pictures of what commissioning found, as PNG files."""

from __future__ import annotations

import importlib.util
import io
import math
from typing import Any

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.lab.commission.findings import Findings
from armguard.lab.commission.stops import LEAD_IN

_COLUMNS, _DPI = 2, 90
_SIZE = (5.0, 2.8)
"""Of one panel, in inches."""


def draw(found: Findings) -> dict[str, bytes]:
    """The pictures for which there is something to show, PNG files by name.

    Args:
        found: What was found.

    Raises:
        ArmguardError: Matplotlib is missing.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ArmguardError("pictures", "need matplotlib", remedy='pip install "armguard[plot]"')
    import matplotlib.figure

    rows = math.ceil(len(found.brakes) / _COLUMNS)
    pictures: dict[str, bytes] = {}
    for name, draw_panel in (("stops", _draw_stops), ("stopping", _draw_stopping)):
        if not rows:
            continue
        figure = matplotlib.figure.Figure(
            figsize=(_COLUMNS * _SIZE[0], rows * _SIZE[1]), layout="constrained"
        )
        panels: Any = np.ravel(figure.subplots(rows, _COLUMNS, squeeze=False))
        for panel, joint in zip(panels, found.brakes, strict=False):
            draw_panel(panel, found, joint)
            panel.set_title(joint, fontsize=9)
        for panel in panels[len(found.brakes) :]:
            panel.set_axis_off()
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=_DPI)
        pictures[f"{name}.png"] = file.getvalue()
    return pictures


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
    panel.set(xlabel="since STOP [ms]; dotted: slows down at the latest", ylabel="speed")


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
    panel.set(xlabel="speed; lines: what [[brakes]] states", ylabel="stopping time [ms]")
