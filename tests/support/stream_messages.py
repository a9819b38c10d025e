"""What the tests of streams share: messages, and a table behind an edge with clocks of the test."""

import msgspec
import numpy as np

from armguard.obstacles import Frame, Obstacles
from armguard.streams import Edge, EdgeSettings, FaultLog
from armguard.streams.other_arm_intake import OtherArm
from support.manual_clock import ManualClock

JOINTS = ["shoulder", "elbow"]
MONOTONIC = 1000.0
UNIX = 1.7e9


class Messages:
    """An input that hands out what a test puts in."""

    def __init__(self, *messages):
        self.ended = False
        self.waiting = [pack(message) for message in messages]

    def receive(self):
        return self.waiting.pop(0) if self.waiting else None

    def close(self):
        pass


class World:
    """An edge between messages and a table, with clocks that the test sets."""

    def __init__(self, clock=None, bounds=(), sources=None, **options):
        self.clock = ManualClock(5.0) if clock is None else clock
        self.lines = []
        self.faults = FaultLog(self.clock.now, self.lines.append)
        frames = {"camera": Frame(np.eye(3), [1.0, 0.0, 0.0], 0.01)}
        self.obstacles = Obstacles(frames=frames, bounds=bounds, sources=sources)
        self.input = Messages()
        clocks = {
            "monotonic": lambda: self.clock.now() + MONOTONIC,
            "unix": lambda: self.clock.now() + UNIX,
        }
        self.edge = Edge(
            self.obstacles, JOINTS, self.clock, self.faults, EdgeSettings(**(clocks | options))
        )

    def send(self, *messages):
        self.input.waiting += [pack(message) for message in messages]
        self.edge.drain([self.input])

    def stamp(self, id="a"):
        return self.obstacles.table.accepted.stamp[self.obstacles.row(id)]

    def kinds(self):
        return sorted({key.kind for key in self.faults.counts})


def pack(message):
    return message if isinstance(message, bytes) else msgspec.msgpack.encode(message)


def obstacles(**changes):
    message = {
        "type": "obstacles",
        "source": "cam0",
        "seq": 1,
        "stamp": MONOTONIC + 5.0,
        "ids": ["a"],
        "position": [[1.0, 2.0, 3.0]],
        "velocity": [[0.0, 0.0, 0.5]],
        "radius": 0.1,
    }
    message.update(changes)
    return {key: value for key, value in message.items() if value is not ...}


def joints(**changes):
    message = {
        "type": "joints",
        "stamp": MONOTONIC + 5.0,
        "names": ["elbow", "gripper", "shoulder"],
        "q": [2.0, 9.0, 1.0],
        "v": [0.2, 0.9, 0.1],
    }
    message.update(changes)
    return {key: value for key, value in message.items() if value is not ...}


class HeldUpClock(ManualClock):
    """The process is held up after each reading, as long as is written down; then not at all."""

    def __init__(self, *holds):
        super().__init__(5.0)
        self.holds = list(holds)
        self.readings = []

    def now(self):
        reading = super().now()
        self.readings.append(reading)
        if self.holds:
            self.sleep_until(reading + self.holds.pop(0))
        return reading


def make_held_up_world(**options):
    clock = HeldUpClock()
    true_time = lambda: ManualClock.now(clock)  # noqa: E731  # the readings of others take no time
    offsets = {"monotonic": lambda: true_time() + MONOTONIC, "unix": lambda: true_time() + UNIX}
    world = World(clock, **(offsets | options))
    clock.readings.clear()
    return world


def two_arms(**options):
    told = []
    other = OtherArm(
        ["base", "tip"], lambda *state: told.append(state), lambda *plan: told.append(plan)
    )
    return World(arm="left", others={"right": other}, **options), told


def plan(**changes):
    still = [[0.0, 0.0]] * 2
    message = {"type": "plan", "ask": "commit", "number": 3, "stamp": MONOTONIC + 5.0}
    message |= {"names": ["shoulder", "elbow"], "times": [0.0, 1.0], "q": still, "v": still}
    return message | {"tracking_error": 0.01} | changes


ZONE = [[x, y, z] for x in (0.4, 0.8) for y in (-0.2, 0.2) for z in (0.0, 0.5)]
