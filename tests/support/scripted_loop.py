"""A loop whose messages a test writes down, tick by tick."""

import json

from armguard.app.cell import Cell
from armguard.app.loop import Observer, RateLoop
from armguard.app.stepper import Stepper
from armguard.streams import Edge, EdgeSettings, FaultLog

CELL = '[robot]\nname = "panda"\n[sources.camera]\n'
NAMES = [f"panda_joint{number}" for number in range(1, 8)]
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


class Script:
    """An input that says, tick by tick, what a test wrote down."""

    def __init__(self, *ticks):
        self.ended = False
        self._ticks = [list(messages) for messages in ticks]

    def receive(self):
        if not self._ticks:
            self.ended = True
            return None
        if self._ticks[0]:
            return json.dumps(self._ticks[0].pop(0)).encode()
        self._ticks.pop(0)
        return None

    def close(self):
        pass


def joints(stamp, **changes):
    return {"type": "joints", "stamp": stamp, "names": NAMES, "q": READY, "v": [0] * 7, **changes}


def ball(stamp, x=9.0, **changes):
    position = [[x, 0.0, 0.5]]
    message = {"type": "obstacles", "source": "camera", "stamp": stamp, "ids": ["ball"]}
    return {**message, "position": position, "velocity": [[0, 0, 0]], "radius": 0.1, **changes}


def make_loop(script, clock, publish, text=CELL, answers=None, rest=None, **options):
    robot, obstacles, monitor = Cell.from_text(text).build()
    faults = FaultLog(clock.now, lambda line: None)
    edge = Edge(
        obstacles, robot.joints, clock, faults, EdgeSettings(monotonic=clock.now, **options)
    )

    def answer(number, verdict):
        if answers is not None:
            answers.append((number, verdict))

    observer = Observer()
    if rest is not None:
        observer.rest = rest
    stepper = Stepper(monitor, edge, answer)
    return RateLoop(stepper, edge, [script], clock, publish, answer, [observer])
