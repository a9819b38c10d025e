"""The picture of a study: price of settings against caution."""

from __future__ import annotations

import importlib.util
import io
from typing import Any

import numpy as np

from armguard.lab.tradeoff.study import Study

PICTURE = "price.png"
SIZE, DPI = (9.0, 5.0), 90


def can_draw() -> bool:
    """Whether matplotlib is there, which the extra `plot` brings."""
    return importlib.util.find_spec("matplotlib") is not None


def draw_price(study: Study) -> bytes:
    """A PNG with one point for each setting; the dotted line joins those of the front."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE, layout="constrained")
    axes: Any = figure.subplots()
    found = [(one.setting, one.figures) for one in study.outcomes if one.figures is not None]
    points = {
        setting.name: (100.0 * one.core, 100.0 * (one.stop + one.slow)) for setting, one in found
    }
    kind_of = {setting.name: setting.axis or setting.name for setting, _ in found}
    for kind in dict.fromkeys(kind_of.values()):
        places = np.array([points[name] for name, one in kind_of.items() if one == kind])
        axes.plot(*places.T, "*" if len(places) == 1 else "o", ms=9, label=kind, alpha=0.8)
    front = np.array(sorted(points[name] for name in study.front if name in points))
    axes.step(*front.reshape(-1, 2).T, "k:", where="post", label="front")
    axes.set(
        xscale="log",
        xlabel="price: steps and messages, % of a core",
        ylabel="caution: share of STOP and SLOW, %",
    )
    axes.legend(fontsize="small")
    axes.grid(alpha=0.3)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    return file.getvalue()
