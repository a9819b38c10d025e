import inspect
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from msgspec import UNSET

from armguard import ContactLimit
from armguard.app.cell import Cell
from armguard.exceptions import ArmguardError, CellError
from armguard.monitor.configuration import digest_configuration
from armguard.people import BOUNDS
from armguard.recording import Recorder
from armguard.robot import Robot
from armguard.settings import Settings
from armguard.settings.separation_rule import HUMAN_SPEED
from armguard.streams import SourceLimits
from armguard.streams.keys import write_new_pair
from support.cell_texts import FRAMES, ROBOT

EXAMPLE = Path(__file__).parents[3] / "demos" / "cell.toml"
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


@pytest.fixture(scope="module")
def example():
    cell = Cell.load(EXAMPLE)
    return cell, *cell.build()


def test_the_example_gives_robot_obstacles_and_monitor(example):
    cell, robot, obstacles, monitor = example
    assert robot.name == "panda"
    assert obstacles.ids[:3] == ["table", "pillar", "door"]
    (door,) = obstacles.entrance_rows
    assert obstacles.table.radius[door] == pytest.approx(0.1 + 2.0 * 0.1)
    assert obstacles.silent_sources(0.0, 0.2) == ["camera"]
    assert monitor.period == 0.001
    verdict = monitor.step(0.0, READY, np.zeros(7))
    assert [str(reason) for reason in verdict.reasons][:1] == [
        "source silent: camera (nothing received, expected a message every 0.2 s or sooner)"
    ]
    # The table is ignored, the pillar is out of reach, and somebody may come in by the door.
    assert verdict.obstacle == "door"
    assert cell.frames["camera"].calibration_error == 0.01


def test_the_example_says_what_the_library_would_do_anyway():
    """The values that the example explains are the defaults, so that neither misleads."""
    defaults = Settings()
    tables = Cell.load(EXAMPLE).tables
    for table in (tables.monitor, tables.thresholds):
        for key in table.__struct_fields__:
            if key not in ("joint_timeout", "budget"):
                assert getattr(table, key) == getattr(defaults, key), key
    # This one alone is longer, for a desktop, and the file says what that costs.
    assert tables.thresholds.joint_timeout == 0.25 > max(0.1, 5.0 / tables.monitor.rate)
    # Without it the example would stop far more than it needs to, and says so.
    assert tables.robot.operating == "published"
    # What no number says, a file says by leaving it out.
    assert (tables.monitor.budget, defaults.budget) == (UNSET, None)


def test_every_setting_of_the_monitor_has_a_key():
    tables = Cell.load(EXAMPLE).tables
    keys = {*tables.monitor.__struct_fields__, *tables.thresholds.__struct_fields__}
    keys |= {*tables.bounds.__struct_fields__} - {"accel", "speed", "extent", "body_limits", "of"}
    # Certificates are for observers within the same program; `ignore`, `[separation]` and
    # `[robot.operating]` have places of their own.
    others = {"ignore", "base_placement", "certify", "separation", "operating", "payload"}
    others.add("contact_limits")
    assert keys == set(Settings.__struct_fields__) - others


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[monitor]\nmotion = "planned"\nstop = "path"', "monitor.stop: .*commits pieces"),
        ("[monitor]\npath_deceleration = 2.0", "monitor.path_deceleration: .*commits pieces"),
        ("[entrances.door]\naccel = 1.0", "entrances.door.accel: .*bound on speed alone"),
    ],
)
def test_keys_of_earlier_versions_say_what_replaces_them(text, words):
    with pytest.raises(CellError, match=words) as caught:
        Cell.from_text(f"{ROBOT}\n{text}\n")
    assert "is no key any more" in str(caught.value)


AUTO = (
    'settings = "auto"\n'
    + ROBOT
    + 'operating = "published"\n[sources.eye]\n[monitor]\nrate = 50.0\n'
)


def test_a_cell_may_have_its_settings_chosen():
    _, obstacles, monitor = Cell.from_text(AUTO).build()
    choice = monitor.choice
    assert choice.is_same
    assert choice.ticks == 150
    told = {name: getattr(monitor.settings, name) for name in choice.settings}
    assert told == choice.settings
    assert set(told) == {"max_staleness", "motion", "budget"}
    assert monitor.period == 0.02
    assert len(obstacles) == 0
    assert Cell.from_text(AUTO).build()[2].choice == choice


