"""A URDF becomes a robot that loads; what is missing or wrong is one line and exit code 2."""

import os
import pty
import tomllib
from pathlib import Path

import numpy as np
import pytest

from armguard.app.cell import Cell
from armguard.app.cli import NewRobot, main
from armguard.exceptions import RobotError
from armguard.lab.new_robot import command
from armguard.lab.new_robot.command import NO_PLANNING, make_folder
from armguard.lab.new_robot.questions import GIVEN, Asker
from armguard.robot import Robot
from armguard.robot.ros_parameters import PlanningLimits
from support.mjcf_arms import write_mjcf
from support.urdf_arms import BOX, joint_xml, link_xml, two_links, write_urdf

BARE_LIMIT = '<limit lower="-1" upper="2"/>'
PLANNING = PlanningLimits(("shoulder",), {"shoulder": 0.8}, {"shoulder": 3.0}, ())


def run(arguments, capsys):
    """Exit code, standard output and standard error."""
    try:
        code = main(["robot", "new", *(str(argument) for argument in arguments)])
    except SystemExit as end:
        code = end.code
    return code, *capsys.readouterr()


def make(urdf, out, planning=NO_PLANNING, ask=None, **wishes):
    wishes = {"yes": ask is None, "spheres": 2} | wishes
    asker = Asker(ask, takes_usual=wishes["yes"])
    return make_folder(NewRobot("new", Path(urdf), out, **wishes), planning, asker)


def read(folder):
    return tomllib.loads((folder / "robot.toml").read_text())


def fingered(folder):
    """An arm with two fingers, the second of which follows the first."""
    return write_urdf(
        folder,
        *(link_xml(name) for name in ("base", "upper", "left", "right")),
        joint_xml("shoulder", "base", "upper"),
        joint_xml("left_finger", "upper", "left", "prismatic"),
        joint_xml("right_finger", "upper", "right", "prismatic", '<mimic joint="left_finger"/>'),
    )


def test_a_new_robot_loads_and_says_what_was_chosen(tmp_path, capsys):
    urdf, out = two_links(tmp_path), tmp_path / "mine"
    code, text, err = run([urdf, "--out", out, "--yes", "--spheres", 2], capsys)
    assert code == 0, err
    robot = Robot.load(out)
    assert (robot.name, robot.joints) == ("mine", ("shoulder",))
    assert robot.cover.check(robot).proved
    assert robot.lower_position_limit[0] == -1.0
    assert robot.velocity_limit[0] == 1.0
    assert robot.source("shoulder", "velocity") == "arm.urdf"
    for limit in ("acceleration", "braking"):
        assert robot.source("shoulder", limit).startswith("CHOSEN")
    assert robot.published_operating_limits is not None
    assert "CHOSEN" in text
    for what in ("position", "velocity"):
        assert f"- {what} errors: CHOSEN: armguard's default" in text
    # What was written goes wherever a robot is named.
    (tmp_path / "cell.toml").write_text('[robot]\nname = "mine"\n[sources.camera]\n')
    cell = Cell.load(tmp_path / "cell.toml")
    assert cell.make_robot().joints == robot.joints
    assert cell.urdf[0].endswith("arm.urdf")
    assert main(["cover", str(out), "--check"]) == 0


def test_moveits_limits_are_what_the_controller_keeps_to(tmp_path):
    make(two_links(tmp_path), tmp_path / "mine", PLANNING, joint_limits=tmp_path / "limits.yaml")
    operating = read(tmp_path / "mine")["operating"]["published"]
    assert operating["velocity"] == {"shoulder": 0.8}
    assert operating["acceleration"] == {"shoulder": 3.0}
    assert operating["sources"]["velocity"] == "limits.yaml, as MoveIt has it"


def test_what_is_given_goes_before_the_urdf(tmp_path):
    make(
        two_links(tmp_path),
        tmp_path / "mine",
        velocity=["should*=0.7"],
        position=["shoulder=-0.5:0.5"],
        acceleration=["9"],
        deceleration=["4"],
        load="0.5",
        velocity_error=["0.01"],
    )
    said = read(tmp_path / "mine")
    joint = said["joints"]["shoulder"]
    assert (joint["velocity"], joint["acceleration"], joint["position"]) == (0.7, 9.0, [-0.5, 0.5])
    assert joint["velocity_error"] == 0.01
    assert said["brakes"][0]["deceleration"] == {"shoulder": 4.0}
    assert said["brakes"][0]["load"] == 0.5
    assert said["sources"]["velocity"] == GIVEN


