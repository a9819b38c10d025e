import pytest

from armguard.exceptions import RobotError
from armguard.robot.ros_parameters import read_planning_limits, read_robot_description

LIMITS = """
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 0.5
joint_limits:
  shoulder:
    has_velocity_limits: true
    max_velocity: 1.5
    has_acceleration_limits: false
    max_acceleration: 0.0
    max_jerk: 30.0
  elbow:
    has_velocity_limits: false
    max_acceleration: 4
"""


def write(folder, text):
    path = folder / "joint_limits.yaml"
    path.write_text(text)
    return path


def test_limits_count_where_the_file_says_that_there_are_some(tmp_path):
    found = read_planning_limits(write(tmp_path, LIMITS))
    assert found.joints == ("shoulder", "elbow")
    assert found.velocity == {"shoulder": 1.5}
    assert found.acceleration == {"elbow": 4.0}
    assert found.unused == (
        "shoulder.max_jerk",
        "default_velocity_scaling_factor",
        "default_acceleration_scaling_factor",
    )


def test_limits_are_found_in_the_namespaces_of_a_node(tmp_path):
    inner = "\n".join("      " + line for line in LIMITS.splitlines())
    text = f"/**:\n  ros__parameters:\n    robot_description_planning:\n{inner}\n"
    assert read_planning_limits(write(tmp_path, text)).velocity == {"shoulder": 1.5}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("joint_limits: {a: {max_velocity: .nan}}", "joint a: max_velocity is nan"),
        ("joint_limits: {a: {max_velocity: -1}}", "max_velocity is -1"),
        ("joint_limits: {a: {max_acceleration: 0}}", "max_acceleration is 0"),
        ("joint_limits: {a: {max_acceleration: .inf}}", "max_acceleration is inf"),
        ("joint_limits: {a: {max_velocity: fast}}", "max_velocity is 'fast'"),
        ("joint_limits: {a: {has_velocity_limits: true}}", "max_velocity is None"),
        (
            "joint_limits: {a: {has_velocity_limits: 1, max_velocity: 1}}",
            "has_velocity_limits is 1",
        ),
        ("joint_limits: {a: 3}", "joint a: is 3"),
        ("joint_limits: {}", "has no joint_limits"),
        ("a: b", "has no joint_limits"),
        ("joint_limits: [", "is not YAML"),
    ],
)
def test_unusable_limits_are_refused_by_name(tmp_path, text, words):
    with pytest.raises(RobotError, match=r"joint_limits\.yaml") as caught:
        read_planning_limits(write(tmp_path, text))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_robot_description_is_found_in_parameters(tmp_path):
    text = "/**:\n  ros__parameters:\n    robot_description: |\n      <robot name='a'/>\n"
    assert read_robot_description(write(tmp_path, text)).strip() == "<robot name='a'/>"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: b", "has no robot_description"),
        ("robot_description: $(xacro arm.xacro)", "expected the text of a URDF; expand"),
        ("robot_description: {command: xacro arm.xacro}", "expand"),
    ],
)
def test_what_is_no_urdf_is_refused(tmp_path, text, words):
    with pytest.raises(RobotError, match=words):
        read_robot_description(write(tmp_path, text))
