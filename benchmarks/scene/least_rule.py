"""The least that a rule can stop an arm which trusts people to keep their bounds, and no more.

It knows to the micrometre how the arm goes on and how it stops, has no errors, and says STOP only
where a person who moves on from what was measured of them, within the bounds, could touch a link
that moves. A rule that says go on then is right by luck alone. So what stops less than this is not
right for all that people may do, whatever it knows of the arm; and what armguard stops more is what
its errors and its bounds on the arm cost.
"""

from __future__ import annotations

import copy
import math
import time
from typing import Any

import numpy as np

from armguard.jit import kernel
from scene.clearance import Leaves, nearest_on_segment
from scene.recorded_people import NAMES, RADII, People
from scene.stop_rules import Moment, Rule

STEP = 4e-3
"""Between instants at which a touch is looked for, in [s]; those between are left out."""


class LeastRule(Rule):
    """Says STOP only where it must."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._leaves = Leaves(self.robot)

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""
        stream = people.streams[self.setting.bounds, self.clean]
        count, bodies = len(people.ends), len(NAMES)
        self._sent = stream.sent
        self._ends = np.zeros((count, bodies, 2, 3))
        self._velocities = np.zeros((count, bodies, 2, 3))
        self._bounds = np.zeros((bodies, 2))
        for frame, calls in enumerate(stream.messages):
            for call in calls:
                rows = [NAMES.index(name) for name in call.ids]
                # A ball has one end, which is both.
                self._ends[frame, rows] = call.position
                self._bounds[rows] = np.stack([call.accel, call.speed], axis=1)
                # What is measured to be faster than it may be has an error.
                pace = np.linalg.norm(call.velocity, axis=2, keepdims=True)
                share = np.minimum(1.0, call.speed[:, None, None] / np.maximum(pace, 1e-9))
                self._velocities[frame, rows] = share * call.velocity

    def judge(self, moment: Moment) -> bool:
        """Whether the arm may go on."""
        begin = time.perf_counter()
        people, response = moment.people, self.timing.response
        frames = self._sent[people.frame(moment.since - self.setting.camera)]
        ages = np.where(frames >= 0, moment.since - frames / people.rate, np.inf)
        rows = np.arange(len(NAMES))
        ends, velocities = self._ends[frames, rows], self._velocities[frames, rows]
        arm, spent, touched = copy.copy(moment.arm), 0.0, False
        arm.brakes = self.brakes
        moving = np.ones(len(self._leaves.moves), dtype=bool)
        while not touched:
            going = spent < response - 1e-9
            if arm.rests and not going:
                break
            self._leaves.place(arm.q, arm.v)
            if not going:
                moving = (self._leaves.moves & (arm.v != 0.0)).any(axis=1)
            touched = can_touch(
                self._leaves.centers, self._leaves.radius, moving[self._leaves.link], ends,
                velocities, RADII, ages + spent, self._bounds,
            )  # fmt: skip
            step = min(STEP, response - spent) if going else STEP
            arm.step(step, going)
            spent += step
        self.price = time.perf_counter() - begin
        return not touched


@kernel
def can_touch(centers, radius, moving, ends, velocities, radii, ages, bounds):  # type: ignore[no-untyped-def]
    """Whether a body can be where a moving sphere is, so long after it was seen.

    Each end of a body turns by its whole acceleration to a velocity that its speed allows, and
    keeps that. Its velocity changes straight towards the sphere, and so that is how far it gets
    from where it would have drifted to; by less, if it likes, since its bounds are convex.
    """
    for body in range(ends.shape[0]):
        age, accel, speed = ages[body], bounds[body, 0], bounds[body, 1]
        if age == math.inf:
            continue
        drift = ends[body] + velocities[body] * age
        for i in range(centers.shape[0]):
            if not moving[i]:
                continue
            x, y, z = centers[i]
            dx, dy, dz, distance = nearest_on_segment(x, y, z, drift)
            room = distance - radius[i] - radii[body]
            if room <= 0.0:
                return True
            gain = math.inf
            for end in range(2):
                vx, vy, vz = velocities[body, end]
                towards = -(vx * dx + vy * dy + vz * dz) / distance
                square = vx * vx + vy * vy + vz * vz
                change = math.sqrt(max(towards**2 + speed**2 - square, 0.0)) - towards
                turning = min(age, max(change, 0.0) / accel)
                gain = min(gain, accel * turning * (age - 0.5 * turning))
            if room <= gain:
                return True
    return False
