from pathlib import Path

import pytest

from armguard.exceptions import RobotError
from armguard.robot import Robot
from armguard.robot.description import read_description
from support.urdf_arms import limits_for, two_links

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"velocity": None}, "velocity"),
        ({"position": None}, "'shoulder'.*has no position limit"),
        ({"acceleration": float("inf")}, "shoulder: acceleration = inf"),
        ({"acceleration": float("nan")}, "shoulder: acceleration = nan"),
        ({"braking": 2.0}, r"shoulder: braking = 2\.0 has no stated range.*\[\[brakes\]\]"),
        ({"velocity": -1.0}, "shoulder: velocity = -1.0"),
        ({"position": [float("-inf"), 1.0]}, "shoulder: position"),
        ({"position": [1.0, float("nan")]}, "shoulder: position"),
        ({"position": [1.0, 1.0]}, "lower < upper"),
        ({"position_error": float("nan")}, "position_error = nan"),
        ({"velocity_error": -0.1}, "velocity_error = -0.1"),
        ({"jerk": 10.0}, "jerk"),
        ({"velocity": "fast"}, "velocity"),
        ({"sources": {"speed": "a guess"}}, "speed"),
    ],
)
def test_unusable_limits_are_refused_by_name(tmp_path, changes, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_urdf(two_links(tmp_path), limits=limits_for("shoulder", **changes))


def test_a_value_of_another_type_names_its_joint():
    limits = limits_for("shoulder", "elbow")
    limits["joints"]["elbow"]["velocity"] = "fast"
    with pytest.raises(RobotError, match=r"got `str` - at `joints\.elbow\.velocity`"):
        read_description(limits)


def published_for(velocity=0.5, acceleration=3.0, joint="shoulder", source="a test"):
    limits = {"velocity": {joint: velocity}, "acceleration": {joint: acceleration}}
    sources = {"velocity": source, "acceleration": source}
    return {"operating": {"published": {"sources": sources, **limits}}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"velocity": 1.0001}, r"velocity: joint shoulder.*is 1\.0001.*at most 1\.0, the velocity"),
        ({"acceleration": 5.5}, r"acceleration: joint shoulder.*is 5\.5.*at most 5\.0"),
        ({"acceleration": 0.0}, r"is 0\.0.*above 0"),
        ({"velocity": float("nan")}, "is nan"),
        ({"velocity": float("inf")}, "is inf"),
        ({"acceleration": -1.0}, r"is -1\.0"),
        ({"velocity": "fast"}, "velocity"),
        ({"joint": "elbow"}, "velocity: is for elbow; expected shoulder"),
        ({"source": " "}, "velocity: has no source"),
    ],
)
def test_operating_limits_that_cannot_be_are_refused_by_name(changes, message):
    with pytest.raises(RobotError, match=message):
        read_description(limits_for("shoulder") | published_for(**changes))


def test_operating_limits_are_those_of_the_watched_joints(tmp_path):
    path = two_links(tmp_path)
    limits = limits_for("shoulder")
    plain = Robot.from_urdf(path, limits=limits)
    assert plain.published_operating_limits is None
    robot = Robot.from_urdf(path, limits=limits | published_for(velocity=1.0))
    published = robot.published_operating_limits
    assert (published.velocity.tolist(), published.acceleration.tolist()) == ([1.0], [3.0])
    assert published.source == "velocity: a test; acceleration: a test"
    with pytest.raises(ValueError, match="read-only"):
        published.velocity[0] = 2.0
    # What is published of an arm at work changes no limit that its bounds rest on.
    assert robot.velocity_limit == plain.velocity_limit
    assert robot.acceleration_limit == plain.acceleration_limit


@pytest.mark.parametrize("content", ["joints = 3", "[joints", "\xff", ""])
def test_malformed_files_are_refused(tmp_path, content):
    path = tmp_path / "robot.toml"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(RobotError, match=r"robot\.toml"):
        read_description(path)
    with pytest.raises(RobotError, match="cannot be read"):
        read_description(tmp_path / "none.toml")
