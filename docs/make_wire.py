"""The page about the wire: `python docs/make_wire.py` writes docs/wire.md.

Tables of fields are made of the classes in armguard/messages: what a field is called,
its type, whether it may be left out, and the text that stands below it.
"""

from __future__ import annotations

import ast
import inspect
import itertools
from pathlib import Path

from armguard.messages import answers, command, incoming, reasons
from armguard.recording import events
from armguard.streams import SourceLimits, addresses, goal_intake, inputs
from armguard.verdict import ReasonKind

PAGE = Path(__file__).resolve().parent / "wire.md"

TYPES = {
    "str": "string",
    "str | None": "string or nil",
    "bool": "boolean",
    "int": "integer",
    "int | None": "integer or nil",
    "Number": "integer, 0 to 2⁶³ − 1",
    "Number | None": "integer, 0 to 2⁶³ − 1, or nil",
    "float": "number",
    "float | None": "number or nil",
    "list[str]": "strings",
    "str | list[str] | None": "string, or strings, one a row, or nil",
    "list[float]": "numbers",
    "list[GoalPath] | None": "list of paths, or nil",
    "bytes | list[float]": "numbers",
    "bytes | list[float] | None": "numbers, or nil",
    "Points": f"n rows of 3 numbers, or of 1 to {incoming.POINT_LIMIT} such points",
    "Points | None": "as of `position`, or nil",
    "Cloud": "rows of 3 numbers",
    "tuple[float, float, float]": "3 numbers",
    "bytes | list[bool] | None": "booleans, one a point, or nil",
    "Rows": "rows of numbers",
    "Rows | None": "rows of numbers, or nil",
    "Values": "number, or one a row",
    "Values | None": "number, or one a row, or nil",
    "Literal['commit', 'share']": '`"commit"` or `"share"`',
    "Literal['finish', 'brake'] | None": '`"finish"`, `"brake"` or nil',
    "list[ReasonMessage]": "list of reasons",
    "CertificateMessage | None": "certificate or nil",
    "HeldMessage | None": "cause or nil",
    "ReasonMessage | None": "reason or nil",
    "Figure": "number",
    "list[Figure]": "numbers",
    "list[tuple[Figure, Figure, Figure]]": "rows of 3 numbers",
}
"""What the types in the schemas are called; one that is not here has no name yet."""

HEAD = f"""# The wire

<!-- written by docs/make_wire.py from armguard/messages: change it there -->

The processes of a cell exchange messages over ZeroMQ sockets. `armguard run`, or `armguard shield`, binds; all others connect. So processes can start in any order and restart.

| socket | of the monitor | of yours | default address | option of `armguard run` |
|---|---|---|---|---|
| obstacles | SUB, bound | PUB | `{addresses.OBSTACLES_ADDRESS}` | `--obstacles` |
| joint states, plans and goals | SUB, bound | PUB | `{addresses.JOINTS_ADDRESS}` | `--joints` |
| verdicts, commands and answers | PUB, bound | SUB | `{addresses.VERDICTS_ADDRESS}` | `--verdicts` |

Both inputs take every type of message, and can be one address. With `--obstacles -` the monitor reads one JSON object a line from standard input, joint states too; the only socket is then that of the verdicts.

Addresses are `ipc://` or TCP of this machine. Others need keys in the cell file; then all sockets of the monitor are CURVE servers that ask for them ([Keys](keys.md)).

## Messages

Each message is one part: a msgpack map, or a JSON object with the same fields; the first byte tells them apart. Verdicts, commands and answers are msgpack, or JSON for all readers with `armguard run --json-verdicts`; armguard's own readers take both.

- `type` names the message. Unknown fields are refused, missing ones are named.
- In msgpack, arrays of numbers may be lists, or packed little-endian float64 in a `bin`, row by row; those of commands are packed. A field that can be nil, null in JSON, can be left out.
- JSON has no infinite numbers. In verdicts {answers.GREATEST!r}, the greatest number, stands for them. NaN, such as the stamp of a joint state without one, is NaN in msgpack and null in JSON. Any number of a verdict or an answer can be NaN. Obey the level first: a STOP counts whatever its numbers are. A `valid_until` that is NaN has expired, a `speed_scale` that is NaN is 0. Infinite bounds can be sent in msgpack only.
- Stamps are seconds of the machine's monotonic clock (`CLOCK_MONOTONIC`, Python's `time.monotonic()`, C++'s `std::chrono::steady_clock` on Linux), unless the cell file names another clock for the source: `unix` (seconds since 1970), or `arrival` for a sender without a usable clock.
- Lengths are metres, angles radians, times seconds. The rest follows: m/s, m/s², rad/s.
- `seq` counts the messages of one source, by 1. A gap counts as lost messages, a step back as a sender that restarted, and two tracks that both go on as two senders. None is a STOP by itself: obstacles that are not reported grow with their bounds.

What is refused is counted by kind and source, printed on standard error, and in the summary of the run. If obstacles may be missing because of it, the verdict says so. One source can send {SourceLimits().message_rate:g} messages a second of {SourceLimits().message_size} bytes and have {SourceLimits().obstacles} obstacles, and a cloud {SourceLimits().points} points, unless the cell file says less. An input takes {inputs.CONNECTION_LIMIT} connections. One beyond that is shut out within a tick, and counted under `connections`, until another one has ended. A connection counts before its key is known, so strangers can take the place of a driver that has lost its connection, which is a STOP: keep them away by a firewall. A tick takes 64 messages from an input, fairly from all connections, and no more than fit into half of its period; the rest waits. Each connection holds at most {inputs.WAITING_BYTES // 2**20} MiB of waiting messages.

Complete nodes without armguard's library, which the tests run: [perception.py](nodes/perception.py) and [controller.py](nodes/controller.py) (pyzmq), [perception.cpp](nodes/perception.cpp) (cppzmq), and [lines.cpp](nodes/lines.cpp), which needs no socket. In Python with armguard, `armguard.streams.Publisher` and `VerdictReader` send and receive all of it.
"""

