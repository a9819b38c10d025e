"""The least that a rule can stop an arm which trusts people to keep their bounds, and no more.

It knows to the micrometre how the arm goes on and how it stops, has no errors, and says STOP only
where a person who moves on from what was measured of them, within the bounds, could touch a link
that moves. A rule that says go on then is right by luck alone. So what stops less than this is not
right for all that people may do, whatever it knows of the arm; and what armguard stops more is what
its errors and its bounds on the arm cost.

With errors it knows the path, and no more: people are off what was measured of them by
as much as is stated, joints are off the path by the errors of encoders and of tracking, and each
leaves it when it likes. All that it tries is one arm that this allows, drawn towards where a person
comes nearest, so it still stops less than a rule must. What armguard stops more than this is what
its mathematics costs.
"""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np

from armguard.jit import kernel
from armguard.lab.simulation.recordings import MARKER_ERROR
from scene.clearance import Leaves, nearest_on_segment
from scene.recorded_people import IDS, NAMES, RADII, People
from scene.stop_rules import (
    PERIOD,
    TRACKING_ERROR,
    VELOCITY_TRACKING_ERROR,
    Moment,
    Rule,
)

STEP = 4e-3
"""Between instants at which a touch is looked for, in [s]; those between are left out."""

NEAR = 0.3
"""Room beyond which no error makes a touch of none, in [m]: no more is looked for there."""


class Seen(NamedTuple):
    """What was seen of all bodies, and how wrong that may be."""

    ends: np.ndarray
    """In [m]. Shape (bodies, 2, 3)."""
    velocities: np.ndarray
    """Of both ends, in [m]/[s]. Shape (bodies, 2, 3)."""
    ages: np.ndarray
    """In [s]; inf where nothing was. Shape (bodies,)."""
    error: float
    """Of positions, in [m]."""
    errors: np.ndarray
    """Of velocities, in [m]/[s]. Shape (bodies,)."""


class Course(NamedTuple):
    """How joints go on and stop."""

    times: np.ndarray
    """In [s] from now. Shape (k,)."""
    q: np.ndarray
    """Shape (k, nv)."""
    v: np.ndarray
    """Shape (k, nv)."""
    leave: np.ndarray
    """Until when each joint is on its way, to brake from then on, in [s]. Shape (nv,)."""


