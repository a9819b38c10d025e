"""What a cell file may say: the tables and keys of `cell.toml`, their units and ranges.

Parsing is strict and every mistake is one `CellError` that names file, key, value and what was
expected. A key that is absent leaves the matter to the default of the class that it configures,
so no default is written down twice. Settings of the monitor are not written down here either:
`complete_tables` adds those that their record declares.
"""

from __future__ import annotations

import functools
import math
import re
import tomllib
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar, dataclass_transform, get_args

import msgspec
from msgspec import UNSET, Meta, UnsetType

from armguard.exceptions import ArmguardError, CellError
from armguard.settings.contact_limits import ContactLimit
from armguard.settings.declarations import NotNegative, Positive, read_declarations
from armguard.settings.separation_rule import SeparationRule
from armguard.settings.settings import REMOVED, Settings
from armguard.streams.authentication import Right
from armguard.streams.inputs import BYTE_LIMIT
from armguard.streams.keys import KEY_LENGTH

MOST_DOMAINS = 232
"""The highest number of a domain of DDS."""

Bound = Annotated[NotNegative, Meta(extra={"may_be_infinite": True})]
Fraction = Annotated[float, Meta(gt=0.0, le=1.0)]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Name = Annotated[str, Meta(min_length=1)]
IgnoreEntry = Annotated[list[Name], Meta(min_length=2, max_length=3)]
"""Pattern of links, pattern of obstacle ids, and perhaps the source that reports these."""


@dataclass_transform(frozen_default=True)
class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Refuses keys that it does not know; all of its kind inherit that they are frozen."""


class IgnoreTable(_Table, kw_only=True):
    """An entry of `ignore` that holds in one zone."""

    link: Name
    """Pattern of links."""
    ids: Name
    """Pattern of obstacle ids."""
    source: Name | None = None
    """Source that reports the ids."""
    zone: Annotated[list[Vector], Meta(min_length=4, max_length=8)]
    """4 to 8 corners in the world, in [m]."""


class BaseTable(_Table):
    """`[robot.base]`: pose of the robot's base in the world."""

    xyz: Vector = (0.0, 0.0, 0.0)
    """Position, in [m]."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Rotation: x, y, z, w."""


class OperatingTable(_Table):
    """`[robot.operating]`: limits that the controller enforces.

    One number is a fraction of the hardware's limits; a list has one limit for each joint.
    """

    velocity: Fraction | list[Positive] | UnsetType = UNSET
    """Greatest velocity, in [rad/s] or [m/s]."""
    acceleration: Fraction | list[Positive] | UnsetType = UNSET
    """Greatest acceleration, in [rad/s²] or [m/s²]."""


class UrTable(_Table, kw_only=True, tag_field="name", tag="ur"):
    """`[robot.driver]`: an arm of Universal Robots ([page](ur.md)).

    Its `name` is "ur".
    """

    host: Name
    """Controller address."""
    model: Name
    """Expected model, such as `"UR5e"`."""
    rate: Positive = 500.0
    """Joint states per second, in [Hz]: at most 500."""
    joints: list[Name] | None = None
    """The six joints, from the base."""
    timeout: Positive = 0.1
    """Silence of the robot that pauses its program, in [s]."""
    speed: Fraction = 1.0
    """Speed slider where nothing is near."""
    stop_within: Positive = 1.0
    """Longest motion after a pause, in [s]."""
    deceleration: Positive = 4.0
    """Its deceleration, in [rad/s²]."""


class FrankaTable(_Table, kw_only=True, tag_field="name", tag="franka"):
    """`[robot.driver]`: an arm of Franka Robotics ([page](franka.md)).

    Its `name` is "franka".
    """

    host: Name
    """Controller address."""
    model: Name = "FR3"
    """Name in messages."""
    joints: list[Name] | None = None
    """The seven joints, from the base."""
    timeout: Positive = 0.1
    """Silence of the robot that pauses its program, in [s]."""
    waypoints: list[list[float]] = []
    """Two or more positions to move between, in [rad]."""
    speed: Fraction = 1.0
    """Fraction of `[robot.operating]` where nothing is near."""
    stop_within: Positive = 1.0
    """Longest motion after a pause, in [s]."""
    deceleration: Positive = 4.0
    """Deceleration to waypoints and pauses, in [rad/s²]."""


