"""Pictures of what commissioning found, as PNG files."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armguard.lab.commission.findings import Findings
from armguard.lab.commission.stops import LEAD_IN
from armguard.lab.pictures import check_plots, draw_figures

_COLUMNS = 2
_SIZE = (5.0, 2.8)
"""Of one panel, in inches."""


def draw(found: Findings) -> dict[str, bytes]:
    """The pictures for which there is something to show, PNG files by name.

    Args:
        found: What was found.

    Raises:
        ArmguardError: Matplotlib is missing.
    """
    check_plots("")
    pictures: dict[str, bytes] = {}
    for name, joints, draw_panel in (
        ("stops", list(found.brakes), _draw_stops),
        ("stopping", list(found.brakes), _draw_stopping),
        ("velocities", list(found.limits), _draw_velocities),
    ):
        if joints:
            size = _COLUMNS * _SIZE[0], math.ceil(len(joints) / _COLUMNS) * _SIZE[1]
            drawn = functools.partial(_draw_panels, found, joints, draw_panel)
            pictures |= draw_figures({name: drawn}, size)
    return pictures


def _draw_panels(found: Findings, joints: Sequence[str], draw_panel: Any, figure: Any) -> None:
    """A panel for each joint."""
    rows = math.ceil(len(joints) / _COLUMNS)
    panels = np.ravel(figure.subplots(rows, _COLUMNS, squeeze=False))
    for panel, joint in zip(panels, joints, strict=False):
        draw_panel(panel, found, joint)
        panel.set_title(joint, fontsize=9)
    for panel in panels[len(joints) :]:
        panel.set_axis_off()


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


def _draw_velocities(panel: Any, found: Findings, name: str) -> None:
    """How often a joint was how fast, and the limit that it kept to."""
    seen, joint = found.seen, found.seen.robot.joints.index(name)
    panel.hist(np.abs(seen.v[:, joint]), bins=60, log=True)
    panel.axvline(found.limits[name].velocity, color="black", linestyle=":", linewidth=0.8)
    panel.set(xlabel="speed; dotted: kept to", ylabel="joint states")
