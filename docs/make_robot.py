"""The page about robot.toml: `python docs/make_robot.py` writes docs/robot.md.

Tables of keys are made of the classes that read the file, in armguard/robot/description.py and
brakes.py: what a key is called, its type, its default, and the text that stands below it.
"""

from __future__ import annotations

import ast
import itertools
from pathlib import Path
from types import ModuleType

from armguard.robot import brakes, description

PAGE = Path(__file__).resolve().parent / "robot.md"

TYPES = {
    "str": "string",
    "float": "number",
    "float | None": "number",
    "tuple[float, float] | None": "two numbers",
    "tuple[str, ...]": "strings",
    "tuple[BrakeRow, ...]": "tables",
    "dict[str, JointDescription]": "table of tables",
    "dict[str, LockedJoint]": "table of tables",
    "dict[str, float]": "numbers",
    "Amounts": "number(s)",
    "Amounts | None": "number(s)",
    "LimitSources": "table",
    "OperatingSources": "table",
    "OperatingTable": "table",
    "OperatingDescription | None": "table",
}
"""What the types in the schemas are called; one that is not here has no name yet."""

DEFAULTS = {"''": "empty", "()": "none", "{}": "none", "None": "none", "1e-3": "0.001"}
"""What defaults are called that are no numbers; those of tables are their keys' own."""

HEAD = """# robot.toml

<!-- written by docs/make_robot.py -->

A robot is a folder with `robot.toml` and the [cover](covers.md) proved for it, as in `robots/`. `robot.toml` states limits that hold in every mode, braking, and the source of each figure.

## An arm of your own

    armguard robot new arm.urdf --out my_arm

reads the URDF or [MJCF](mujoco.md), asks for what it lacks, proves the cover and writes both files. Each question has an option; `--yes` takes values `DERIVED` from efforts and inertias, or `CHOSEN`. **Replace both by data of the maker.**

- `--joint-limits joint_limits.yaml` reads MoveIt's limits as operating limits.
- A moving link without collision geometry needs `--collision-from-visual LINK`, or `--bare-links LINK`, which leaves it unwatched.
- Mimic joints, and those of `--travel`, can be anywhere in their range. `--lock JOINT=POSITION` is for joints that stand still; `--joints` chooses what is watched.

Use the folder as a robot's name: `armguard.Robot.load("./my_arm")`.

## Keys

armguard refuses unknown keys, and limits that are missing, not finite or without a source. Parentheses have the type, and the default or *needed*; other keys are optional. Keys without a type are strings or, with a unit, numbers.
"""

SECTIONS = (
    ("At the top", description.RobotDescription, description),
    ("`[sources]`, and `sources` of a joint", description.LimitSources, description),
    ("`[joints.NAME]`", description.JointDescription, description),
    ("`[[brakes]]`", brakes.BrakeRow, brakes),
    ("`[locked.NAME]`", description.LockedJoint, description),
    ("`[operating]`", description.OperatingTable, description),
    ("`[operating.published]`", description.OperatingDescription, description),
    ("`[operating.published.sources]`", description.OperatingSources, description),
)
"""Title of each table, the class that reads it, and the module that has it."""

AFTER = {
    "`[[brakes]]`": "A row holds for the joints that it names, or for all. It needs `deceleration`, or `stopping_time` and `stopping_distance`. Between two rows, the one for the higher load or speed counts. A joint faster than any row is a STOP.\n",
    "`[locked.NAME]`": "State one of the two.\n",
    "`[operating.published]`": 'They are in force only with `operating = "published"` in a cell file or `Monitor`.\n',
}

TAIL = """## The smallest file

```toml
urdf = "arm.urdf"

[sources]
position = "arm.urdf"
velocity = "arm.urdf"
acceleration = "data sheet, page 7"

[joints.shoulder]
position = [-1.0, 2.0]
velocity = 1.0
acceleration = 5.0

[[brakes]]
load = 1.0
source = "data sheet, page 9"
speed = 1.1
stopping_time = 0.5
stopping_distance = 0.3
```

`armguard cover arm.urdf --limits robot.toml --out .` makes its cover.
"""


def read_keys(schema: type, module: ModuleType) -> list[tuple[str, str, str, str]]:
    """Keys of a table: name, type in words, default or "needed", and the text below it."""
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    (body,) = (
        node.body
        for node in tree.body
        if isinstance(node, ast.ClassDef) and node.name == schema.__name__
    )
    keys = []
    for key, text in itertools.pairwise(body):
        if not isinstance(key, ast.AnnAssign):
            continue
        words = " ".join(ast.literal_eval(text.value).split())
        default = "needed"
        if key.value is not None:
            spelled = ast.get_source_segment(Path(module.__file__).read_text("utf-8"), key.value)
            default = "none" if spelled.endswith("()") else spelled
            default = DEFAULTS.get(default.replace('"', "'"), default)
        keys.append((key.target.id, TYPES[ast.unparse(key.annotation)], default, words))
    return keys


def write_key(name: str, kind: str, default: str, text: str) -> str:
    """A key as an item of a list; strings and numbers with a unit need no type."""
    is_plain = kind == "string" or (kind == "number" and "[" in text)
    notes = ["" if is_plain else kind, "" if default in ("none", "empty") else default]
    told = ", ".join(filter(None, notes))
    return f"- `{name}`{f' ({told})' if told else ''}: {text}"


def write_page() -> str:
    """The page, in Markdown."""
    parts = [HEAD]
    for title, schema, module in SECTIONS:
        rows = [write_key(*key) for key in read_keys(schema, module)]
        parts.append("\n".join([f"### {title}\n", *rows]) + "\n")
        if title in AFTER:
            parts.append(AFTER[title])
    return "\n".join([*parts, TAIL])


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
