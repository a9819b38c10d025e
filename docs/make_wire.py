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
from armguard.streams import SourceLimits, addresses, goal_intake, inputs

PAGE = Path(__file__).resolve().parent / "wire.md"

TYPES = {
    "str": "string",
    "str | None": "string or nil",
    "bool": "boolean",
    "int": "integer",
    "int | None": "integer or nil",
    "Number": "count",
    "Number | None": "count",
    "float": "number",
    "float | None": "number or nil",
    "list[str]": "strings",
    "str | list[str] | None": "string or strings",
    "list[float]": "numbers",
    "list[GoalPath] | None": "paths",
    "bytes | list[float]": "numbers",
    "bytes | list[float] | None": "numbers",
    "Points": f"n points or hulls of up to {incoming.POINT_LIMIT}",
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

`armguard run` or `armguard shield` binds ZeroMQ SUB sockets for inputs and a PUB socket for outputs; others connect. Default addresses:

- obstacles: `{addresses.OBSTACLES_ADDRESS}` (`--obstacles`)
- joint states, plans, goals: `{addresses.JOINTS_ADDRESS}` (`--joints`)
- verdicts, commands, answers: `{addresses.VERDICTS_ADDRESS}` (`--verdicts`)

Each input takes every message; `--obstacles -` reads JSON lines from standard input. Addresses are `ipc://` or local TCP; others need [keys](keys.md), with CURVE on all sockets.

Nodes without armguard: [perception.py](nodes/perception.py), [controller.py](nodes/controller.py), [perception.cpp](nodes/perception.cpp), [lines.cpp](nodes/lines.cpp). Python has `armguard.streams.Publisher` and `VerdictReader`.

## Messages

A message is one part: a msgpack map or a JSON object. Outputs are msgpack, or JSON with `--json-verdicts`.

- `type` names the message. Unknown and missing fields are refused by name. Optional fields can be nil (JSON: null) or absent; in outputs, nil is none or unknown.
- Parentheses have type, unit and default. Without a type, fields are strings or, with a unit, numbers; counts are from 0 to 2⁶³ − 1. Joint values follow `names`. Bounds, radii and errors can be lists.
- In msgpack, number arrays can be little-endian float64 in a `bin`, row by row, as in commands.
- Outputs can have NaN (JSON: null) and infinity (JSON: {answers.GREATEST!r}). A STOP counts whatever its numbers are. A NaN `valid_until` has expired; a NaN `speed_scale` is 0. Inputs can have infinite bounds in msgpack.
- Times of outputs are of the monotonic clock (`CLOCK_MONOTONIC`, `time.monotonic()`, `std::chrono::steady_clock`); a `…_time` counts from the tick. Times of inputs are of the source's clock or, from “Joint states” on, the joint states', as in the cell file.
- Gaps in `seq` count as lost messages, steps back as a restart, two tracks as two senders; none is a STOP.

Refused messages are counted and printed; verdicts say if obstacles may be missing. Default limits of a source: {SourceLimits().message_rate:g} messages per second of {SourceLimits().message_size} bytes, {SourceLimits().obstacles} obstacles, {SourceLimits().points} points per cloud; of an input: {inputs.CONNECTION_LIMIT} connections, strangers' included (use a firewall), {inputs.WAITING_BYTES // 2**20} MiB waiting each. A tick takes 64 messages of an input, fairly from all connections.

Shared fields:
"""

OBSTACLES = """## Obstacles

`obstacles`: what a source saw.
"""

AFTER_OBSTACLES = """Without `ids`, it is a heartbeat. Silence beyond `source_timeout` (0.2 s) of a source that has sent or is required is a STOP. Without `snapshot`, absent obstacles stay and grow with their bounds. Ids belong to their source. Hulls of a message have as many points.

```json
{"type": "obstacles", "source": "camera", "seq": 17, "stamp": 12.345, "ids": ["ball"],
 "position": [[2.0,0.3,0.5]], "velocity": [[-0.8,0.0,0.0]], "radius": 0.1, "position_error": 0.01}
{"type": "obstacles", "source": "camera", "seq": 18, "stamp": 12.355, "ids": []}
```
"""

CLOUD = """## Clouds

`cloud`: a depth camera's points, if the cell file has `[clouds]` ([details](sensors.md)).
"""

AFTER_CLOUD = """The nearest of the last thousand joint states, within `time_error` (5 ms), removes the arm's points; without it, the arm stops. Points that are not finite are dropped and counted. Ids such as `voxel 3 -2 14` are reserved.

```json
{"type": "cloud", "source": "depth", "stamp": 12.345, "origin": [2.4,-1.2,1.3],
 "points": [[0.3,-0.7,0.2],[0.31,-0.7,0.2]], "position_error": 0.02}
```
"""

REMOVE = """`remove`: obstacles that left:
"""

JOINTS = """## Joint states

`joints`, as often as possible, from one sender.
"""

AFTER_JOINTS = """A gap longer than `joint_timeout` is a STOP until a reset; old states are dropped.
"""

RESET = """## Reset

`reset` (`armguard reset`) ends latched STOPs whose cause has gone, and forgets [what no message ends](obstacles.md#sources).
"""

AFTER_RESET = """Only a run with `--reset-token` obeys. Several arms need `arm`. A `reset_verdict` answers after the tick's verdict, unless another arm is named or the client lacks the right:
"""

IGNORE = """## Contact that is wanted

`ignore` exempts pairs until a time, in a zone, or both ([Allowing contact](contact.md)). Clients need the right `joints`.
"""

WATCH = """`watch` ends it, without a token:
"""

AFTER_WATCH = """Verdicts answer by `pair_ignored` and `pair_watched`.

```json
{"type": "ignore", "number": 1, "token": "TOKEN", "link": "panda_hand", "ids": "part*",
 "zone": [[0.4,-0.2,0.0],[0.8,-0.2,0.0],[0.4,0.2,0.0],[0.8,0.2,0.0],
          [0.4,-0.2,0.5],[0.8,-0.2,0.5],[0.4,0.2,0.5],[0.8,0.2,0.5]]}
{"type": "watch", "number": 1}
```
"""

VERDICT = """## Verdicts

`verdict`, once per tick. The controller must obey the newest one, and brake without a valid one. A run ends with a STOP.
"""

REASONS = """A reason ([all kinds](reasons.md)):
"""

HELD = """A cause of a held level, from the tick that began it:
"""

CERTIFICATE = """A certificate:
"""

PLANS = """## Plans

`plan`: a motion to rest.
"""

ANSWERS = """`"commit"` needs `motion = "planned"`. A `plan_verdict` answers in the same tick; only the newest plan is judged. The monitor then assumes that the arm follows it. Otherwise the controller follows its present piece to rest.
"""

SHARING = """`"share"` promises other monitors that the arm follows the plan, perhaps late, or stops ([Several arms](several_arms.md#plans-that-are-shared)). It needs `until` and `velocity_tracking_error`, and has no answer.
"""

GOALS = """## Goals

`goal`: what `armguard shield` must do ([Shield](shield.md#as-a-process)), by one of `paths`, `velocity` and `chunk`.
"""

PATHS = """A path:
"""

AFTER_GOALS = f"""A late or incorrect goal is refused, and named in commands; the one before continues. The newest of a tick counts. At most {goal_intake.MOST_PATHS} paths, with {goal_intake.MOST_SAMPLES} timed samples together or {goal_intake.MOST_WAYPOINTS} waypoints, or {goal_intake.MOST_POINTS} points of a chunk are accepted. A velocity counts for {goal_intake.LONGEST_VELOCITY:g} s: repeat it. Paths and chunks are followed to their ends.

```json
{{"type": "goal", "number": 5, "until": 13.0, "names": ["shoulder","elbow"],
 "paths": [{{"q": [[0.0,0.5],[0.4,0.7],[0.8,0.5]]}}]}}
{{"type": "goal", "number": 6, "until": 12.5, "names": ["shoulder","elbow"], "velocity": [0.2,0.0]}}
```
"""

COMMANDS = """## Commands

`command`, after each verdict of `armguard shield`: a proved motion to rest.
"""

AFTER_COMMANDS = f"""Empty `times`: the arm's position is unknown. A controller follows a motion to its end, in any silence, and brakes by `stop`, not by verdicts. It changes to another one only by `take_up_by`, and only within {command.SAME_PLACE:g} rad or m and {command.SAME_VELOCITY:g} rad/s or m/s of the old one.
"""

RECORDED = f"""## In a recording

A [recording](recording.md) is an MCAP file with these topics below `{events.PREFIX}`, as JSON with a schema for each. Messages and calls of an application are stored in the form of this page. `joint_state` also has `now`, the time of its tick. Times are of the monotonic clock, shifted to the time of day at which the recording began.

- Numbers are bit-exact. The strings `"Infinity"`, `"-Infinity"` and `"NaN"` stand for what JSON lacks, although schemas say `number`.
- Lists of lists are written as one list, row by row. A list with one number holds for all rows. Fields that do not apply are absent.
- Metadata `armguard` has format, part, versions, processor, and the [digest of the configuration](safety.md#which-configuration-it-was); `armguard.link` is behind each chunk. The attachments `settings.json` and `robot.json` are what the monitor was made with.
- `scene` shows, ten times a second, the arm's spheres in the colour of the level, and the obstacles: `foxglove.SceneUpdate`.
"""


def write_topics() -> str:
    """What each topic of a recording holds, in Markdown."""
    rows = ["| topic | message |", "|---|---|"]
    for kind, topic in events.TOPICS.items():
        (meaning, *_) = inspect.getdoc(kind).split("\n\n")
        rows.append(f"| `{topic}` | {' '.join(meaning.split())} |")
    return "\n".join(rows) + "\n"


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
    unit = ", ".join(units)
    state = _write_default(default, text) if is_input else ""
    notes = ", ".join(filter(None, (f"{'' if kind == 'string' else kind} {unit}".strip(), state)))
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
        CERTIFICATE,
        write_fields(answers.CertificateMessage),
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
        RECORDED,
        write_topics(),
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
