"""What taking in messages about obstacles costs, and what that is of a second of scene.

    python benchmarks/bench_intake.py [--rows 1 100] [--kinds clean order] [--obstacles 1000] …

First, one message of so many rows: the time of `Obstacles.update`, per message and per row, with
the tests of acceptance, under a certificate that rests on each row (what a monitor that evaluates
them leaves behind). Kinds of messages:

- clean: arrays of NumPy, one number for all in the other fields, ids in the order of before;
- read: the same with strings of their own, as they come from a decoder;
- each: one number for each row in every field;
- frame: in a frame that is not the world's;
- boxes: eight points a row;
- still: without velocities;
- refused: one row in ten is a metre off;
- order: ids in another order in each message;
- lists: nested lists in place of arrays;
- packed, JSON: over the wire, from the bytes of the message to the table, decoding included.

Then, per second of scene: a Panda works at 1 kHz amid balls that wander about a hall, all of which
are measured in one message at 10, 30 or 100 Hz; what armguard and the sweeps of
`bench_schedules.py` spend on messages and on ticks, in milliseconds, and the tick of armguard that
follows a message, which takes in what has changed, beside the others. The sweeps take what they
are told, whatever it is, and keep nothing of before.

Times are of one core. Those of messages are medians, with the 99 % beside them, and the least of
all in a column of its own: on a machine that does other things besides it says most.
"""

from __future__ import annotations

import argparse
import gc
import time

import msgspec
import numpy as np

from armguard.obstacles import Frame, Obstacles
from armguard.obstacles.table import clear_changed_rows, copy_state
from armguard.robot import Robot
from armguard.streams.edge import Edge, EdgeSettings
from armguard.streams.faults import FaultLog
from scene.crowds import RATE, Crowd, Work
from scene.machine import describe_machine
from scene.rivals import Sweep, Watch

KINDS = (
    *("clean", "read", "each", "frame", "boxes", "still"),
    *("refused", "order", "lists", "packed", "JSON"),
)
INTERVAL = 0.01  # between messages, [s]
FIELDS = {"radius": 0.05, "position_error": 0.005, "velocity_error": 0.05}
CORNERS = np.array([[x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)])
CONTESTANTS = (
    ("armguard", Watch, ("deadline", "joint")),
    ("sweep, spheres", Sweep, ("spheres",)),
    ("sweep, reach", Sweep, ("reach",)),
)


