"""What a cell file may say: the tables and keys of `cell.toml`, their units and ranges.

Parsing is strict and every mistake is one `CellError` that names file, key, value and what was
expected. A key that is absent leaves the matter to the default of the class that it configures,
so no default is written down twice.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar, get_args

import msgspec
from msgspec import UNSET, Meta, UnsetType

from armguard.exceptions import CellError
from armguard.pairs.cloud_filter import SHELL
from armguard.streams.authentication import Right
from armguard.streams.inputs import BYTE_LIMIT
from armguard.streams.keys import KEY_LENGTH

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Fraction = Annotated[float, Meta(gt=0.0, le=1.0)]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Name = Annotated[str, Meta(min_length=1)]
IgnoreEntry = Annotated[list[Name], Meta(min_length=2, max_length=3)]
"""Pattern of links, pattern of obstacle ids, and perhaps the source that reports these."""


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Refuses keys that it does not know."""


class IgnoreTable(_Table, frozen=True, kw_only=True):
    """An entry of `ignore` that holds within a zone alone: a hull of points, in the world."""

    link: Name
    ids: Name
    source: Name | None = None
    zone: Annotated[list[Vector], Meta(min_length=4, max_length=8)]


class BaseTable(_Table, frozen=True, kw_only=True):
    """`[robot.base]`: where the robot stands in the world."""

    xyz: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)


class OperatingTable(_Table, frozen=True, kw_only=True):
    """`[robot.operating]`: what the controller keeps to while the arm works.

    One number is a fraction of the hardware's limits; a list has one limit for each joint.
    """

    velocity: Fraction | list[Positive] | UnsetType = UNSET
    acceleration: Fraction | list[Positive] | UnsetType = UNSET


class RobotTable(_Table, frozen=True, kw_only=True):
    """`[robot]`: one that armguard knows, a folder with one, or any URDF with a file of limits."""

    name: Name | None = None
    urdf: Name | None = None
    limits: Name | None = None
    package_dirs: list[Name] = []
    joints: list[Name] | None = None
    cover: Name | None = None
    level: Annotated[int, Meta(ge=0)] | None = None
    base: BaseTable = BaseTable()
    payload: NotNegative | UnsetType = UNSET
    operating: OperatingTable | Literal["published"] | UnsetType = UNSET


class StampTable(_Table, frozen=True, kw_only=True):
    """`[joint_state]`: how the robot's states are stamped."""

    clock: Literal["monotonic", "unix"] = "monotonic"
    latency: NotNegative = 0.0
    clock_error: NotNegative = 0.0


class FrameTable(_Table, frozen=True, kw_only=True):
    """`[frames.<name>]`: where a sensor stands, and how well that is known."""

    parent: Name = "world"
    xyz: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    calibration_error: NotNegative = 0.0


class SourceTable(_Table, frozen=True, kw_only=True):
    """`[sources.<name>]`: one that sends obstacles."""

    rate: Positive | None = None
    timeout: Positive | None = None
    clock: Literal["monotonic", "unix", "arrival"] = "monotonic"
    latency: NotNegative = 0.0
    clock_error: NotNegative = 0.0
    required: bool = True
    on_refusal: Literal["bound", "stop"] = "bound"
    max_message_size: Annotated[int, Meta(gt=0, le=BYTE_LIMIT)] | UnsetType = UNSET
    max_message_rate: Positive | UnsetType = UNSET
    max_obstacles: Annotated[int, Meta(gt=0)] | UnsetType = UNSET
    max_points: Annotated[int, Meta(gt=0)] | UnsetType = UNSET


class CloudsTable(_Table, frozen=True, kw_only=True):
    """`[clouds]`: that clouds of depth cameras are taken, and how the arm is taken out of them."""

    shell: NotNegative = SHELL
    time_error: NotNegative = 0.005


class StaticTable(_Table, frozen=True, kw_only=True):
    """`[statics.<id>]`: something that never moves, a ball or the rounded hull of 8 points."""

    frame: Name = "world"
    position: Vector | None = None
    points: Annotated[list[Vector], Meta(min_length=1, max_length=8)] | None = None
    radius: NotNegative


class EntranceTable(StaticTable, frozen=True, kw_only=True):
    """`[entrances.<id>]`: where a body may come out at any moment before it has been reported."""

    detection_time: NotNegative
    speed: Positive | UnsetType = UNSET
    accel: NotNegative | UnsetType = UNSET


class RoundTable(_Table, frozen=True, kw_only=True):
    """A capsule or cylinder along z: of a capsule, `length` is that between its balls' centres."""

    radius: Positive
    length: Positive


