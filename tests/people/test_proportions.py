import math

import pytest

from armguard.people.proportions import SEGMENTS, SHORTEST, TALLEST, THICKNESSES

# Mean, standard deviation in [mm] of the men of ANSUR II, the larger ones.
MEN = {
    "upper_arm": (363.7, 18.2),  # shoulder-elbow length
    "palm": (116.5, 6.2),
    "foot": (271.2, 13.1),
    "shoulders": (415.7, 19.2),
}


@pytest.mark.parametrize("name", MEN)
def test_lengths_are_four_standard_deviations_above_the_mean(name):
    mean, deviation = MEN[name]
    assert SEGMENTS[name].length == pytest.approx(1e-3 * (mean + 4.0 * deviation), abs=1e-3)


def test_with_a_height_a_length_is_less_for_the_usual_and_more_for_the_tallest():
    for name, segment in SEGMENTS.items():
        assert SHORTEST * segment.per_height < segment.length < TALLEST * segment.per_height, name
        # The ratio holds for tall men as well as the length does.
        assert 1.95 * segment.per_height == pytest.approx(segment.length, rel=0.2), name


def test_limbs_are_thicker_than_their_girth_and_say_whence():
    for part, girth in {
        "upper_arm": 0.497,
        "forearm": 0.399,
        "thigh": 0.86,
        "shank": 0.512,
    }.items():
        thickness = THICKNESSES[part]
        assert thickness.flesh >= 1.2 * girth / math.tau
        assert thickness.radius > thickness.flesh
    assert all(thickness.source for thickness in THICKNESSES.values())