OBSTACLES = """## Obstacles

`{"type": "obstacles", …}`: what one source saw at one time, as `Obstacles.update` takes it.
"""

AFTER_OBSTACLES = """- *Heartbeat*: a message with `ids` empty says that the source has nothing new. A source that has sent once, and one that the cell file requires, must send at least every `source_timeout` (0.2 s), or it is a STOP.
- *Snapshot*: with `snapshot` the obstacles of this source that are not in `ids` are removed. Without it they stay, and grow with their bounds.
- An id belongs to its source: of two sources that use one id, each has an obstacle of its own.
- All rows of a message have as many points; bodies of different kinds go in messages of their own.

```json
{"type": "obstacles", "source": "camera", "seq": 17, "stamp": 12.345, "ids": ["ball"],
 "position": [[2.0, 0.3, 0.5]], "velocity": [[-0.8, 0.0, 0.0]], "radius": 0.1, "position_error": 0.01}
{"type": "obstacles", "source": "camera", "seq": 18, "stamp": 12.355, "ids": []}
```
"""

CLOUD = """## Clouds

`{"type": "cloud", …}`: what a depth camera measured, as `Obstacles.update_cloud` takes it. The cell file needs `[clouds]`. [Entrances and clouds](sensors.md) says what becomes of points and what that costs.
"""

AFTER_CLOUD = """- The monitor takes out the points of the arm, by the joint state nearest to the cloud in time. If none of the last thousand is within `time_error` of it (`[clouds]`, 5 ms), all points count, and the arm stops because of its own picture.
- Points that are not finite are left out, counted and reported.
- A source sends clouds, or obstacles: one that does both uses no ids of the form `voxel 3 -2 14`, which are refused.

```json
{"type": "cloud", "source": "depth", "seq": 4, "stamp": 12.345, "origin": [2.4, -1.2, 1.3],
 "points": [[0.3, -0.7, 0.2], [0.31, -0.7, 0.2]], "position_error": 0.02}
```
"""

REMOVE = """## Remove

`{"type": "remove", …}`: these obstacles have left the cell.
"""

JOINTS = """## Joint states

`{"type": "joints", …}`, as often as the controller can, from one sender.
"""

AFTER_JOINTS = """A gap between joint states longer than `joint_timeout` is a STOP until a reset. Until the first fresh one comes, older ones are dropped as a backlog, and the verdict is STOP.
"""

