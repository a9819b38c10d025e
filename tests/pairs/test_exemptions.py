"""Pairs that are not watched for the time being: until a time, or within a zone."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.obstacles import Obstacles
from armguard.pairs.exemptions import MOST, Exemptions
from armguard.pairs.ignored import IgnoredPairs
from support.panda_monitor import panda

BOX = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [0.0, 1.0])).reshape(3, 8).T
LINKS = panda().links


def make(ignore=(), sources=("camera",)):
    obstacles = Obstacles(sources=list(sources))
    return obstacles, Exemptions(obstacles, IgnoredPairs(ignore, panda(), sources))


def left_out(obstacles, exemptions, name):
    row = obstacles.row(name)
    watched = exemptions.leave_out(row, np.ones(len(LINKS), dtype=bool), LINKS)
    return {link for link, one in zip(LINKS, watched, strict=True) if not one}


def test_a_pair_is_left_out_until_the_arm_might_not_rest_before_the_end():
    obstacles, exemptions = make()
    obstacles.add_static("fixture", [0.5, 0.0, 0.5], 0.1)
    assert exemptions.is_idle
    made = exemptions.add("panda_hand", "fix*", until=2.0, now=0.5)
    assert (made.number, made.until, made.zone) == (1, 2.0, None)
    assert left_out(obstacles, exemptions, "fixture") == set()
    change = exemptions.update(1.0, 0.3)
    assert change.rows.tolist() == [obstacles.row("fixture")]
    assert left_out(obstacles, exemptions, "fixture") == {"panda_hand"}
    (state,) = exemptions.states
    assert state.left_out == 1
    assert "until 2.000 s" in state.detail
    assert len(exemptions.update(1.69, 0.3).rows) == 0
    # 0.31 s before its end, with an arm that rests in 0.3 s, it still counts; then no more.
    assert left_out(obstacles, exemptions, "fixture") == {"panda_hand"}
    change = exemptions.update(1.71, 0.3)
    assert len(change.rows) == 1
    assert any("watched again" in line for line in change.lines)
    assert left_out(obstacles, exemptions, "fixture") == set()
    assert "might not rest" in exemptions.states[0].detail
    # One that is slower by now rests in time again.
    assert len(exemptions.update(1.8, 0.1).rows) == 1
    change = exemptions.update(2.0, 0.1)
    assert change.ended == (made,)
    assert left_out(obstacles, exemptions, "fixture") == set()
    assert exemptions.listed == ()
    assert exemptions.is_idle
    assert len(exemptions.update(2.1, 0.1).rows) == 0


@pytest.mark.parametrize("horizon", [np.inf, np.nan])
def test_nothing_is_left_out_where_no_stop_is_known(horizon):
    obstacles, exemptions = make()
    obstacles.add_static("fixture", [0.5, 0.0, 0.5], 0.01)
    exemptions.add("*", "fixture", until=1e9)
    exemptions.add("*", "fixture", zone=BOX)
    exemptions.update(1.0, horizon)
    assert left_out(obstacles, exemptions, "fixture") == set()
    assert len(exemptions.update(1.0, 0.1).rows) == 1
    assert left_out(obstacles, exemptions, "fixture") == set(LINKS)


def test_a_zone_holds_those_that_stay_in_it():
    obstacles, exemptions = make()
    for number, x in enumerate((0.0, 0.95, 3.0)):
        obstacles.update(
            [f"part{number}"], 0.0, [[x, 0.0, 0.5]], radius=0.02, speed=0.2, source="camera"
        )
    exemptions.add("panda_hand", "part*", zone=BOX)
    exemptions.update(0.0, 0.1)
    found = [left_out(obstacles, exemptions, f"part{number}") for number in range(3)]
    assert found == [{"panda_hand"}, {"panda_hand"}, set()]
    assert "2 of 3 obstacles in its zone" in exemptions.states[0].detail
    # Whatever a body may do for so long leads out.
    assert exemptions.update(0.0, 0.2).rows.tolist() == [obstacles.row("part1", "camera")]
    assert "2 of 3" not in exemptions.states[0].detail
    exemptions.update(30.0, 0.1)
    assert exemptions.states[0].left_out == 0


def test_both_a_time_and_a_zone_must_allow_it():
    obstacles, exemptions = make()
    obstacles.add_static("in", [0.0, 0.0, 0.5], 0.1)
    obstacles.add_static("out", [5.0, 0.0, 0.5], 0.1)
    exemptions.add("*", "*", until=1.0, zone=BOX)
    exemptions.update(0.0, 0.5)
    assert left_out(obstacles, exemptions, "in") == set(LINKS)
    assert left_out(obstacles, exemptions, "out") == set()
    exemptions.update(0.6, 0.5)
    assert left_out(obstacles, exemptions, "in") == set()


def test_a_source_says_whose_obstacles_are_meant():
    obstacles, exemptions = make(sources=("camera", "scanner"))
    exemptions.add("*", "part", "camera", until=9.0)
    for source in ("scanner", "camera"):
        obstacles.update(["part"], 0.0, [[1, 0, 0]], radius=0.1, source=source)
    for source in ("scanner", "camera"):
        row = obstacles.row("part", source)
        exemptions.leave_out(row, np.ones(len(LINKS), dtype=bool), LINKS)
    assert exemptions.update(0.0, 0.1).rows.tolist() == [obstacles.row("part", "camera")]
    assert exemptions.unmatched == []


def test_who_takes_the_row_of_another_is_watched():
    obstacles, exemptions = make()
    obstacles.update(["part"], 0.0, [[1, 0, 0]], radius=0.1, source="camera")
    exemptions.add("*", "part", until=9.0)
    exemptions.update(0.0, 0.1)
    row = obstacles.row("part")
    obstacles.remove(["part"], source="camera")
    obstacles.update(["person"], 0.1, [[1, 0, 0]], radius=0.1, source="camera")
    assert obstacles.row("person") == row
    # A scheduler asks when the row comes into use; what it hears then is put right in that tick.
    exemptions.leave_out(row, np.ones(len(LINKS), dtype=bool), LINKS)
    assert exemptions.update(0.1, 0.1).rows.tolist() == [row]
    assert left_out(obstacles, exemptions, "person") == set()
    obstacles.remove(["person"], source="camera")
    assert len(exemptions.update(0.2, 0.1).rows) == 0


def test_a_pattern_waits_for_its_match_and_is_told_until_then():
    obstacles, exemptions = make()
    exemptions.add("panda_hand", "fixtrue", until=2.0)
    exemptions.add("panda_hand", "*", until=2.0, zone=BOX)
    exemptions.add("panda_hand", "later", "camera", until=2.0)
    assert exemptions.unmatched == ["fixtrue"]
    exemptions.update(1.0, 0.1)
    assert exemptions.unmatched == ["fixtrue"]
    assert "no matching obstacle" in exemptions.states[0].detail
    obstacles.add_static("fixtrue", [0.0, 0.0, 0.5], 0.1)
    left_out(obstacles, exemptions, "fixtrue")
    assert exemptions.unmatched == []
    exemptions.add("panda_hand", "nothing", until=2.0, now=1.0)
    exemptions.update(2.0, 0.1)
    assert exemptions.unmatched == []


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({}, "neither a time nor a zone"),
        ({"until": np.nan}, "until"),
        ({"until": np.inf}, "until"),
        ({"until": 1.0}, "until.*later than 1.000 s"),
        ({"until": -3.0}, "until"),
        ({"until": "soon"}, "until"),
        ({"until": True}, "until"),
        ({"until": [2.0]}, "until"),
        ({"zone": BOX[:4]}, "no room"),
        ({"zone": np.nan * BOX}, "finite"),
        ({"until": 2.0, "link": "panda_thumb"}, "panda_thumb.*not watched"),
        ({"until": 2.0, "link": 3}, "ignore"),
        ({"until": 2.0, "ids": None}, "ignore"),
        ({"until": 2.0, "source": "lidar"}, "lidar.*none of the obstacles' sources"),
        ({"until": 2.0, "link": "*", "ids": "*"}, "leaves nothing to watch"),
    ],
)
def test_what_cannot_be_is_refused_by_name_and_changes_nothing(wrong, words):
    _, exemptions = make()
    arguments = {"link": "panda_hand", "ids": "part", **wrong}
    with pytest.raises(ArmguardError, match=words):
        exemptions.add(**arguments, now=1.0)
    assert exemptions.is_idle
    assert exemptions.count == 0


def test_nothing_is_left_to_watch_by_all_of_them_together():
    _, exemptions = make(ignore=[(link, "*") for link in LINKS[2:]])
    exemptions.add(LINKS[0], "*", until=2.0)
    exemptions.add(LINKS[1], "*", zone=BOX)
    with pytest.raises(ArmguardError, match="leaves nothing to watch"):
        exemptions.add(LINKS[1], "*", until=3.0)
    exemptions.end(1)
    exemptions.add(LINKS[1], "*", until=3.0)


def test_they_are_ended_by_number_and_bounded_in_number():
    obstacles, exemptions = make()
    obstacles.add_static("fixture", [0.0, 0.0, 0.5], 0.1)
    for _ in range(MOST):
        exemptions.add("panda_hand", "fixture", until=9.0)
    with pytest.raises(ArmguardError, match=f"more than {MOST}"):
        exemptions.add("panda_hand", "fixture", until=9.0)
    exemptions.update(0.0, 0.1)
    for number in range(1, MOST + 1):
        exemptions.end(number)
    exemptions.end(3)
    for wrong in (0, MOST + 1, -1, True, 1.0, None):
        with pytest.raises(ArmguardError, match="does not exist"):
            exemptions.end(wrong)
    change = exemptions.update(0.1, 0.1)
    assert len(change.ended) == MOST
    assert len(change.rows) == 1
    assert exemptions.is_idle


def test_a_reset_ends_what_has_a_time():
    """What comes after it may be of another clock."""
    obstacles, exemptions = make()
    obstacles.add_static("fixture", [0.0, 0.0, 0.5], 0.1)
    exemptions.add("panda_hand", "fixture", until=9.0)
    kept = exemptions.add("panda_link5", "fixture", zone=BOX)
    exemptions.update(0.0, 0.1)
    assert left_out(obstacles, exemptions, "fixture") == {"panda_hand", "panda_link5"}
    exemptions.reset()
    assert exemptions.listed == (kept,)
    assert left_out(obstacles, exemptions, "fixture") == set()
    assert len(exemptions.update(-5.0, 0.1).rows) == 1
    assert left_out(obstacles, exemptions, "fixture") == {"panda_link5"}