def test_what_a_cell_states_stands_beside_what_is_chosen():
    text = AUTO.replace("rate = 50.0", "rate = 50.0\nmotion = 'isotropic'\nmax_staleness = 0.4")
    text = text.replace("operating =", "level = 1\noperating =")
    robot, _, monitor = Cell.from_text(text).build()
    assert (monitor.settings.motion, monitor.settings.max_staleness) == ("isotropic", 0.4)
    assert set(monitor.choice.settings) == {"budget"}
    assert monitor.choice.level is None
    assert max(robot.cover.levels(link) for link in robot.links) == 2


def test_settings_are_chosen_by_a_recording(tmp_path):
    _, obstacles, monitor = Cell.from_text(ROBOT + "[monitor]\nrate = 50.0\n").build()
    with Recorder(tmp_path / "day.mcap", monitor) as recorder:
        for tick in range(20):
            obstacles.update(["far"], 0.02 * tick, [[9.0, 0.0, 0.5]], radius=0.1, source="eye")
            monitor.step(0.02 * tick, READY, np.zeros(7))
        assert recorder.close() == ""
    text = AUTO.replace("[robot]", 'settings_from = "day.mcap"\n[robot]')
    choice = Cell.from_text(text, tmp_path).build()[2].choice
    assert (choice.ticks, choice.same_level) == (20, 1.0)
    assert choice.out_of_reach == Robot.load("panda").links
    (tmp_path / "day.mcap").write_bytes(b"nothing of the kind")
    with pytest.raises(CellError, match=r"settings_from: .*day\.mcap: is no MCAP file"):
        Cell.from_text(text, tmp_path).build()
    with pytest.raises(CellError, match=r"settings_from: .*no\.mcap: cannot be read"):
        Cell.from_text(text.replace("day", "no"), tmp_path).build()


def test_the_example_explains_every_key():
    text = EXAMPLE.read_text()
    tables = Cell.load(EXAMPLE).tables
    for name in tables.__struct_fields__:
        table = getattr(tables, name)
        parts = table.values() if isinstance(table, dict) else [table]
        for part in parts:
            for key in getattr(part, "__struct_fields__", ()):
                assert f"{key} = " in text or f"[{name}.{key}]" in text or key == "position", key


def test_obstacles_in_a_frame_arrive_in_the_world_with_its_error():
    obstacles = Cell.from_text(FRAMES).make_obstacles()
    obstacles.update(["a"], 0.0, [[1.0, 2.0, 3.0]], radius=0.1, frame="lens", position_error=0.1)
    row = obstacles.row("a")
    accepted = obstacles.table.accepted
    np.testing.assert_allclose(accepted.points[row, 0], [3.0, 3.0, -3.5], atol=1e-12)
    assert accepted.position_error[row] == pytest.approx(0.112)


def test_tethers_are_stated_of_the_table():
    text = "[[tethers]]\na = 'hand'\nb = 'elbow'\nlength = 0.3\nsource = 'measured'\n"
    obstacles = Cell.from_text("robot = { name = 'panda' }\n" + text).make_obstacles()
    assert obstacles.tethers == (("hand", "elbow", 0.3, "measured"),)
    for wrong, problem in (
        (text.replace("elbow", "hand"), r"cell: tethers\[0\]: b: is 'hand', as a is"),
        (text.replace("0.3", "-0.3"), r"tethers\[0\]\.length"),
        (text.replace("0.3", "300"), r"tethers\[0\]: length: is 300"),
        (text.replace("measured", ""), r"tethers\[0\]\.source"),
        (text.replace("source", "by"), r"tethers\[0\]\.by"),
    ):
        with pytest.raises(CellError, match=problem):
            Cell.from_text("robot = { name = 'panda' }\n" + wrong).make_obstacles()


def test_entrances_stand_in_their_frame_and_take_bounds_by_their_name():
    text = f"{FRAMES}[bounds]\nspeed = 1.5\n[bounds.of]\n'gate*' = {{ accel = 4.0, speed = 3.0 }}\n"
    for name, more in (("door", ""), ("gate 1", ""), ("hatch", "speed = 0.5\n")):
        text += f"[entrances.'{name}']\nframe = 'lens'\nposition = [0, 0, 1]\nradius = 0.2\n"
        text += f"detection_time = 0.1\n{more}"
    cell = Cell.from_text(text)
    table = cell.make_obstacles().table
    error = cell.frames["lens"].calibration_error
    assert error > 0.0
    assert table.points[0, 0] == pytest.approx(cell.frames["lens"].apply([0, 0, 1]))
    assert table.speed[:3].tolist() == [1.5, 3.0, 0.5]
    assert table.accel[:3].tolist() == [10.0, 4.0, 10.0]
    assert table.radius[:3] == pytest.approx(0.2 + error + 0.1 * np.array([1.5, 3.0, 0.5]))


