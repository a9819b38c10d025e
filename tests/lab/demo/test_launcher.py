"""The demo as its user meets it: real processes, ended in every order."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from armguard.app.cell import Cell
from armguard.app.cli import Demo
from armguard.exceptions import ArmguardError
from armguard.lab.demo import nodes
from armguard.lab.demo.launcher import run_demo, write_cell
from armguard.lab.demo.nodes import make_sources
from armguard.lab.demo.places import find_place
from armguard.robot.description import find_robot
from armguard.shield import Path as ArmPath
from armguard.streams import VerdictReader
from support.demo_processes import RunningDemo, finish, wait_until

RECORDINGS = Path(
    os.environ.get("ARMGUARD_RECORDINGS", Path(__file__).parents[3] / "../shared/data/human-motion")
)


def test_mistakes_are_raised_before_anything_is_started():
    for mistake in ({"duration": float("nan")}, {"duration": -1.0}, {"obstacles": -1}):
        with pytest.raises(ArmguardError):
            run_demo(Demo(**mistake))
    with pytest.raises(ArmguardError, match="port"):
        run_demo(Demo(port=-1))
    with pytest.raises(ArmguardError, match=r"has no robot\.toml"):
        run_demo(Demo(robot="/"))


@pytest.mark.parametrize("has_published", [True, False])
def test_an_arm_of_ones_own_is_named_by_its_folder(tmp_path, has_published):
    folder = tmp_path / 'an "odd" arm'
    shutil.copytree(find_robot("panda"), folder)
    if not has_published:
        text = (folder / "robot.toml").read_text().partition("[operating")[0]
        (folder / "robot.toml").write_text(text)
    cell = Cell.from_text(write_cell(str(folder), make_sources(5.0, "", 1, 0), "deadline"))
    assert cell.make_robot().name == folder.name
    assert (cell.tables.robot.operating == "published") == has_published
    assert cell.urdf[0].endswith("panda.urdf")


@pytest.mark.skipif(
    not (RECORDINGS / "handover-0.csv").exists(),
    reason="no recordings there: set ARMGUARD_RECORDINGS to their folder",
)
def test_a_real_person_is_supervised_over_the_same_streams(tmp_path):
    person = str(RECORDINGS / "handover-0.csv")
    arguments = ["--person", person, "--duration", "6", "--no-view", "--json"]
    with RunningDemo(*arguments, folder=tmp_path) as demo:
        out, _ = finish(demo)
    assert demo.process.returncode == 0
    summary = json.loads(out)
    assert summary["received"] > 1000
    # Somebody is seen near the arm; whether it must stop for them is for the verdict to say.
    levels = summary["levels"]
    assert levels["STOP"] + levels["SLOW"] + levels["AWARE"] > 0
    assert 0.0 <= summary["min_contact_time"] < 1.0
    assert summary["message_faults"] == {}


@pytest.mark.parametrize("robot", ["panda", "ur5e"])
def test_a_shield_can_move_the_arm_of_its_cell(robot):
    sources = make_sources(20.0, "", 0, 0)
    cell = Cell.from_text(write_cell(robot, sources, "deadline", is_moved=True))
    model, obstacles, monitor = cell.build()
    shield = cell.make_shield(monitor)
    waypoints = nodes.make_trajectory(model, find_place(robot), 0).waypoints
    shield.set_path(ArmPath(waypoints[:2]))
    q, v, now = waypoints[0], np.zeros(len(model.joints)), 0.0
    for _ in range(25):
        obstacles.update([], now, [], source="person")
        command = shield.step(now, q, v)
        now += monitor.period
        q, v, _ = command.at(now)
    assert command.reason is None
    assert shield.progress > 0.0


def test_a_shield_moves_the_arm_from_goal_to_goal(tmp_path):
    arguments = ["--shield", "--duration", "8", "--no-view", "--json"]
    with RunningDemo(*arguments, folder=tmp_path) as demo:
        demo.wait_for_verdicts()
        with VerdictReader(demo.verdicts) as reader:
            assert wait_until(
                lambda: reader.latest() and reader.command and reader.command.progress > 0.01
            )
            assert reader.command.refused is None
        out, _ = finish(demo)
    assert demo.process.returncode == 0
    summary = json.loads(out)
    assert "goal refused: goals" not in summary["message_faults"]
