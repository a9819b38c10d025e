import ast
import copy
import inspect
import itertools
import re
import textwrap

import msgspec
import pytest

from armguard.app.cell import Cell
from armguard.app.cell.schema import (
    PATHS,
    ArmTable,
    CellTables,
    RobotTable,
    _Table,
    complete_tables,
    describe_table,
    parse_cell,
)
from armguard.exceptions import CellError
from armguard.monitor.configuration import digest_data
from armguard.settings.contact_limits import ContactLimit

ROBOT = '[robot]\nname = "panda"\n'
DOOR = "[entrances.door]\nposition = [2, 0, 1]\n"
MISTAKES = [
    ("", "robot", "is missing"),
    ("[robot]", "robot", "neither name nor urdf"),
    ("settings = 'best'\n" + ROBOT, "settings", "is 'best'; expected one of 'auto', 'stated'"),
    ("settings = 3\n" + ROBOT, "settings", "is 3"),
    ("settings_from = 'a.mcap'\n" + ROBOT, "settings_from", 'is given; expected settings = "auto"'),
    (
        "settings = 'auto'\n" + ROBOT + "[monitor]\nschedule = 'full'",
        "monitor.schedule",
        'is \'full\' beside settings = "auto"; expected "deadline"',
    ),
    ('[robot]\nname = "panda"\nurdf = "a"', "robot", "both name and urdf"),
    ('[robot]\nurdf = "arm.urdf"', "robot.limits", "is missing"),
    (ROBOT + "joints = []", "robot.joints", r"is \[\]"),
    ("[[robots]]\nname = 'left'", "sources", "is missing beside"),
    (ROBOT + "colour = 'red'", "robot.colour", "'red'.*one of urdf, limits, .*name"),
    ("[robot]\nname = 7", "robot.name", "is 7; expected text"),
    (ROBOT + "[robot.base]\nxyz = [1, 2]", "robot.base.xyz", r"is \[1, 2\]; expected .*length 3"),
    (ROBOT + "[robot.base]\nxyz = [1, 2, 'up']", "robot.base.xyz[2]", "is 'up'; expected float"),
    (ROBOT + "[robot.base]\nxyz = [1, 2, nan]", "robot.base.xyz[2]", "is nan; expected .*finite"),
    (
        ROBOT + "[robot.base]\nquaternion = [0, 0, 0, 1.01]",
        "robot.base.quaternion",
        "of length 1.01; expected x, y, z, w",
    ),
    (ROBOT + "[separation]\nspeed = 1", "separation.speed", "no key.*one of human_speed, intr"),
    (ROBOT + "[separation]\nrobot_uncertainty = nan", "separation.robot_uncertainty", "finite"),
    (ROBOT + "[tool]\nname = 'a'\nlink = 'b'\nball = 1", "tool.ball", "one of name, link, xyz"),
    (ROBOT + "[frames.world]", "frames.world", "frame of its own"),
    (ROBOT + "[frames.a]\nparent = 'b'", "frames.a.parent", "is 'b'; expected one of world, base"),
    (
        ROBOT + "[frames.a]\nparent = 'b'\n[frames.b]\nparent = 'a'",
        "frames.b.parent",
        r"circle \(a in b in a\)",
    ),
    (ROBOT + "[frames.a]\nparent = 'a'", "frames.a.parent", r"circle \(a in a\)"),
    (
        ROBOT + "[frames.a]\ncalibration_error = -1",
        "frames.a.calibration_error",
        "is -1.*from 0 on",
    ),
    (
        ROBOT + "[sources.cam0]\ntimeout = 0",
        "sources.cam0.timeout",
        "is 0; .*number above 0",
    ),
    (
        ROBOT + "[sources.cam0]\nrequired = 1",
        "sources.cam0.required",
        "is 1; .*true or false",
    ),
    (
        ROBOT + "[sources.cam0]\nclock = 'sundial'",
        "sources.cam0.clock",
        "is 'sundial'; expected one of 'monotonic', 'unix', 'arrival'",
    ),
    (ROBOT + "[sources.cam0]\nclock = 'arrival'", "sources.cam0.latency", "is 0.0"),
    (
        ROBOT + "[sources.cam0]\nclock = 'arrival'\nlatency = 0.1",
        "bounds.speed",
        "missing with sources.cam0.clock",
    ),
    (ROBOT + "[sources.cam0]\nclock_error = -0.1", "sources.cam0.clock_error", "is -0.1"),
    (
        ROBOT + "[sources.cam0]\nclock_error = 0.1\n[bounds]\nspeed = 2.0",
        "bounds.accel",
        "missing with sources.cam0.clock_error = 0.1",
    ),
    (
        ROBOT + "[sources.cam0]\nrate = 5\ntimeout = 0.1",
        "sources.cam0.timeout",
        "is 0.1; expected longer than one period of its rate, 0.2 s",
    ),
    (ROBOT + "[statics.t]\nradius = 1", "statics.t", "not exactly one of position and points"),
    (ROBOT + "[statics.t]\nposition = [0, 0, 0]", "statics.t.radius", "is missing"),
    (
        ROBOT + "[statics.t]\nradius = 1\nposition = [0, 0, 0]\nframe = 'moon'",
        "statics.t.frame",
        "is 'moon'; expected one of world, base",
    ),
    (ROBOT + DOOR + "radius = 1", "entrances.door.detection_time", "is missing"),
    (ROBOT + DOOR + "detection_time = 1", "entrances.door.radius", "is missing"),
    (ROBOT + DOOR + "radius = 1\ndetection_time = -1", "entrances.door.detection_time", "is -1"),
    (
        ROBOT + f"[entrances.door]\nradius = 1\ndetection_time = 1\npoints = {[[0, 0, 0]] * 9}",
        "entrances.door.points",
        "length <= 8",
    ),
    (ROBOT + "[bounds]\nof = 3", "bounds.of", "is 3; expected a table"),
    (ROBOT + "[bounds.of]\n'*' = 3", "bounds.of.*", "is 3; expected a part of a body"),
    (ROBOT + "[bounds.of]\n'' = 'hand'", "bounds.of", "has an empty name"),
    (ROBOT + "[bounds.of]\n'*' = ''", "bounds.of.*", "is ''; expected one of head, trunk"),
    (ROBOT + "[sources.'']", "sources", "has an empty name"),
    (ROBOT + "[bounds.of]\n'*' = 'paw'", "bounds.of.*", "is 'paw'; expected one of head, trunk"),
    (ROBOT + "[bounds.of]\n'b*' = {accel = 1}", "bounds.of.b*.speed", "is missing"),
    (ROBOT + "[bounds.of]\nb = {accel = -1, speed = 1}", "bounds.of.b.accel", "is -1"),
    (ROBOT + "[bounds.of]\nb = {accel = nan, speed = 1}", "bounds.of.b.accel", "is nan"),
    (ROBOT + "[monitor]\nrate = 0", "monitor.rate", "is 0"),
    (ROBOT + "[monitor]\nmax_staleness = 1", "monitor.max_staleness", "is 1"),
    (ROBOT + "[monitor]\nbudget = 0", "monitor.budget", "is 0"),
    (ROBOT + "[robot.operating]\nvelocity = 1.5", "robot.operating.velocity", "is 1.5"),
    (ROBOT + "[robot.operating]\nacceleration = [1, 0]", "robot.operating.acceleration[1]", "is 0"),
    (ROBOT + "operating = 'mine'", "robot.operating", "is 'mine'"),
    (
        ROBOT + "[thresholds]\nrise_delay = true",
        "thresholds.rise_delay",
        "is True; .*from 0 on",
    ),
    (ROBOT + "[thresholds]\nrise_delay = 1\n[treshold]\na = 1", "treshold", "is no key"),
    ("monitor = [1]\n" + ROBOT, "monitor", r"is \[1\]; expected a table"),
    ("ignore = [['a']]\n" + ROBOT, "ignore[0]", "expected a list of length >= 2"),
    ("ignore = [['a', 'b', 'c', 'd']]\n" + ROBOT, "ignore[0]", "length <= 3"),
]