def test_the_arm_is_told_from_others_in_clouds_where_clouds_are_taken():
    robot = Robot.load("panda")
    assert Cell.from_text(ROBOT).make_own_points(robot) is None
    cell = Cell.from_text(f"{FRAMES}[clouds]\ntime_error = 0.0\n")
    own = cell.make_own_points(robot)
    q = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
    points = np.array([[1.0, 0.0, 0.2], [0.0, 0.0, 0.2]])  # in the arm's column, and beside it
    assert own.find_others(points, q, "world", (0.0, 0.0, 0.0)).tolist() == [False, True]
    lens = cell.frames["lens"]
    seen = (points - lens.translation) @ lens.rotation
    assert own.find_others(seen, q, "lens", (0.0, 0.0, 0.0)).tolist() == [False, True]
    with pytest.raises(ArmguardError, match="unknown"):
        own.find_others(points, q, "moon", (0.0, 0.0, 0.0))


def test_the_trail_of_clouds_is_seen_from_where_their_rays_begin():
    robot = Robot.load("panda")
    own = Cell.from_text(f"{FRAMES}[clouds]\ntrail = 0.5\n").make_own_points(robot)
    q = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
    behind = np.array([[1.0, 0.3, 0.2]])  # the arm's column, from one side
    assert not own.find_others(behind, q, "world", (1.0, -2.0, 0.2)).any()
    assert own.find_others(behind, q, "world", (1.0, 2.0, 0.2)).all()


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("[bounds]\nspeed = inf\n", r"cell: entrances.door: .* has a speed of inf"),
        ("[statics.door]\nposition = [3, 0, 0]\nradius = 1\n", r"entrances.door: .* already"),
        ("[bounds]\nextent = 1.0\n", r"entrances.door: .*within the extent of 1 m"),
    ],
)
def test_an_entrance_that_cannot_be_is_an_error_of_its_table(text, pattern):
    door = "[entrances.door]\nposition = [2, 0, 1]\nradius = 0.2\ndetection_time = 0.1\n"
    with pytest.raises(CellError, match=pattern):
        Cell.from_text(ROBOT + text + door).make_obstacles()


def test_the_base_moves_the_robot_and_statics_follow_their_frame():
    def contact_time(base, frame, position):
        text = (
            f"{ROBOT}[robot.base]\nxyz = {base}\n"
            f'[statics.post]\nframe = "{frame}"\nposition = {position}\nradius = 0.1\n'
        )
        _, _, monitor = Cell.from_text(text).build()
        return monitor.step(0.0, READY, np.zeros(7)).contact_time

    here = contact_time([0.0, 0.0, 0.0], "world", [1.0, 0.0, 0.5])
    assert 0.0 < here < math.inf
    assert contact_time([1.0, 2.0, 3.0], "world", [2.0, 2.0, 3.5]) == pytest.approx(here)
    assert contact_time([1.0, 2.0, 3.0], "base", [1.0, 0.0, 0.5]) == pytest.approx(here)
    assert contact_time([1.0, 2.0, 3.0], "world", [1.0, 0.0, 0.5]) != pytest.approx(here)


def test_operating_limits_are_fractions_or_one_for_each_joint():
    text = f"{ROBOT}[robot.operating]\nvelocity = 0.3\nacceleration = {[2.0] * 7}\n"
    robot, _, monitor = Cell.from_text(text).build()
    velocity, acceleration = monitor.settings.operating.resolve(robot)
    np.testing.assert_allclose(velocity, 0.3 * robot.velocity_limit)
    assert (acceleration == 2.0).all()
    limits = monitor._scheduler.arm.state.scene.limits
    np.testing.assert_array_equal(limits.operating_acceleration, acceleration)


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("[robot.operating]", "robot.operating: .*neither"),
        ("[robot.operating]\nvelocity = [1.0, 1.0]", "robot.operating: .*has 2 values"),
        (f"[robot.operating]\nacceleration = {[99.0] * 7}", "robot.operating: .*panda_joint1"),
    ],
)
def test_operating_limits_that_do_not_fit_are_refused(text, pattern):
    cell = Cell.from_text(ROBOT + text)
    with pytest.raises(CellError, match=pattern):
        cell.monitor_settings(cell.make_robot())


