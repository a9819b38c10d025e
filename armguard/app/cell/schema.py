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
    """An entry of `ignore` that holds within a zone alone: a hull of points, in the world."""

    link: Name
    """A link, or a pattern of links."""
    ids: Name
    """A pattern of obstacle ids."""
    source: Name | None = None
    """The source that reports these; then they may come later."""
    zone: Annotated[list[Vector], Meta(min_length=4, max_length=8)]
    """Corners of the zone, in the world, in [m]."""


class BaseTable(_Table):
    """`[robot.base]`: where the robot stands in the world."""

    xyz: Vector = (0.0, 0.0, 0.0)
    """Position of its base, in [m]."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Its turn: x, y, z, w, of length 1."""


class OperatingTable(_Table):
    """`[robot.operating]`: what the controller keeps to while the arm works.

    One number is a fraction of the hardware's limits; a list has one limit for each joint.
    """

    velocity: Fraction | list[Positive] | UnsetType = UNSET
    """What no joint exceeds: one number is a fraction of each hardware limit, a list has one limit
    for each joint, in [rad/s] or [m/s]."""
    acceleration: Fraction | list[Positive] | UnsetType = UNSET
    """How a joint speeds up at most, in the same way, in [rad/s²] or [m/s²]. It may slow down as
    hard as the hardware can."""


class UrTable(_Table, kw_only=True, tag_field="name", tag="ur"):
    """`[robot.driver]`: an arm of Universal Robots that `armguard drive` joins ([page](ur.md)).

    Its `name` is "ur".
    """

    host: Name
    """Address of its controller."""
    model: Name
    """Which one it must be, such as `"UR5e"`; another one is refused."""
    rate: Positive = 500.0
    """Joint states a second, in [Hz]: at most 500, and 125 for the CB series."""
    joints: list[Name] | None = None
    """Names of its six joints, from the base on; without it, those of the maker's descriptions."""
    timeout: Positive = 0.1
    """Silence of the robot after which its program is paused, in [s]. After three times as much, of
    the robot or of the driver's process, the arm is stopped, which ends its program."""
    speed: Fraction = 1.0
    """The speed slider where nothing is near, from above 0 to 1."""
    stop_within: Positive = 1.0
    """How long the arm may move on after an order to pause, in [s]. Then it is stopped, which
    ends its program."""
    deceleration: Positive = 4.0
    """Of that stop, in [rad/s²]."""


class FrankaTable(_Table, kw_only=True, tag_field="name", tag="franka"):
    """`[robot.driver]`: an arm of Franka Robotics that `armguard drive` joins ([page](franka.md)).

    Its `name` is "franka".
    """

    host: Name
    """Address of its controller."""
    model: Name = "FR3"
    """What messages call it: the robot does not tell which one it is."""
    joints: list[Name] | None = None
    """Names of its seven joints, from the base on; without it, those of the maker's
    descriptions."""
    timeout: Positive = 0.1
    """Silence of the robot after which its program is paused, in [s]. After three times as much, of
    the robot or of the driver's process, another process connects."""
    waypoints: list[list[float]] = []
    """Positions of all joints between which it moves, again and again, in [rad]: two at least, and
    none where a shield moves it."""
    speed: Fraction = 1.0
    """How fast it moves between them where nothing is near, as a fraction of `[robot.operating]`,
    from above 0 to 1."""
    stop_within: Positive = 1.0
    """How long it may move on after an order to pause, in [s]. Then the robot ends its motion,
    which ends the program."""
    deceleration: Positive = 4.0
    """To a waypoint, and to a pause, in [rad/s²]."""


class ObstacleTopicTable(_Table, kw_only=True):
    """`[robot.driver.obstacles.<source>]`: a topic that shows obstacles, by its source."""

    topic: Name
    """Its name, such as `"/people"`."""
    type: Name
    """Type of its messages, one of [these](ros2.md#what-comes-in)."""
    radius: NotNegative | None = None
    """Of what comes without sizes, in [m]; needed for such types."""
    snapshot: bool = False
    """Whether each message shows all that its source sees."""


