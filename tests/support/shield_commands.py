"""Commands as a shield sends them: the first joint goes from rest to rest."""

import time

import numpy as np

from armguard.drivers.motion import QUIET
from armguard.messages.command import CommandMessage, pack

NAMES = tuple("abcdef")
HOME = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
DURATION, SPEED = 1.0, 0.4


class Pauses:
    """Waits between goals until a driver takes the next one, also after a fault."""

    def __init__(self):
        self._sent = time.monotonic()

    def wait(self):
        time.sleep(max(0.0, self._sent + 1.5 * QUIET - time.monotonic()))
        self._sent = time.monotonic()


def move(t):
    """Where the first joint is on its way from rest to rest, and how fast."""
    u = np.clip(t / DURATION, 0.0, 1.0)
    return (
        SPEED * DURATION * (u - np.sin(2 * np.pi * u) / (2 * np.pi)),
        SPEED * (1 - np.cos(2 * np.pi * u)),
        SPEED * 2 * np.pi / DURATION * np.sin(2 * np.pi * u),
    )


def command(stamp, sequence=1, goal=2, begun=None, names=NAMES, home=HOME, size=1.0, **changes):
    """The rest of the motion that began at `begun`, as a command of a later tick has it.

    `size` is how many times as far it goes.
    """
    begun = stamp if begun is None else begun
    times = np.linspace(0.0, max(DURATION - (stamp - begun), 0.01), 200)
    way, speed, accel = move(times + stamp - begun)
    rows = [np.zeros((len(times), len(home))) for _ in range(3)]
    for row, values in zip(rows, (way, speed, accel), strict=True):
        row[:, 0] = size * values
    rows[0] += home
    order = [NAMES.index(name) for name in names] if set(names) == set(NAMES) else range(len(home))
    q, v, a = (pack(row[:, order]) for row in rows)
    fields = {
        "sequence": sequence,
        "stamp": stamp,
        "take_up_by": stamp + 0.01,
        "valid_until": begun + DURATION,
        "names": list(names),
        "times": pack(times),
        "q": q,
        "v": v,
        "a": a,
        "moving": True,
        "scale": 1.0,
        "progress": 0.0,
        "executed": 0,
        "stop": None,
        "reason": None,
        "contact_speed": None,
        "goal": goal,
        "refused": None,
        "problem": "",
        "run": "first",
    }
    return CommandMessage(**(fields | changes))