RESET = """## Reset

`{"type": "reset", …}` ends a latched STOP once its cause has gone; a cause that persists latches again at once. It also forgets [what no message can end](obstacles.md#sources), such as the silence of a mistyped source. `armguard reset` sends it, with `--arm` in a cell with several arms: the monitors of the others leave it alone.
"""

AFTER_RESET = """A run without `--reset-token` obeys no reset. With several arms, a reset must name an arm of the cell. What was not obeyed is counted. A reset with a `number` gets one answer, `{"type": "reset_verdict", …}`, on the socket of the verdicts, after the verdict of the tick in which it came. One that names another arm of the cell, or whose client may not send it, gets none.
"""

IGNORE = """## Contact that is wanted

`{"type": "ignore", …}`: from the next tick on, what fits is not watched for the time being, until a time, in a zone, or both; [Allowing contact](contact.md) says when it is watched all the same. One of `until` and `zone` must be there. It needs the token that `armguard run --reset-token` was given and, where there are keys, the right `joints`.
"""

WATCH = """`{"type": "watch", …}` ends it before its time, and needs no token.
"""

AFTER_WATCH = """The answer is in the notes of the verdicts that follow: `pair_ignored` says what is not watched, `pair_watched` why an exempt pair is. What is refused, such as a time in the past or an unknown link, is counted as `ignore refused` and printed on standard error.

```json
{"type": "ignore", "number": 1, "token": "TOKEN", "link": "panda_hand", "ids": "part*", "until": 15.0,
 "zone": [[0.4, -0.2, 0.0], [0.8, -0.2, 0.0], [0.4, 0.2, 0.0], [0.8, 0.2, 0.0],
          [0.4, -0.2, 0.5], [0.8, -0.2, 0.5], [0.4, 0.2, 0.5], [0.8, 0.2, 0.5]]}
{"type": "watch", "number": 1}
```
"""

VERDICT = """## Verdicts

`{"type": "verdict", …}`, once a tick. The controller must obey the newest one, and brake if none is valid. When a run ends, its last verdict is a STOP.
"""

REASONS = """A reason is a map:
"""

HELD = """A level that is held, although its tick alone would give a higher one, has a cause, a map:
"""

CERTIFICATE = """A certificate is a map:
"""

PLANS = """## Plans

`{"type": "plan", …}`: what the controller will do, and what it asks. The cell file needs `motion = "planned"` in `[monitor]`.
"""

ANSWERS = """Both kinds end at rest. Each plan that has these fields gets one answer, `{"type": "plan_verdict", …}`, on the socket of the verdicts, in the tick in which it came. Of several that come in one tick the newest is judged; the others are refused for that.
"""

SHARING = """**A plan that is shared** (`"ask": "share"`) is a promise to the monitors of the other arms of the cell: until `until` the arm does nothing but follow it, on time or slower, or stop ([Several arms](several_arms.md#plans-that-are-shared)). It needs `until` and `velocity_tracking_error`, no `motion = "planned"`, and gets no answer. An incorrect one is counted as `plan refused`, and narrows nothing.
"""

GOALS = """## Goals

`{"type": "goal", …}`: what `armguard shield` must do from now on, in place of the goal before ([Shield](shield.md#as-a-process)). A monitor without a shield refuses it.
"""

PATHS = """A path is a map:
"""

AFTER_GOALS = f"""Exactly one of `paths`, `velocity` and `chunk` must be there. A goal that is late or incorrect is refused: the one before goes on. It is counted as `goal refused`, printed on standard error, and named in the commands that follow (`refused`, `problem`). Of several in one tick the newest counts. A goal has {goal_intake.MOST_PATHS} paths at most, which have {goal_intake.MOST_SAMPLES} samples together where they have times, and {goal_intake.MOST_WAYPOINTS} waypoints where they have none; a chunk has {goal_intake.MOST_POINTS} points at most. A velocity counts for {goal_intake.LONGEST_VELOCITY:g} s at most: send it again and again; zeros bring the arm to rest. A path and a chunk are followed to their ends, even if the caller is silent.

```json
{{"type": "goal", "number": 5, "until": 13.0, "names": ["shoulder", "elbow"],
 "paths": [{{"q": [[0.0, 0.5], [0.4, 0.7], [0.8, 0.5]]}}]}}
{{"type": "goal", "number": 6, "until": 12.5, "names": ["shoulder", "elbow"], "velocity": [0.2, 0.0]}}
```
"""

