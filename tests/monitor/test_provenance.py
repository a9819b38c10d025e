import numpy as np

from armguard.monitor.provenance import (
    NAMES,
    describe_provenance,
    digest_package,
    digest_robot,
    list_differences,
)
from armguard.robot import Robot


def test_everything_that_verdicts_rest_on_has_a_value():
    found = describe_provenance(Robot.load("panda"))
    assert set(found) == set(NAMES)
    assert all(isinstance(value, str) and value for value in found.values())
    assert found == describe_provenance(Robot.load("panda"))


def test_differences_are_told_with_both_values_and_each_cause_once():
    here = dict.fromkeys(NAMES, "same")
    assert list_differences(here, here) == []
    other = here | {"processor": "old", "processor_features": "older", "numba": "0.1"}
    assert list_differences(other, here) == [
        "another processor: old recorded, same here",
        "another compiler (numba): 0.1 recorded, same here",
    ]
    assert list_differences({}, here)[0] == (
        "another version of armguard: unknown recorded, same here"
    )


def test_a_robot_and_its_cover_have_digests_of_their_own():
    robot, other = Robot.load("panda"), Robot.load("panda")
    assert digest_robot(robot) == digest_robot(other)
    other.velocity_error = np.nextafter(other.velocity_error, 1.0)
    assert digest_robot(robot)["cover"] == digest_robot(other)["cover"]
    assert digest_robot(robot)["robot"] != digest_robot(other)["robot"]
    assert digest_robot(Robot.load("ur5"))["cover"] != digest_robot(robot)["cover"]


def test_the_digest_of_a_package_is_of_all_its_modules_and_their_places(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "one.py").write_text("x = 1")
    digests = [digest_package(tmp_path)]
    (tmp_path / "a" / "one.py").write_text("x = 2")
    digests.append(digest_package(tmp_path))
    (tmp_path / "a" / "one.py").rename(tmp_path / "a" / "two.py")
    digests.append(digest_package(tmp_path))
    (tmp_path / "a" / "notes.txt").write_text("no module")
    assert digest_package(tmp_path) == digests[-1]
    assert len(set(digests)) == 3
