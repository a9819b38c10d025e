import math

import pytest

from armguard.exceptions import RobotError
from armguard.lab.new_robot.limits import JointFacts, find_coupled, find_travel
from armguard.lab.new_robot.questions import Figure
from armguard.robot.urdf import read_urdf
from support.urdf_arms import joint_xml, link_xml, write_urdf

MASS = (
    '<inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)


def read(folder, mass=MASS, limit='<limit lower="-1" upper="2" effort="10" velocity="1"/>'):
    """A lift, an arm that turns without end, and a finger."""
    links = [
        link_xml(name).replace("<collision>", f"{mass}<collision>", 1)
        for name in ("base", "lift", "arm", "finger")
    ]
    joints = (
        joint_xml("rise", "base", "lift", "prismatic"),
        joint_xml("turn", "lift", "arm", "continuous"),
        joint_xml("grip", "arm", "finger"),
    )
    urdf = '<limit lower="-1" upper="2" effort="10" velocity="1"/>'
    return read_urdf(write_urdf(folder, *links, *(one.replace(urdf, limit) for one in joints)))


def facts(folder, watched=("rise", "turn", "grip"), **changes):
    found = JointFacts(read(folder, **changes), watched, {}, "arm.urdf")
    speeds = {joint: Figure(1.0, "arm.urdf") for joint in found.joints}
    ranges = {joint: Figure((-1.0, 2.0), "arm.urdf") for joint in ("rise", "grip")}
    found.put({joint: ranges[joint] for joint in ranges if joint in found.joints}, speeds)
    return found


def test_what_it_lacks_is_usual_for_what_turns_and_what_slides(tmp_path):
    found = facts(tmp_path, limit="")
    assert (found.positions, found.velocities) == ({}, {})
    found.refuse_ranges([])
    assert set(found.usual_positions) == {"turn", "grip"}
    assert found.usual_velocities["rise"].value == 2.0
    assert found.usual_velocities["turn"].value == math.pi


def test_a_range_that_is_none_is_refused_unless_another_is_given(tmp_path):
    found = facts(tmp_path, limit='<limit lower="2" upper="1" velocity="1"/>')
    with pytest.raises(
        RobotError, match=r"joint 'rise': has position = \[2, 1\] in the model file"
    ):
        found.refuse_ranges(["grip=0:1"])
    found.refuse_ranges(["grip=0:1", "rise=0:1"])


def test_figures_are_derived_where_efforts_and_inertias_tell(tmp_path):
    strong = '<limit lower="-1" upper="2" effort="600" velocity="1"/>'
    found = facts(tmp_path, ["rise"], limit=strong)
    (acceleration,) = found.derive_accelerations().values()
    assert acceleration.source.startswith("DERIVED")
    # 600 N on all that it carries, 6 kg, at 37° to gravity, and a quarter more, rounded up.
    assert 1.25 * (600.0 / 6.0) < acceleration.value < 1.25 * (600.0 / 6.0 + 9.81) * 1.1
    (deceleration,) = found.derive_decelerations(0.0, {"rise": acceleration}).values()
    assert 0.0 < deceleration.value <= acceleration.value


def test_efforts_do_not_make_limits_lower_than_without_them(tmp_path):
    """100 N hold 6 kg at 37° to gravity; 10 N do not, so that they are none of this arm."""
    for effort, words in (("10", "do not determine it"), ("100", "would allow less")):
        limit = f'<limit lower="-1" upper="2" effort="{effort}" velocity="1"/>'
        found = facts(tmp_path, ["rise"], limit=limit)
        (acceleration,) = found.derive_accelerations().values()
        assert acceleration.value == 50.0
        assert acceleration.source.startswith("CHOSEN")
        assert words in acceleration.source
        (deceleration,) = found.derive_decelerations(0.0, {"rise": acceleration}).values()
        assert deceleration.source.startswith("CHOSEN" if effort == "10" else "DERIVED")


@pytest.mark.parametrize(
    "changes", [{"mass": ""}, {"limit": '<limit lower="-1" upper="2" velocity="1"/>'}]
)
def test_figures_are_chosen_where_they_do_not(tmp_path, changes):
    found = facts(tmp_path, **changes)
    accelerations = found.derive_accelerations()
    decelerations = found.derive_decelerations(1.0, accelerations)
    for figures in (accelerations, decelerations):
        assert all(one.source.startswith("CHOSEN") for one in figures.values())
    # None stops harder than its limit allows.
    gentle = {joint: Figure(0.1, "given") for joint in found.joints}
    assert {one.value for one in found.derive_decelerations(1.0, gentle).values()} == {0.1}
    assert all(one.value <= 0.1 for one in found.choose_work_accelerations(gentle).values())


def test_joints_that_have_to_do_with_watched_ones(tmp_path):
    urdf = read(tmp_path)
    assert find_coupled(urdf, ["turn"]) == (["rise"], ["grip"])
    assert find_coupled(urdf, ["rise", "turn", "grip"]) == ([], [])
    assert find_travel(urdf, "rise") == (-1.0, 2.0)
    assert find_travel(urdf, "turn") is None


@pytest.mark.parametrize(
    ("leader", "kind", "travel"),
    [
        ("turn", "revolute", (-4.0, 2.0)),
        ("turn", "continuous", None),
        ("nothing", "revolute", (-1.0, 2.0)),
        ("grip", "revolute", None),
    ],
)
def test_how_far_a_mimic_joint_travels(tmp_path, leader, kind, travel):
    """No cover has what a leader without end, or one that itself follows, takes along."""
    follows = f'<mimic joint="{leader}" multiplier="-2"/>'
    path = write_urdf(
        tmp_path,
        *(link_xml(name) for name in ("base", "arm", "finger")),
        joint_xml("turn", "base", "arm", kind),
        joint_xml("grip", "arm", "finger", extra=follows),
    )
    assert find_travel(read_urdf(path), "grip") == travel