class LeastRule(Rule):
    """Says STOP only where it must.

    Args:
        fastest: What joints keep to at work, in [rad]/[s], shape (nv,): it has errors. None: it
            knows everything.
    """

    def __init__(self, *arguments: Any, fastest: np.ndarray | None = None, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._leaves = Leaves(self.robot)
        self._fastest = fastest

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""
        stream = people.streams[self.setting.bounds, self.clean]
        count, bodies = len(people.ends), len(NAMES)
        self._sent = stream.sent
        self._ends = np.zeros((count, bodies, 2, 3))
        self._velocities = np.zeros((count, bodies, 2, 3))
        self._errors = np.zeros((count, bodies))
        self._bounds = np.zeros((bodies, 2))
        for frame, calls in enumerate(stream.messages):
            for call in calls:
                rows = [IDS.index(name) for name in call.ids]
                # A ball has one end, which is both.
                self._ends[frame, rows] = call.position
                self._bounds[rows] = np.stack([call.accel, call.speed], axis=1)
                # What is measured to be faster than it may be has an error, at least of that.
                pace = np.linalg.norm(call.velocity, axis=2, keepdims=True)
                share = np.minimum(1.0, call.speed[:, None, None] / np.maximum(pace, 1e-9))
                self._velocities[frame, rows] = share * call.velocity
                spent = np.maximum(pace.max(axis=(1, 2)) - call.speed, 0.0)
                self._errors[frame, rows] = np.maximum(call.velocity_error - spent, 0.0)

    def judge(self, moment: Moment) -> bool:
        """Whether the arm may go on."""
        begin = time.perf_counter()
        people, has_errors = moment.people, self._fastest is not None
        frames = self._sent[people.frame(moment.since - self.setting.camera)]
        rows = np.arange(len(NAMES))
        seen = Seen(
            self._ends[frames, rows],
            self._velocities[frames, rows],
            np.where(frames >= 0, moment.since - frames / people.rate, np.inf),
            MARKER_ERROR if has_errors else 0.0,
            has_errors * self._errors[frames, rows],
        )
        going = np.linspace(0.0, response := self.timing.response, math.ceil(response / STEP) + 1)
        arm = moment.arm
        before, arm.brakes = arm.brakes, self.brakes
        q, v = arm.preview(going)
        arm.brakes = before
        room, pull = self._look(Course(going, q, v, np.full(q.shape[1], response)), seen)
        if has_errors and 0.0 < room < NEAR:
            room, _ = self._look(self._draw(going, q, v, pull), seen)
        self.price = time.perf_counter() - begin
        return room > 0.0

    def _draw(self, going: np.ndarray, q: np.ndarray, v: np.ndarray, pull: np.ndarray) -> Course:
        """What joints may do that are drawn some way, each by sign; 0 where it is all the same."""
        robot, response = self.robot, going[-1]
        # What was measured is off by no more than its own error, and drifts away from there.
        error = np.minimum(
            TRACKING_ERROR + robot.position_error,
            robot.position_error + response * robot.velocity_error,
        )
        speed = VELOCITY_TRACKING_ERROR + robot.velocity_error
        # One that goes the other way leaves as soon as the next tick's STOP may bite.
        leave = np.where(pull * v[0] < 0.0, PERIOD, response)
        fastest = np.maximum(self._fastest, np.abs(v))
        q, v = q + pull * error, np.clip(v + pull * speed, -fastest, fastest)
        return Course(going, q, v, leave)

    def _look(self, course: Course, seen: Seen) -> tuple[float, np.ndarray]:
        """Least room that bodies leave an arm on its course, in [m], and which way joints take it.

        The latter are signs; 0 where a joint does not count. Shape (nv,).
        """
        times, q, v, leave = course
        leaves, response = self._leaves, times[-1]
        joints = np.arange(q.shape[1])
        at = np.searchsorted(times, leave - 1e-12)
        start, speed = q[at, joints], v[at, joints]
        # Brakes that bite early may bite as hard as joints can.
        rate = np.where(
            leave < response, self.robot.acceleration_limit, self.brakes.deceleration(speed)
        )
        rest = times[at] + np.abs(speed) / rate
        after = np.arange(response, max(rest.max(), response) + STEP, STEP)[1:]
        least, pull = math.inf, np.zeros(len(joints))
        for k, now in enumerate([*times, *after]):
            on = k < at
            gone = np.clip(now - times[at], 0.0, rest - times[at])
            left = start + gone * (speed - 0.5 * np.sign(speed) * rate * gone)
            row = min(k, len(times) - 1)
            leaves.place(np.where(on, q[row], left), v[row])
            moving = np.ones(len(leaves.moves), dtype=bool)
            if now > response:
                moving = (leaves.moves & (now < rest)).any(axis=1)
            room, sphere, *way = find_room(
                leaves.centers, leaves.radius, moving[leaves.link], seen.ends, seen.velocities,
                RADII, seen.ages + now, self._bounds, seen.error, seen.errors,
            )  # fmt: skip
            if room <= 0.0:
                return room, pull
            if room < least:
                least = room
                columns = leaves.kinematics.data.J
                turning = np.cross(columns[3:].T, leaves.centers[sphere])
                pull = np.sign((columns[:3].T + turning) @ way) * leaves.moves[leaves.link[sphere]]
        return least, pull


@kernel
def find_room(centers, radius, moving, ends, velocities, radii, ages, bounds, error, errors):  # type: ignore[no-untyped-def]
    """The least room of a moving sphere that bodies leave it, so long after they were seen.

    With the sphere, and the way from there to the body. At 0 or below the body can be where the
    sphere is, and none is looked at after the first of these. Each of its ends, as far off and as
    much faster as errors allow, turns by its whole acceleration to a velocity that its speed
    allows, and keeps that. Its velocity changes straight towards the sphere, and so that is how far
    it gets from where it would have drifted to; by less, if it likes, since its bounds are convex.
    """
    least, sphere = math.inf, 0
    wx = wy = wz = 0.0
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
            room = distance - radius[i] - radii[body] - error
            if room > 0.0:
                gain = math.inf
                for end in range(2):
                    vx, vy, vz = velocities[body, end]
                    towards = -(vx * dx + vy * dy + vz * dz) / distance
                    square = vx * vx + vy * vy + vz * vz
                    most = math.sqrt(max(towards**2 + speed**2 - square, 0.0)) - towards
                    more = min(errors[body], max(most, 0.0))
                    turning = min(age, max(most - more, 0.0) / accel)
                    way = more * age + accel * turning * (age - 0.5 * turning)
                    gain = min(gain, way)
                room -= gain
            if room < least:
                least, sphere = room, i
                wx, wy, wz = dx, dy, dz
                if room <= 0.0:
                    return least, sphere, wx, wy, wz
    return least, sphere, wx, wy, wz
