"""Cells with several arms, each with a monitor of its own."""

import threading
import time

import numpy as np
import pytest

from armguard.app.cell import Cell
from armguard.app.loop import Observer, RunOptions, run
from armguard.exceptions import CellError
from armguard.pairs import ArmObstacles
from armguard.streams.nodes import Publisher, VerdictReader
from support.panda_monitor import HOME

SOURCES = "[sources]\n"
LEFT = '[[robots]]\nname = "left"\nrobot = "panda"\noperating = { velocity = 0.3 }\n'
RIGHT = (
    '[[robots]]\nname = "right"\nrobot = "panda"\ncalibration_error = 0.002\n'
    "[robots.base]\nxyz = [1.2, 0.0, 0.1]\nquaternion = [0.0, 0.0, 1.0, 0.0]\n"
)
ARMS = LEFT + RIGHT + SOURCES

MISTAKES = [
    (LEFT + LEFT + SOURCES, r"robots\[1\].name: is 'left' again"),
    (LEFT + "[sources.left]\n", r"robots\[0\].name: is 'left', as a source"),
    (ARMS.replace("left", "world"), "has no arm 'left'"),
    (ARMS.replace("right", "world"), r"robots\[1\].name: is 'world'"),
    ("robots = []\n" + SOURCES, "robots: has no arm 'left'; expected .*at least one"),
    (LEFT, "sources: is missing beside"),
    ('[robot]\nname = "panda"\n' + ARMS, "robot: is given beside"),
    (ARMS + '[tool]\nname = "a"\nlink = "b"\nsphere = 0.1\n', "tool: is given beside"),
    (ARMS + '[frames.lens]\nparent = "base"\n', r"frames.lens.parent: is 'base'; .*left, right"),
    (ARMS + "[frames.right]\n", "frames.right: is a frame of its own"),
    (ARMS + '[statics.a]\nframe = "base"\nposition = [0, 0, 0]\nradius = 0.1\n', "statics.a.frame"),
    ('settings = "auto"\n' + ARMS, 'settings: is "auto" beside'),
    (ARMS.replace('robot = "panda"\ncal', 'robot = "pandora"\ncal'), "pandora"),
    (ARMS.replace("0.002", "-1"), r"robots\[1\].calibration_error: is -1"),
    ('[robot]\nname = "panda"\n', "robots: is missing, so there is no arm 'left'"),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES)
def test_mistakes_about_arms_are_told_by_their_place(text, words):
    with pytest.raises(CellError, match=words):
        Cell.from_text(text, arm="left").make_other_arms()


def test_which_arm_is_watched_has_to_be_said():
    with pytest.raises(CellError, match="none is chosen; expected --arm with one of left, right"):
        Cell.from_text(ARMS)


KEYS = '[keys]\nsecret = "monitor.secret"\n[keys.clients.driver]\nmay = ["joints"]\n'
PUBLIC = f'public = "{"a" * 40}"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ARMS + KEYS + PUBLIC, r"keys.clients.driver.arms: is missing.*left, right"),
        (ARMS + KEYS + PUBLIC + 'arms = ["middle"]\n', "driver.arms: has 'middle'.*left, right"),
    ],
)
def test_which_arms_a_client_speaks_for_has_to_be_said(text, words):
    with pytest.raises(CellError, match=words):
        Cell.from_text(text, arm="left")
    Cell.from_text(ARMS + KEYS + PUBLIC + 'arms = ["right"]\n', arm="left")
    alone = '[robot]\nname = "panda"\n' + KEYS + PUBLIC
    Cell.from_text(alone)
    with pytest.raises(CellError, match=r"driver.arms: has 'left'; expected none"):
        Cell.from_text(alone + 'arms = ["left"]\n')


