"""The reference of cell files: `python docs/make_cell.py` writes docs/cell.md.

Each table of the file is a class in armguard/app/cell/schema.py; settings of the monitor, and the
records within them, are in armguard/settings. The page has what these declare, and the text below
each key. A table has the defaults of the class that it configures.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import re
from pathlib import Path
from types import ModuleType, NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec
from msgspec import NODEFAULT, UNSET, UnsetType

from armguard.app.cell import schema
from armguard.obstacles import Obstacles
from armguard.pairs import CloudFilter
from armguard.settings import contact_limits, separation_rule, settings
from armguard.shield import Shield
from armguard.streams import SourceLimits

PAGE = Path(__file__).resolve().parent / "cell.md"

HEAD = """# Cell file

<!-- written by docs/make_cell.py -->

All keys of a `cell.toml`; [demos/cell.toml](../demos/cell.toml) shows them. The smallest is

```toml
robot = { name = "panda" }
```

- Parentheses have range, unit and default. The first of several words is the default. Keys without a type are strings or, with a unit, numbers. Numbers without a range are at least 0.
- A file has `[robot]` or `[[robots]]`; all else is optional. Paths are relative to the file.
- Without `[sources]`, the level is STOP until a message comes; an empty `[sources]` states that none comes.
- In Python: `armguard.app.cell.Cell.load(path).build()`.
"""

CONFIGURED = {
    "CloudsTable": (CloudFilter,),
    "SourceTable": (SourceLimits,),
    "BoundsTable": (Obstacles,),
    "ShieldTable": (Shield,),
}
"""The classes whose arguments a table gives, which have the defaults."""

RENAMED = {
    "max_message_size": "message_size",
    "max_message_rate": "message_rate",
    "max_obstacles": "obstacles",
    "max_points": "points",
}
"""Arguments whose keys have other names."""

WORDS = {
    "_AnyArmTable.joints": "all with limits",
    "_AnyArmTable.cover": "the robot's; fitted to a URDF at each start",
    "_AnyArmTable.level": "the finest",
    "_AnyArmTable.payload": "the heaviest of the brakes",
    "_AnyArmTable.operating": "hardware limits",
    "OperatingTable.velocity": "hardware limits",
    "OperatingTable.acceleration": "hardware limits",
    "UrTable.joints": "the maker's",
    "FrankaTable.joints": "the maker's",
    "Ros2Table.domain": "`ROS_DOMAIN_ID` or 0",
    "SourceTable.timeout": "`thresholds.source_timeout`",
    "ShieldTable.chunk_period": "one tick",
    "EntranceTable.speed": "as in `[bounds]`",
    "CellTables.settings_from": "a simulated visit",
}
"""Defaults that are no values."""

HEADINGS: dict[type, str] = {
    schema.PatternTable: "[bounds.of]",
    separation_rule.SeparationRule: "[separation]",
    schema.IgnoreTable: "ignore = [{ … }]",
}
"""Of tables whose documentation does not begin with one."""

SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
TYPES = {float: "number", str: "string", bool: "boolean"}
USUAL = {"string": "", "≥0": "", "integer ≥0": "integer"}
"""Types that the page does not spell, since its head says what they are."""


def read_texts(module: ModuleType) -> dict[str, str]:
    """The texts below the fields of a module's classes, by "Class.field"."""
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    texts = {}
    for node in (one for one in tree.body if isinstance(one, ast.ClassDef)):
        for field, text in itertools.pairwise([*node.body, ast.Pass()]):
            if isinstance(field, ast.AnnAssign):
                name = f"{node.name}.{ast.unparse(field.target)}"
                if not (isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)):
                    raise ValueError(f"{name} has no text below it")
                texts[name] = " ".join(str(text.value.value).split())
    return texts


TEXTS = {
    name: text
    for module in (schema, settings, separation_rule, contact_limits)
    for name, text in read_texts(module).items()
}
SETTINGS = {field.name: field for field in msgspec.structs.fields(settings.Settings)}


def list_tables() -> list[type]:
    """The classes of all tables, each before those within it."""
    found: list[type] = []

    def visit(table: type) -> None:
        if table not in found:
            found.append(table)
            for field in msgspec.structs.fields(table):
                for inner in find_tables(field.type):
                    visit(inner)

    visit(schema.complete_tables())
    return [one for one in found if one is not schema.RoundTable]