class FrameErrorsTable(_Table):
    """`[robot.driver.frames.<pattern>]`: what frames that come as transforms may be off by.

    It holds for those whose name fits the pattern ([Frames](ros2.md#frames)).
    """

    position: NotNegative = 0.0
    """Of its origin in its parent, in [m]."""
    angle: NotNegative = 0.0
    """Of its turn, in [rad]."""
    speed: NotNegative = 0.0
    """Of its origin in its parent, at most, in [m/s]."""
    turn_rate: NotNegative = 0.0
    """At most, in [rad/s]."""


class Ros2Table(_Table, kw_only=True, tag_field="name", tag="ros2"):
    """`[robot.driver]`: an arm in a ROS 2 graph that `armguard drive` joins ([page](dds.md)).

    Its `name` is "ros2".
    """

    domain: Annotated[int, Meta(ge=0, le=MOST_DOMAINS)] | None = None
    """Number of its domain; without it, that of the variable `ROS_DOMAIN_ID`, or 0."""
    joint_states: Name = "/joint_states"
    """Topic of the joint states."""
    speed_override: Name = "/armguard/speed_override"
    """Topic for the speed that verdicts allow."""
    trajectory: Name | None = None
    """Topic for trajectories, such as `"/joint_trajectory_controller/joint_trajectory"`: for the
    commands of a shield, and for braking an arm that moves on."""
    timeout: Positive = 0.1
    """Silence of the joint states after which the arm is stopped, in [s]."""
    stop_within: Positive = 1.0
    """How long the arm may move on after a speed of 0, in [s]. Then a trajectory that brakes is
    sent, where there is a topic for it."""
    deceleration: Positive = 4.0
    """Of that trajectory, in [rad/s²]."""
    obstacles: dict[Name, ObstacleTopicTable] = {}
    """Topics that show obstacles."""
    frames: dict[Name, FrameErrorsTable] = {}
    """Errors and bounds of frames that come as transforms, by pattern; the first that fits counts.
    """


class _AnyArmTable(_Table):
    """What `[robot]` and `[[robots]]` say alike."""

    urdf: Name | None = None
    """Path of the URDF of any other robot: its geometry and joints."""
    limits: Name | None = None
    """Path of its robot.toml: its limits, each with its source. Beside `urdf` alone, and needed
    there."""
    package_dirs: list[Name] = []
    """Folders in which `package://` names of meshes are looked up. Beside `urdf` alone."""
    joints: list[Name] | None = None
    """The joints to be watched: of one arm beside `urdf` alone, of several those that are this
    arm's, by name or by pattern, such as `["left_*"]`."""
    cover: Name | None = None
    """Path of a cover.json, as `armguard cover` writes it."""
    level: Annotated[int, Meta(ge=0)] | None = None
    """The finest level of the cover to be used, from 0, which is one ball a link."""
    base: BaseTable = BaseTable()
    """Where the robot stands."""
    payload: NotNegative | UnsetType = UNSET
    """What it carries at most, tool included, in [kg]: how soon it stops."""
    operating: OperatingTable | Literal["published"] | UnsetType = UNSET
    """What its controller keeps to: a table, or `"published"` for the figures that are published of
    a robot that armguard knows."""
    driver: UrTable | FrankaTable | Ros2Table | None = None
    """How `armguard drive` joins it."""


class RobotTable(_AnyArmTable):
    """`[robot]`: one that armguard knows, a folder with one, or any URDF with a file of limits."""

    name: Name | None = None
    """A robot that armguard knows, as `armguard robots` lists them. Either this or `urdf`."""


class StampTable(_Table):
    """`[joint_state]`: how the robot's states are stamped."""

    clock: Literal["monotonic", "unix"] = "monotonic"
    """Which clock stamps: the machine's monotonic one, or seconds since 1970."""
    latency: NotNegative = 0.0
    """How old a state is by the time of its stamp, in [s]."""
    clock_error: NotNegative = 0.0
    """What stamps may be off by, either way, in [s]. It widens the errors of all joints."""


