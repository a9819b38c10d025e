"""Lengths and radii of people's body parts: published means plus four standard deviations.

Every figure is computed from the public measurements of 4,082 men and 1,986 women [Gordon2014]_. A
figure is the mean plus four standard deviations, of men or of women, whichever is larger. With a
stated height, it is this figure of the ratio to the person's stature, times the height. These
people were soldiers: fit adults. State other lengths where other people work.

Bodies are measured between marks on the skin, skeletons between the centres of joints. Each length
therefore contains the distance between two centres. The distance of a camera's joints from the
centres must be part of its position error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

SOURCE = "ANSUR II [Gordon2014]: mean plus 4 standard deviations"
"""Source of lengths that are neither stated nor learned."""

TALLEST = 2.3
SHORTEST = 1.3
"""Heights that can be stated, in [m]; what is beyond is another unit."""


class Segment(NamedTuple):
    """Greatest distance of two points of a body."""

    length: float
    """Greatest length of any adult, in [m]."""
    per_height: float
    """Greatest length of a person of known height, in [m] per [m] of height."""
    is_rigid: bool
    """Whether it is one bone or so, whose length can be learned from samples."""


SEGMENTS: Mapping[str, Segment] = MappingProxyType(
    {
        # From the acromion to the lowest point of the bent elbow; both centres lie between them.
        "upper_arm": Segment(0.437, 0.2311, True),
        # From the back of the elbow to the wrist: forearm-hand length less hand length.
        "forearm": Segment(0.350, 0.1869, True),
        # Palm length: from the wrist to the knuckles.
        "palm": Segment(0.142, 0.0786, True),
        # Trochanterion to lateral epicondyle, in height. The centres of both joints lie further
        # inside, by amounts that differ by less than 0.05 m, which adds less than 3 mm.
        "thigh": Segment(0.526, 0.2833, True),
        # Lateral epicondyle to lateral malleolus.
        "shank": Segment(0.518, 0.2904, True),
        # Foot length, which is longer than from the ankle to the toes.
        "foot": Segment(0.324, 0.1755, True),
        # From the top of the head to the breastbone, which is longer than from between the ears to
        # between the shoulders.
        "neck": Segment(0.376, 0.2122, False),
        # Biacromial breadth: between the outer ends of both shoulders.
        "shoulders": Segment(0.493, 0.2763, False),
        # From a shoulder to the hip below it: acromion to trochanterion, and 0.15 m by which a
        # shoulder rises and a side stretches (assumed).
        "trunk": Segment(0.824, 0.4615, False),
        # Between the hips: bicristal breadth, which is more than between their joints.
        "hips": Segment(0.363, 0.2187, False),
    }
)
"""Lengths by name."""


class Thickness(NamedTuple):
    """What is around the joints of a part of a body."""

    flesh: float
    """From the hull of its points to the skin at the most, in [m]."""
    clothes: float
    """On the skin, in [m]: assumed."""
    source: str
    """What the flesh is made of, in the names of [Gordon2014]_."""

    @property
    def radius(self) -> float:
        """Of the part, in [m]."""
        return self.flesh + self.clothes


def _from_girth(girth: float, name: str) -> Thickness:
    """Of a limb: a girth's radius, and a quarter more, because a bone is not in the middle."""
    return Thickness(round(1.25 * girth / math.tau, 3), 0.02, f"{name}, 2π, times 1.25 (assumed)")


THICKNESSES: Mapping[str, Thickness] = MappingProxyType(
    {
        # Between the ears: up to the crown 0.156 m. To the chin less than half of the arc over it
        # from ear to ear, 0.194 m, which begins half a breadth aside, in narrow heads 0.066 m:
        # 0.183 m. Clothes are a helmet.
        "head": Thickness(0.183, 0.05, "tragion to top of head, bitragion chin arc, head breadth"),
        "neck": _from_girth(0.501, "neck circumference"),
        # A belly of 0.404 m from back to front, of which less than 0.15 m are behind the hips, and
        # the shoulders' flesh of 0.094 m with 0.03 m from acromion to joint, which is less.
        "torso": Thickness(0.254, 0.02, "abdominal extension depth, sitting"),
        "shoulder": Thickness(0.124, 0.02, "bideltoid less biacromial breadth, halved"),
        "upper_arm": _from_girth(0.497, "biceps circumference, flexed"),
        "forearm": _from_girth(0.399, "forearm circumference, flexed"),
        # From between the knuckles to the farthest fingertip: hand length less palm length, 0.102
        # m, and half a hand's breadth of 0.053 m aside. The thumb reaches no farther (assumed).
        "hand": Thickness(0.116, 0.01, "hand length less palm length, hand breadth"),
        "thigh": _from_girth(0.860, "thigh circumference"),
        "shank": _from_girth(0.512, "calf circumference"),
        # Around the line from ankle to toes: the heel is below and behind the ankle, by 0.096 m and
        # less than a third of the foot's 0.324 m. The clothes are a shoe.
        "foot": Thickness(0.145, 0.03, "lateral malleolus height, foot length"),
    }
)
"""What is around the joints, by part."""
