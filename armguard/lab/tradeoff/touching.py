"""Balls that touch the arm within their bounds, so that a setting can miss a contact.

The arm ignores verdicts and its path is known, so each ball moves to the future place of a corner
of the arm. Its accelerations and speeds are far below the bounds that tables of obstacles assume.
No monitor can prevent these contacts; its verdicts before them count.
"""

from __future__ import annotations

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.lab.tradeoff.scene import Notebook, Scene, Site
from armguard.lab.tradeoff.truth import TrueArm

Array = NDArray[np.float64]

RATE, SOURCE = 100.0, "touching"
"""Messages a second, and who sends them where a cell names no source."""

RADIUS, AWAY = 0.05, 1.5
"""Of the balls, and how far off they wait, in [m]."""

APPROACH, STAY = 2.5, 0.2
"""Of their way to the arm, and back, and of their time there, in [s]."""


def add_touching(scene: Scene, site: Site, count: int, seed: int) -> str:
    """Let balls touch the arm, one after the other; returns a name for them.

    Args:
        scene: Is told of them.
        site: Where, and by what arm.
        count: How many balls.
        seed: Of the links that they touch, and of the sides that they come from.
    """
    random = np.random.default_rng(seed)
    arm = TrueArm(site.robot, site.base)
    ways = []
    for number in range(count):
        time = scene.seconds * (number + 1) / (count + 1)
        arm.place(scene.sample(time)[0])
        corners = arm.corners(int(random.integers(len(arm.links) // 2, len(arm.links))))
        touched = corners[random.integers(len(corners))]
        outward = touched - site.base.translation
        outward[2] = 0.0
        outward += random.normal(0.0, 0.3, 3)
        waits = touched + AWAY * outward / np.linalg.norm(outward)
        ways.append((time, waits, touched))
    ids = tuple(f"touching-{number}" for number in range(count))
    source = site.sources[0] if site.sources else SOURCE
    notebook = Notebook(scene.messages, 0.0, pinocchio.SE3.Identity(), source)
    for tick in range(round(scene.seconds * RATE) + 1):
        states = [find_state(tick / RATE - time, *ends) for time, *ends in ways]
        places, paces = (np.array([state[part] for state in states]) for part in (0, 1))
        notebook.update(ids, tick / RATE, places, paces, radius=RADIUS)
    scene.messages.sort(key=lambda message: message.stamp)
    return f"{count} balls that touch it"


def find_state(since: float, waits: Array, touched: Array) -> tuple[Array, Array]:
    """Where a ball is and how fast: a quintic from rest to rest, and the same way back.

    Args:
        since: Time since it arrives where it touches, in [s]; negative before.
        waits: Where it comes from, in [m]. Shape (3,).
        touched: Where it goes, in [m]. Shape (3,).
    """
    back = since > STAY
    share = 1.0 - (since - STAY) / APPROACH if back else 1.0 + since / APPROACH
    u = min(max(share, 0.0), 1.0)
    way = touched - waits
    pace = 30.0 * u * u * (1.0 - u) ** 2 / APPROACH * (-1.0 if back else 1.0)
    place: Array = waits + u**3 * (10.0 - 15.0 * u + 6.0 * u * u) * way
    return place, pace * way
