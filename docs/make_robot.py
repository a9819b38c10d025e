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

<!-- written by docs/make_robot.py from armguard/robot/description.py and brakes.py: change it there -->

A robot is a folder with `robot.toml` and the `cover.json` proved for it, as in `robots/`. `robot.toml` states limits that hold in every mode, braking, and the source of each figure.

## An arm of your own

    armguard robot new arm.urdf --out my_arm

reads the URDF, asks for what it lacks, proves the cover and writes both files. The file can also be an [MJCF](mujoco.md), a path below `robots/` of example-robot-data, or a ROS parameter file with `robot_description`. Each question has an option; `--yes` takes values `DERIVED` from efforts and inertias, or `CHOSEN`. **Replace both by data of the maker.**

- `--joint-limits joint_limits.yaml` reads MoveIt's limits as operating limits.
- Meshes are found beside the URDF, above it, and in `--package-dirs`.
- A moving link without collision geometry needs `--collision-from-visual LINK`, or `--bare-links LINK`, which leaves it unwatched.
- Mimic joints, and those of `--travel`, can be anywhere in their range. `--lock JOINT=POSITION` is for joints that stand still; `--joints` chooses what is watched.

Use the folder as a robot's name: `armguard.Robot.load("./my_arm")`, `armguard show my_arm`. [Tested arms](arms.md) lists examples.

## Keys

Unknown keys, and limits that are missing, not finite or without a source, are refused by name.
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
    "`[sources]`, and `sources` of a joint": "A source that begins with CHOSEN or DERIVED marks an unpublished figure.\n",
    "`[[brakes]]`": "A row holds for the joints that it names, or for all. It needs `deceleration`, or `stopping_time` and `stopping_distance` (ISO 10218-1, annex B); the tighter proof counts. Between rows the higher one counts; a joint faster than any row is a STOP.\n",
    "`[locked.NAME]`": "State one of both. With `travel`, links count as all that they can reach.\n",
    "`[operating.published]`": 'For each joint. In force only with `operating = "published"` in a cell file, or `Monitor(operating="published")`; a state beyond is a STOP.\n',
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

`armguard cover arm.urdf --limits robot.toml --out .` makes the cover beside it.
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


def write_page() -> str:
    """The page, in Markdown."""
    parts = [HEAD]
    for title, schema, module in SECTIONS:
        rows = [
            f"| `{name}` | {kind} | {default} | {text} |"
            for name, kind, default, text in read_keys(schema, module)
        ]
        head = ["| key | type | default | meaning |", "|---|---|---|---|"]
        parts.append("\n".join([f"### {title}\n", *head, *rows]) + "\n")
        if title in AFTER:
            parts.append(AFTER[title])
    return "\n".join([*parts, TAIL])


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
