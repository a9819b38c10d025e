"""Pictures of studies, drawn to PNG and SVG.

They need matplotlib, which is in the extra `plot`.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Callable, Mapping
from typing import Any

from armguard.exceptions import ArmguardError

MARKS = "osD^vPXph<>"
"""Of points, by series."""

DPI = 90


def check_plots() -> None:
    """Make sure that pictures can be drawn.

    Raises:
        ArmguardError: They cannot.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ArmguardError(
            "pictures", "need matplotlib", remedy='pip install "armguard[plot]", or --no-plots'
        )


def draw_figures(
    drawn: Mapping[str, Callable[[Any], None]], size: tuple[float, float]
) -> dict[str, bytes]:
    """PNG and SVG files by name; what is drawn alike gives equal files.

    Args:
        drawn: Draws into a figure of matplotlib's, by name of the picture.
        size: Width and height, in inches.
    """
    import matplotlib.figure

    pictures: dict[str, bytes] = {}
    with matplotlib.rc_context({"svg.hashsalt": "armguard", "svg.fonttype": "none"}):
        for name, draw in drawn.items():
            figure = matplotlib.figure.Figure(figsize=size, layout="constrained")
            draw(figure)
            for kind, options in (("png", {"dpi": DPI}), ("svg", {"metadata": {"Date": None}})):
                file = io.BytesIO()
                figure.savefig(file, format=kind, **options)
                pictures[f"{name}.{kind}"] = file.getvalue()
    return pictures
