"""Every demo runs headless, and what the demos claim is so."""

import importlib.metadata
import importlib.util
import inspect
import re
import subprocess
import sys
import types
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from armguard.bridges import ros2
from armguard.bridges.messages import OBSTACLES
from armguard.exceptions import ArmguardError
from support.bags_made import START, STORE, header, joint_state, pose_array, transforms
from support.driven_cell import find_host
from support.quartic import smallest_root

DEMOS = sorted((Path(__file__).parents[2] / "demos").glob("[0-9][0-9]_*.py"))

# Arguments of `main` that make a demo short, and those that name sockets, kept from real ones.
QUICK = {"seeds": 20, "duration": 0.3, "steps": 20}
SOCKETS = {"address", "joints", "verdicts", "obstacles"}

# Demos that need what not every machine has.
NEEDS = {
    "05_mujoco": "mujoco",
    "06_ros2_bridge": "rclpy",
    "10_depth_camera": "mujoco",
    "13_learning": "gymnasium",
}


def require_renderer():
    from armguard.bridges.mujoco import find_renderer

    if find_renderer() is None:
        pytest.skip("MuJoCo cannot render here: neither libegl1 nor libosmesa6 is installed")


def load_demo(path):
    specification = importlib.util.spec_from_file_location(f"demo_{path.stem}", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", DEMOS, ids=lambda path: path.stem)
def test_every_demo_has_a_title_and_a_main_that_runs(path, capsys, tmp_path):
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    if path.stem == "10_depth_camera":
        require_renderer()
    demo = load_demo(path)
    assert capsys.readouterr().out == "", "importing a demo must not run it"
    assert inspect.getdoc(demo).splitlines()[0].endswith(".")
    parameters = inspect.signature(demo.main).parameters
    assert all(one.default is not one.empty for one in parameters.values())
    arguments = {name: value for name, value in QUICK.items() if name in parameters}
    if "host" in parameters:
        arguments["host"] = find_host()
    arguments |= {name: f"ipc://{tmp_path}/{name}" for name in SOCKETS & set(parameters)}
    demo.main(**arguments)


def test_in_mujoco_a_supervised_arm_touches_nothing_while_it_moves_and_another_does():
    """MuJoCo measures the distances, knowing nothing of armguard's."""
    pytest.importorskip("mujoco")
    demo = load_demo(next(path for path in DEMOS if path.stem == "05_mujoco"))
    supervised, free = (demo.main(6.0, is_obeying=one) for one in (True, False))
    assert supervised.least_moving_distance > 0.0
    assert supervised.path > 0.1
    assert {"SLOW", "STOP"} <= set(supervised.levels)
    assert free.least_moving_distance < 0.0, "else there is nothing to be stopped for"


def test_with_a_shield_a_learner_touches_nobody_and_without_one_it_does():
    """MuJoCo finds the contacts, knowing nothing of armguard's covers."""
    pytest.importorskip("gymnasium")
    demo = load_demo(next(path for path in DEMOS if path.stem == "13_learning"))
    found = demo.main(1000)
    assert found["with a shield"].contacts == 0
    assert found["with a shield"].placed > 0
    assert found["without a shield"].contacts > 0, "else there is nothing to be kept from"


def test_two_supervised_arms_keep_apart_and_others_do_not():
    """Coal measures the distances between the hulls of their links."""
    demo = load_demo(next(path for path in DEMOS if path.stem == "09_two_arms"))
    supervised, free = (demo.main(5.0, is_obeying=one) for one in (True, False))
    assert supervised.least_moving_distance > 0.0
    assert "SLOW" in supervised.levels["left"]
    assert free.least_moving_distance < 0.0, "else there is nothing to be stopped for"


def test_beside_a_depth_camera_nobody_is_touched_by_an_arm_that_moves(capfd):
    """MuJoCo measures the true person, who comes and reaches in."""
    pytest.importorskip("mujoco")
    require_renderer()
    demo = load_demo(next(path for path in DEMOS if path.stem == "10_depth_camera"))
    seen = demo.main(9.0)
    assert seen.contacts == 0
    assert seen.least_moving_distance > 0.0
    half, most = seen.latency
    assert 1.0 / demo.RATE < half <= most < np.inf
    assert {"CLEAR", "STOP"} <= set(seen.levels)
    assert "points of 36,864" in capfd.readouterr().out


def test_a_tracked_person_who_comes_within_reach_is_a_stop_and_one_who_leaves_is_none(capsys):
    demo = load_demo(next(path for path in DEMOS if path.stem == "11_skeleton"))
    assert demo.main() == 360
    lines = capsys.readouterr().out.splitlines()
    levels = [line.split(": ")[1].split(",")[0] for line in lines[:-1]]
    assert levels[0] == levels[-1] == "CLEAR"
    assert "STOP" in levels
    assert lines[-1] == "360 frames, 0 bad ones, 13 obstacles"


@pytest.fixture(scope="module")
def paper():
    return load_demo(next(path for path in DEMOS if path.stem == "02_paper"))


def test_sample_two_gives_the_published_times_with_the_published_bounds(paper):
    _, contact_time = paper.compute_pairs(paper.SAMPLE_POSITION, paper.SAMPLE_VELOCITY)
    assert f"{paper.PAIR_ACCEL[0]:.2f} {paper.PAIR_ACCEL[1]:.2f}" == "1.20 2.31"
    assert f"{contact_time[0]:.2f}" == paper.PUBLISHED_CONTACT_TIME[0]
    assert f"{contact_time[1]:.1f}" == paper.PUBLISHED_CONTACT_TIME[1]


def test_contact_times_of_the_world_are_the_smallest_roots_of_the_quartic(paper):
    states = [(paper.SAMPLE_POSITION, paper.SAMPLE_VELOCITY)]
    for seed in range(20):
        states += zip(*paper.draw_motion(seed), strict=True)
    for position, velocity in states:
        distance, contact_time = paper.compute_pairs(position, velocity)
        for pair, (i, j) in enumerate(zip(paper.FIRST, paper.SECOND, strict=True)):
            x, v = position[j] - position[i], velocity[j] - velocity[i]
            assert distance[pair] == pytest.approx(np.linalg.norm(x))
            expected = smallest_root(x, v, 2 * paper.RADIUS, paper.PAIR_ACCEL[pair])
            assert contact_time[pair] == pytest.approx(expected, rel=1e-7)


def test_the_paper_prints_its_figures_beside_ours(paper, capsys):
    paper.main(seeds=5)
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 100
    for row in (
        "1-2 .* 1.20 .* 0.950 .* 0.95",
        "1-3 .* 2.31 .* 3.100 .* 3.1",
        "DAA and full-DAA +20",
    ):
        assert re.search(row, printed)


def test_no_worlds_are_refused(paper):
    with pytest.raises(ArmguardError, match="1 or more"):
        paper.main(seeds=0)


@pytest.fixture(scope="module")
def bridge():
    return load_demo(next(path for path in DEMOS if path.stem == "06_ros2_bridge"))


def test_without_ros_the_bridge_says_so(bridge):
    if importlib.util.find_spec("rclpy"):
        pytest.skip("ROS 2 is here")
    with pytest.raises(ArmguardError, match=r"ROS 2: is not there.*setup\.bash"):
        bridge.main()


def test_the_bridge_without_ros_ends_in_one_line():
    if importlib.util.find_spec("rclpy"):
        pytest.skip("ROS 2 is here")
    path = next(path for path in DEMOS if path.stem == "06_ros2_bridge")
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "ROS 2: is not there" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--obstacles", "/people"], r"'/people' is not \[SOURCE=\]TOPIC:TYPE"),
        (["--moving", "wrist:fast:1"], "'wrist:fast:1' is not FRAME:SPEED:TURN_RATE"),
        (["--moving", "wrist"], "'wrist' is not FRAME"),
        (["--radius", "wide"], "invalid float value: 'wide'"),
    ],
)
def test_bad_arguments_of_the_bridge_are_told(bridge, capsys, arguments, words):
    with pytest.raises(SystemExit) as told:
        bridge.make_parser().parse_args(arguments)
    assert told.value.code == 2
    assert re.search(words, capsys.readouterr().err)