class ObstacleTopicTable(_Table, kw_only=True):
    """`[robot.driver.obstacles.<source>]`: a topic of obstacles."""

    topic: Name
    """Its name, such as `"/people"`."""
    type: Name
    """One of [these](ros2.md#what-comes-in)."""
    radius: NotNegative | None = None
    """Radius, in [m]; needed for types without sizes."""
    snapshot: bool = False
    """A message has all that the source sees."""


class FrameErrorsTable(_Table):
    """`[robot.driver.frames.<pattern>]`: [frames](ros2.md#frames); the first match counts."""

    position: NotNegative = 0.0
    """Error of the origin, in [m]."""
    angle: NotNegative = 0.0
    """Error of the rotation, in [rad]."""
    speed: NotNegative = 0.0
    """Greatest speed of the origin, in [m/s]."""
    turn_rate: NotNegative = 0.0
    """Greatest angular velocity, in [rad/s]."""


class Ros2Table(_Table, kw_only=True, tag_field="name", tag="ros2"):
    """`[robot.driver]`: an arm in a ROS 2 graph ([page](dds.md)).

    Its `name` is "ros2".
    """

    domain: Annotated[int, Meta(ge=0, le=MOST_DOMAINS)] | None = None
    """DDS domain."""
    joint_states: Name = "/joint_states"
    """Topic of the joint states."""
    speed_override: Name = "/armguard/speed_override"
    """Topic for the allowed speed."""
    holds_after_restart: bool = True
    """Hold at speed 0 after restarts."""
    acknowledge: Name = "/armguard/acknowledge"
    """Topic that ends this hold."""
    trajectory: Name | None = None
    """Topic for shield commands and braking."""
    timeout: Positive = 0.1
    """Silence of joint states that stops the arm, in [s]."""
    stop_within: Positive = 1.0
    """Longest motion after speed 0, in [s]; then `trajectory` brakes."""
    deceleration: Positive = 4.0
    """Its deceleration, in [rad/s²]."""
    obstacles: dict[Name, ObstacleTopicTable] = {}
    """Topics with obstacles, by source."""
    frames: dict[Name, FrameErrorsTable] = {}
    """Errors of frames from transforms, by pattern; the first match counts."""


class _AnyArmTable(_Table):
    """Keys that `[robot]` and `[[robots]]` share."""

    urdf: Name | None = None
    """Path of another robot's URDF."""
    limits: Name | None = None
    """Path of its robot.toml; needed with `urdf`."""
    package_dirs: list[Name] = []
    """Folders for `package://` names."""
    joints: list[Name] | None = None
    """Watched joints, by name or pattern, such as `["left_*"]`."""
    cover: Name | None = None
    """Path of a cover.json from `armguard cover`."""
    level: Annotated[int, Meta(ge=0)] | None = None
    """Finest cover level."""
    base: BaseTable = BaseTable()
    """Pose of the robot's base."""
    payload: NotNegative | UnsetType = UNSET
    """Greatest mass, tool included, in [kg]."""
    operating: OperatingTable | Literal["published"] | UnsetType = UNSET
    """Limits that the controller enforces; `"published"`: those of a known robot."""
    driver: UrTable | FrankaTable | Ros2Table | None = None
    """How `armguard drive` connects to the robot."""


class RobotTable(_AnyArmTable):
    """`[robot]`: a known robot, or a URDF with a file of limits."""

    name: Name | None = None
    """Robot of `armguard robots`, or folder of one."""


class StampTable(_Table):
    """`[joint_state]`: stamps of joint states."""

    clock: Literal["monotonic", "unix"] = "monotonic"
    """Monotonic clock, or seconds since 1970."""
    latency: NotNegative = 0.0
    """Age of a state at its stamp, in [s]."""
    clock_error: NotNegative = 0.0
    """Stamp error, either way, in [s]."""


