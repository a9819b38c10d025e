"""Pictures of a study: price against caution, and the scene over time."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from armguard.lab.pictures import MARKS, draw_figures
from armguard.lab.tradeoff.ladder import AUTO, AXES, DEFAULT, FINEST
from armguard.lab.tradeoff.study import Study
from armguard.verdict import Level

SIZE = 9.0, 5.0

CAPTIONS = {
    "price": "Price against caution: one point a setting; below the dotted line there was none",
    "time": "Contact time, stop time and level over the scene, of the default and of the finest",
}
"""What the pictures show, by name, in the order in which they are shown."""
POINTS = 600
"""Of a line over time; between two of them the least of the times is drawn."""


def draw_pictures(study: Study) -> dict[str, bytes]:
    """PNG files by name."""
    return draw_figures(
        {
            "price": lambda figure: _draw_price(figure, study),
            "time": lambda figure: _draw_time(figure, study),
        },
        SIZE,
    )


def _draw_price(figure: Any, study: Study) -> None:
    """One point a setting; the front is the line below which none was found."""
    axes = figure.subplots()
    for axis, mark in zip(["", *AXES, AUTO], itertools.cycle("*" + MARKS), strict=False):
        points = [
            (100.0 * one.figures.core, 100.0 * one.figures.stop)
            for one in study.outcomes
            if one.figures is not None and one.setting.axis == axis
            and one.setting.name not in (DEFAULT, FINEST)
        ]  # fmt: skip
        if points:
            axes.plot(*zip(*points, strict=True), mark, label=axis or "combined", alpha=0.8)
    for name, color in ((DEFAULT, "black"), (FINEST, "red")):
        figures = study.find(name)
        if figures is not None:
            axes.plot(100.0 * figures.core, 100.0 * figures.stop, "*", ms=16, c=color, label=name)
    front = [study.find(name) for name in study.front]
    line = sorted((100.0 * one.core, 100.0 * one.stop) for one in front if one is not None)
    if line:
        axes.step(*zip(*line, strict=True), "k:", where="post", lw=1, label="front")
    axes.set(
        xscale="log",
        xlabel="price: steps and messages, % of a core",
        ylabel="caution: share of STOP, %",
    )
    axes.legend(fontsize="small")
    axes.grid(alpha=0.3)


def _draw_time(figure: Any, study: Study) -> None:
    """Level, contact time and stop time of the default, beside the finest setting's."""
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    for name, color in ((FINEST, "tab:red"), (DEFAULT, "tab:blue")):
        track = study.tracks[name]
        width = max(1, len(track.time) // POINTS)
        count = len(track.time) // width * width
        if not count:
            continue
        time = track.time[:count:width]
        blocks = [
            field[:count].reshape(-1, width).min(axis=1)
            for field in (np.minimum(track.contact_time, 10.0), track.level)
        ]
        above.plot(time, blocks[0], color=color, lw=1, label=f"contact time, {name}")
        below.step(time, blocks[1], color=color, lw=1, where="post")
        if name == DEFAULT:
            stop = track.stop_time[:count].reshape(-1, width).max(axis=1)
            above.plot(time, stop, color="black", lw=1, ls="--", label="stop time")
    above.set_yscale("symlog", linthresh=0.1)
    above.set_ylim(0.0, None)
    above.set(ylabel="s")
    above.legend(fontsize="small")
    above.grid(alpha=0.3)
    below.set_yticks([int(level) for level in Level], [level.name for level in Level])
    below.set(xlabel="scene, s")
    below.grid(alpha=0.3)
