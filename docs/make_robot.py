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
    "dict[str, float]": "number for each joint",
    "Amounts": "number, or one for each joint",
    "Amounts | None": "number, or one for each joint",
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

What armguard must know of an arm and no URDF contains: limits that hold in every mode, what brakes guarantee, and the source of each figure. A folder with a `robot.toml`, and a `cover.json` that was proved for it, is a robot: `robots/` has those that armguard knows.

## An arm of your own

    armguard robot new arm.urdf --out my_arm

reads the URDF, asks for what it lacks, fits and proves the cover, writes both files, and prints which figures are not data of the arm. The file can also be an MJCF ([MuJoCo](mujoco.md)), a path below `robots/` of example-robot-data, or a ROS parameter file with `robot_description`. On a terminal, Enter takes the usual value. Elsewhere each answer has an option, and a missing one is named. `--yes` takes all usual values: what efforts and inertias of the URDF allow (`DERIVED`), or a choice (`CHOSEN`). Neither is data of your arm: replace them by what its maker states.

Operating limits count only where a cell file says `operating = "published"`; `armguard tradeoff --robot my_arm --axis operating` shows how much less the arm then stops.

- `--joint-limits joint_limits.yaml` takes MoveIt's `max_velocity` and `max_acceleration`, if `has_velocity_limits` and `has_acceleration_limits` say so. Plans keep them, so they become the operating limits, never the hardware's. Default scaling factors are not applied, because a request can name others.
- Meshes are found as `armguard cover` finds them: beside the URDF, in the folders above it, and in `--package-dirs`.
- A link that is drawn and moves, but has no collision geometry, would not be watched. `--collision-from-visual LINK` takes what is drawn; `--bare-links LINK` leaves it uncovered.
- Joints that mimic others are not watched. They, and those of `--travel`, can be anywhere in their range; a mimic joint also wherever the range of its leader takes it. `--lock JOINT=POSITION` is for what stands still, `--joints` chooses what is watched. `--yes` does not guess the position of a joint that carries the arm, such as a lift.

Use the folder wherever a robot is named: `armguard.Robot.load("./my_arm")`, `armguard demo --robot my_arm`, `armguard show my_arm`, `armguard cover --check my_arm`, and `name = "my_arm"` in `[robot]` of a cell file, relative to that file. [Tested arms](arms.md) lists those of example-robot-data.

## Keys

Reading is strict: an unknown key, or a limit that is missing, not finite or without a source, is refused by name. Lengths are metres, angles radians, times seconds, loads kilograms. A key with the default "none" can be left out.
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
    "`[sources]`, and `sources` of a joint": "A source that begins with CHOSEN or DERIVED marks a figure that nobody has published.\n",
    "`[[brakes]]`": "A row is about the joints that its tables name, or about all if each value is one number. It needs `deceleration`, or `stopping_time` and `stopping_distance`, as makers publish them by ISO 10218-1, annex B. Each is a proof by itself, and the tighter one counts. Between two rows the next higher one counts, in load and in speed. A joint that can be faster than any row when its brakes engage is a STOP that names it. No row may stop harder than the acceleration limit allows, or sooner with more load or from more speed.\n",
    "`[locked.NAME]`": "One of both. With `travel`, the links beyond count as all that they can reach (fingers, a head); with `position`, the joint must stand still there.\n",
    "`[operating.published]`": 'In force only where it is asked for: `operating = "published"` in `[robot]` of a cell file, or `Monitor(operating="published")`. A state beyond it is a STOP.\n',
}

TAIL = """## The smallest file

```toml
title = "One joint"
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