class FrameTable(_Table):
    """`[frames.<name>]`: pose of a sensor."""

    parent: Name = "world"
    """`world`, `base`, or a frame of the file."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Origin in the parent, in [m]."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Rotation: x, y, z, w."""
    calibration_error: NotNegative = 0.0
    """Error of points due to the frame, in [m]."""


class SourceTable(_Table):
    """`[sources.<name>]`: a sender of obstacles."""

    rate: Positive | None = None
    """Planned messages per second, in [Hz]."""
    timeout: Positive | None = None
    """Silence that stops the arm, in [s]."""
    clock: Literal["monotonic", "unix", "arrival"] = "monotonic"
    """`"arrival"`: the source has no comparable clock."""
    latency: NotNegative = 0.0
    """Measurement to stamp, in [s]; with `arrival`, longest time to arrival, above 0."""
    clock_error: NotNegative = 0.0
    """Stamp error, either way, in [s]."""
    required: bool = True
    """The arm waits for its first message."""
    on_refusal: Literal["bound", "stop"] = "bound"
    """A refused sample can be true and counts, or stops the arm."""
    max_message_size: Annotated[int, Meta(gt=0, le=BYTE_LIMIT)] | UnsetType = UNSET
    """Greatest message, in [bytes]."""
    max_message_rate: Positive | UnsetType = UNSET
    """Most messages per second, in [1/s]."""
    max_obstacles: Annotated[int, Meta(gt=0)] | UnsetType = UNSET
    """Most obstacles at once."""
    max_points: Annotated[int, Meta(gt=0)] | UnsetType = UNSET
    """Most points of a cloud."""


class CloudsTable(_Table):
    """`[clouds]`: accept clouds and remove the arm from them; left out: refuse them."""

    shell: NotNegative | UnsetType = UNSET
    """Points this near to the cover count as the arm, in [m]; nothing is seen there."""
    time_error: NotNegative = 0.005
    """Greatest time between cloud and joint state, in [s]."""
    trail: NotNegative | UnsetType = UNSET
    """How far behind the arm its edge can be measured, in [m]; nothing is seen there."""


class StaticTable(_Table, kw_only=True):
    """`[statics.<id>]`: an obstacle that never moves."""

    frame: Name = "world"
    """Frame of the points."""
    position: Vector | None = None
    """One point, in [m]."""
    points: Annotated[list[Vector], Meta(min_length=1, max_length=8)] | None = None
    """1 to 8 hull points, in [m]."""
    radius: NotNegative
    """Radius around them, in [m]."""


class EntranceTable(StaticTable, kw_only=True):
    """`[entrances.<id>]`: a place where unreported bodies can appear."""

    detection_time: NotNegative
    """Longest time from appearance to report, in [s]."""
    speed: Positive | None = None
    """Greatest speed, in [m/s]."""


class TetherTable(_Table, kw_only=True):
    """`[[tethers]]`: two [tethered](obstacles.md#tethers) obstacles of one source."""

    a: Name
    """One id."""
    b: Name
    """The other id."""
    length: NotNegative
    """Greatest distance of a centre point of either from the other's hull, in [m]."""
    source: Name
    """Origin of the length."""


class RoundTable(_Table):
    """A capsule or cylinder along z: of a capsule, `length` is that between its balls' centres."""

    radius: Positive
    """Of the round part, in [m]."""
    length: Positive
    """Along z, in [m]; of a capsule, between the centres of its balls."""


class ToolTable(_Table):
    """`[tool]`: a body fixed to a link, with one geometry."""

    name: Name
    """Name in verdicts."""
    link: Name
    """Its link."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Position in the frame of the link's joint, in [m]."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Rotation: x, y, z, w."""
    sphere: Positive | None = None
    """Radius, in [m]."""
    box: tuple[Positive, Positive, Positive] | None = None
    """Edge lengths, in [m]."""
    capsule: RoundTable | None = None
    """`{ radius = …, length = … }` along z, in [m]; length between centres."""
    cylinder: RoundTable | None = None
    """`{ radius = …, length = … }` along z, in [m]."""
    mesh: Name | None = None
    """Path of an STL, OBJ or DAE file."""
    mesh_scale: Positive = 1.0
    """Length factor; 0.001 for millimetres."""