class FrameTable(_Table):
    """`[frames.<name>]`: where a sensor stands, and how well that is known."""

    parent: Name = "world"
    """The frame that it stands in: `world`, `base`, or another of this file."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Its origin in the parent, in [m]."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Its turn in the parent: x, y, z, w, of length 1."""
    calibration_error: NotNegative = 0.0
    """How far a point may be off because of the frame, in [m]. It is added to the errors of what is
    given in it, and along a chain of frames."""


class SourceTable(_Table):
    """`[sources.<name>]`: one that sends obstacles."""

    rate: Positive | None = None
    """Messages a second that it means to send, in [Hz]. A `timeout` shorter than a period of it is
    refused."""
    timeout: Positive | None = None
    """Silence that it may keep before the arm has to stop, in [s]."""
    clock: Literal["monotonic", "unix", "arrival"] = "monotonic"
    """Which clock stamps: the machine's monotonic one, seconds since 1970, or the time of arrival
    for a source without a clock that could be compared."""
    latency: NotNegative = 0.0
    """From the measurement to the stamp, in [s]. With `arrival`: from the measurement to the
    arrival, at the longest, and above 0."""
    clock_error: NotNegative = 0.0
    """What stamps may be off by, either way, in [s]. It widens errors by what bounds allow, so
    `[bounds]` must state them."""
    required: bool = True
    """Whether the arm stands until this source has spoken. Any source that has spoken must go on.
    """
    on_refusal: Literal["bound", "stop"] = "bound"
    """What a refused sample does: it may be true, and counts with its bounds, or it stops the arm.
    """
    max_message_size: Annotated[int, Meta(gt=0, le=BYTE_LIMIT)] | UnsetType = UNSET
    """Size of one message at most, in [bytes]."""
    max_message_rate: Positive | UnsetType = UNSET
    """Messages a second at most, in [1/s]."""
    max_obstacles: Annotated[int, Meta(gt=0)] | UnsetType = UNSET
    """Obstacles in the table at once, at most."""
    max_points: Annotated[int, Meta(gt=0)] | UnsetType = UNSET
    """Points of one cloud at most."""


class CloudsTable(_Table):
    """`[clouds]`: that clouds of depth cameras are taken, and how the arm is taken out of them."""

    shell: NotNegative | UnsetType = UNSET
    """How far from the arm's cover a point still counts as the arm's own, in [m]: what is nearer to
    it than this is not seen."""
    time_error: NotNegative = 0.005
    """What stamps of clouds and of joint states may be apart by, in [s]."""
    trail: NotNegative | UnsetType = UNSET
    """How far behind the arm, along a ray, points of its edge may be measured, in [m]: what lies
    there on a ray that touches the shell is not seen."""


class StaticTable(_Table, kw_only=True):
    """`[statics.<id>]`: something that never moves, a ball or the rounded hull of 8 points."""

    frame: Name = "world"
    """The frame that its points are given in."""
    position: Vector | None = None
    """Its place, in [m]. Either this or `points`."""
    points: Annotated[list[Vector], Meta(min_length=1, max_length=8)] | None = None
    """1 to 8 points, whose hull it is, in [m]."""
    radius: NotNegative
    """By which the point or the hull is rounded, in [m]."""


class EntranceTable(StaticTable, kw_only=True):
    """`[entrances.<id>]`: where a body may come out at any moment before it has been reported."""

    detection_time: NotNegative
    """From leaving it until a source has reported the body, at the longest, in [s]."""
    speed: Positive | None = None
    """Of what may come out, in [m/s]."""


class TetherTable(_Table, kw_only=True):
    """`[[tethers]]`: two obstacles that are never far apart, such as an elbow and its shoulder.

    Where one of them is not seen it is near the other one ([Obstacles](obstacles.md#tethers)).
    """

    a: Name
    """Id of one obstacle."""
    b: Name
    """Id of the other one, reported by the same source."""
    length: NotNegative
    """No centre point of either is ever farther from the hull of the other's centre points, in [m].
    """
    source: Name
    """Where the length comes from."""


class RoundTable(_Table):
    """A capsule or cylinder along z: of a capsule, `length` is that between its balls' centres."""

    radius: Positive
    """Of the round part, in [m]."""
    length: Positive
    """Along z, in [m]; of a capsule, between the centres of its balls."""


