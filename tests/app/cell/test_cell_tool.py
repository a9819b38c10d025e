import numpy as np
import pytest

from armguard.app.cell import Cell
from armguard.exceptions import CellError

ROBOT = '[robot]\nname = "panda"\n'
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
TOOL = """
[tool]
name = "welder"
link = "panda_hand"
xyz = [0.0, 0.0, 0.2]
quaternion = [0.7071067811865476, 0.0, 0.0, 0.7071067811865476]
"""


def test_a_tool_becomes_a_link():
    cell = Cell.from_text(ROBOT + TOOL + "cylinder = { radius = 0.02, length = 0.3 }\n")
    robot, _, monitor = cell.build()
    assert robot.links[-1] == "welder"
    extent = np.ptp(robot.triangles("welder").reshape(-1, 3), axis=0)
    np.testing.assert_allclose(extent, [0.04, 0.3, 0.04], atol=1e-3)
    assert monitor.step(0.0, READY, np.zeros(7)).complete


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ("", "tool: has no geometry; expected one of sphere, box"),
        ("sphere = 0.1\nbox = [0.1, 0.1, 0.1]", "tool: has sphere and box"),
        ("sphere = -0.1", "tool.sphere: is -0.1"),
        ("box = [0.1, 0.1]", "tool.box"),
        ("capsule = { radius = 0.1 }", "tool.capsule.length: is missing"),
        ("cone = 0.1", "tool.cone: is no key"),
        ("mesh = 'none.stl'", "tool: none.stl: cannot be read as a mesh"),
        ("box = [200.0, 1.0, 1.0]", "reaches 100"),
    ],
)
def test_unusable_tools_are_refused(geometry, message):
    with pytest.raises(CellError, match=message):
        Cell.from_text(ROBOT + TOOL + geometry + "\n").make_robot()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"panda_hand"', '"elbow"', "tool: link 'elbow'"),
        ('"welder"', '"panda_hand"', "tool: attached body 'panda_hand'.*has the name of another"),
        ("[0.7071067811865476,", "[0.8,", "tool.quaternion"),
    ],
)
def test_misplaced_tools_are_refused(old, new, message):
    with pytest.raises(CellError, match=message):
        Cell.from_text(ROBOT + TOOL.replace(old, new, 1) + "sphere = 0.1\n").make_robot()