class ArmTable(_AnyArmTable, kw_only=True):
    """`[[robots]]`: one of several arms, with its own monitor and `tool`."""

    name: Name
    """Unique name; `arm` in joint states."""
    robot: Name | None = None
    """As `name` of `[robot]`."""
    calibration_error: NotNegative = 0.0
    """Error of its points for other arms, in [m]."""
    tool: ToolTable | None = None
    """Body fixed to one of its links."""
    ignore: list[IgnoreEntry] = []
    """Unwatched pairs, besides the cell's."""

    def as_robot(self) -> RobotTable:
        """The same as `[robot]` of a cell in which there is no other arm."""
        shared = {key: getattr(self, key) for key in _AnyArmTable.__struct_fields__}
        return RobotTable(name=self.robot, **shared)


class PatternTable(_Table):
    """Bounds of the ids of one pattern."""

    accel: Bound
    """Greatest acceleration, in [m/s²], or inf."""
    speed: Bound
    """Greatest speed, in [m/s], or inf."""


class BoundsTable(_Table):
    """`[bounds]`: motion bounds of obstacles that state none."""

    accel: Bound | UnsetType = UNSET
    """Greatest acceleration, in [m/s²]: at most 1000, or inf."""
    speed: Bound | UnsetType = UNSET
    """Greatest speed, in [m/s]: at most 100, or inf."""
    extent: Positive | UnsetType = UNSET
    """Greatest world coordinate, either way, in [m]."""
    body_limits: tuple[Positive, Positive] | UnsetType = UNSET
    """Speed in [m/s] and acceleration in [m/s²] that no body part exceeds."""
    of: dict[Name, str | PatternTable] = {}
    """By id pattern, the first match: a body part such as `"hand"`, or a table."""


class ContactTable(_Table, ContactLimit, kw_only=True):
    """`[contact_limits.<region>]`: [permitted contact](contact_limits.md).

    It is stated by `speed`; by `energy` and `body_mass`; or by `force`, `stiffness` and
    `body_mass`.
    """

    ids: list[Name] = []
    """Id patterns of the region, besides messages."""


class MonitorTable(_Table):
    """`[monitor]`: evaluation of pairs."""


class ThresholdsTable(_Table):
    """`[thresholds]`: times that decide levels and faults."""


class ShieldTable(_Table, kw_only=True):
    """`[shield]`: motion by `armguard shield`, with `motion = "planned"`.

    `robot.operating` limits the speed.
    """

    jerk: Positive | list[Positive]
    """Greatest jerk of all joints or each, in [rad/s³] or [m/s³]."""
    look_ahead: Positive | UnsetType = UNSET
    """Time for which the requested speed must stay possible, in [s]."""
    chunk_period: Positive | UnsetType = UNSET
    """Time between chunk points, in [s]."""
    tracking_error: Positive | list[Positive] | UnsetType = UNSET
    """Greatest distance from a command, in [rad] or [m]."""
    velocity_tracking_error: Positive | list[Positive] | UnsetType = UNSET
    """Greatest velocity error, in [rad/s] or [m/s]."""


class ClientTable(_Table):
    """`[keys.clients.<name>]`: a client that can connect."""

    public: Annotated[str, Meta(min_length=KEY_LENGTH, max_length=KEY_LENGTH)]
    """Public key, 40 characters."""
    may: Annotated[list[Right], Meta(min_length=1)]
    """`obstacles` as the source of its name, `joints`, `verdicts`, `reset`, `view`."""
    arms: list[Name] = []
    """Arms of `[[robots]]` for which it sends `joints`."""


class KeysTable(_Table):
    """`[keys]`: the monitor's secret and its only [clients](keys.md)."""

    secret: Name
    """Path of the secret file from `armguard keys new`."""
    clients: dict[Name, ClientTable] = {}
    """Clients, by name."""


