"""A robot.toml that was written is read as what was to be written."""

import tomllib

from armguard.lab.new_robot.questions import Figure
from armguard.lab.new_robot.text import NewRobot, list_choices, write_text
from armguard.robot.description import LockedJoint, read_description

ODD = 'left "elbow" \\ 1'
JOINTS = ["a", ODD]


def each(value, *sources):
    return {j: Figure(value, s) for j, s in zip(JOINTS, sources * 2, strict=False)}


def make_new(**changes):
    figures = {
        "title": 'An "odd" arm',
        "urdf": "../arm.urdf",
        "package_dirs": ("/far/away",),
        "bare_links": ("lens",),
        "collision_from_visual": ("hand",),
        "locked": {
            "finger": LockedJoint(travel=(0.0, 0.04)), "torso": LockedJoint(position=-0.25)
        },
        "figures": {
            "load": {"": Figure(2.0, "CHOSEN: 2 kg")},
            "position": {"a": Figure((-1.0, 2.0), "the model file")},
            "velocity": each(1.5, "the model file", "CHOSEN: fast"),
            "acceleration": each(9.0, "DERIVED: from efforts"),
            "position_error": each(0.001, "CHOSEN: the default"),
            "velocity_error": each(0.03, "GIVEN"),
            "deceleration": each(3.0, "CHOSEN: soft", "measured"),
            "operating_velocity": each(1.0, "limits.yaml"),
            "operating_acceleration": each(4.0, "limits.yaml", "CHOSEN: gentle"),
        },
    }  # fmt: skip
    return NewRobot(**(figures | changes))


def test_what_was_written_is_read():
    read = read_description(tomllib.loads(write_text(make_new())))
    assert (read.title, read.urdf) == ('An "odd" arm', "../arm.urdf")
    assert (read.package_dirs, read.bare_links) == (("/far/away",), ("lens",))
    assert read.collision_from_visual == ("hand",)
    assert list(read.joints) == JOINTS
    assert (read.joints["a"].position, read.joints[ODD].position) == ((-1.0, 2.0), None)
    assert read.joints[ODD].velocity_error == 0.03
    assert write_text(make_new()).count("position_error = 0.001 # CHOSEN: the default\n") == 2
    assert read.source("a", "velocity") == "the model file"
    assert read.source(ODD, "velocity") == "CHOSEN: fast"
    assert read.locked["finger"].travel == (0.0, 0.04)
    assert read.locked["torso"].position == -0.25
    brakes = read.brake_entries()
    assert [(one.load, one.deceleration, one.source) for one in brakes["a"]] == [
        (2.0, 3.0, "CHOSEN: soft")
    ]
    assert brakes[ODD][0].source == "measured"
    # They hold from whatever speed can be measured without breaking the limit.
    assert brakes["a"][0].speed >= 1.5 + 0.03
    published = read.operating.published
    assert published.acceleration == {"a": 4.0, ODD: 4.0}
    assert published.sources.acceleration == f"a: limits.yaml; {ODD}: CHOSEN: gentle"


def test_what_is_no_data_of_the_arm_is_listed():
    assert list_choices(make_new()) == [
        f"velocity limits of {ODD}: CHOSEN: fast",
        "acceleration limits: DERIVED: from efforts",
        "position errors: CHOSEN: the default",
        "load of the brakes: CHOSEN: 2 kg",
        "decelerations of the brakes of a: CHOSEN: soft",
        f"operating accelerations of {ODD}: CHOSEN: gentle",
    ]
