"""The page about the wire: `python docs/make_wire.py` writes docs/wire.md.

Tables of fields are made of the classes in armguard/messages: what a field is called,
its type, whether it may be left out, and the text that stands below it.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import re
from collections import Counter
from pathlib import Path

from armguard.messages import answers, command, incoming, reasons
from armguard.recording import events
from armguard.streams import addresses, goal_intake

PAGE = Path(__file__).resolve().parent / "wire.md"

TYPES = {
    "str": "string",
    "str | None": "string or nil",
    "bool": "boolean",
    "int": "integer",
    "int | None": "integer or nil",
    "Number": "integer",
    "Number | None": "integer",
    "float": "number",
    "float | None": "number or nil",
    "list[str]": "strings",
    "str | list[str] | None": "string or strings",
    "list[float]": "numbers",
    "list[GoalPath] | None": "paths",
    "bytes | list[float]": "numbers",
    "bytes | list[float] | None": "numbers",
    "Points": "n points or hulls",
    "Points | None": "as `position`",
    "Cloud": "rows",
    "tuple[float, float, float]": "point",
    "bytes | list[bool] | None": "booleans",
    "Rows": "rows",
    "Rows | None": "rows",
    "Values": "number",
    "Values | None": "number",
    "Literal['commit', 'share']": '`"commit"` or `"share"`',
    "Literal['finish', 'brake'] | None": '`"finish"`, `"brake"` or nil',
    "list[ReasonMessage]": "reasons",
    "CertificateMessage | None": "certificate or nil",
    "HeldMessage | None": "cause or nil",
    "ReasonMessage | None": "reason or nil",
    "Figure": "number",
    "list[Figure]": "numbers",
    "list[tuple[Figure, Figure, Figure]]": "rows",
}
"""What the types in the schemas are called; one that is not here has no name yet."""

SHARED = (
    incoming.ObstaclesMessage,
    incoming.CloudMessage,
    incoming.RemoveMessage,
    incoming.JointsMessage,
    incoming.ResetMessage,
    incoming.IgnoreMessage,
    incoming.WatchMessage,
    incoming.PlanMessage,
    incoming.GoalMessage,
    answers.VerdictMessage,
    answers.PlanVerdictMessage,
    answers.ResetVerdictMessage,
    command.CommandMessage,
)
"""Messages whose common fields stand in one list."""

HEAD = f"""# The wire

<!-- written by docs/make_wire.py from armguard/messages: change it there -->

`armguard run` and `armguard shield` bind ZeroMQ sockets: SUB for inputs, PUB for outputs. Other processes connect. Default addresses:

- obstacles: `{addresses.OBSTACLES_ADDRESS}` (`--obstacles`)
- joint states, plans, goals: `{addresses.JOINTS_ADDRESS}` (`--joints`)
- verdicts, commands, answers: `{addresses.VERDICTS_ADDRESS}` (`--verdicts`)

Each input accepts every message; `--obstacles -` reads JSON lines from standard input. Addresses are `ipc://` or local TCP; others need [keys](keys.md).

Nodes without armguard: [perception.py](nodes/perception.py), [controller.py](nodes/controller.py), [perception.cpp](nodes/perception.cpp), [lines.cpp](nodes/lines.cpp). In Python, use `armguard.streams.Publisher` and `VerdictReader`.

## Messages

A message has one part: a msgpack map or a JSON object. Its `type` names the message. armguard refuses unknown and missing fields by name. Outputs are msgpack, or JSON with `--json-verdicts`.

- Parentheses have type, unit and default. A field without a type is a string or, with a unit, a number.
- Optional fields can be nil (JSON: null) or absent. In outputs, nil means none or unknown.
- Joint values are in the order of `names`. Bounds, radii and errors are one number, or one per obstacle or joint.
- In msgpack, an array of numbers can be little-endian float64 in a `bin`, row by row. Commands use this form.
- Numbers of outputs can be NaN (JSON: null) or infinite (JSON: {answers.GREATEST!r}). Obey a STOP whatever its numbers are. A NaN `valid_until` has expired; a NaN `speed_scale` is 0.
- Times of outputs are of the monotonic clock (`CLOCK_MONOTONIC`); a `…_time` counts from the tick. Times of obstacles, clouds and removals are of the source's clock. All other inputs use the clock of the joint states.

armguard counts and prints refused messages. The [cell file](cell.md) has limits for each source.

Several messages have these fields:
"""

OBSTACLES = """## Obstacles

`obstacles`: what a source saw.
"""

AFTER_OBSTACLES = """A message without `ids` is a heartbeat. If a required source, or one that has sent, is silent for longer than `source_timeout` (0.2 s), the level is STOP. Without `snapshot`, absent obstacles stay and grow with their bounds.