class CellTables(_Table, kw_only=True):
    """A whole cell file.

    With `robots`, `robot` and `tool` are those of the arm that is watched, and its own `ignore` is
    behind that of the cell.
    """

    settings: Literal["auto", "stated"] = "stated"
    """`"auto"`: a [trial](settings.md) chooses what `[monitor]` and `robot.level` leave out."""
    settings_from: Name | None = None
    """Path of the recording for the trial."""
    robot: RobotTable = RobotTable()
    """The arm. Either this or `robots`."""
    robots: list[ArmTable] = []
    """Several arms; each has a monitor and is an obstacle for the others."""
    joint_state: StampTable = StampTable()
    """Stamps of the joint states."""
    frames: dict[Name, FrameTable] = {}
    """Poses of sensors."""
    sources: dict[Name, SourceTable] | UnsetType = UNSET
    """Senders of obstacles. An empty table: nothing is sent. Without it the arm waits for a first
    message."""
    clouds: CloudsTable | None = None
    """Clouds of depth cameras; without it they are refused."""
    statics: dict[Name, StaticTable] = {}
    """Obstacles that never move."""
    entrances: dict[Name, EntranceTable] = {}
    """Places where bodies can appear."""
    tethers: list[TetherTable] = []
    """Obstacles that stay close."""
    tool: ToolTable | None = None
    """Body fixed to a link."""
    ignore: list[IgnoreEntry | IgnoreTable] = []
    """Unwatched pairs: patterns of link and id, perhaps source."""
    bounds: BoundsTable = BoundsTable()
    """Motion bounds of obstacles."""
    contact_limits: dict[Name, ContactTable] = {}
    """Permitted contact, by body region. Without it nothing may be touched while the arm moves."""
    monitor: MonitorTable = MonitorTable()
    """How often and how pairs are evaluated."""
    thresholds: ThresholdsTable = ThresholdsTable()
    """Times that decide levels and faults."""
    shield: ShieldTable | None = None
    """How a shield moves the arm; `armguard run` ignores it."""
    separation: SeparationRule | None = None
    """Separation distance for comparison."""
    keys: KeysTable | None = None
    """Who can connect."""


PATHS: dict[type[_Table], tuple[str, ...]] = {
    _AnyArmTable: ("urdf", "limits", "package_dirs", "cover"),
    RobotTable: ("name",),
    ArmTable: ("robot",),
    ToolTable: ("mesh",),
    KeysTable: ("secret",),
    CellTables: ("settings_from",),
}
"""Keys whose values are paths, or can be. What they lead to counts, and not where it lies."""

FIRST_THAT_FITS: dict[type[_Table], str] = {BoundsTable: "of", Ros2Table: "frames"}
"""Tables by pattern of which the first that fits counts, and so their order."""

WITHOUT_ORDER = ("ignore", "tethers", "robots")
"""Lists whose order means nothing."""