@pytest.mark.parametrize(("text", "key", "pattern"), MISTAKES)
def test_mistakes_name_file_key_value_and_expectation(text, key, pattern, tmp_path):
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(CellError, match=pattern) as caught:
        Cell.load(tmp_path / "mine.toml")
    assert caught.value.offender == f"{tmp_path}/mine.toml: {key}"
    assert "\n" not in str(caught.value)
    assert "$" not in str(caught.value)
    assert "`" not in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"[robot", b"a = 1\na = 2", b"\xff\xfe", b"x = " + b"[" * 9999]
)
def test_what_is_no_toml_is_refused(content, tmp_path):
    (tmp_path / "mine.toml").write_bytes(content)
    with pytest.raises(CellError, match=r"mine\.toml"):
        Cell.load(tmp_path / "mine.toml")


def test_each_key_that_may_hold_a_path_is_known_as_one():
    """So that where files lie does not count in the digest of a configuration."""
    tables = [CellTables, *_Table.__subclasses__(), RobotTable, ArmTable]
    found = {
        (kind, name)
        for kind in tables
        for name, text in read_texts(kind).items()
        if re.match(r"Paths? |Folders |Robot .* folder ", text)
    }
    told = {(kind, name) for kind, names in PATHS.items() for name in names}
    assert found <= told
    # `robot` of `[[robots]]` is told of as `name` of `[robot]`, which may be a folder.
    assert told - found == {(ArmTable, "robot")}


