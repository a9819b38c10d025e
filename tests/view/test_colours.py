import itertools
import math

import numpy as np
import pytest

from armguard.view.buckets import BUCKET_COUNT
from armguard.view.colours import (
    FIRST_LEVEL,
    LEVEL_SIGNS,
    LEVELS,
    REFUSED,
    THEMES,
    choose_paints,
    compute_palette,
    describe_levels,
    find_levels,
)

STOP_TIME, MARGINS = 0.2, (0.1, 0.3)

# Colour vision without one kind of cone, on linear RGB: Machado, Oliveira, Fernandes (2009),
# severity 1.0.
EYES = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
XYZ = [
    [0.4124564, 0.3575761, 0.1804375],
    [0.2126729, 0.7151522, 0.0721750],
    [0.0193339, 0.1191920, 0.9503041],
]
WHITE = [0.95047, 1.0, 1.08883]
LEAST = 20.0
"""In CIELAB, where 2.3 is just noticeable side by side: these are told apart at a glance."""


NOTICED = 2.3
"""In CIELAB: just noticeable side by side."""


def see(colour, eye):
    """An sRGB colour in CIELAB as this eye sees it."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    ratio = XYZ @ np.clip(np.array(EYES[eye]) @ linear, 0.0, 1.0) / WHITE
    x, y, z = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("eye", EYES)
def test_levels_are_told_apart_by_every_eye(eye, theme):
    palette = compute_palette(theme)
    numbers = [*range(FIRST_LEVEL, FIRST_LEVEL + len(LEVELS)), REFUSED]
    seen = [see(palette[number], eye) for number in numbers]
    for one, other in itertools.combinations(seen, 2):
        assert np.linalg.norm(one - other) > LEAST


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("eye", EYES)
def test_buckets_are_one_scale_to_every_eye(eye, theme):
    """Neighbours differ, 32 times as far differs at a glance, and lightness is in order."""
    palette = compute_palette(theme)
    seen = np.array([see(colour, eye) for colour in palette[:BUCKET_COUNT]])
    distances = np.linalg.norm(seen[:, None] - seen, axis=2)
    apart = np.subtract.outer(np.arange(BUCKET_COUNT), np.arange(BUCKET_COUNT))
    assert distances[apart == 1].min() > 1.5 * NOTICED
    assert distances[apart >= 5].min() > LEAST
    # What is imminent is farthest from the background in lightness.
    assert (np.diff(seen[:, 0]) * (1.0 if theme == "light" else -1.0) > 0.0).all()
    assert np.linalg.norm(seen - see(palette[REFUSED], eye), axis=1).min() > LEAST


def test_no_colour_stands_alone():
    assert len(set(LEVEL_SIGNS)) == len(LEVELS)
    lines = describe_levels(MARGINS)
    assert [line["name"] for line in lines] == list(LEVELS)
    assert "100 ms" in lines[1]["text"]
    assert "300 ms" in lines[2]["text"]


def test_a_contact_time_has_the_level_that_the_monitor_gives_it():
    times = [math.nan, 0.0, 0.2, 0.2001, 0.3, 0.3001, 0.5, 0.5001, math.inf]
    found = find_levels(times, STOP_TIME, MARGINS, "STOP")
    assert found.tolist() == [0, 0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize("level", LEVELS)
def test_nothing_is_more_alarming_than_the_verdict(level):
    found = find_levels(np.linspace(0.0, 2.0, 50), STOP_TIME, MARGINS, level)
    assert found.min() == LEVELS.index(level)


def test_an_arm_whose_stop_time_is_unknown_is_red():
    paints = choose_paints([0.1, 1e9], 1e-3, math.inf, MARGINS, "STOP")
    assert paints.by_level.tolist() == [FIRST_LEVEL] * 2