def find_tables(kind: Any) -> list[type]:
    """The tables within a type, in their order."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return [kind]
    return [table for one in get_args(kind) for table in find_tables(one)]


TABLES = list_tables()


def is_table(kind: Any) -> bool:
    """Whether a type is nothing but tables that have a heading of their own."""
    if isinstance(kind, type):
        return kind in TABLES or kind in (UnsetType, NoneType)
    inner = get_args(kind)[1:] if get_origin(kind) is dict else get_args(kind)
    return get_origin(kind) is not Literal and bool(inner) and all(map(is_table, inner))


def name_type(kind: Any, first: object = None, ends: str = "") -> str:
    """A type in words; empty where a file cannot state it.

    Args:
        kind: The type.
        first: The choice to name first.
        ends: Ends of the range of a number.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        stated = ((sign, getattr(inner[1], end)) for end, sign in SIGNS.items())
        ends = " ".join(f"{sign}{end:.7g}" for sign, end in stated if end is not None)
        return name_type(inner[0], first, ends)
    if origin in (Union, UnionType):
        return " or ".join(filter(None, (name_type(one, first, ends) for one in inner)))
    if origin is Literal:
        choices = sorted(inner, key=lambda choice: choice != first)
        return ", ".join(f'`"{choice}"`' for choice in choices)
    if origin is tuple:
        return f"{len(inner)} numbers {ends}".strip()
    if origin is list:
        named = "string" if get_origin(inner[0]) is Literal else name_type(inner[0])
        return f"{named}s" if named in ("string", "number") else f"list of {named}"
    if origin is dict:
        return name_type(inner[1])
    if kind is int:
        return f"integer {ends}"
    if kind in TYPES:
        return (kind is float and ends) or TYPES[kind]
    return "table" if kind in (*TABLES, schema.RoundTable) else ""


def write_default(owner: str, field: msgspec.structs.FieldInfo) -> str:
    """What stands for a key that is left out; empty where it is nothing."""
    words = WORDS.get(f"{owner}.{field.name}")
    if words is not None:
        return words
    if field.required:
        return "needed"
    default = field.default
    if default is UNSET or default is None:
        for configured in CONFIGURED.get(owner, ()):
            parameters: dict[str, Any] = dict(inspect.signature(configured).parameters)
            parameter = parameters.get(RENAMED.get(field.name, field.name))
            default = default if parameter is None else parameter.default
    return "" if default in (UNSET, None, NODEFAULT, "") else _write_value(default)


def _write_value(value: object) -> str:
    """A value as the page has it."""
    if value in ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)) and isinstance(value, tuple):
        return "none" if len(value) == 4 else "0"
    if isinstance(value, tuple):
        return f"`[{', '.join(f'{one:g}' for one in value)}]`"
    if isinstance(value, bool):
        return str(value).lower()
    return f'`"{value}"`' if isinstance(value, str) else f"{value:.7g}"


def write_heading(table: type) -> tuple[str, str]:
    """The heading of a table, and what it is."""
    text = " ".join((inspect.getdoc(table) or "").partition("\n\nRaises")[0].split())
    found = re.fullmatch(r"`(\[.*?\])`: (.*)", text)
    if issubclass(table, schema.CellTables):
        return "Keys at the top", "Before any table."
    heading, words = (HEADINGS[table], text) if found is None else found.groups()
    tag = table.__struct_config__.tag
    words = words if tag is None else words.removesuffix(f' Its `name` is "{tag}".')
    beside = f', `name = "{tag}"`' if tag else ""
    return f"`{heading}`{beside}", re.sub(r"\w", lambda one: one[0].upper(), words, count=1)


def write_table(table: type, shown: dict[str, str]) -> str:
    """One table of the file, in Markdown: a heading, a sentence, and its keys.

    Args:
        table: Its class.
        shown: By class, the heading below which its keys stand; new ones are added.
    """
    heading, words = write_heading(table)
    rows, elsewhere = [], dict[str, None]()
    owners = {}
    for field in msgspec.structs.fields(table):
        names = (one.__name__ for one in table.__mro__)
        owner = next((name for name in names if f"{name}.{field.name}" in TEXTS), "Settings")
        declared = SETTINGS[field.name] if owner == "Settings" else field
        if owner in shown and owner != "Settings":
            elsewhere[shown[owner]] = None
            continue
        owners[owner] = heading
        if is_table(declared.type):
            continue
        text, _, default = TEXTS[f"{owner}.{field.name}"].partition(" Left out: ")
        default = default.removesuffix(".") or write_default(owner, declared)
        units, meaning = split_unit(text)
        kind = name_type(declared.type, declared.default)
        kind = USUAL.get(kind, kind)
        default = "" if kind.startswith(default) else default
        value = ", ".join(filter(None, (f"{kind} {units}".strip(), default)))
        rows.append(f"- `{field.name}`{f' ({value})' if value else ''}: {meaning}")
    shown.update(owners)
    if elsewhere:
        words += f" It also has the keys of {' and '.join(elsewhere)}."
    return "\n".join([f"## {heading}", "", words, "", *rows, ""])


def split_unit(meaning: str) -> tuple[str, str]:
    """The units that a text names, and the text without them."""
    units = re.findall(r"(?<![`\[])\[([^\]]+)\](?!\()", meaning)
    text = re.sub(r",? in \[[^\]]+\](?: or \[[^\]]+\])?", "", meaning)
    return ", ".join(units), text


def write_page() -> str:
    """The page, in Markdown."""
    shown: dict[str, str] = {}
    return "\n".join([HEAD, *(write_table(table, shown) for table in TABLES)])


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
