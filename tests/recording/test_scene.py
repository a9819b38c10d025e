import msgspec
import numpy as np
import pytest

from armguard.messages.events import StaticObstacle
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage
from armguard.monitor.portable import describe_settings
from armguard.recording.events import JointState
from armguard.recording.scene import MOST_DRAWN, Scene
from armguard.robot import Kinematics
from armguard.robot.portable import describe_robot
from support import eventful_runs
from support.panda_monitor import HOME


@pytest.fixture(scope="module")
def made():
    robot, _, monitor = eventful_runs.make_monitor("joint")
    return robot, describe_robot(robot), describe_settings(monitor)


def update(ids, position, **changes):
    fields = {"source": "camera", "radius": 0.1} | changes
    return ObstaclesMessage(ids, 0.0, position=pack(position), **fields)


def pack(numbers):
    return np.array(numbers, float).tobytes()


def state(q):
    return JointState(0.0, [f"joint {k}" for k in range(7)], pack(q), bytes(56), now=0.0)


def draw(scene):
    """Each part by its name, through JSON."""
    picture = msgspec.json.decode(msgspec.json.encode(scene.draw(1_500_000_000)))
    assert all(one["timestamp"] == {"sec": 1, "nsec": 500_000_000} for one in picture["entities"])
    return {entity["id"]: entity for entity in picture["entities"]}


def centres(entity):
    return np.array([list(ball["pose"]["position"].values()) for ball in entity["spheres"]])


def test_the_arm_is_drawn_where_it_is_in_the_colour_of_its_level(made):
    robot, data, settings = made
    scene = Scene(data, settings)
    assert "arm" not in draw(scene), "nothing is known of it"
    scene.take_state(state(HOME))
    scene.take_state(state([np.nan] * 7))
    colors = []
    for level in ("STOP", "CLEAR", "unheard of"):
        scene.take_level(level)
        arm = draw(scene)["arm"]
        colors.append(str(arm["spheres"][0]["color"]))
    kinematics = Kinematics(robot)
    kinematics.compute(HOME, np.zeros(7))
    leaves = kinematics.spheres.child_count == 0
    assert np.allclose(centres(arm), kinematics.centers[leaves], atol=1e-9)
    sizes = [ball["size"]["x"] for ball in arm["spheres"]]
    assert np.allclose(sizes, 2.0 * kinematics.spheres.radius[leaves])
    assert len(set(colors)) == 3


def test_obstacles_are_drawn_as_they_were_reported(made):
    _, data, settings = made
    scene = Scene(data, settings)
    scene.take_static(StaticObstacle(id="post", position=pack([0, 0, 0, 0, 0, 1]), radius=0.2))
    scene.take_update(update(["a", "b"], [1, 2, 3, "NaN", 0, 0]))
    scene.take_update(update(["c"], [1, 0, 0], source="scanner", frame="tilted"))
    parts = draw(scene)["obstacles"]
    assert [text["text"] for text in parts["texts"]] == ["post", "a", "c"]
    assert np.allclose(centres(parts)[2:], [[1, 2, 3], [0.9, 0.4, 0.3]])
    assert len(parts["lines"][0]["points"]) == 2
    scene.take_update(update(["far"], [1e308, 1e308, "Infinity"], frame="tilted"))
    scene.take_update(update(["d"], [9, 9, 9], snapshot=True))
    scene.take_removal(RemoveMessage(["c"], 0.0, "camera"))
    assert [text["text"] for text in draw(scene)["obstacles"]["texts"]] == ["post", "c", "d"]
    scene.take_removal(RemoveMessage(["c", "post"], np.nan, ""))
    assert [text["text"] for text in draw(scene)["obstacles"]["texts"]] == ["d"]


def test_a_crowd_is_drawn_in_part(made):
    _, data, settings = made
    scene = Scene(data, settings)
    count = 2 * MOST_DRAWN
    scene.take_update(update([f"ball {k}" for k in range(count)], [1.0] * 3 * count))
    texts = draw(scene)["obstacles"]["texts"]
    assert len(texts) == MOST_DRAWN
    assert texts[-1]["text"] == f"ball {count - 1}"
