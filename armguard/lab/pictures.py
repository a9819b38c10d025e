"""Pictures of studies, drawn to PNG.

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


def check_plots(otherwise: str = ", or --no-plots") -> None:
    """Make sure that pictures can be drawn.

    Args:
        otherwise: What else can be done where they cannot.

    Raises:
        ArmguardError: They cannot.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ArmguardError(
            "pictures", "need matplotlib", remedy=f'pip install "armguard[plot]"{otherwise}'
        )


def draw_figures(
    drawn: Mapping[str, Callable[[Any], None]], size: tuple[float, float]
) -> dict[str, bytes]:
    """PNG files by name.

    Args:
        drawn: Draws into a figure of matplotlib's, by name of the picture.
        size: Width and height, in inches.
    """
    import matplotlib.figure

    pictures: dict[str, bytes] = {}
    for name, draw in drawn.items():
        figure = matplotlib.figure.Figure(figsize=size, layout="constrained")
        draw(figure)
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=DPI)
        pictures[f"{name}.png"] = file.getvalue()
    return pictures