class ToolTable(_Table):
    """`[tool]`: a body fixed to a link, placed in the frame of the link's joint; one geometry."""

    name: Name
    """What verdicts call it."""
    link: Name
    """The link that it is fixed to."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Place of its geometry in the frame of the joint that moves the link, in [m]."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Turn of its geometry in that frame: x, y, z, w, of length 1."""
    sphere: Positive | None = None
    """Radius of a ball, in [m]."""
    box: tuple[Positive, Positive, Positive] | None = None
    """Lengths of its edges, in [m]."""
    capsule: RoundTable | None = None
    """`{ radius = …, length = … }`, along z, in [m]; the length is between the balls' centres."""
    cylinder: RoundTable | None = None
    """`{ radius = …, length = … }`, along z, in [m]."""
    mesh: Name | None = None
    """Path of an STL, OBJ or DAE file."""
    mesh_scale: Positive = 1.0
    """By which the lengths of the mesh are multiplied: 0.001 for millimetres."""


class ArmTable(_AnyArmTable, kw_only=True):
    """`[[robots]]`: one of several arms; the monitor of each watches it against the others."""

    name: Name
    """What the cell calls it, and what its joint states carry as `arm`; no other has it."""
    robot: Name | None = None
    """As `name` of `[robot]`. Either this or `urdf`."""
    calibration_error: NotNegative = 0.0
    """How far any of its points may be off because of where and how its base stands, in [m]; it
    counts where one arm is another's obstacle. A base that is turned by an angle moves the hand by
    that angle times the reach."""
    tool: ToolTable | None = None
    """What is fixed to one of its links."""
    ignore: list[IgnoreEntry] = []
    """Pairs of its links that are not watched, beside those of the cell."""

    def as_robot(self) -> RobotTable:
        """The same as `[robot]` of a cell in which there is no other arm."""
        shared = {key: getattr(self, key) for key in _AnyArmTable.__struct_fields__}
        return RobotTable(name=self.robot, **shared)


class PatternTable(_Table):
    """What the ids of one pattern can do, in `[bounds.of]`."""

    accel: Bound
    """Bound on the acceleration, in [m/s²]; may be inf."""
    speed: Bound
    """Bound on the speed, in [m/s]; may be inf."""


class BoundsTable(_Table):
    """`[bounds]`: what obstacles can do unless they say otherwise, and what counts as contact.

    `[bounds.of]` says by pattern of ids what those can do, as bounds or as a part of a body; the
    first pattern that fits counts.
    """

    accel: Bound | UnsetType = UNSET
    """Bound on the acceleration of an obstacle that says nothing else, in [m/s²]: at most 1000, or
    inf."""
    speed: Bound | UnsetType = UNSET
    """Bound on its speed, in [m/s]: at most 100, or inf."""
    extent: Positive | UnsetType = UNSET
    """How far from the origin of the world coordinates may be, in [m]."""
    body_limits: tuple[Positive, Positive] | UnsetType = UNSET
    """What no part of a body does: its speed in [m/s], and its acceleration in [m/s²]. What exceeds
    both its bounds and these is an error of measurement."""
    of: dict[Name, str | PatternTable] = {}
    """By pattern of ids, the first that fits: a part of a body, such as `"hand"`, or a table of
    `accel` and `speed`."""


class ContactTable(_Table, ContactLimit, kw_only=True):
    """`[contact_limits.<region>]`: how a surface of the arm may touch one region of a body.

    Stated in exactly one of three ways: by `speed`, by `energy` and `body_mass`, or by `force`,
    `stiffness` and `body_mass`.
    """

    ids: list[Name] = []
    """Patterns of the ids of obstacles that are this region, beside what messages state."""


class MonitorTable(_Table):
    """`[monitor]`: how often and how pairs are evaluated."""


class ThresholdsTable(_Table):
    """`[thresholds]`: times, and a rate, that decide about levels, speeds and faults."""