def test_settings_reach_obstacles_and_monitor():
    text = (
        'ignore = [["panda_link[1-3]", "part*"], ["*", "toy"]]\n'
        + ROBOT
        + "[bounds]\nspeed = 3\naccel = 7.0\nmargin = 0.05\n[monitor]\nrate = 500\nbudget = 77\n"
        + '[sources.cam]\ntimeout = 0.5\nrequired = false\n[sources.lidar]\nclock = "unix"\n'
    )
    _, obstacles, monitor = Cell.from_text(text).build()
    assert (monitor.period, monitor.settings.budget) == (0.002, 77)
    assert obstacles.silent_sources(0.0, 0.2) == ["lidar"]
    obstacles.update(["a"], 0.0, [[9.0, 9.0, 9.0]], radius=0.1)
    row = obstacles.row("a")
    assert obstacles.table.accepted.speed[row] == 3.0
    assert obstacles.table.accepted.accel[row] == 7.0


def test_pairs_are_ignored_within_a_zone_alone():
    corners = [[x, y, z] for x in (0.4, 0.8) for y in (-0.2, 0.2) for z in (0.0, 0.5)]
    text = (
        f'ignore = [["*", "post"], {{ link = "panda_link[67]", ids = "bin", zone = {corners} }}]\n'
        + ROBOT
        + "[statics.post]\nposition = [2.0, 0, 0]\nradius = 0.1\n"
        "[statics.bin]\nposition = [0.6, 0, 0.2]\nradius = 0.1\n"
    )
    _, _, monitor = Cell.from_text(text).build()
    assert monitor.settings.ignore == tuple((link, "post") for link in monitor.robot.links)
    assert [one.pair.link for one in monitor.exemptions] == ["panda_link6", "panda_link7"]
    for one in monitor.exemptions:
        assert one.until == math.inf
        assert np.array_equal(one.zone.points, corners)
    with pytest.raises(CellError, match=r"zone.*no room") as caught:
        Cell.from_text(text.replace("0.5]", "0.0]")).build()
    assert caught.value.offender == "cell: ignore[1]"
    with pytest.raises(CellError, match="length >= 4"):
        Cell.from_text(text.replace(str(corners), str(corners[:3])))


def test_ids_have_the_bounds_of_their_first_pattern():
    text = (
        '[robot]\nname = "panda"\n[bounds]\nspeed = 3.0\n[bounds.of]\n"*_hand" = "hand"\n'
        '"*" = { accel = inf, speed = 12.0 }\n"late" = "head"\n'
    )
    obstacles = Cell.from_text(text).make_obstacles()
    obstacles.update(["left_hand", "late"], 0.0, np.zeros((2, 3)), radius=0.1)
    rows = [obstacles.row(id) for id in ("left_hand", "late")]
    assert obstacles.table.accel[rows].tolist() == [BOUNDS["hand"].accel, math.inf]
    assert obstacles.table.speed[rows].tolist() == [BOUNDS["hand"].speed, 12.0]
    # A bound that the table would refuse is refused by the name of its key.
    text = text.replace("12.0", "1200.0")
    with pytest.raises(CellError, match=r"cell: bounds.*speed: is 1200\.0; expected at most 100"):
        Cell.from_text(text).make_obstacles()


HAND = """
[contact_limits.hand]
ids = ["*_hand"]
speed = 0.9
source = "assumed"
person_speed = 0.5
gap = 0.05
[contact_limits.forearm]
ids = ["*_arm", "left_*"]
force = 160
stiffness = 40000
body_mass = 2
source = "a paper"
"""


def test_contact_limits_and_the_regions_of_ids_are_as_the_file_has_them():
    _, obstacles, monitor = Cell.from_text(ROBOT + HAND).build()
    limits = monitor.settings.contact_limits.by_region
    assert set(limits) == {"hand", "forearm"}
    assert limits["hand"] == ContactLimit(speed=0.9, source="assumed", person_speed=0.5, gap=0.05)
    assert limits["forearm"].max_way == pytest.approx(0.004)
    regions = {"*_hand": "hand", "*_arm": "forearm", "left_*": "forearm"}
    assert obstacles.settings.regions == regions
    _, obstacles, monitor = Cell.from_text(ROBOT).build()
    assert monitor.settings.contact_limits is None
    assert obstacles.settings.regions == {}