def describe_table(value: Any) -> Any:
    """What tables say, as plain data, without paths."""
    if isinstance(value, msgspec.Struct):
        paths = {key for kind, keys in PATHS.items() if isinstance(value, kind) for key in keys}
        ordered = [key for kind, key in FIRST_THAT_FITS.items() if isinstance(value, kind)]
        said = {}
        for key, one in msgspec.structs.asdict(value).items():
            if key in paths or one is UNSET:
                continue
            said[key] = describe_table(list(one.items()) if key in ordered else one)
            if key in WITHOUT_ORDER:
                said[key] = sorted(said[key], key=msgspec.json.encode)
        return said
    if isinstance(value, dict):
        return {key: describe_table(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [describe_table(one) for one in value]
    return value


SETTINGS_TABLES: dict[str, type[_Table]] = {
    "monitor": MonitorTable,
    "thresholds": ThresholdsTable,
    "bounds": BoundsTable,
}
"""Tables that have the settings which are declared to stand in them, beside what they have here."""


@functools.cache
def complete_tables(record: type[msgspec.Struct] = Settings) -> type[CellTables]:
    """The tables of a whole cell file, with the keys that a record of settings declares."""
    completed: list[tuple[str, type, Any]] = []
    for key, table in SETTINGS_TABLES.items():
        keys = [
            (one.name, one.plain_type | UnsetType, UNSET)
            for one in read_declarations(record).values()
            if one.table == key and one.plain_type is not None
        ]
        kind = msgspec.defstruct(table.__name__, keys, bases=(table,), frozen=True, kw_only=True)
        kind.__doc__ = table.__doc__
        completed.append((key, kind, kind()))
    tables: Any = msgspec.defstruct(
        "CellTables", completed, bases=(CellTables,), frozen=True, kw_only=True
    )
    return tables


_REMOVED = {
    "monitor": REMOVED,
    "entrances": {"accel": "leave it out: the bound on speed alone decides when contact may come"},
}
"""By table, keys of earlier versions, and what replaces them."""

_NAMED: dict[str, type[msgspec.Struct]] = {
    "frames": FrameTable,
    "sources": SourceTable,
    "statics": StaticTable,
    "entrances": EntranceTable,
    "keys.clients": ClientTable,
    "bounds.of": PatternTable,
    "contact_limits": ContactTable,
    "robot.driver.obstacles": ObstacleTopicTable,
    "robot.driver.frames": FrameErrorsTable,
}
"""Tables of entries with free names, each of which has one form; patterns have a word besides."""

_T = TypeVar("_T")


def make_error(file: str, key: str, problem: str, expected: str = "") -> CellError:
    """The CellError about one key, given by its dotted path."""
    return CellError(f"{file}: {key}" if key else file, problem, expected=expected)


def parse_cell(text: str, file: str, arm: str | None = None) -> CellTables:
    """Read the text of a cell file.

    Args:
        text: TOML.
        file: What to call it in errors.
        arm: Which of several arms is watched; None: the file has one.

    Raises:
        CellError: If it is no TOML, has a key or value that it must not have, or has no such arm.
    """
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise make_error(file, "", f"is no TOML ({error})") from None
    _check_finite(raw, "", file)
    # Tables with free names one by one: msgspec does not say which entry was wrong.
    for table, kind in _NAMED.items():
        entries: Any = raw
        for step in table.split("."):
            entries = entries.get(step) if isinstance(entries, dict) else None
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            path = f"{table}.{name}"
            if not name:
                raise make_error(file, table, "has an empty name", "a name for each entry")
            if kind is not PatternTable or isinstance(entry, dict):
                _convert(entry, kind, path, file)
            elif not isinstance(entry, str):
                expected = 'a part of a body, such as "hand", or { accel = …, speed = … }'
                raise make_error(file, path, f"is {entry!r}", expected)
    tables = _convert(raw, complete_tables(), "", file)
    if "robots" in raw:
        return _choose_arm(tables, raw, arm, file)
    if "robot" not in raw:
        raise make_error(file, "robot", "is missing")
    if arm is not None:
        raise make_error(file, "robots", f"is missing, so there is no arm {arm!r}", "[[robots]]")
    return tables


def _choose_arm(
    tables: CellTables, raw: Mapping[str, object], arm: str | None, file: str
) -> CellTables:
    """A cell of several arms as the monitor of one of them reads it."""
    names = [one.name for one in tables.robots]
    for number, name in enumerate(names):
        key = f"robots[{number}].name"
        if name in names[:number]:
            raise make_error(file, key, f"is {name!r} again", "a name of its own for each arm")
        if tables.sources is not UNSET and name in tables.sources:
            raise make_error(file, key, f"is {name!r}, as a source", "a name that is free")
    for key in ("robot", "tool"):
        if key in raw:
            raise make_error(file, key, "is given beside [[robots]]", "it in the arm's [[robots]]")
    if tables.sources is UNSET:
        # Else the other arms would do for sources of which nothing is known.
        raise make_error(
            file, "sources", "is missing beside [[robots]]", "[sources], empty if there are none"
        )
    if arm not in names:
        known = ", ".join(names) if names else "at least one [[robots]]"
        problem = "has several arms, and none is chosen" if arm is None else f"has no arm {arm!r}"
        raise make_error(file, "robots", problem, f"--arm with one of {known}")
    chosen = tables.robots[names.index(arm)]
    ignore = [*tables.ignore, *chosen.ignore]
    return msgspec.structs.replace(tables, robot=chosen.as_robot(), tool=chosen.tool, ignore=ignore)


def given(table: msgspec.Struct) -> dict[str, Any]:
    """The keys of a table that are in the file, with their values."""
    pairs = msgspec.structs.asdict(table).items()
    return {name: value for name, value in pairs if value is not UNSET}


def _check_finite(value: object, path: str, file: str) -> None:
    if isinstance(value, dict):
        for key, entry in value.items():
            _check_finite(entry, f"{path}.{key}" if path else key, file)
    elif isinstance(value, list):
        for number, entry in enumerate(value):
            _check_finite(entry, f"{path}[{number}]", file)
    elif isinstance(value, float) and not math.isfinite(value):
        may_be = path.startswith(("bounds.accel", "bounds.speed", "bounds.of."))
        if not (may_be and value == math.inf):
            raise make_error(file, path, f"is {value}", "a finite number")


def _convert(raw: object, kind: type[_T], path: str, file: str) -> _T:
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        raise _translate(error, raw, kind, path, file) from None
    except ArmguardError as error:
        # Of a table that checks itself.
        key = f"{path}.{error.offender}"
        raise make_error(file, key, error.problem, error.expected) from None


def _translate(
    error: msgspec.ValidationError, raw: object, kind: type, path: str, file: str
) -> CellError:
    """One of our errors from one of msgspec's, which looks like "Expected … - at `$.a[0].b`"."""
    text, _, place = str(error).partition(" - at ")
    # Of entries with free names within [[robots]] msgspec does not say which one was wrong.
    place = place.strip("`").partition("[...]")[0]
    steps = re.findall(r"\.(\w+)|\[(\d+)\]", place)
    value = raw
    for name, index in steps:
        # msgspec names a place that it has been to, whatever its type.
        value = value[name] if name else value[int(index)]  # type: ignore[index]  # of unknown type
    key = f"{path}{place.removeprefix('$')}".strip(".")
    field = re.search(r"(?:unknown|missing required) field `(.*)`", text)
    if field is None:
        expected = text.removeprefix("Expected ").partition(", got ")[0]
        is_plain = re.search(r"Invalid enum|`(float|int)`| \| ", text) is not None
        if is_plain and steps and not isinstance(value, Mapping):
            declared = read_declarations(_table_at(kind, steps[:-1], raw)).get(steps[-1][0])
            if declared is not None:
                expected = declared.describe(in_file=True).removesuffix(", or None")
        # msgspec has JSON's words.
        expected = re.sub(r"\bobject\b", "a table", expected.replace("`", ""))
        expected = re.sub(r"\barray\b", "a list", expected)
        return make_error(file, key, f"is {value!r}", expected)
    key = f"{key}.{field[1]}".strip(".")
    if "missing" in text:
        return make_error(file, key, "is missing")
    known = getattr(_table_at(kind, steps, raw), "__struct_fields__", ())
    found = value.get(field[1]) if isinstance(value, Mapping) else value
    removed = _REMOVED.get(key.partition(".")[0], {}).get(field[1])
    if removed is not None:
        return make_error(file, key, "is no key any more", f"no such key: {removed}")
    return make_error(
        file, key, f"is no key (its value is {found!r})", f"one of {', '.join(known)}"
    )


def _table_at(kind: type, steps: list[tuple[str, str]], raw: Any) -> Any:
    """The class of the table that steps lead to from one that is read as `raw`."""
    for name, index in steps:
        raw = raw[name] if name else raw[int(index)]
        is_table = name and issubclass(kind, msgspec.Struct)
        for field in msgspec.structs.fields(kind) if is_table else ():
            if field.name == name:
                # A table that may be left out is one of several types.
                for one in (field.type, *get_args(field.type)):
                    if isinstance(one, type) and issubclass(one, msgspec.Struct):
                        tag = one.__struct_config__.tag
                        if tag is None or (isinstance(raw, Mapping) and raw.get("name") == tag):
                            kind = one
    return kind