def test_joints_that_mimic_are_anywhere_in_their_travel(tmp_path):
    make(fingered(tmp_path), tmp_path / "mine")
    said = read(tmp_path / "mine")
    assert list(said["joints"]) == ["shoulder"]
    travel = {"travel": [-1.0, 2.0]}
    assert said["locked"] == {"left_finger": travel, "right_finger": travel}
    assert set(Robot.load(tmp_path / "mine").links) == {"upper", "left", "right"}


def test_links_that_are_only_drawn_are_covered_as_drawn(tmp_path):
    hand = f'<link name="hand"><visual><origin xyz="0 0 1"/>{BOX}</visual></link>'
    urdf = write_urdf(
        tmp_path,
        link_xml("base"),
        link_xml("upper"),
        hand,
        joint_xml("shoulder", "base", "upper"),
        joint_xml("wrist", "upper", "hand"),
    )
    make(urdf, tmp_path / "mine", collision_from_visual=["hand"])
    robot = Robot.load(tmp_path / "mine")
    np.testing.assert_allclose(robot.triangles("hand").reshape(-1, 3).mean(axis=0)[2], 1.0)
    make(urdf, tmp_path / "usual")
    assert "hand" in Robot.load(tmp_path / "usual").links
    make(urdf, tmp_path / "bare", bare_links=["hand"])
    assert "hand" not in Robot.load(tmp_path / "bare").links


def test_a_urdf_in_a_parameter_file_is_written_beside_it(tmp_path):
    text = two_links(tmp_path).read_text().replace("\n", " ")
    parameters = tmp_path / "description.yaml"
    parameters.write_text(f"robot_description: |\n  {text}\n")
    make(parameters, tmp_path / "mine")
    assert (tmp_path / "mine" / "robot.urdf").is_file()
    (tmp_path / "mine").rename(tmp_path / "moved")
    assert Robot.load(tmp_path / "moved").joints == ("shoulder",)


def test_an_arm_of_the_examples_keeps_their_name(tmp_path):
    make("ur_description/urdf/ur3_robot.urdf", tmp_path / "mine", spheres=1)
    said = read(tmp_path / "mine")
    assert said["urdf"] == "ur_description/urdf/ur3_robot.urdf"
    assert "package_dirs" not in said
    assert said["sources"]["acceleration"].startswith("DERIVED")
    assert len(Robot.load(tmp_path / "mine").joints) == 6


def test_a_terminal_is_asked_and_enter_takes_what_is_usual(tmp_path):
    answers = {"--acceleration": ["fast", "-1", "7"], "--load": ["2"]}
    asked = []

    def ask(text):
        asked.append(text)
        for option, left in answers.items():
            if f"({option})" in text or f"{option} " in text:
                return left.pop(0) if left else ""
        return ""

    make(two_links(tmp_path), tmp_path / "mine", ask=ask, yes=False)
    said = read(tmp_path / "mine")
    assert said["joints"]["shoulder"]["acceleration"] == 7.0
    assert said["brakes"][0]["load"] == 2.0
    assert "default" in asked[0]
    assert sum("--acceleration" in text for text in asked) == 3


def test_answers_are_read_from_a_terminal(monkeypatch):
    master, slave = pty.openpty()
    with os.fdopen(master, "wb", 0) as keys, os.fdopen(slave, "r") as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        keys.write(b" 5 \n\x04")
        assert command.ask_on_terminal("how much? ") == "5"
        with pytest.raises(RobotError, match="has ended"):
            command.ask_on_terminal("and then? ")


def without_limits(folder):
    return write_urdf(
        folder,
        link_xml("base"),
        link_xml("upper"),
        joint_xml("shoulder", "base", "upper").replace(
            '<limit lower="-1" upper="2" effort="10" velocity="1"/>', BARE_LIMIT
        ),
    )


def with_limits(folder, limits):
    path = without_limits(folder)
    path.write_text(path.read_text().replace(BARE_LIMIT, limits))
    return path


def lifted(folder):
    """An arm on a lift."""
    return write_urdf(
        folder,
        *(link_xml(name) for name in ("base", "lift", "upper")),
        joint_xml("torso", "base", "lift", "prismatic"),
        joint_xml("shoulder", "lift", "upper"),
    )