```json
{"type": "obstacles", "source": "camera", "seq": 17, "stamp": 12.345, "ids": ["ball"],
 "position": [[2.0,0.3,0.5]], "velocity": [[-0.8,0.0,0.0]], "radius": 0.1, "position_error": 0.01}
{"type": "obstacles", "source": "camera", "seq": 18, "stamp": 12.355, "ids": []}
```
"""

CLOUD = """## Clouds

`cloud`: a depth camera's points, if the cell file has `[clouds]` ([details](sensors.md)).
"""

AFTER_CLOUD = """armguard removes the arm's points by a joint state within `time_error` (5 ms); without one, the arm stops.

```json
{"type": "cloud", "source": "depth", "stamp": 12.345, "origin": [2.4,-1.2,1.3],
 "points": [[0.3,-0.7,0.2],[0.31,-0.7,0.2]], "position_error": 0.02}
```
"""

REMOVE = """`remove` names obstacles that left:
"""

JOINTS = """## Joint states

`joints`: send it as often as possible, from one sender.
"""

AFTER_JOINTS = """A gap longer than `joint_timeout` is a STOP until a reset.
"""

RESET = """## Reset

`reset` (`armguard reset`) ends latched STOPs whose cause has gone, and forgets [what no message ends](obstacles.md#sources). It needs a run with `--reset-token`.
"""

AFTER_RESET = """A `reset_verdict` answers after the tick's verdict:
"""

IGNORE = """## Contact that is wanted

`ignore` exempts pairs until a time, in a zone, or both ([Allowing contact](contact.md)).
"""

WATCH = """`watch` ends an exemption, without a token:
"""

AFTER_WATCH = """```json
{"type": "ignore", "number": 1, "token": "TOKEN", "link": "panda_hand", "ids": "part*",
 "zone": [[0.4,-0.2,0.0],[0.8,-0.2,0.0],[0.4,0.2,0.0],[0.8,0.2,0.0],
          [0.4,-0.2,0.5],[0.8,-0.2,0.5],[0.4,0.2,0.5],[0.8,0.2,0.5]]}
{"type": "watch", "number": 1}
```
"""

VERDICT = """## Verdicts

`verdict`, once per tick. The controller must obey the newest verdict, and must brake when it has no valid one. A run ends with a STOP.
"""

REASONS = """A reason ([all kinds](reasons.md)):
"""

HELD = """Why a level is held (`held`):
"""

PLANS = """## Plans

`plan` shows a motion of the arm that ends at rest.
"""

ANSWERS = """`"commit"` asks whether the arm may run this piece of its path; it needs `motion = "planned"`. A `plan_verdict` answers in the same tick. If it is safe, the monitor assumes that the arm follows it. Otherwise the controller must follow its present piece to rest.
"""

SHARING = """`"share"` promises other monitors that the arm follows the plan, perhaps late, or stops ([Several arms](several_arms.md#plans-that-are-shared)). It needs `until` and `velocity_tracking_error`, and has no answer.
"""

GOALS = """## Goals

`goal` tells `armguard shield` what to do ([Shield](shield.md#as-a-process)). It has exactly one of `paths`, `velocity` and `chunk`.
"""

PATHS = """A path:
"""

AFTER_GOALS = f"""Commands name a refused goal; the goal before it continues. A velocity counts for {goal_intake.LONGEST_VELOCITY:g} s: repeat it.

```json
{{"type": "goal", "number": 5, "until": 13.0, "names": ["shoulder","elbow"],
 "paths": [{{"q": [[0.0,0.5],[0.4,0.7],[0.8,0.5]]}}]}}
{{"type": "goal", "number": 6, "until": 12.5, "names": ["shoulder","elbow"], "velocity": [0.2,0.0]}}
```
"""

COMMANDS = """## Commands

`command`, after each verdict of `armguard shield`: a motion that is proved until the arm is at rest.
"""

AFTER_COMMANDS = f"""`times` is empty while the arm's position is unknown. A controller must follow its motion to the end, even if no newer command comes, and must brake by `stop`. It can change to a newer motion until `take_up_by`, if both are within {command.SAME_PLACE:g} rad or m and {command.SAME_VELOCITY:g} rad/s or m/s of each other.
"""

RECORDED = f"""## In a recording

A [recording](recording.md) is an MCAP file with these topics below `{events.PREFIX}`, as JSON: {{topics}}. `scene` shows arm and obstacles in viewers. Times are of the monotonic clock, shifted to the time of day at which the recording began.

- Numbers are bit-exact. The strings `"Infinity"`, `"-Infinity"` and `"NaN"` stand for what JSON lacks.
- Lists of lists are written as one list, row by row.
- Metadata `armguard` has versions and the [digest of the configuration](safety.md#which-configuration-it-was).
"""


def write_topics() -> str:
    """The topics of a recording, in Markdown."""
    return ", ".join(f"`{topic}`" for topic in events.TOPICS.values())


def read_fields(schema: type) -> list[tuple[str, str, str, str]]:
    """Fields of a message: name, type in words, default or nothing, and the text below it."""
    tree = ast.parse(Path(inspect.getfile(schema)).read_text(encoding="utf-8"))
    (body,) = (
        node.body
        for node in tree.body
        if isinstance(node, ast.ClassDef) and node.name == schema.__name__
    )
    fields = []
    for field, text in itertools.pairwise(body):
        if isinstance(field, ast.AnnAssign):
            words = " ".join(ast.literal_eval(text.value).split())
            default = "" if field.value is None else ast.unparse(field.value)
            fields.append((field.target.id, TYPES[ast.unparse(field.annotation)], default, words))
    return fields


def find_shared() -> dict[str, tuple[str, str, str, str]]:
    """Fields that are alike in at least two messages, by name."""
    counts = Counter(field for schema in SHARED for field in read_fields(schema))
    return {field[0]: field for field, count in reversed(counts.most_common()) if count > 1}


def write_fields(schema: type) -> str:
    """The fields of a message, in Markdown; what messages share is only named."""
    shared = find_shared() if schema in SHARED else {}
    fields = read_fields(schema)
    named = [f"`{field[0]}`" for field in fields if shared.get(field[0]) == field]
    is_input = issubclass(schema, incoming.Message | incoming.GoalPath)
    rows = [write_field(field, is_input) for field in fields if shared.get(field[0]) != field]
    also = [f"- {', '.join(named)}"] if named else []
    return "\n".join([*rows, *also]) + "\n"


def write_field(field: tuple[str, str, str, str], is_input: bool) -> str:
    """A field as an item of a list."""
    name, kind, default, text = field
    units = re.findall(r"(?<!`)\[([^\]]+)\](?!\()", text)
    text = re.sub(r",? \[[^\]]+\](?!\()(?: or \[[^\]]+\])?", "", text)
    kind = kind.removesuffix(" or nil")
    kind = kind.removesuffix("number").replace("numbers", "list") if units else kind
    unit = " or ".join(units)
    state = _write_default(default, text) if is_input else ""
    notes = ", ".join(filter(None, ("" if kind == "string" else kind, unit, state)))
    return f"- `{name}`{f' ({notes})' if notes else ''}: {text}"


def _write_default(default: str, text: str) -> str:
    """What a field stands for that is left out; empty where it is needed, or its text says so."""
    if default in ("None", "[]"):
        return "" if "left out" in text else "optional"
    value = default.replace(chr(39), chr(34))
    return {"": "", "False": "false", "0.0": "0"}.get(default, f"`{value}`")


def write_page() -> str:
    """The page, in Markdown."""
    shared = [write_field(field, is_input=True) for field in find_shared().values()]
    parts = [
        HEAD,
        "\n".join(sorted(shared)) + "\n",
        OBSTACLES,
        write_fields(incoming.ObstaclesMessage),
        AFTER_OBSTACLES,
        REMOVE,
        write_fields(incoming.RemoveMessage),
        CLOUD,
        write_fields(incoming.CloudMessage),
        AFTER_CLOUD,
        JOINTS,
        write_fields(incoming.JointsMessage),
        AFTER_JOINTS,
        RESET,
        write_fields(incoming.ResetMessage),
        AFTER_RESET,
        write_fields(answers.ResetVerdictMessage),
        IGNORE,
        write_fields(incoming.IgnoreMessage),
        WATCH,
        write_fields(incoming.WatchMessage),
        AFTER_WATCH,
        VERDICT,
        write_fields(answers.VerdictMessage),
        REASONS,
        write_fields(reasons.ReasonMessage),
        HELD,
        write_fields(answers.HeldMessage),
        PLANS,
        write_fields(incoming.PlanMessage),
        ANSWERS,
        write_fields(answers.PlanVerdictMessage),
        SHARING,
        GOALS,
        write_fields(incoming.GoalMessage),
        PATHS,
        write_fields(incoming.GoalPath),
        AFTER_GOALS,
        COMMANDS,
        write_fields(command.CommandMessage),
        AFTER_COMMANDS,
        RECORDED.format(topics=write_topics()),
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