class ToolTable(_Table, frozen=True, kw_only=True):
    """`[tool]`: a body fixed to a link, placed in the frame of the link's joint; one geometry."""

    name: Name
    link: Name
    xyz: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    sphere: Positive | None = None
    box: tuple[Positive, Positive, Positive] | None = None
    capsule: RoundTable | None = None
    cylinder: RoundTable | None = None
    mesh: Name | None = None
    mesh_scale: Positive = 1.0


class ArmTable(_Table, frozen=True, kw_only=True):
    """`[[robots]]`: one of several arms; the monitor of each watches it against the others."""

    name: Name
    robot: Name | None = None
    urdf: Name | None = None
    limits: Name | None = None
    package_dirs: list[Name] = []
    joints: list[Name] | None = None
    cover: Name | None = None
    level: Annotated[int, Meta(ge=0)] | None = None
    base: BaseTable = BaseTable()
    calibration_error: NotNegative = 0.0
    payload: NotNegative | UnsetType = UNSET
    operating: OperatingTable | Literal["published"] | UnsetType = UNSET
    tool: ToolTable | None = None
    ignore: list[IgnoreEntry] = []

    def as_robot(self) -> RobotTable:
        """The same as `[robot]` of a cell in which there is no other arm."""
        shared = {key: getattr(self, key) for key in RobotTable.__struct_fields__ if key != "name"}
        return RobotTable(name=self.robot, **shared)


class PatternTable(_Table, frozen=True, kw_only=True):
    """What the ids of one pattern can do, in `[bounds.of]`."""

    accel: NotNegative
    speed: NotNegative


class BoundsTable(_Table, frozen=True, kw_only=True):
    """`[bounds]`: what obstacles can do unless they say otherwise, and what counts as contact.

    `[bounds.of]` says by pattern of ids what those can do, as bounds or as a part of a body; the
    first pattern that fits counts.
    """

    accel: NotNegative | UnsetType = UNSET
    speed: NotNegative | UnsetType = UNSET
    margin: NotNegative | UnsetType = UNSET
    extent: Positive | UnsetType = UNSET
    of: dict[Name, Name | PatternTable] = {}


class MonitorTable(_Table, frozen=True, kw_only=True):
    """`[monitor]`: how often and how pairs are evaluated."""

    rate: Positive | UnsetType = UNSET
    schedule: Name | UnsetType = UNSET
    motion: Name | UnsetType = UNSET
    stop: Name | UnsetType = UNSET
    leave: Name | UnsetType = UNSET
    path_deceleration: Positive | UnsetType = UNSET
    max_staleness: Annotated[float, Meta(ge=0.0, lt=1.0)] | UnsetType = UNSET
    budget: Annotated[int, Meta(gt=0)] | UnsetType = UNSET
    advances: Annotated[int, Meta(gt=0)] | UnsetType = UNSET


class ThresholdsTable(_Table, frozen=True, kw_only=True):
    """`[thresholds]`: times in [s] that decide about levels and faults."""

    reaction_time: NotNegative | UnsetType = UNSET
    latency: NotNegative | UnsetType = UNSET
    slow_margin: NotNegative | UnsetType = UNSET
    aware_margin: NotNegative | UnsetType = UNSET
    rise_delay: NotNegative | UnsetType = UNSET
    source_timeout: Positive | UnsetType = UNSET
    joint_timeout: Positive | UnsetType = UNSET


class SeparationTable(_Table, frozen=True, kw_only=True):
    """`[separation]`: the usual rule's distance, whose margin each verdict is to carry."""

    human_speed: NotNegative | Literal["own"] | UnsetType = UNSET
    intrusion_distance: NotNegative | UnsetType = UNSET
    human_uncertainty: NotNegative | UnsetType = UNSET
    robot_uncertainty: NotNegative | UnsetType = UNSET


class ClientTable(_Table, frozen=True, kw_only=True):
    """`[keys.clients.<name>]`: one that may connect, by its public key, and what it may do."""

    public: Annotated[str, Meta(min_length=KEY_LENGTH, max_length=KEY_LENGTH)]
    may: Annotated[list[Right], Meta(min_length=1)]


class KeysTable(_Table, frozen=True, kw_only=True):
    """`[keys]`: the monitor's secret file, and all that may connect; nothing else may."""

    secret: Name
    clients: dict[Name, ClientTable] = {}


class CellTables(_Table, frozen=True, kw_only=True):
    """A whole cell file.

    With `robots`, `robot` and `tool` are those of the arm that is watched, and its own `ignore` is
    behind that of the cell.
    """

    settings: Literal["auto", "stated"] = "stated"
    settings_from: Name | None = None
    robot: RobotTable = RobotTable()
    robots: list[ArmTable] = []
    joint_state: StampTable = StampTable()
    frames: dict[Name, FrameTable] = {}
    sources: dict[Name, SourceTable] | UnsetType = UNSET
    clouds: CloudsTable | None = None
    statics: dict[Name, StaticTable] = {}
    entrances: dict[Name, EntranceTable] = {}
    tool: ToolTable | None = None
    ignore: list[IgnoreEntry | IgnoreTable] = []
    bounds: BoundsTable = BoundsTable()
    monitor: MonitorTable = MonitorTable()
    thresholds: ThresholdsTable = ThresholdsTable()
    separation: SeparationTable | None = None
    keys: KeysTable | None = None


