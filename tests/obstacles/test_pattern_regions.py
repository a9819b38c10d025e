import pytest

from armguard.body_regions import NUMBERS
from armguard.exceptions import ObstacleError
from armguard.obstacles import Obstacles
from armguard.obstacles.pattern_regions import PatternRegions

HAND, FOREARM = 1 << NUMBERS["hand"], 1 << NUMBERS["forearm"]


def test_without_patterns_nothing_is_looked_up():
    assert PatternRegions().find(["a", "b"]) is None


def test_an_id_has_the_regions_of_all_patterns_that_fit_in_any_order():
    patterns = {"*_hand": "hand", "left_*": "forearm"}
    for given in (patterns, dict(reversed(patterns.items()))):
        regions = PatternRegions(given)
        for _ in range(2):
            found = regions.find(["left_hand", "right_hand", "left_arm", "box", "Left_Hand"])
            assert found.tolist() == [HAND | FOREARM, HAND, FOREARM, 0, 0]
        assert regions.find([]).shape == (0,)
        assert regions.patterns == patterns


def test_a_stream_of_new_ids_fills_no_memory():
    regions = PatternRegions({"*_hand": "hand"})
    for k in range(100):
        found = regions.find([f"{k}-{i}{'_hand' * (i % 2)}" for i in range(100)])
        assert found.tolist() == [0, HAND] * 50
    assert len(regions._known) <= 4096


@pytest.mark.parametrize(
    ("patterns", "message"),
    [
        ({"*": "paw"}, r"regions: pattern '\*': names the region 'paw'; expected one of head, "),
        ({"*": ""}, "names the region ''"),
        ({"*": None}, "names the region None"),
        ({"*": ["hand"]}, r"names the region \['hand'\]"),
        ({"": "hand"}, "regions: has pattern ''"),
        ({3: "hand"}, "regions: has pattern 3"),
        ([("*", "hand")], "regions: is .*; expected a region by pattern of ids"),
        (7, "regions: is 7"),
    ],
)
def test_malformed_patterns_are_refused_by_name(patterns, message):
    with pytest.raises(ObstacleError, match=message):
        Obstacles(regions=patterns)