def test_a_joint_that_carries_the_arm_stands_where_somebody_says(tmp_path):
    make(lifted(tmp_path), tmp_path / "mine", joints=["shoulder"], lock=["torso=0.25"])
    assert read(tmp_path / "mine")["locked"] == {"torso": {"position": 0.25}}
    answers = {"--lock torso=POSITION": "0.5"}
    make(
        lifted(tmp_path),
        tmp_path / "asked",
        joints=["shoulder"],
        ask=lambda text: next((one for option, one in answers.items() if option in text), ""),
    )
    assert read(tmp_path / "asked")["locked"] == {"torso": {"position": 0.5}}


@pytest.mark.parametrize(
    ("prepare", "options", "words"),
    [
        (two_links, [], "--acceleration: is missing"),
        (two_links, ["--acceleration", 9, "--load", 1], "--deceleration: is missing"),
        (without_limits, [], "--velocity: is missing"),
        (two_links, ["--yes", "--acceleration", "nan"], "--acceleration nan: is 'nan'"),
        (two_links, ["--yes", "--acceleration", 1, "--deceleration", 2], "no harder a stop"),
        (two_links, ["--yes", "--joints", "elbow"], "--joints elbow: names 'elbow'"),
        (two_links, ["--yes", "--lock", "shoulder=0"], "has no joint to watch"),
        (
            two_links,
            ["--yes", "--collision-from-visual", "hand"],
            "link 'hand': is not in the model file",
        ),
        (two_links, ["--yes", "--collision-from-visual", "upper"], "collision geometry of its own"),
        (two_links, ["--yes", "--package-dirs", "none"], "--package-dirs none: is not a folder"),
        (two_links, ["--yes", "--joint-limits", "none.yaml"], "none.yaml: cannot be read"),
        (two_links, ["--yes", "--title", "x\ny = 1"], "--title: gives the title 'x\\ny = 1'"),
        (fingered, ["--yes", "--joints", "*"], "mimic"),
        (
            lifted,
            ["--yes", "--joints", "shoulder"],
            "--lock torso=POSITION: is missing: joint torso carries watched joints",
        ),
        (lambda folder: folder / "none.urdf", ["--yes"], "none.urdf: cannot be read"),
        (lambda folder: two_links(folder, kind="floating"), ["--yes"], "degrees of freedom"),
        (
            lambda folder: with_limits(folder, '<limit lower="-1" upper="2" velocity="-1"/>'),
            ["--yes"],
            "joint 'shoulder': has velocity='-1' in its limit element",
        ),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(tmp_path, capsys, prepare, options, words):
    path, out = prepare(tmp_path), tmp_path / "mine"
    code, text, err = run([path, "--out", out, *options], capsys)
    assert (code, text) == (2, "")
    assert err.startswith("armguard: ")
    assert len(err.splitlines()) == 1
    assert words in err
    assert not out.exists()


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ("joint_limits: {elbow: {max_velocity: 1}}", "names joint 'elbow'"),
        ("joint_limits: {shoulder: {max_velocity: 5}}", "above the limit of the joint"),
        ("joint_limits: {shoulder: {max_velocity: .nan}}", "max_velocity is nan"),
    ],
)
def test_unusable_planning_limits_are_refused(tmp_path, capsys, limits, words):
    (tmp_path / "limits.yaml").write_text(limits)
    options = ["--yes", "--joint-limits", tmp_path / "limits.yaml", "--out", tmp_path / "mine"]
    code, _, err = run([two_links(tmp_path), *options], capsys)
    assert code == 2
    assert words in err.splitlines()[-1]


def test_a_folder_that_has_something_in_it_is_left_alone(tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.mkdir()
    (taken / "file").write_text("mine")
    code, _, err = run([two_links(tmp_path), "--yes", "--out", taken], capsys)
    assert code == 2
    assert "is not empty" in err
    assert [path.name for path in taken.iterdir()] == ["file"]
    code, _, err = run([two_links(tmp_path), "--yes", "--out", taken / "file"], capsys)
    assert code == 2
    assert "cannot be made: File exists" in err


def test_an_mjcf_becomes_a_robot_and_its_missing_velocities_are_named(tmp_path):
    path, out = write_mjcf(tmp_path), tmp_path / "mine"
    with pytest.raises(RobotError, match=r"--velocity.*pan, lift, roll"):
        make(path, out, yes=False, ask=None)
    make(path, out, velocity=["2"], spheres=1)
    robot = Robot.load(out)
    assert robot.joints == ("pan", "lift", "roll")
    assert robot.velocity_limit.tolist() == [2.0, 2.0, 2.0]
    assert read(out)["urdf"] == "../arm.xml"