_MAY_BE_INFINITE = ("bounds.accel", "bounds.speed")

_NAMED: dict[str, type[_Table]] = {
    "frames": FrameTable,
    "sources": SourceTable,
    "statics": StaticTable,
    "entrances": EntranceTable,
    "keys.clients": ClientTable,
}

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
            _convert(entry, kind, f"{table}.{name}", file)
    _check_patterns(raw.get("bounds"), file)
    tables = _convert(raw, CellTables, "", file)
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


def _check_patterns(bounds: object, file: str) -> None:
    """Convert the entries of `[bounds.of]` one by one, for the sake of their errors."""
    patterns = bounds.get("of") if isinstance(bounds, dict) else None
    for pattern, entry in patterns.items() if isinstance(patterns, dict) else ():
        path = f"bounds.of.{pattern}"
        if not pattern:
            raise make_error(file, "bounds.of", "has an empty pattern", "a pattern of ids")
        if isinstance(entry, dict):
            _convert(entry, PatternTable, path, file)
        elif not isinstance(entry, str) or not entry:
            expected = 'a part of a body, such as "hand", or { accel = …, speed = … }'
            raise make_error(file, path, f"is {entry!r}", expected)


def given(table: msgspec.Struct) -> dict[str, Any]:
    """The keys of a table that are in the file, with their values."""
    pairs = ((name, getattr(table, name)) for name in table.__struct_fields__)
    return {name: value for name, value in pairs if value is not UNSET}


def _check_finite(value: object, path: str, file: str) -> None:
    if isinstance(value, dict):
        for key, entry in value.items():
            _check_finite(entry, f"{path}.{key}" if path else key, file)
    elif isinstance(value, list):
        for number, entry in enumerate(value):
            _check_finite(entry, f"{path}[{number}]", file)
    elif isinstance(value, float) and not math.isfinite(value):
        may_be = path in _MAY_BE_INFINITE or path.startswith("bounds.of.")
        if not (may_be and value == math.inf):
            raise make_error(file, path, f"is {value}", "a finite number")


def _convert(raw: object, kind: type[_T], path: str, file: str) -> _T:
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        raise _translate(error, raw, kind, path, file) from None


def _translate(
    error: msgspec.ValidationError, raw: object, kind: type, path: str, file: str
) -> CellError:
    """One of our errors from one of msgspec's, which looks like "Expected … - at `$.a[0].b`"."""
    text, _, place = str(error).partition(" - at ")
    place = place.strip("`")
    steps = re.findall(r"\.(\w+)|\[(\d+)\]", place)
    value = raw
    for name, index in steps:
        # msgspec names a place that it has been to, whatever its type.
        value = value[name] if name else value[int(index)]  # type: ignore[index]  # of unknown type
    key = f"{path}{place.removeprefix('$')}".strip(".")
    field = re.search(r"(?:unknown|missing required) field `(.*)`", text)
    if field is None:
        expected = text.removeprefix("Expected ").partition(", got ")[0]
        if text.startswith("Invalid enum value"):
            expected = _choices(kind, steps)
        return make_error(file, key, f"is {value!r}", expected.replace("`", ""))
    key = f"{key}.{field[1]}".strip(".")
    if "missing" in text:
        return make_error(file, key, "is missing")
    known = getattr(_table_at(kind, steps), "__struct_fields__", ())
    found = value[field[1]] if isinstance(value, Mapping) else value
    return make_error(
        file, key, f"is no key (its value is {found!r})", f"one of {', '.join(known)}"
    )


def _table_at(kind: type, steps: list[tuple[str, str]]) -> Any:
    for name, _ in steps:
        for field in msgspec.structs.fields(kind) if name and issubclass(kind, _Table) else ():
            if field.name == name:
                # A table that may be left out is one of two types.
                for one in (field.type, *get_args(field.type)):
                    if isinstance(one, type) and issubclass(one, _Table):
                        kind = one
    return kind


def _choices(kind: type, steps: list[tuple[str, str]]) -> str:
    table = _table_at(kind, steps[:-1])
    for field in msgspec.structs.fields(table):
        if steps and field.name == steps[-1][0]:
            return "one of " + ", ".join(repr(choice) for choice in field.type.__args__)
    return "another value"
