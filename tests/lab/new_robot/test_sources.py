from pathlib import Path

import pytest

from armguard.exceptions import RobotError
from armguard.lab.new_robot.sources import find_urdf
from armguard.robot.description import find_example_urdf
from support.urdf_arms import mesh_xml, two_links

UR3 = "ur_description/urdf/ur3_robot.urdf"


def find(name, folder, packages=()):
    return find_urdf(Path(name), folder / "mine", [Path(one) for one in packages], folder)


def test_a_file_is_named_so_that_both_may_be_moved_together(tmp_path):
    (tmp_path / "meshes").mkdir()
    found = find(two_links(tmp_path), tmp_path, [tmp_path / "meshes"])
    assert (found.key, found.package_keys, found.text) == ("../arm.urdf", ("../meshes",), None)
    assert found.origin == "arm.urdf"
    assert found.folders[:2] == [tmp_path / "meshes", tmp_path]


@pytest.mark.parametrize("is_whole", [True, False])
def test_one_of_the_examples_is_named_as_such(tmp_path, is_whole):
    path, packages = find_example_urdf(UR3)
    found = find(path if is_whole else UR3, tmp_path)
    assert (found.path, found.key, found.package_keys) == (path, UR3, ())
    assert packages in found.folders
    assert "example-robot-data" in found.origin


def test_what_is_taken_out_of_parameters_needs_no_file_of_its_own(tmp_path):
    parameters = tmp_path / "description.yaml"
    text = two_links(tmp_path, mesh_xml("package://arm/upper.stl")).read_text().replace("\n", " ")
    parameters.write_text(f"robot_description: |\n  {text}\n")
    found = find(parameters, tmp_path)
    assert (found.key, found.package_keys) == ("robot.urdf", ("..",))
    assert found.text.strip() == text.strip() == found.path.read_text().strip()
    parameters.write_text(parameters.read_text().replace("package://arm/", "meshes/"))
    with pytest.raises(
        RobotError, match=r"mesh 'meshes/upper\.stl': is relative, but the URDF is not"
    ):
        find(parameters, tmp_path)
    parameters.write_text("robot_description: <robot")
    with pytest.raises(RobotError, match="is not XML"):
        find(parameters, tmp_path)


def test_what_is_not_there_is_said(tmp_path):
    with pytest.raises(
        RobotError, match=r"none\.urdf: cannot be read: no such file; expected a URDF"
    ):
        find("none.urdf", tmp_path)
    with pytest.raises(RobotError, match="is not a folder"):
        find(UR3, tmp_path, ["none"])