class ManualClock:
    """A clock that is set."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """What it was set to, in [s]."""
        return self._now

    def sleep_until(self, deadline: float) -> None:
        """Set it, in [s]."""
        self._now = deadline


class Wire:
    """One message at a time, from memory."""

    ended = False
    message: bytes | None = None

    def receive(self) -> bytes | None:
        """The message, once."""
        message, self.message = self.message, None
        return message

    def close(self) -> None:
        """There is nothing to close."""


class Intake:
    """A table that takes messages of one kind, and how long that takes."""

    def __init__(self, kind: str, rows: int, seed: int = 0) -> None:
        self._kind, self._random = kind, np.random.default_rng(seed)
        self._obstacles = Obstacles(
            sources=["crowd"], frames={"camera": Frame(np.eye(3), [0.0, 0.0, 1.0], 0.001)}
        )
        self._ids = [f"ball-{row}" for row in range(rows)]
        self._position = self._random.uniform(-3.0, 3.0, (rows, 3))
        self._velocity = self._random.uniform(-0.1, 0.1, (rows, 3))
        self._clock, self._wire, self._time = ManualClock(), Wire(), 0.0
        faults = FaultLog(self._clock.now, lambda line: None)
        clock = self._clock.now
        settings = EdgeSettings(monotonic=clock)
        self._edge = Edge(self._obstacles, ["a"], self._clock, faults, settings)
        self.take()
        table = self._obstacles.table
        for row in range(rows):
            copy_state(table.accepted, row, table.reference_states, row)
        clear_changed_rows(table.changed_rows)

    def take(self) -> int:
        """Take in the next message; how long that took, in [ns]."""
        self._time += INTERVAL
        self._clock.sleep_until(self._time)
        kind, rows = self._kind, len(self._ids)
        ids, velocity = self._ids, self._velocity
        position = self._position + velocity * self._time
        fields = dict(FIELDS, source="crowd")
        if kind in ("read", "refused"):
            ids = ["".join(id) for id in ids]
        if kind == "refused":
            position[self._random.random(rows) < 0.1] += 1.0
        if kind == "order":
            order = self._random.permutation(rows)
            ids, position, velocity = [ids[i] for i in order], position[order], velocity[order]
        if kind == "boxes":
            position = position[:, None] + CORNERS
            velocity = np.repeat(velocity[:, None], len(CORNERS), axis=1)
        if kind == "each":
            fields |= {name: np.full(rows, value) for name, value in FIELDS.items()}
            fields |= {"accel": np.full(rows, 10.0), "speed": np.full(rows, 2.0)}
        if kind == "frame":
            fields["frame"] = "camera"
        if kind == "still":
            velocity = None
        if kind in ("lists", "JSON"):
            position, velocity = position.tolist(), velocity.tolist()
        if kind == "packed":
            position, velocity = position.tobytes(), velocity.tobytes()
        encode = {"packed": msgspec.msgpack.encode, "JSON": msgspec.json.encode}.get(kind)
        if encode is None:
            begin = time.perf_counter_ns()
            self._obstacles.update(ids, self._time, position, velocity, **fields)
            end = time.perf_counter_ns()
        else:
            head = {"type": "obstacles", "ids": ids, "stamp": self._time}
            self._wire.message = encode(
                {**head, "position": position, "velocity": velocity, **fields}
            )
            begin = time.perf_counter_ns()
            self._edge.drain([self._wire])
            end = time.perf_counter_ns()
        refused = len(self._obstacles.take_faults())
        if refused and kind != "refused":
            raise SystemExit(f"{kind}: {refused} rows of a clean message were refused")
        return end - begin


def time_messages(options) -> None:
    """Print what messages of each kind and size cost."""
    columns = ("rows", "µs, least", "median", "p99", "ns a row, least", "median")
    print(f"\n{'kind':<10}" + "".join(f"{title:>16}" for title in columns))
    for kind in options.kinds:
        for rows in options.rows:
            intake = Intake(kind, rows)
            gc.collect()
            gc.disable()
            took = np.array([intake.take() for _ in range(_count_messages(rows, options))])
            gc.enable()
            took = took[len(took) // 5 :]
            least, middle, high = took.min(), np.median(took), np.quantile(took, 0.99)
            cells = [f"{rows:,}", *(f"{value / 1e3:,.1f}" for value in (least, middle, high))]
            cells += [f"{value / rows:,.0f}" for value in (least, middle)]
            print(f"{kind:<10}" + "".join(f"{cell:>16}" for cell in cells), flush=True)


def _count_messages(rows: int, options) -> int:
    return max(30, min(options.messages, 200_000 // rows))


def time_scene(count: int, rate: float, work: Work, options) -> None:
    """Print what a second of scene costs with so many balls, measured at a rate in [Hz]."""
    every = round(RATE / rate)
    crowd = Crowd(count, work.find_clearance(every / RATE), rate)
    rows = slice(0, count)
    for name, make, arguments in CONTESTANTS:
        contestant = make(work, count, *arguments)
        messages, after, others, evaluations, stops = [], [], [], [], 0
        gc.collect()
        gc.disable()
        for tick in range(len(work.q)):
            stamp = tick / RATE
            is_measured = tick % every == 0
            if is_measured:
                position, velocity = crowd.sample(rows, stamp)
                begin = time.perf_counter_ns()
                contestant.update(rows, crowd.names, stamp, position, velocity)
                messages.append(time.perf_counter_ns() - begin)
            state = stamp, work.q[tick], work.v[tick], float(work.stop_time[tick])
            begin = time.perf_counter_ns()
            contestant.step(*state)
            (after if is_measured else others).append(time.perf_counter_ns() - begin)
            answer = contestant.read()
            evaluations.append(answer.evaluations)
            stops += not answer.go
        gc.enable()
        first = options.warm
        after, others = after[round(first / every) :], others[first - round(first / every) :]
        messages = messages[round(first / every) :]
        # Medians stand for what a second costs: the machine does other things besides.
        intake = 1e-6 * rate * np.median(messages)
        ticks = 1e-6 * (rate * np.median(after) + (RATE - rate) * np.median(others))
        cells = [f"{count:,}", f"{rate:g}", f"{intake:,.2f}", f"{ticks:,.2f}"]
        cells += [f"{intake + ticks:,.2f}", f"{np.median(after) / 1e3:,.1f}"]
        cells += [f"{np.median(others) / 1e3:,.1f}", f"{np.quantile(others, 0.99) / 1e3:,.1f}"]
        cells += [f"{np.mean(evaluations[first:]):,.1f}", f"{stops}"]
        print(f"{name:<16}" + "".join(f"{cell:>12}" for cell in cells), flush=True)


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="*", default=[1, 9, 100, 1000, 10_000])
    parser.add_argument("--kinds", choices=KINDS, nargs="+", default=KINDS)
    parser.add_argument("--messages", type=int, default=2000, help="most of each kind and size")
    parser.add_argument("--obstacles", type=int, nargs="*", default=[10, 1000, 10_000])
    parser.add_argument("--rates", type=float, nargs="+", default=[10.0, 30.0, 100.0])
    parser.add_argument("--seconds", type=float, default=3.0, help="of scene, that count")
    parser.add_argument("--warm", type=int, default=1000, help="ticks before that")
    parser.add_argument("--speed", type=float, default=0.1, help="share of the joints' limits")
    options = parser.parse_args(arguments)
    print(describe_machine())
    if options.rows:
        time_messages(options)
    if options.obstacles:
        ticks = options.warm + round(RATE * options.seconds)
        work = Work(Robot.load("panda"), ticks, options.speed)
        columns = ("obstacles", "Hz", "intake ms/s", "ticks ms/s", "sum", "after µs", "others µs")
        columns += ("p99", "evaluated", "stops")
        print(f"\n{'per second':<16}" + "".join(f"{title:>12}" for title in columns))
        for count in options.obstacles:
            for rate in options.rates:
                time_scene(count, rate, work, options)


if __name__ == "__main__":
    main()
