"""The reference of cell files: `python docs/make_cell.py` writes docs/cell.md.

Tables are made of the classes in armguard/app/cell/schema.py: what a key is called, its type, and
the text that stands below it. Settings of the monitor, and the records within them, come from
armguard/settings. Defaults that the schema leaves to the other classes which a table
configures are read from their signatures.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import re
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

import msgspec

from armguard.app.cell import schema
from armguard.obstacles import Obstacles
from armguard.pairs import CloudFilter
from armguard.settings import contact_limits, separation_rule, settings
from armguard.settings.declarations import Declaration, read_declarations
from armguard.shield import Shield
from armguard.streams import SourceLimits

PAGE = Path(__file__).resolve().parent / "cell.md"

HEAD = """# Cell file

<!-- written by docs/make_cell.py from armguard/app/cell/schema.py and armguard/settings: change it there -->

What a `cell.toml` may say. `armguard run`, `armguard shield`, `armguard tradeoff` and `armguard replay --cell` read it; [demos/cell.toml](../demos/cell.toml) is one with every table in it. The smallest one is

```toml
robot = { name = "panda" }
```

- Lengths are metres, times seconds, angles radians. Paths are relative to the file.
- What is left out has the default that stands here; “needed” keys have none.
- Reading is strict: an unknown key, a wrong type, a number out of range or one that is not finite is refused in one line, which names file, key, what was found and what was expected. Infinite numbers are accepted for bounds on acceleration and speed alone.
- In Python: `armguard.app.cell.Cell.load(path).build()` gives robot, obstacles and monitor.
"""

TYPES = {
    "Positive": "number above 0",
    "NotNegative": "number from 0 on",
    "Bound": "number from 0 on",
    "Positive | list[Positive]": "number above 0, or one a joint",
    "Fraction": "above 0, up to 1",
    "Fraction | list[Positive]": "fraction of 1, or numbers above 0",
    "Annotated[int, Meta(ge=0)]": "integer from 0 on",
    "Annotated[int, Meta(gt=0)]": "integer above 0",
    "Annotated[int, Meta(gt=0, le=BYTE_LIMIT)]": "integer above 0",
    "Vector": "3 numbers",
    "Quaternion": "4 numbers",
    "Annotated[list[Vector], Meta(min_length=1, max_length=8)]": "rows of 3 numbers",
    "tuple[Positive, Positive]": "2 numbers above 0",
    "tuple[Positive, Positive, Positive]": "3 numbers above 0",
    "Name": "string",
    "list[Name]": "strings",
    "list[list[float]]": "rows of numbers",
    "list[IgnoreEntry]": "rows of 2 or 3 strings",
    "list[IgnoreEntry | IgnoreTable]": "rows of 2 or 3 strings, or tables",
    "Annotated[list[Vector], Meta(min_length=4, max_length=8)]": "4 to 8 rows of 3 numbers",
    "Annotated[str, Meta(min_length=KEY_LENGTH, max_length=KEY_LENGTH)]": "string",
    "Annotated[list[Right], Meta(min_length=1)]": "strings",
    "Annotated[int, Meta(ge=0, le=MOST_DOMAINS)]": f"integer, 0 to {schema.MOST_DOMAINS}",
    "bool": "boolean",
    "OperatingTable | Literal['published']": 'table, or `"published"`',
    "dict[Name, str | PatternTable]": "table of strings or tables",
}
"""What the types in the schema are called; other tables are called so by `name_type`."""

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
    "_AnyArmTable.joints": "all that have limits",
    "_AnyArmTable.cover": "the robot's own; fitted at each start to a URDF",
    "_AnyArmTable.level": "the finest",
    "_AnyArmTable.payload": "the heaviest that its brakes are stated for",
    "_AnyArmTable.operating": "the hardware's limits",
    "CellTables.robot": "needed, unless there are `robots`",
    "CellTables.clouds": "none are taken",
    "OperatingTable.velocity": "the hardware's",
    "OperatingTable.acceleration": "the hardware's",
    "Ros2Table.domain": "as `ROS_DOMAIN_ID` says",
    "SourceTable.timeout": "`thresholds.source_timeout`",
    "ShieldTable.chunk_period": "one period of the shield",
    "EntranceTable.speed": "as `[bounds]` has it",
    "CellTables.settings_from": "a simulated visit to the arm",
}
"""Defaults that are no values."""


def read_texts(module: ModuleType) -> dict[str, dict[str, tuple[str, str | None, str]]]:
    """By class and field: type, default and text, as a module's source has them."""
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    classes: dict[str, dict[str, tuple[str, str | None, str]]] = {}
    for node in (one for one in tree.body if isinstance(one, ast.ClassDef)):
        fields = classes[node.name] = {}
        for field, text in itertools.pairwise([*node.body, ast.Pass()]):
            if not isinstance(field, ast.AnnAssign):
                continue
            name = field.target.id
            if not (isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)):
                raise ValueError(f"{node.name}.{name} has no text below it")
            default = None if field.value is None else ast.unparse(field.value)
            words = " ".join(str(text.value.value).split())
            fields[name] = ast.unparse(field.annotation), default, words
    return classes


