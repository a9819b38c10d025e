from pathlib import Path

import pytest

from armguard.app.cli import Drive, main
from armguard.app.drive import make_options
from armguard.drivers.ur import JOINTS
from armguard.exceptions import ArmguardError
from armguard.streams.addresses import JOINTS_ADDRESS

CELL = """
sources = {{}}
[robot]
name = "ur5e"
{driver}
"""
DRIVER = '[robot.driver]\nname = "ur"\nhost = "127.0.0.1"\nmodel = "UR5e"\n'
FR3 = '[robot.driver]\nname = "franka"\nhost = "127.0.0.1"\nwaypoints = []\n'


def refuse(tmp_path, capsys, *words, driver=DRIVER):
    """The one line that says why it is refused."""
    cell = tmp_path / "cell.toml"
    cell.write_text(CELL.format(driver=driver))
    assert main(["drive", str(cell), *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    return line


@pytest.mark.parametrize(
    ("driver", "said"),
    [
        ("", "robot.driver: is missing"),
        (DRIVER.replace('"ur"', '"kuka"'), "robot.driver.name"),
        (DRIVER + "rate = 1000.0", "robot.driver.rate"),
        (DRIVER + "speed = 0.0", "robot.driver.speed"),
        (DRIVER + "speed = 1.5", "robot.driver.speed"),
        (DRIVER + "deceleration = -1.0", "robot.driver.deceleration"),
        (DRIVER + "colour = 1", "colour"),
        (DRIVER + 'joints = ["a", "b"]', "robot.driver.joints: has a, b, and the monitor watches"),
        (DRIVER + f"joints = {list(reversed(JOINTS))}", "has wrist_3_joint, wrist_2_joint"),
        (DRIVER.replace("UR5e", "UR5"), "model: is 'UR5', and the monitor watches a 'ur5e'"),
        (DRIVER.replace("UR5e", "UR10e"), "model: is 'UR10e', and the monitor watches a 'ur5e'"),
        (FR3 + f"joints = {list(JOINTS)}", "model: is 'FR3', and the monitor watches a 'ur5e'"),
    ],
)
def test_what_a_cell_file_says_wrong_is_one_line(tmp_path, capsys, driver, said):
    assert said in refuse(tmp_path, capsys, driver=driver)


FRANKA = """
sources = {{}}
[robot]
name = "panda"
operating = {{ velocity = 0.5, acceleration = 0.2 }}
[robot.driver]
name = "franka"
host = "127.0.0.1"
model = "FR3"
{more}
"""
THERE, ELSEWHERE = [0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0], [0.5, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", "robot.driver.waypoints: has 0"),
        (f"waypoints = {[THERE, THERE]}", "robot.driver.waypoints: has 1"),
        (f"waypoints = {[THERE, ELSEWHERE[:6]]}", "robot.driver.waypoints[1]"),
        (f"waypoints = {[THERE, [*ELSEWHERE[:6], 3.0]]}", "robot.driver.waypoints[1]"),
        (f"waypoints = {[[*THERE[:6], 'nan'], ELSEWHERE]}", "waypoints"),
        (f"waypoints = {[THERE, ELSEWHERE]}\nrate = 500.0", "rate"),
        (
            f"waypoints = {[THERE, ELSEWHERE]}\n[monitor]\nmotion = 'planned'\n"
            "[shield]\njerk = 500.0",
            "robot.driver.waypoints: is there beside [shield]",
        ),
    ],
)
def test_waypoints_are_where_the_driver_moves_the_robot_and_nowhere_else(
    tmp_path, capsys, more, said
):
    cell = tmp_path / "cell.toml"
    cell.write_text(FRANKA.format(more=more))
    assert main(["drive", str(cell)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_driver_gets_the_limits_and_forces_that_the_monitor_counts_with(tmp_path):
    cell = tmp_path / "cell.toml"
    limits = "\n".join(
        f"[contact_limits.{region}]\nsource = 'test'\n{how}"
        for region, how in (
            ("hand", "force = 140\nstiffness = 75000\nbody_mass = 0.6"),
            ("forearm", "force = 120\nstiffness = 40000\nbody_mass = 1.0"),
            ("chest", "speed = 0.1"),
            ("head", "speed = 0.0"),
        )
    )
    cell.write_text(FRANKA.format(more=f"waypoints = {[THERE, ELSEWHERE]}\n{limits}"))
    options = make_options(Drive(cell))
    assert options.names == tuple(f"panda_joint{k}" for k in range(1, 8))
    assert options.franka.velocities == pytest.approx([1.0875] * 4 + [1.305] * 3)
    assert options.franka.accelerations == pytest.approx([3.0, 1.5, 2.0, 2.5, 3.0, 4.0, 4.0])
    assert options.franka.waypoints == (tuple(THERE), tuple(ELSEWHERE))
    assert options.franka.contact_force == 120.0
    assert options.validity == pytest.approx(0.003)
    assert options.is_first
    assert not make_options(Drive(cell, again=True)).is_first
    assert options.joints == (JOINTS_ADDRESS,)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--duration", "0"], "--duration"),
        (["--measure", "--stops", "0"], "--stops"),
        (["--joints", "ipc:///joints", "--joints", "tcp://0.0.0.0:5702"], "tcp://0.0.0.0:5702"),
        (["--verdicts", "nonsense"], "nonsense"),
        (["--key", "x.secret"], "--server-key"),
    ],
)
def test_what_the_command_line_says_wrong_is_one_line(tmp_path, capsys, words, said):
    assert said in refuse(tmp_path, capsys, *words)


def test_a_missing_library_is_one_line_with_the_remedy(tmp_path, capsys, monkeypatch):
    def check(driver):
        raise ArmguardError("driver", "needs ur_rtde", remedy="pip install 'armguard[ur]'")

    monkeypatch.setattr("armguard.app.drive.check_library", check)
    assert "pip install 'armguard[ur]'" in refuse(tmp_path, capsys)


ROS2 = '[robot.driver]\nname = "ros2"\n'
CAMERA = "[robot.driver.obstacles.camera]\ntopic = '/people'\ntype = "
PEOPLE = "'people_msgs/msg/People'\n"


@pytest.mark.parametrize(
    ("driver", "said"),
    [
        (ROS2 + "domain = 233", "robot.driver.domain"),
        (ROS2 + 'host = "here"', "robot.driver.host: is no key"),
        (ROS2 + "deceleration = 0.0", "robot.driver.deceleration"),
        (ROS2 + CAMERA + PEOPLE + "radius = 0.4", "is no source; expected [sources.camera]"),
        (ROS2 + "[shield]\njerk = 500.0", "robot.driver.trajectory: is missing beside [shield]"),
        (ROS2 + "[robot.driver.frames.eye]\nspeed = -1.0", "robot.driver.frames.eye.speed"),
    ],
)
def test_what_a_cell_file_says_wrong_of_a_graph_is_one_line(tmp_path, capsys, driver, said):
    assert said in refuse(tmp_path, capsys, driver=driver)


SHIELD = "[monitor]\nmotion = 'planned'\n[shield]\njerk = 500.0\n"


@pytest.mark.parametrize(
    ("driver", "words", "said"),
    [
        (DRIVER + SHIELD, ["--measure"], "--measure: is given beside [shield]"),
        (ROS2 + SHIELD, ["--measure"], "--measure: is given beside [shield]"),
        (DRIVER + "speed = 0.5\n" + SHIELD, [], "robot.driver.speed: is 0.5 beside [shield]"),
        (FR3 + "speed = 0.5\n" + SHIELD, [], "robot.driver.speed: is 0.5 beside [shield]"),
    ],
)
def test_what_a_shield_makes_void_is_refused(tmp_path, capsys, driver, words, said):
    assert said in refuse(tmp_path, capsys, *words, driver=driver)


@pytest.mark.parametrize("key", ["speed = -1.0", "haste = 1.0"])
def test_a_mistake_in_one_of_several_robots_is_one_line(tmp_path, capsys, key):
    cell = tmp_path / "cell.toml"
    driver = f'driver = {{ name = "ros2", frames = {{ eye = {{ {key} }} }} }}'
    cell.write_text(f'sources = {{}}\n[[robots]]\nname = "left"\nrobot = "ur5e"\n{driver}\n')
    assert main(["drive", str(cell), "--arm", "left"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "robots[0].driver.frames" in line


@pytest.mark.parametrize(
    ("kind", "said"), [(PEOPLE, "poses without sizes"), ("'std_msgs/msg/String'\n", "is of type")]
)
def test_a_topic_of_obstacles_that_cannot_be_read_is_one_line(tmp_path, capsys, kind, said):
    cell = tmp_path / "cell.toml"
    cell.write_text(f'[robot]\nname = "ur5e"\n{ROS2}{CAMERA}{kind}[sources.camera]\n')
    assert main(["drive", str(cell)]) == 2
    line = capsys.readouterr().err
    assert said in line
    assert "robot.driver.obstacles.camera" in line


def test_the_domain_is_that_of_the_file_or_of_the_environment(tmp_path, monkeypatch):
    cell = tmp_path / "cell.toml"
    cell.write_text(CELL.format(driver=ROS2))
    for text, domain in (("", 0), ("7", 7), ("232", 232)):
        monkeypatch.setenv("ROS_DOMAIN_ID", text)
        assert make_options(Drive(cell)).ros2.domain == domain
    for text in ("-1", "x", "233"):
        monkeypatch.setenv("ROS_DOMAIN_ID", text)
        with pytest.raises(ArmguardError, match="ROS_DOMAIN_ID"):
            make_options(Drive(cell))
    cell.write_text(CELL.format(driver=ROS2 + "domain = 3"))
    assert make_options(Drive(cell)).ros2.domain == 3


def test_a_restart_holds_an_arm_of_a_graph_unless_the_file_says_otherwise(tmp_path):
    cell = tmp_path / "cell.toml"
    for more, topic in (
        ("", "/armguard/acknowledge"),
        ('acknowledge = "/go"', "/go"),
        ("holds_after_restart = false", ""),
    ):
        cell.write_text(CELL.format(driver=ROS2 + more))
        assert make_options(Drive(cell)).ros2.acknowledge == topic


def test_the_cells_of_the_demos_say_all_that_a_driver_needs():
    demos = Path(__file__).parents[2] / "demos"
    options = make_options(Drive(demos / "ros2.toml"))
    assert (options.ros2.domain, list(options.ros2.obstacles)) == (7, ["camera"])
    assert options.names == tuple(f"panda_joint{number}" for number in range(1, 8))
    assert make_options(Drive(demos / "ros2_shield.toml")).follows
    assert make_options(Drive(demos / "ur5e.toml")).ros2 is None
