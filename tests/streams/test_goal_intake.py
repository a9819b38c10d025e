"""Goals are read in the order of the joints, and refused by name where they are of no use."""

import math

import numpy as np
import pytest

from armguard.streams import StampClock
from armguard.streams.goal_intake import LONGEST_VELOCITY, MOST_POINTS, MOST_SAMPLES, MOST_WAYPOINTS
from support.stream_messages import MONOTONIC, World, two_arms

NOW = MONOTONIC + 5.0
NAMES = ["elbow", "gripper", "shoulder"]


def goal(**changes):
    message = {"type": "goal", "number": 3, "until": NOW + 0.5, "names": NAMES} | changes
    return {key: value for key, value in message.items() if value is not ...}


def read(*messages, **options):
    world = World(**options)
    world.send(*messages)
    return world.edge.requests.goals, world


def test_goals_arrive_in_the_order_of_the_watched_joints():
    packed = np.array([[2.0, 9.0, 1.0]] * 2).tobytes()
    (path, jog, chunk), world = read(
        goal(paths=[{"q": packed}, {"q": [[2, 9, 1]] * 3, "times": [0, 1, 2]}], number=1),
        goal(velocity=[0.2, 9.0, 0.1], number=2),
        goal(chunk=[[2.0, 9.0, 1.0]] * 4),
    )
    assert [one.number for one in (path, jog, chunk)] == [1, 2, 3]
    (bare, no_times), (timed, times) = path.paths
    assert bare.tolist() == [[1.0, 2.0]] * 2
    assert no_times is None
    assert timed.tolist() == [[1.0, 2.0]] * 3
    assert times.tolist() == [0.0, 1.0, 2.0]
    assert jog.velocity.tolist() == [0.1, 0.2]
    assert chunk.chunk.tolist() == [[1.0, 2.0]] * 4
    assert jog.until == pytest.approx(5.5)
    assert world.faults.total == 0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "goal is empty; expected one of paths, velocity and chunk"),
        ({"velocity": [0.0] * 3, "chunk": [[0.0] * 3]}, "goal is velocity and chunk"),
        ({"velocity": [0.0] * 3, "until": NOW - 1.0}, "until is 1 s ago"),
        ({"velocity": [0.0] * 3, "until": math.nan}, "until is nan"),
        ({"chunk": [[0.0] * 3], "until": math.inf}, "until is inf"),
        ({"velocity": [0.0] * 3, "until": NOW + 60.0}, "until is 60 s ahead"),
        ({"velocity": [0.0] * 2}, "velocity is 2 values"),
        ({"velocity": [math.nan, 0.0, 0.0]}, "velocity is not finite"),
        ({"velocity": b"\0" * 23}, "velocity is 23 bytes"),
        ({"velocity": [0.0], "names": ["elbow"]}, "shoulder"),
        ({"velocity": [0.0] * 3, "arm": "left"}, "arm is 'left'"),
        ({"chunk": []}, "chunk is 0 rows"),
        ({"chunk": [[0.0] * 3] * (MOST_POINTS + 1)}, "chunk is 101 rows"),
        ({"chunk": [[0.0] * 2]}, "chunk is"),
        ({"chunk": [[math.inf] * 3]}, "chunk is not finite"),
        ({"paths": []}, "paths is 0 of them"),
        ({"paths": [{"q": [[0.0] * 3]}] * 9}, "paths is 9 of them"),
        ({"paths": [{"q": []}]}, "paths[0].q is 0 rows"),
        ({"paths": [{"q": [[0.0] * 3, [0.0] * 2]}]}, "paths[0].q is rows of unequal length"),
        ({"paths": [{"q": [[math.nan] * 3] * 2}]}, "paths[0].q is not finite"),
        ({"paths": [{"q": [[0.0] * 3] * 2, "times": [0.0]}]}, "paths[0].times is 1 values"),
        ({"paths": [{"q": [[0.0] * 3] * MOST_WAYPOINTS}] * 2}, "waypoints without times"),
        (
            {"paths": [{"q": b"\0" * 24 * (MOST_SAMPLES + 1), "times": [0.0]}]},
            "samples with times",
        ),
    ],
)
def test_what_is_late_or_garbage_is_refused_by_name(changes, words):
    (request,), world = read(goal(**changes))
    assert words in request.problem
    assert (request.paths, request.velocity, request.chunk) == ((), None, None)
    assert world.faults.count("goal refused") == 1
    assert words in world.lines[0]


@pytest.mark.parametrize(
    "message",
    [
        goal(number=-1, velocity=[0.0] * 3),
        goal(until=..., velocity=[0.0] * 3),
        goal(velocity="fast"),
        goal(speed=1.0, velocity=[0.0] * 3),
        goal(paths=[{"q": [[0.0] * 3], "pace": 1.0}]),
    ],
)
def test_what_has_no_form_of_a_goal_is_malformed(message):
    goals, world = read(message)
    assert goals == []
    assert world.kinds() == ["malformed"]


def test_the_end_of_a_goal_is_never_late_because_clocks_differ():
    clock = StampClock("monotonic", 0.5, 0.02)
    (request,), _ = read(goal(velocity=[0.0] * 3), joint_clock=clock)
    assert 5.48 - 1e-9 <= request.until <= 5.48
    assert LONGEST_VELOCITY > 0.5


def test_goals_go_to_the_arm_that_they_name():
    world, _ = two_arms()
    for arm, number in (("right", 1), ("left", 2), ("", 3)):
        world.send(goal(arm=arm, number=number, velocity=[0.0] * 3))
        found = [(one.number, bool(one.problem)) for one in world.edge.requests.goals]
        assert found == {"right": [], "left": [(2, False)], "": [(3, True)]}[arm]


def test_a_reset_ends_what_was_asked_before_it_in_the_same_drain():
    reset = {"type": "reset", "token": "sesame"}
    jogs = [goal(number=number, velocity=[0.0] * 3) for number in (1, 2)]
    goals, _ = read(jogs[0], reset, jogs[1], reset_token="sesame")
    assert [one.number for one in goals] == [2]


def test_a_drain_forgets_the_goals_of_the_one_before():
    goals, world = read(goal(velocity=[0.0] * 3))
    assert len(goals) == 1
    world.send()
    assert world.edge.requests.goals == []