PACKAGE = Path(__file__).parents[2] / "demos" / "ros2_package"


def test_the_package_of_the_bridge_says_what_ros_has_to_know(bridge):
    """What format 3 of package.xml demands, and all packages of the messages."""
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert (root.tag, root.get("format")) == ("package", "3")
    for name in ("name", "version", "description", "maintainer", "license"):
        assert root.findtext(name), name
    assert "@" in root.find("maintainer").get("email")
    assert root.findtext("version") == importlib.metadata.version("armguard")
    named = {one.text for one in root.iter("exec_depend")}
    used = re.findall(r"(\w+)/msg/\w+", inspect.getsource(bridge) + inspect.getsource(ros2))
    assert named >= {*used, "rclpy", "rosidl_runtime_py"}
    assert named >= {kind.partition("/")[0] for kind in OBSTACLES}
    build = (PACKAGE / "CMakeLists.txt").read_text()
    assert f"project({root.findtext('name')} " in build
    for path in re.findall(r"\$\{CMAKE_CURRENT_SOURCE_DIR\}/(\S+)", build):
        assert (PACKAGE / path).is_file(), path


def test_the_launch_file_gives_the_bridge_what_it_takes(bridge):
    root = ElementTree.parse(PACKAGE / "launch" / "armguard.launch.xml").getroot()
    values = {one.get("name"): one.get("default") for one in root.iter("arg")}
    assert [name for name, default in values.items() if default is None] == ["cell"]
    values |= {"cell": "cell.toml", "options": "--obstacles /people:people_msgs/msg/People"}
    (node,) = root.iter("node")
    words = re.sub(r"\$\(var (\w+)\)", lambda found: values[found[1]], node.get("args")).split()
    options = bridge.make_parser().parse_args(words)
    assert (str(options.cell), options.joints) == ("cell.toml", "/joint_states")
    assert options.obstacles == [("/people", "people_msgs/msg/People")]
    assert node.get("pkg") == ElementTree.parse(PACKAGE / "package.xml").findtext("name")
    assert f"RENAME {node.get('exec')})" in (PACKAGE / "CMakeLists.txt").read_text()