TEXTS = {
    **read_texts(schema),
    **read_texts(settings),
    **read_texts(separation_rule),
    **read_texts(contact_limits),
}
RECORDS = (settings.Settings, separation_rule.SeparationRule, contact_limits.ContactLimit)
"""What declares keys that the schema does not have."""


def list_tables() -> list[type]:
    """The classes of all tables, each before those within it."""
    found: list[type] = []

    def visit(table: type) -> None:
        if table in found:
            return
        found.append(table)
        for field in msgspec.structs.fields(table):
            todo = [field.type]
            while todo:
                kind = todo.pop(0)
                todo += get_args(kind)
                if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
                    visit(kind)

    visit(schema.complete_tables())
    return [one for one in found if one is not schema.RoundTable]


def name_type(annotation: str) -> str:
    """A type in words."""
    kind = re.sub(r" \| (UnsetType|None)\b", "", annotation)
    if kind.startswith("Literal["):
        return " or ".join(f'`"{choice}"`' for choice in re.findall(r"'(\w+)'", kind))
    if kind in TYPES:
        return TYPES[kind]
    if re.fullmatch(r"\w+Table( \| \w+Table)*|SeparationRule", kind):
        return "table"
    if re.fullmatch(r"(dict\[Name, |list\[)\w+Table\]", kind):
        return "tables"
    raise ValueError(f"the type {kind} has no name yet: give it one in TYPES of docs/make_cell.py")


def name_default(owner: str, key: str, default: str | None) -> str:
    """What stands for a key that is left out."""
    if default is None:
        return "needed"
    words = WORDS.get(f"{owner}.{key}")
    if words is not None:
        return words
    if default in ("UNSET", "None"):
        for configured in CONFIGURED.get(owner, ()):
            parameters: dict[str, Any] = dict(inspect.signature(configured).parameters)
            parameter = parameters.get(RENAMED.get(key, key))
            if parameter is not None and parameter.default is not None:
                return _write_value(parameter.default)
        return "none"
    if re.fullmatch(r"\w+Table\(\)|\{\}|\[\]", default):
        return "empty"
    named = getattr(schema, default, None)
    return _write_value(ast.literal_eval(default) if named is None else named)


def write_setting(declared: Declaration, text: str) -> tuple[str, str, str]:
    """Type, default and text of a setting of the monitor."""
    kind = declared.plain_type
    if get_origin(kind) is Literal:
        words = " or ".join(f'`"{choice}"`' for choice in get_args(kind))
    else:
        words = declared.describe(in_file=True).removesuffix(", or None").removeprefix("a ")
        words = words.replace("finite ", "").replace("whole number", "integer")
        words = re.sub(r"'(\w+)'", r'`"\1"`', words)
    if declared.default not in (None, ""):
        return words, _write_value(declared.default), text
    text, default = text.split(" Left out: ")
    return words, default.removesuffix("."), text


def _write_value(value: object) -> str:
    """A value as the page has it."""
    if isinstance(value, tuple):
        return ", ".join(_write_value(one) for one in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f'`"{value}"`' if isinstance(value, str) else f"{value:.7g}"


def write_table(table: type) -> str:
    """One table of the file, in Markdown: a heading, a sentence, and its keys."""
    text = " ".join((table.__doc__ or "").split("\n\n")[0].split())
    found = re.fullmatch(r"`(\[.*?\])`: (.*)", text)
    heading, words = ("Keys at the top", text) if found is None else found.groups()
    if issubclass(table, schema.CellTables):
        words = "Before any table."
    elif table is schema.PatternTable:
        heading, words = "[bounds.of]", "What the ids of one pattern can do, as a table:"
    elif table is separation_rule.SeparationRule:
        heading = "[separation]"
    elif table is schema.IgnoreTable:
        heading = "ignore = [{ … }]"
    words = words[0].upper() + words[1:]
    heading = heading if heading == "Keys at the top" else f"`{heading}`"
    tag = table.__struct_config__.tag
    if tag is not None:
        heading += f', `name = "{tag}"`'
    rows = ["| key | type | unit | left out | meaning |", "|---|---|---|---|---|"]
    listed = {}
    for owner in (one.__name__ for one in reversed(table.__mro__) if one not in RECORDS):
        for key, (annotation, default, text) in TEXTS.get(owner, {}).items():
            listed[key] = name_type(annotation), name_default(owner, key, default), text
    for record in RECORDS:
        for key, declared in read_declarations(record).items():
            if key in table.__struct_fields__ and key not in listed:
                listed[key] = write_setting(declared, TEXTS[record.__name__][key][-1])
    for key, (kind, default, text) in listed.items():
        unit, meaning = split_unit(text)
        rows.append(f"| `{key}` | {kind} | {unit} | {default} | {meaning} |")
    return f"## {heading}\n\n{words}\n\n" + "\n".join(rows) + "\n"


def split_unit(meaning: str) -> tuple[str, str]:
    """The units that a text names in brackets, and the text without them."""
    units = re.findall(r"(?<!`)\[([^\]]+)\](?!\()", meaning)
    return ", ".join(units), re.sub(r",? in \[[^\]]+\](?: or \[[^\]]+\])?", "", meaning)


def write_page() -> str:
    """The page, in Markdown."""
    return "\n".join([HEAD, *(write_table(table) for table in list_tables())])


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