def test_the_example_of_the_page_is_one():
    page = (EXAMPLE.parents[1] / "docs" / "contact_limits.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    _, _, monitor = Cell.from_text(ROBOT + example).build()
    limits = monitor.settings.contact_limits.by_region
    assert set(limits) == {"hand", "forearm"}
    assert all(limit.source.startswith("example only") for limit in limits.values())


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            "[contact_limits.hand]\nspeed = 0.9",
            "^cell: contact_limits.hand.source: is ''; expected",
        ),
        (
            '[contact_limits.hand]\nspeed = -1\nsource = "a"',
            "^cell: contact_limits.hand.speed: is -1; expected a finite number from 0 on",
        ),
        (
            '[contact_limits.hand]\nspeed = inf\nsource = "a"',
            "^cell: contact_limits.hand.speed: is inf; expected a finite number",
        ),
        (
            '[contact_limits.hand]\nenergy = 0.5\nsource = "a"',
            "^cell: contact_limits.hand.body_mass: is missing beside energy",
        ),
        (
            '[contact_limits.hand]\nsource = "a"',
            "^cell: contact_limits.hand.speed: is missing, like energy and force; expected exactly",
        ),
        (
            '[contact_limits.hand]\nspeed = 0.5\nforce = 140\nsource = "a"',
            "^cell: contact_limits.hand.force: is given beside speed; expected exactly one of",
        ),
        (
            '[contact_limits.paw]\nspeed = 0.9\nsource = "a"',
            "^cell: contact_limits: names the region 'paw'; expected one of head",
        ),
        (
            '[contact_limits.head]\nspeed = 0.1\nsource = "a"',
            "^cell: contact_limits.head: permits contact at 0.1 m/s; expected 0",
        ),
        (
            '[contact_limits.hand]\nspeed = 0.1\nsource = "a"\nmass = 3',
            "^cell: contact_limits.hand.mass: is no key",
        ),
        (
            HAND + '[contact_limits.chest]\nids = ["*_arm"]\nspeed = 0.1\nsource = "a"',
            "^cell: contact_limits.chest.ids: has .*, as contact_limits.forearm.ids",
        ),
        (
            HAND + '[monitor]\nmotion = "isotropic"',
            "^cell: contact_limits: are given beside motion=.isotropic.; expected",
        ),
    ],
)
def test_contact_limits_that_make_no_sense_are_one_line(table, message):
    with pytest.raises(CellError, match=message) as found:
        Cell.from_text(f"{ROBOT}\n{table}").build()
    assert "\n" not in str(found.value)


def separation_of(table):
    """What the verdict of a cell with such a table says of one scene, in [m]."""
    _, obstacles, monitor = Cell.from_text(ROBOT + table).build()
    obstacles.update(["person"], 0.0, [[2.0, 0.5, 0.5]], radius=0.1)
    return monitor.step(0.0, READY, np.zeros(7)).separation


def test_the_separation_distance_is_as_the_file_has_it():
    assert separation_of("") is None
    usual = separation_of("[separation]\n")
    assert separation_of(f"[separation]\nhuman_speed = {HUMAN_SPEED}\n") == usual
    further = "intrusion_distance = 0.2\nhuman_uncertainty = 0.1\nrobot_uncertainty = 0.05\n"
    assert separation_of("[separation]\n" + further) < usual
    # The bound of obstacles is 2 m/s by default.
    own = separation_of('[separation]\nhuman_speed = "own"\n')
    assert own == separation_of("[separation]\nhuman_speed = 2.0\n") < usual


def test_a_clock_error_of_the_joints_widens_their_errors():
    known = Cell.from_text(ROBOT).make_robot()
    robot, _, monitor = Cell.from_text(ROBOT + "[joint_state]\nclock_error = 0.004").build()
    top_speed = known.velocity_limit + known.velocity_error
    np.testing.assert_allclose(robot.position_error, known.position_error + 0.004 * top_speed)
    np.testing.assert_allclose(
        robot.velocity_error, known.velocity_error + 0.004 * known.acceleration_limit
    )
    np.testing.assert_array_equal(robot.rest_velocity_error, known.velocity_error)
    assert not robot.position_error.flags.writeable
    # States that differ by what joints do in twice that time are no jump.
    moved = np.array(READY) + 1.9 * 0.004 * known.velocity_limit
    assert (
        monitor.step(0.0, READY, np.zeros(7)).level == monitor.step(1e-3, moved, np.zeros(7)).level
    )