class ShieldTable(_Table, kw_only=True):
    """`[shield]`: how `armguard shield` moves the arm; its rate is that of `[monitor]`.

    It needs `motion = "planned"` there, and `robot.operating` says how fast the arm moves.
    """

    jerk: Positive | list[Positive]
    """The greatest jerk of all joints, or of each, in [rad/s³] or [m/s³]."""
    look_ahead: Positive | UnsetType = UNSET
    """For how long the arm must be able to go on as fast as it was asked to, in [s]: less gets more
    work done, more brakes more gently."""
    chunk_period: Positive | UnsetType = UNSET
    """Between points of a chunk, in [s]."""
    tracking_error: Positive | list[Positive] | UnsetType = UNSET
    """How far all joints, or each, may be off a command, in [rad] or [m]."""
    velocity_tracking_error: Positive | list[Positive] | UnsetType = UNSET
    """How far their velocities may be off, in [rad/s] or [m/s]."""


class ClientTable(_Table):
    """`[keys.clients.<name>]`: one that may connect, by its public key, and what it may do."""

    public: Annotated[str, Meta(min_length=KEY_LENGTH, max_length=KEY_LENGTH)]
    """Its public key, 40 characters, as `armguard keys new` prints it."""
    may: Annotated[list[Right], Meta(min_length=1)]
    """What it may do: `obstacles` (as the source of its own name), `joints` (and plans, goals, and
    contact that is wanted), `verdicts` (and commands), `reset`, `view`."""
    arms: list[Name] = []
    """Beside `[[robots]]`, the arms that it speaks for with `joints`, by their names there."""


class KeysTable(_Table):
    """`[keys]`: the monitor's secret file, and all that may connect; nothing else may."""

    secret: Name
    """Path of the secret file of the monitor, as `armguard keys new` writes it."""
    clients: dict[Name, ClientTable] = {}
    """Who may connect, by name."""


class CellTables(_Table, kw_only=True):
    """A whole cell file.

    With `robots`, `robot` and `tool` are those of the arm that is watched, and its own `ignore` is
    behind that of the cell.
    """

    settings: Literal["auto", "stated"] = "stated"
    """Whether a trial at the start chooses what `[monitor]` and `robot.level` leave out ([Choosing
    settings](settings.md))."""
    settings_from: Name | None = None
    """Path of the recording that the trial is taken from."""
    robot: RobotTable = RobotTable()
    """The arm. Either this or `robots`."""
    robots: list[ArmTable] = []
    """Several arms, each watched by a monitor of its own, and an obstacle for the others."""
    joint_state: StampTable = StampTable()
    """How its states are stamped."""
    frames: dict[Name, FrameTable] = {}
    """Where sensors stand."""
    sources: dict[Name, SourceTable] | UnsetType = UNSET
    """What sends obstacles. An empty table says that nothing does; without it the arm stands until
    something is sent."""
    clouds: CloudsTable | None = None
    """How clouds of depth cameras are taken; without it none are."""
    statics: dict[Name, StaticTable] = {}
    """What never moves."""
    entrances: dict[Name, EntranceTable] = {}
    """Where bodies may come out."""
    tethers: list[TetherTable] = []
    """Which obstacles are never far apart."""
    tool: ToolTable | None = None
    """What is fixed to a link."""
    ignore: list[IgnoreEntry | IgnoreTable] = []
    """Pairs that are not watched: link or pattern of links, pattern of obstacle ids, and perhaps
    the source that reports these. The arm stands while a pattern of ids has fitted nothing; with a
    source it may come later. A table ignores them in a zone only."""
    bounds: BoundsTable = BoundsTable()
    """What obstacles can do."""
    contact_limits: dict[Name, ContactTable] = {}
    """By region of a body, what contact with it is permitted. Without it nothing may be touched
    while the arm moves ([Contact limits](contact_limits.md))."""
    monitor: MonitorTable = MonitorTable()
    """How often and how pairs are evaluated."""
    thresholds: ThresholdsTable = ThresholdsTable()
    """Times that decide about levels and faults."""
    shield: ShieldTable | None = None
    """How a shield moves the arm; `armguard run` leaves it alone."""
    separation: SeparationRule | None = None
    """The usual rule's distance."""
    keys: KeysTable | None = None
    """Who may connect."""


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