class StandInForRos:
    """Takes the places of rclpy and what belongs to it, for a node that ticks a few times."""

    def __init__(self, play):
        self.play, self.sent, self.takers, self.ticks = play, {}, {}, []
        self.now = START

    def install(self, monkeypatch):
        """Put modules of these names where imports find them."""
        rclpy = types.ModuleType("rclpy")
        rclpy.init = lambda args: None
        rclpy.create_node = lambda name: self
        rclpy.spin = lambda node: self.play(self)
        rclpy.utilities = types.SimpleNamespace(
            remove_ros_args=lambda args: args[: args.index("--ros-args")]
        )
        qos = types.ModuleType("rclpy.qos")
        qos.DurabilityPolicy = types.SimpleNamespace(TRANSIENT_LOCAL=1)
        qos.qos_profile_sensor_data = 5
        qos.QoSProfile = lambda depth, durability: depth
        utilities = types.ModuleType("rosidl_runtime_py.utilities")
        utilities.get_message = lambda name: STORE.types[name]
        parent = types.ModuleType("rosidl_runtime_py")
        for module in (rclpy, qos, parent, utilities):
            monkeypatch.setitem(sys.modules, module.__name__, module)

    def create_publisher(self, kind, topic, depth):
        return types.SimpleNamespace(publish=self.sent.setdefault(topic, []).append)

    def create_subscription(self, kind, topic, callback, depth):
        self.takers[topic] = callback

    def create_timer(self, period, callback):
        self.ticks.append(callback)

    def destroy_node(self):
        self.ticks.clear()

    def get_clock(self):
        stamp = header(1e-9 * (self.now - START)).stamp
        now = types.SimpleNamespace(nanoseconds=self.now, to_msg=lambda: stamp)
        return types.SimpleNamespace(now=lambda: now)


def test_a_bridge_with_a_stand_in_for_ros_supervises(bridge, monkeypatch, tmp_path):
    def play(ros):
        (tick,) = ros.ticks
        tick()  # nothing has come yet
        seen = [(0.0, "world", "eye", (0.0, 0.0, 0.0))]
        for k in range(160):
            now = 0.02 * k
            ros.now = START + round(1e9 * now)
            ros.takers["/tf_static"](transforms(*seen))
            ros.takers["/tf"](transforms((now, "eye", "wrist", (1.0, 0.0, 0.0))))
            ros.takers["/people"](pose_array(now, [(2.5 - now, 0.0, 0.5)], "wrist"))
            ros.takers["/joint_states"](joint_state(now))
            tick()

    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nname = "panda"\noperating = "published"\n[monitor]\nrate = 50.0\n')
    ros = StandInForRos(play)
    ros.install(monkeypatch)
    monkeypatch.setattr(bridge, "bytes", lambda numbers: numbers[0], raising=False)  # of rosbags
    options = ["--cell", str(cell), "--obstacles", "camera=/people:geometry_msgs/msg/PoseArray"]
    options += ["--radius", "0.1", "--moving", "wrist:0.1:0.5", "--ros-args", "-p", "x:=1"]
    bridge.main(tuple(options))
    speeds = [one.data for one in ros.sent["/armguard/speed_override"]]
    assert speeds[0] == speeds[-1] == 0.0
    assert max(speeds) == 1.0
    told = ros.sent["/diagnostics"]
    levels = [one.status[0].level for one in told]
    assert levels[0] == levels[-1] == 2
    assert 0 in levels
    assert "contact" in told[-1].status[0].message
    for one in told:
        STORE.serialize_cdr(one, "diagnostic_msgs/msg/DiagnosticArray")