def test_a_urdf_and_what_belongs_to_it_are_found_beside_the_file(tmp_path, monkeypatch):
    calls, options = [], inspect.signature(Robot.from_urdf).parameters
    monkeypatch.setattr(Robot, "from_urdf", lambda *path, **options: calls.append((path, options)))
    (tmp_path / "cell.toml").write_text(
        '[robot]\nurdf = "arm.urdf"\nlimits = "limits.toml"\njoints = ["elbow"]\n'
        'package_dirs = ["meshes", "/opt/meshes"]\ncover = "cover.json"\nlevel = 2\n'
    )
    Cell.load(tmp_path / "cell.toml").make_robot()
    Cell.from_text('[robot]\nurdf = "/a.urdf"\nlimits = "b.toml"', tmp_path).make_robot()
    assert calls[0][0] == (tmp_path / "arm.urdf",)
    assert calls[0][1] == {
        "limits": tmp_path / "limits.toml",
        "joints": ["elbow"],
        "package_dirs": [tmp_path / "meshes", Path("/opt/meshes")],
        "cover": tmp_path / "cover.json",
        "level": 2,
    }
    assert calls[1][0] == (Path("/a.urdf"),)
    assert calls[1][1]["joints"] is calls[1][1]["cover"] is calls[1][1]["level"] is None
    assert set(calls[0][1]) == set(options) - {"path"}


def test_a_known_robot_takes_another_cover_of_it_down_to_a_level(tmp_path):
    own = Robot.load("panda").cover
    own.cut(1).save(tmp_path / "coarse.json")
    (tmp_path / "cell.toml").write_text(ROBOT + 'cover = "coarse.json"\n')
    robot = Cell.load(tmp_path / "cell.toml").make_robot()
    assert [len(robot.cover.spheres(link)) for link in own.links] == [
        len(own.spheres(link, 1)) for link in own.links
    ]
    robot = Cell.from_text(ROBOT + "level = 0").make_robot()
    assert all(len(robot.cover.tree(link).spheres) == 1 for link in own.links)


@pytest.mark.parametrize(
    ("text", "key", "pattern"),
    [
        (ROBOT + "level = 9", "robot.level", "is 9; expected 0 to 3"),
        (ROBOT + 'cover = "no.json"', "robot.cover", "no.json: cannot be read"),
        ('[robot]\nname = "nobody"\ncover = "no.json"', "robot.name", "'nobody'"),
        ('[robot]\nname = "nobody"', "robot.name", "'nobody'.*one of .*panda"),
        ('[robot]\nurdf = "no.urdf"\nlimits = "no.toml"', "robot.urdf", "no.toml"),
        (ROBOT + '[monitor]\nschedule = "never"', "monitor.schedule", "'never'"),
        (ROBOT + '[monitor]\nschedule = "full"\nbudget = 5', "monitor.budget", "deadline"),
        (ROBOT + '[monitor]\nmotion = "slow"', "monitor.motion", "'slow'"),
        ("ignore = [['arm*', '*']]\n" + ROBOT, "ignore[0]", "'arm.*panda_link1"),
        ("ignore = [['panda_*', '*']]\n" + ROBOT, "ignore", "panda_.*leaves nothing to watch"),
        ("ignore = [['*', 'a', 'eye']]\n" + ROBOT, "ignore", "'eye'"),
        (
            "ignore = [['*', 'a', 'eye']]\n" + ROBOT + "[sources.cam]\n",
            "ignore",
            "'eye'.*expected one of cam",
        ),
    ],
)
def test_what_shows_only_when_built_names_its_key_too(text, key, pattern):
    with pytest.raises(CellError, match=pattern) as caught:
        Cell.from_text(text).build()
    assert caught.value.offender == f"cell: {key}"


def test_files_that_cannot_be_read_are_named(tmp_path):
    for path in (tmp_path / "absent.toml", tmp_path):
        with pytest.raises(CellError, match="cannot be read"):
            Cell.load(path)