COMMANDS = """## Commands

`{"type": "command", …}`, once a tick of `armguard shield`, after the verdict: the motion that the arm must follow to its rest. It was proved as a whole.
"""

AFTER_COMMANDS = f"""A controller follows one motion at a time, to its end, even if all else is silent. It takes up another one if both hold; otherwise it goes on along its own:

- It comes in time, by `take_up_by`.
- It joins: at that time it has the arm within {command.SAME_PLACE:g} rad or m, and {command.SAME_VELOCITY:g} rad/s or m/s, of where the motion before has it. So a motion that continues a lost one is not taken up.

The controller need not obey the verdict of the same tick: `stop` of the command says when to brake.
"""

TAIL = """A controller of committed pieces asks for the next piece during the present one. If the answer is no, or does not come, it follows the present one to its end, at rest.

```python
from armguard.streams import Publisher, VerdictReader


def ask(publisher: Publisher, reader: VerdictReader, stamp, names, times, q, v) -> bool:
    number = publisher.plan("commit", stamp, names, times, q, v, tracking_error=0.01)
    answer = reader.answer(number, timeout=0.01)
    return answer is not None and answer.safe
```
"""

RECORDED = f"""## In a recording

A [recording](recording.md) is an MCAP file with these topics below `{events.PREFIX}`, as JSON with a schema for each. Messages of this page stand as on the wire, calls of an application as the same messages. `joint_state` has the time of its tick besides, `now`. Times are the machine's monotonic clock, moved to the time of day at which the recording began.

- Numbers are read back to the bit. The strings `"Infinity"`, `"-Infinity"` and `"NaN"` stand for what JSON lacks, although schemas say `number`.
- Lists of lists are written as one list, row by row. A list with one number holds for all rows. Fields that do not apply are left out.
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


def write_table(schema: type) -> str:
    """The fields of a message, in Markdown."""
    rows = ["| field | type | meaning |", "|---|---|---|"]
    is_sent_whole = not issubclass(schema, incoming.Message | incoming.GoalPath)  # by the monitor
    for name, words, default, text in read_fields(schema):
        optional = f", optional{_write_default(default)}" if default and not is_sent_whole else ""
        rows.append(f"| `{name}` | {words}{optional} | {text} |")
    return "\n".join(rows) + "\n"


def _write_default(default: str) -> str:
    """What a field that is left out stands for, where that is a value."""
    known = {"None": "", "[]": ": no rows", "False": ": false", "0.0": ": 0"}
    return known.get(default, f": `{default.replace(chr(39), chr(34))}`")


def write_page() -> str:
    """The page, in Markdown."""
    kinds = ", ".join(f"`{kind.name.lower()}`" for kind in ReasonKind)
    parts = [
        HEAD,
        OBSTACLES,
        write_table(incoming.ObstaclesMessage),
        AFTER_OBSTACLES,
        CLOUD,
        write_table(incoming.CloudMessage),
        AFTER_CLOUD,
        REMOVE,
        write_table(incoming.RemoveMessage),
        JOINTS,
        write_table(incoming.JointsMessage),
        AFTER_JOINTS,
        RESET,
        write_table(incoming.ResetMessage),
        AFTER_RESET,
        write_table(answers.ResetVerdictMessage),
        IGNORE,
        write_table(incoming.IgnoreMessage),
        WATCH,
        write_table(incoming.WatchMessage),
        AFTER_WATCH,
        VERDICT,
        write_table(answers.VerdictMessage),
        REASONS,
        write_table(reasons.ReasonMessage),
        f"Kinds: {kinds}. [Reasons](reasons.md) says what to do about each.\n",
        HELD,
        write_table(answers.HeldMessage),
        CERTIFICATE,
        write_table(answers.CertificateMessage),
        PLANS,
        write_table(incoming.PlanMessage),
        ANSWERS,
        write_table(answers.PlanVerdictMessage),
        SHARING,
        TAIL,
        GOALS,
        write_table(incoming.GoalMessage),
        PATHS,
        write_table(incoming.GoalPath),
        AFTER_GOALS,
        COMMANDS,
        write_table(command.CommandMessage),
        AFTER_COMMANDS,
        RECORDED,
        write_topics(),
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