def read_texts(kind):
    """What the class itself says below each of its keys."""
    body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0].body
    return {
        field.target.id: text.value.value
        for field, text in itertools.pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr)
    }


def list_tables():
    """Every kind of table that a cell file may have."""
    kinds, waiting = {}, [msgspec.inspect.type_info(complete_tables())]
    while waiting:
        one = waiting.pop()
        if isinstance(one, msgspec.inspect.StructType) and one.cls not in kinds:
            kinds[one.cls] = None
        elif isinstance(one, msgspec.inspect.StructType):
            continue
        for name in ("fields", "types", "item_types"):
            waiting += [getattr(each, "type", each) for each in getattr(one, name, ())]
        for name in ("type", "item_type", "key_type", "value_type"):
            waiting += [getattr(one, name)] if hasattr(one, name) else []
    return list(kinds)


LIMITED = {"speed": 0.1, "source": "assumed"}
"""What a table of contact limits cannot do without."""

KEYS = [(kind, key) for kind in list_tables() for key in kind.__struct_fields__]


def make_other(value):
    """Another value than this one, whatever it is."""
    match value:
        case bool():
            return not value
        case int() | float():
            return value + 1
        case str():
            return value + "x"
        case list() | tuple():
            return [*value, "x"]
        case dict():
            return {**value, "x": 1}
    return "x"


@pytest.mark.parametrize(("kind", "key"), KEYS, ids=lambda one: getattr(one, "__name__", one))
def test_every_key_of_every_table_counts_in_the_digest_unless_it_is_a_path(kind, key):
    """A key that is added to any table is among these by itself."""
    needed = {one.name: "needed" for one in msgspec.structs.fields(kind) if one.required} | (
        LIMITED if issubclass(kind, ContactLimit) else {}
    )
    table = kind(**needed)
    changed = copy.copy(table)
    msgspec.structs.force_setattr(changed, key, make_other(getattr(table, key)))
    paths = {name for one, names in PATHS.items() if issubclass(kind, one) for name in names}
    digests = {digest_data(describe_table(one)) for one in (table, changed)}
    assert len(digests) == (1 if key in paths else 2)


def test_tables_are_found_in_tables_lists_and_dictionaries():
    """The test above is about these; so many there are at least."""
    names = {kind.__name__ for kind, _ in KEYS}
    assert {"CellTables", "RobotTable", "SourceTable", "RoundTable", "Ros2Table"} <= names
    assert {"FrameErrorsTable", "ContactTable", "SeparationRule", "ClientTable"} <= names
    assert len(KEYS) > 150


@pytest.mark.parametrize(
    ("text", "one", "other", "counts"),
    [
        ("[bounds.of]\n{}\n{}", '"a*" = "hand"', '"*b" = "head"', True),
        ("{}\n{}", "[statics.a]\nradius = 1.0", "[statics.b]\nradius = 2.0", False),
        ("ignore = [{}, {}]", '["*", "a"]', '["*", "b"]', False),
        (
            "[[tethers]]\n{}\n[[tethers]]\n{}",
            'a = "1"\nb = "2"\nlength = 1\nsource = "x"',
            'a = "2"\nb = "3"\nlength = 1\nsource = "x"',
            False,
        ),
        (
            '[robot.driver]\nname = "ros2"\n[robot.driver.frames]\n{}\n{}',
            '"a*" = {{ angle = 1.0 }}',
            '"*b" = {{ angle = 2.0 }}',
            True,
        ),
    ],
)
def test_an_order_counts_where_the_first_that_fits_does(text, one, other, counts):
    found = set()
    for pair in ((one, other), (other, one)):
        said = text.format(*pair).replace("{{", "{").replace("}}", "}")
        # Keys of no table stand in front of all tables.
        said = f"{said}\n{ROBOT}" if said.startswith("ignore") else f"{ROBOT}{said}"
        found.add(digest_data(describe_table(parse_cell(said, "cell", None))))
    assert len(found) == 1 + counts


def test_tables_are_described_without_paths_and_with_all_else():
    text = """
[robot]
urdf = "a/arm.urdf"
limits = "a/robot.toml"
package_dirs = ["a"]
cover = "a/cover.json"
payload = 2
[frames.cover]
xyz = [1, 0, 0]
[sources.mesh]
[tool]
name = "gripper"
link = "hand"
mesh = "a/gripper.stl"
mesh_scale = 0.001
"""
    told = describe_table(parse_cell(text, "cell", None))
    assert told == describe_table(parse_cell(text.replace('"a', '"/elsewhere/b'), "cell", None))
    assert told["robot"]["payload"] == 2.0
    assert told["tool"]["mesh_scale"] == 0.001
    assert set(told["frames"]) == {"cover"}
    assert set(told["sources"]) == {"mesh"}
    assert "/" not in str(told)