def test_each_arm_is_in_the_table_of_the_other_where_it_stands():
    cells = {arm: Cell.from_text(ARMS, arm=arm) for arm in ("left", "right")}
    assert cells["left"].monitor_settings(cells["left"].make_robot())["operating"] is not None
    for arm, other in (("left", "right"), ("right", "left")):
        obstacles = cells[arm].make_obstacles()
        assert obstacles.source_names == [other]
        assert obstacles.row(f"{other} panda_link0") >= 0
        assert obstacles.row(f"{arm} panda_link0") < 0
        (seen,) = cells[arm].make_other_arms()
        seen.publish(obstacles, 0.0, HOME, np.zeros(7))
        row = obstacles.row(f"{other} panda_link1 0")
        base = 1.2 if other == "right" else 0.0
        assert abs(obstacles.table.accepted.points[row, 0, 0] - base) < 0.2
        assert obstacles.table.accepted.position_error[row] > 0.002, "the bases' places, too"


def test_each_arm_ignores_what_it_is_told_to():
    own = 'ignore = [["panda_link1", "right panda_link1 *", "right"]]\n'
    text = 'ignore = [["panda_link2", "table"]]\n' + LEFT + own + RIGHT + SOURCES
    shared = ("panda_link2", "table")
    ignored = {}
    for arm in ("left", "right"):
        cell = Cell.from_text(text, arm=arm)
        ignored[arm] = cell.monitor_settings(cell.make_robot())["ignore"]
    assert ignored["left"] == [shared, ("panda_link1", "right panda_link1 *", "right")]
    assert ignored["right"] == [shared]


def test_arms_on_one_body_do_not_take_it_for_the_other_s():
    arms = "".join(
        f'[[robots]]\nname = "{side}"\nrobot = "baxter"\njoints = ["{side}_*"]\n'
        'operating = "published"\n'
        for side in ("left", "right")
    )
    cell = Cell.from_text(arms + SOURCES, arm="left")
    obstacles = cell.make_obstacles()
    assert len(obstacles) == 0
    (right,) = cell.make_other_arms()
    right.publish(obstacles, 0.0, np.zeros(7), np.zeros(7))
    assert obstacles.row("right right_wrist 0") >= 0
    assert not any("left_" in id for id in obstacles.ids)


def test_a_run_watches_its_arm_against_the_other_one_and_takes_its_plan(tmp_path, monkeypatch):
    patient = "[monitor]\nrate = 100.0\n[thresholds]\njoint_timeout = 30.0\nsource_timeout = 30.0\n"
    cell = Cell.from_text(ARMS + patient, arm="left")
    obstacles, joints, verdicts = (f"ipc://{tmp_path}/{name}" for name in "ojv")
    names, still = cell.make_robot().joints, np.zeros(7)
    found, plans, ended = [], [], threading.Event()
    take = ArmObstacles.take_plan

    def note(other, *plan):
        plans.append(other.name)
        take(other, *plan)

    monkeypatch.setattr(ArmObstacles, "take_plan", note)

    def send():
        with Publisher(joints) as publisher:
            while not ended.wait(0.005):
                now, rest = time.monotonic(), np.zeros((2, 7))
                plan = now, names, [0.0, 0.3], rest + HOME, rest, 0.001, 0.01
                publisher.share_plan("right", now + 60.0, *plan)
                for arm in ("left", "right"):
                    publisher.joints(time.monotonic(), names, HOME, still, arm=arm)

    def observe(_, verdict):
        if verdict.complete and verdict.obstacle is not None and plans:
            found.append(verdict)
            raise KeyboardInterrupt

    observer = Observer()
    observer.observe = observe
    sender = threading.Thread(target=send)
    sender.start()
    reader = VerdictReader(verdicts)
    try:
        report = run(
            cell, RunOptions(obstacles, joints, verdicts, duration=60.0), observer=observer
        )
    finally:
        ended.set()
        sender.join()
    assert found[0].obstacle.startswith("right panda_")
    with reader:
        assert reader.latest(10.0).arm == "left"
    assert set(plans) == {"right"}
    assert not any("malformed" in kind or "refused" in kind for kind in report.faults)