def test_a_file_says_whether_there_are_sources():
    silent = Cell.from_text('[robot]\nname = "panda"\n').make_obstacles()
    assert silent.expects_sources
    none = Cell.from_text('[robot]\nname = "panda"\n[sources]\n').make_obstacles()
    assert not none.expects_sources
    assert not none.has_sources


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("speed = 2000.0", "bounds.speed.*2000.0.*at most 100 m/s.*inf"),
        ("accel = 9810.0", "bounds.accel.*9810.0.*at most 1000 m/s²"),
        ("speed = nan", "bounds.speed: is nan"),
        ("extent = inf", "bounds.extent: is inf"),
    ],
)
def test_bounds_in_other_units_are_refused(line, message):
    with pytest.raises(CellError, match=message):
        Cell.from_text(f'[robot]\nname = "panda"\n[bounds]\n{line}\n').make_obstacles()


def test_a_cell_says_what_the_arm_carries():
    _, _, monitor = Cell.from_text(f"{ROBOT}payload = 0.25\n").build()
    assert monitor.payload == 0.25
    _, _, monitor = Cell.from_text(ROBOT).build()
    assert monitor.payload == 1.0
    for payload, pattern in (
        ("1.5", "kilograms from 0 to 1"),
        ("-1.0", "from 0 on"),
        ("nan", "nan"),
    ):
        with pytest.raises(CellError, match=rf"robot\.payload.*{pattern}"):
            Cell.from_text(f"{ROBOT}payload = {payload}\n").build()


def test_limits_of_a_source_are_those_of_the_file_and_else_the_usual_ones():
    text = ROBOT + "[sources.a]\nmax_obstacles = 7\nmax_message_rate = 3.0\n[sources.b]\n"
    limits = Cell.from_text(text).source_limits
    assert limits == {"a": SourceLimits(obstacles=7, message_rate=3.0), "b": SourceLimits()}
    for line in ("max_obstacles = 0", "max_message_rate = -1.0", "max_message_size = 5000000"):
        with pytest.raises(CellError, match=rf"sources\.a\.{line.split()[0]}"):
            Cell.from_text(ROBOT + f"[sources.a]\n{line}\n")


KEYS = '[keys]\nsecret = "monitor.secret"\n[keys.clients.camera]\npublic = "{}"\nmay = {}\n'


def test_a_source_without_a_key_is_refused_where_there_are_keys(tmp_path):
    key = write_new_pair("monitor", tmp_path)[2]
    good = ROBOT + "[sources.camera]\n" + KEYS.format(key, ["obstacles"])
    with Cell.from_text(good, tmp_path).make_authenticator() as authenticator:
        assert authenticator.may("camera", "obstacles")
        assert not authenticator.may("camera", "reset")
        assert not authenticator.may("lidar", "obstacles")
    for bad in (good + "[sources.lidar]\n", good.replace("obstacles", "view")):
        with pytest.raises(CellError, match=r"sources\.\w+: has no key, and so cannot speak"):
            Cell.from_text(bad, tmp_path)
    assert Cell.from_text(ROBOT).make_authenticator() is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('["obstacles"]', '["everything"]'), r"keys\.clients\.camera\.may"),
        (('["obstacles"]', "[]"), r"keys\.clients\.camera\.may"),
        (('public = "', 'public = "x'), r"keys\.clients\.camera\.public"),
        (('secret = "monitor.secret"', ""), r"keys\.secret: is missing"),
        (("public", "key"), r"keys\.clients\.camera\.key: is no key"),
        (("monitor.secret", "none.secret"), r"keys\.secret: .*none\.secret: cannot be read"),
        (("monitor.secret", "monitor.public"), r"has no secret key"),
        (("[keys.clients.camera]", "[keys.clients]\n[keys.clients.camera]"), None),
    ],
)
def test_mistakes_about_keys_name_file_and_key(tmp_path, change, words):
    key = write_new_pair("monitor", tmp_path)[2]
    text = ROBOT + KEYS.format(key, '["obstacles"]').replace(*change)
    if words is None:
        Cell.from_text(text, tmp_path).make_authenticator().close()
        return
    with pytest.raises(CellError, match=words):
        Cell.from_text(text, tmp_path).make_authenticator()


def digest(text, folder=".", arm=None):
    """The digest of the configuration that a cell file makes."""
    cell = Cell.from_text(text, folder, arm)
    return digest_configuration(cell.build()[2], cell.describe())


