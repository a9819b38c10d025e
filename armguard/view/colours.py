"""One colour language: everything has the colour of the level that its own contact time earns.

Red, orange, yellow and blue differ in lightness as well as in hue, so that whoever does not tell
red from green, or blue from yellow, tells the levels apart (a test simulates it). No colour stands
alone: levels have words and signs, and what was refused is drawn with edges.

Nothing is drawn as more alarming than the verdict. An arm that surely rests before contact is not
told to stop, however short the contact time; then it is not red either.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVELS = ("STOP", "SLOW", "AWARE", "CLEAR")
LEVEL_COLOURS = ("#e5173a", "#f57f00", "#ffec52", "#5fb0ff")
LEVEL_SIGNS = ("■", "▼", "▲", "●")
"""Beside the word, for those who see no colours."""

FAR_COLOUR = "#3f5f80"
"""CLEAR fades into it."""
FAR = 16.0
"""Contact times that are no longer told apart, in [s]."""

REFUSED_COLOUR = "#8b3df5"
UNWATCHED_COLOUR = "#6f7d8c"


def parse_colour(code: str) -> NDArray[np.float64]:
    """An sRGB colour "#rrggbb" as values from 0 to 1. Shape (3,)."""
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def find_levels(
    contact_times: ArrayLike, stop_time: float, margins: tuple[float, float], level: str
) -> NDArray[np.int64]:
    """Numbers of the levels that contact times earn, 0 for STOP to 3 for CLEAR.

    Args:
        contact_times: In [s]; NaN is unknown and counts as 0. Shape (n,).
        stop_time: In which the arm rests, in [s].
        margins: Beyond that, in [s], below which the level is SLOW, and AWARE.
        level: The verdict's; none of the answers is lower.
    """
    times = np.asarray(contact_times, dtype=np.float64)
    found = np.zeros(times.shape, dtype=np.int64)
    for margin in (0.0, *margins):
        found += times > stop_time + margin
    return np.maximum(found, LEVELS.index(level)) if level in LEVELS else found


def compute_colours(
    contact_times: ArrayLike, stop_time: float, margins: tuple[float, float], level: str
) -> NDArray[np.float32]:
    """SRGB values from 0 to 1 of what has these contact times; see `find_levels`. Shape (n, 3)."""
    times = np.asarray(contact_times, dtype=np.float64)
    levels = find_levels(times, stop_time, margins, level)
    colours = np.array([parse_colour(code) for code in LEVEL_COLOURS])[levels]
    begin = max(stop_time + margins[1], 1e-3)
    if begin < FAR:
        # Twice as far in time is the same step anywhere.
        share = np.log2(np.maximum(times, begin) / begin) / np.log2(FAR / begin)
        share = np.where(levels == len(LEVELS) - 1, np.clip(share, 0.0, 1.0), 0.0)
        colours += share[..., None] * (parse_colour(FAR_COLOUR) - colours)
    return colours.astype(np.float32)


def describe_levels(margins: tuple[float, float]) -> list[dict[str, str]]:
    """The legend: name, sign, colour and meaning of each level.

    Args:
        margins: Beyond the stopping time, in [s], below which the level is SLOW, and AWARE.
    """
    slow, aware = (f"{1e3 * margin:.0f} ms" for margin in margins)
    meanings = (
        "before the arm can rest",
        f"up to {slow} after that",
        f"up to {aware} after that",
        "later; darker: far later",
    )
    rows = zip(LEVELS, LEVEL_SIGNS, LEVEL_COLOURS, meanings, strict=True)
    return [
        {"name": name, "sign": sign, "colour": colour, "text": text}
        for name, sign, colour, text in rows
    ]
