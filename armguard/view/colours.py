"""The palette of the view: everything that is drawn refers to a colour by its number.

Bodies and pairs have the colour of their bucket of imminence: one scale from imminent (amber) over
coral and magenta to far (blue), in perceptually equal steps. Lightness falls from bucket to bucket,
also for colour-blind viewers. A page can request colours by level instead, from the contact time of
each body or pair. Viewers with red-green or blue-yellow blindness can distinguish the levels; tests
simulate them. No meaning depends on colour alone: levels have words and signs, buckets have times,
and refused obstacles are drawn with edges.

The palette has each colour twice: for a dark page and for a light page. On the light page, imminent
contact is darkest.

Colours by level are never more alarming than the verdict. An arm that is at rest before contact
gets no STOP, however short the contact time; so nothing is red then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.view.buckets import BUCKET_COUNT, compute_buckets

LEVELS = ("STOP", "SLOW", "AWARE", "CLEAR")
LEVEL_SIGNS = ("■", "▼", "▲", "●")
"""Sign of each level beside its word, readable without colours."""

THEMES = ("dark", "light")
LEVEL_COLOURS = {
    "dark": ("#e5173a", "#f57f00", "#ffec52", "#5fb0ff"),
    "light": ("#900604", "#c35a02", "#dfa80a", "#308fd3"),
}
BUCKET_COLOURS = {
    "dark": (
        *("#ffe39e", "#ffd56a", "#fec645", "#fab747", "#f5a84a", "#f19850", "#ea8957", "#e17b5e"),
        *("#d96d65", "#d05d6b", "#c45074", "#b2477f", "#9a428a", "#7a4293", "#4c4599", "#054689"),
    ),
    "light": (
        *("#7f0007", "#861616", "#8e2425", "#963134", "#9c3d44", "#a24955", "#a65565", "#a96175"),
        *("#af6c84", "#b67594", "#bd7fa5", "#c18ab7", "#c395c8", "#c3a1da", "#c1aeeb", "#bdbbfc"),
    ),
}
"""Found by a search for equal steps in lightness that all simulated viewers of the tests
distinguish."""

_OTHER_COLOURS = {
    "dark": ("#8b3df5", "#6f7d8c", "#ffffff", "#93a1b0", "#ff6b6b", "#7bd88f", "#6ba8ff"),
    "light": ("#5a12d6", "#6f7d8c", "#10151b", "#7d8894", "#c62828", "#2e7d32", "#1565c0"),
}
_STILL_GREY = {"dark": "#7d8894", "light": "#9aa5b1"}
STILL_SHARE = 0.6
"""Share of grey in the colour of statics."""

FIRST_LEVEL = BUCKET_COUNT
"""Number of the colour of STOP; those of the other levels follow."""
PROVED = FIRST_LEVEL + LEVELS.index("CLEAR")
"""Colour of a motion on which nothing can touch the arm."""
REFUSED, UNWATCHED, INK, PALE, AXIS_X, AXIS_Y, AXIS_Z = range(
    FIRST_LEVEL + len(LEVELS), FIRST_LEVEL + len(LEVELS) + 7
)
"""Numbers of the other colours."""
STILL = AXIS_Z + 1
"""Offset from the number of a colour to its greyer version."""


class Paints(NamedTuple):
    """Numbers of the colours of several bodies."""

    by_bucket: NDArray[np.uint8]
    """Shape (n,)."""
    by_level: NDArray[np.uint8]
    """The same for pages that request colours by level. Shape (n,)."""

    @classmethod
    def of(cls, paint: int, count: int) -> Paints:
        """One colour for a number of bodies."""
        paints = np.full(count, paint, dtype=np.uint8)
        return cls(paints, paints)

    def take(self, rows: ArrayLike | slice) -> Paints:
        """Colours of some of the bodies."""
        return Paints(self.by_bucket[rows], self.by_level[rows])  # type: ignore[index]


def parse_colour(code: str) -> NDArray[np.float64]:
    """An sRGB colour "#rrggbb" as values from 0 to 1. Shape (3,)."""
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def compute_palette(theme: str) -> NDArray[np.float64]:
    """All colours of one of `THEMES` by number, in sRGB from 0 to 1. Shape (n, 3)."""
    codes = (*BUCKET_COLOURS[theme], *LEVEL_COLOURS[theme], *_OTHER_COLOURS[theme])
    colours = np.array([parse_colour(code) for code in codes])
    greyer = colours + STILL_SHARE * (parse_colour(_STILL_GREY[theme]) - colours)
    return np.concatenate([colours, greyer])


def find_levels(
    contact_times: ArrayLike, stop_time: float, margins: tuple[float, float], level: str
) -> NDArray[np.int64]:
    """Numbers of the levels of contact times, 0 for STOP to 3 for CLEAR.

    Args:
        contact_times: In [s]; NaN is unknown and counts as 0. Shape (n,).
        stop_time: Time until the arm is at rest, in [s].
        margins: Margins beyond the stop time, in [s], below which the level is SLOW, and AWARE.
        level: Level of the verdict; no answer is lower.
    """
    times = np.asarray(contact_times, dtype=np.float64)
    found = np.zeros(times.shape, dtype=np.int64)
    for margin in (0.0, *margins):
        found += times > stop_time + margin
    return np.maximum(found, LEVELS.index(level)) if level in LEVELS else found


def choose_paints(
    contact_times: ArrayLike,
    period: float,
    stop_time: float,
    margins: tuple[float, float],
    level: str,
) -> Paints:
    """Colours of bodies with these contact times; see `compute_buckets` and `find_levels`."""
    levels = FIRST_LEVEL + find_levels(contact_times, stop_time, margins, level)
    return Paints(compute_buckets(contact_times, period), levels.astype(np.uint8))


def describe_levels(margins: tuple[float, float]) -> list[dict[str, str | int]]:
    """The legend of the levels: name, sign, number of the colour, and meaning of each.

    Args:
        margins: Margins beyond the stop time, in [s], below which the level is SLOW, and AWARE.
    """
    slow, aware = (f"{1e3 * margin:.0f} ms" for margin in margins)
    meanings = (
        "before the arm can be at rest",
        f"up to {slow} after that",
        f"up to {aware} after that",
        "later",
    )
    return [
        {"name": name, "sign": sign, "paint": FIRST_LEVEL + number, "text": text}
        for number, (name, sign, text) in enumerate(zip(LEVELS, LEVEL_SIGNS, meanings, strict=True))
    ]