WHOLE = """
[robot]
name = "panda"
payload = 1
operating = { velocity = 0.5, acceleration = 0.5 }
[sources.camera]
latency = 0.01
rate = 30
[sources.scanner]
[bounds]
speed = 2
accel = 10
[statics.post]
position = [1, 0, 0]
radius = 0.1
[statics.wall]
position = [-2, 0, 0]
radius = 0.1
[thresholds]
latency = 0.003
"""


def test_the_order_of_tables_and_the_form_of_numbers_change_no_digest():
    first = digest(WHOLE)
    head, *tables = re.split(r"(?m)^(?=\[)", WHOLE)
    assert digest("".join([head, *reversed(tables)])) == first
    for one, other in (
        ("payload = 1\n", "payload = 1.0\n"),
        ("latency = 0.003", "latency = 3e-3 # as measured"),
        ("rate = 30\n", "rate = 3.0e1\n"),
        ("[1, 0, 0]", "[\n  1.0, 0, -0,\n]"),
        ("velocity = 0.5, acceleration = 0.5", "acceleration = 0.5, velocity = 0.5"),
    ):
        assert one in WHOLE
        assert digest(WHOLE.replace(one, other)) == first


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("payload = 1", "payload = 0.5"),
        ("velocity = 0.5", "velocity = 0.51"),
        ("latency = 0.01", "latency = 0.011"),
        ("rate = 30", "rate = 25"),
        ("[sources.scanner]", "[sources.radar]"),
        ("[sources.scanner]", '[sources.scanner]\nclock = "unix"'),
        ("[sources.scanner]", "[sources.scanner]\nmax_obstacles = 9"),
        ("speed = 2", "speed = 2.000000000000001"),
        ("[statics.post]", "[statics.pole]"),
        ("radius = 0.1", "radius = 0.11"),
        ("latency = 0.003", "latency = 0.002"),
        ("[thresholds]", "[joint_state]\nclock_error = 0.001\n[thresholds]"),
        ("[thresholds]", "[clouds]\n[thresholds]"),
        ("[thresholds]", "[frames.eye]\nxyz = [1, 1, 1]\n[thresholds]"),
        ('name = "panda"', 'name = "panda"\nlevel = 1'),
        ("payload = 1", "payload = 1\nbase = { xyz = [0, 0, 0.1] }"),
    ],
)
def test_whatever_a_cell_file_says_changes_the_digest(one, other):
    assert one in WHOLE
    assert digest(WHOLE.replace(one, other, 1)) != digest(WHOLE)


def test_where_the_files_of_a_robot_lie_and_what_its_folder_is_called_do_not_count(tmp_path):
    robot = Path(__file__).parents[3] / "robots" / "panda"
    text, found = WHOLE.replace('"panda"', '"arm"'), {digest(WHOLE)}
    for name in ("one", "two"):
        shutil.copytree(robot, tmp_path / name / "arm")
        found.add(digest(text, tmp_path / name))
    (tmp_path / "one" / "arm").rename(tmp_path / "one" / "renamed")
    found.add(digest(WHOLE.replace('"panda"', '"renamed"'), tmp_path / "one"))
    assert len(found) == 1
    file = tmp_path / "two" / "arm" / "robot.toml"
    written = file.read_text()
    file.write_text(written.replace("acceleration = 7.5", "acceleration = 7.6"))
    assert file.read_text() != written
    assert digest(text, tmp_path / "two") not in found


def test_another_arm_of_the_cell_counts_as_it_is():
    text = """
[sources]
[[robots]]
name = "left"
robot = "panda"
[[robots]]
name = "right"
robot = "panda"
base = { xyz = [1, 0, 0] }
"""
    one, other = text.split("[[robots]]")[1:]
    digests = [digest(text, arm=arm) for arm in ("left", "right")]
    assert digest(f"[sources]\n[[robots]]{other}[[robots]]{one}", arm="left") == digests[0]
    digests.append(digest(text.replace("[1, 0, 0]", "[1.1, 0, 0]"), arm="left"))
    other = text.replace("base =", 'operating = "published"\nbase =')
    digests.append(digest(other, arm="left"))
    other = text.replace('robot = "panda"\nbase', 'robot = "ur5"\nbase')
    digests.append(digest(other, arm="left"))
    assert len(set(digests)) == 5
