import math

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.bodies import BODIES
from armguard.obstacles import Obstacles
from armguard.people import BOUNDS, PATTERNS, find_bounds, list_bounds


def test_every_bound_is_finite_and_says_how_often_it_holds_and_whence():
    for part, bound in BOUNDS.items():
        assert 0.0 < bound.accel < math.inf, part
        assert 0.0 < bound.speed < math.inf, part
        if bound.percentile == 0.0:
            assert bound.source.startswith("assumed"), part
            continue
        assert 99.0 <= bound.percentile < 100.0, part
        assert "docs/people.md" in bound.source
    assert {part for part in BOUNDS if not BOUNDS[part].percentile} == {"thigh", "shank", "foot"}
    with pytest.raises(TypeError):
        BOUNDS["head"] = BOUNDS["hand"]


def test_limbs_have_the_bounds_of_their_wilder_end():
    for limb, ends in {"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "hand")}.items():
        assert BOUNDS[limb].accel == max(BOUNDS[end].accel for end in ends)
        assert BOUNDS[limb].speed == max(BOUNDS[end].speed for end in ends)


@pytest.mark.parametrize(
    ("id", "part"),
    [
        ("left_hand", "hand"),
        ("hand", "hand"),
        ("person 2/right_hand", "hand"),
        ("cam0:left-wrist", "hand"),
        ("left_elbow", "forearm"),
        ("right_shoulder", "upper_arm"),
        ("p1_left_upper_arm", "upper_arm"),
        ("hip", "trunk"),
        ("anna/left_thigh", "thigh"),
        ("left_knee", "shank"),
        ("right_foot", "foot"),
        ("head", "head"),
        # Nothing is claimed of what only sounds like a part of a body.
        ("overhead_crane", None),
        ("crane_overhead", None),
        ("ship", None),
        ("second.hand.dealer", None),
        ("Hand", None),
        ("", None),
        ("ball", None),
    ],
)
def test_ids_are_parts_of_bodies_by_whole_words(id, part):
    assert find_bounds(id) is (None if part is None else BOUNDS[part])


def test_bodies_of_the_simulation_have_bounds_that_hold_for_all_of_their_points():
    joints = {"collar": "trunk", "hip": "trunk", "head": "head"}
    joints |= {f"{side}_{end}": end for side in ("left", "right") for end in ("elbow", "hand")}
    joints |= {f"{side}_shoulder": "shoulder" for side in ("left", "right")}
    for body in BODIES:
        bound = find_bounds(body.name)
        for point in body.points:
            assert bound.accel >= BOUNDS[joints[point]].accel
            assert bound.speed >= BOUNDS[joints[point]].speed


def test_patterns_of_ones_own_count_in_their_order():
    patterns = {"*_elbow": "elbow", "*": "hand"}
    assert find_bounds("left_elbow", patterns) is BOUNDS["elbow"]
    assert find_bounds("anything", patterns) is BOUNDS["hand"]
    with pytest.raises(
        ArmguardError, match=r"pattern '\*': names part 'paw'; expected one of head"
    ):
        find_bounds("x", {"*": "paw"})
    with pytest.raises(ArmguardError, match="'paw'"):
        list_bounds({"*": "paw"})


def test_the_table_of_obstacles_takes_them():
    obstacles = Obstacles(sources=[], bounds=list_bounds())
    ids = ["left_hand", "left_elbow", "head", "box"]
    obstacles.update(ids, 0.0, [[i, 0.0, 1.0] for i in range(4)], radius=0.1)
    rows = [obstacles.row(id) for id in ids]
    accels = [BOUNDS["hand"].accel, BOUNDS["forearm"].accel, BOUNDS["head"].accel, 10.0]
    assert obstacles.table.accel[rows].tolist() == accels
    assert [pattern for pattern, *_ in list_bounds()] == list(PATTERNS)
