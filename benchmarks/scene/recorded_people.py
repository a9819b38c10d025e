"""Recorded people as every rule is shown them: with the faults of the data, or without.

`as they come` are the recording's samples as a perception system would have sent them. `clean` are
those that agree with the bounds that are claimed: whatever a monitor would refuse is not sent, as
if the body had been hidden then, and so neither a rule's doubts nor its trust in swapped markers
decide the comparison. It takes hindsight, is done alike for all rules, and no motion is smoothed.

What really happened, for contacts and for the rule that knows the future, is the recording without
jumps, straight on from the last good sample to the next one.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armguard.jit import FloatArray, kernel, pack
from armguard.lab.simulation import Recording
from armguard.lab.simulation.bodies import BODIES, POINTS
from armguard.lab.simulation.recordings import MARKER_ERROR, estimate_velocities
from armguard.obstacles import Obstacles
from armguard.obstacles.consistency import body_allows
from armguard.obstacles.record import Record
from armguard.obstacles.table import States, make_states
from armguard.people import BOUNDS, find_bounds, measure_motion
from scene.tied_people import JOINTS, measure_bones

MEMORY = 1.0
"""How far back, in [s], a clean sample agrees with all others."""

DOUBT = 0.5
"""How long after a sample that broke its bounds nothing was promised of that body, in [s]: longer
than a delay and a stop."""

NAMES = tuple(body.name for body in BODIES)
IDS = tuple(f"person/{name}" for name in NAMES)
"""Of obstacles. They are all one person's, so that none counts as what another one can be clamped
against."""
RADII = np.array([body.radius for body in BODIES])
ENDS = np.array([[POINTS.index(body.points[k]) for k in (0, -1)] for body in BODIES])
"""Places of each body's two ends among the tracked points. Shape (9, 2)."""
_SENT = (*BODIES, *JOINTS)
_SENT_IDS = tuple(f"person/{body.name}" for body in _SENT)
_SENT_RADII = np.array([body.radius for body in _SENT])
_SENT_ENDS = np.array([[POINTS.index(body.points[k]) for k in (0, -1)] for body in _SENT])
"""The same of all that can be sent, joints included. Shape (13, 2)."""

_PART_OF_POINT = {"head": "head", "collar": "trunk", "hip": "trunk"} | {
    f"{side}_{joint}": joint
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "hand")
}


class Message(NamedTuple):
    """A call of `Obstacles.update`."""

    ids: list[str]
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    accel: np.ndarray
    speed: np.ndarray
    velocity_error: np.ndarray


class Claim(NamedTuple):
    """What one set of bounds makes of a recording: of nine bodies, and after them four joints."""

    accel: np.ndarray
    """In [m]/[s]². Shape (13,)."""
    speed: np.ndarray
    """In [m]/[s]. Shape (13,)."""
    velocity: np.ndarray
    """Of points, from past samples, in [m]/[s]. Shape (frames, 9, 3)."""
    error: np.ndarray
    """Of bodies' velocities, in [m]/[s]. Shape (frames, 13)."""
    shown: np.ndarray
    """Which bodies were seen. Shape (frames, 13)."""
    agrees: np.ndarray
    """Whether those samples agree with the bounds. Shape (frames, 13)."""


class Stream:
    """One recorded person under one claim about how people move.

    Args:
        recording: Of the person.
        claim: What bounds make of it.
        clean: Whether samples that break the bounds are left out.
        joints: Whether joints are sent, to which limbs can be tied.

    Attributes:
        sent: Index of the last frame that was sent of each body, up to each frame; -1 before the
            first. Shape (frames, 9).
        broke: Whether a sample in the last `DOUBT` seconds broke its bounds. Shape (frames, 9).
        messages: By frame.
    """

    def __init__(
        self, recording: Recording, claim: Claim, clean: bool, joints: bool = False
    ) -> None:
        self._rate = recording.rate
        points, shown = recording.position, claim.shown
        sends = shown & claim.agrees if clean else shown
        frames = np.arange(len(points))[:, None]
        count = len(BODIES)
        self.sent = np.maximum.accumulate(np.where(sends, frames, -1), axis=0)[:, :count]
        breaks = np.where(shown & ~claim.agrees, frames, -(10**9))[:, :count]
        self.broke = frames - np.maximum.accumulate(breaks, axis=0) <= DOUBT * self._rate
        self.messages = []
        for frame in range(len(points)):
            calls = []
            for corners in (1, 2):
                rows = [
                    row for row, body in enumerate(_SENT if joints else BODIES)
                    if len(body.points) == corners and sends[frame, row]
                ]  # fmt: skip
                if rows:
                    places = _SENT_ENDS[rows][:, :corners]
                    calls.append(
                        Message(
                            [_SENT_IDS[row] for row in rows], points[frame, places],
                            claim.velocity[frame, places], _SENT_RADII[rows], claim.accel[rows],
                            claim.speed[rows], claim.error[frame, rows],
                        )
                    )  # fmt: skip
            self.messages.append(calls)

    def publish(self, table: Obstacles, frame: int, begin: float) -> None:
        """Send what there is of a frame; `begin` is when the recording began, in [s]."""
        stamp = begin + frame / self._rate
        calls = self.messages[frame]
        for call in calls:
            table.update(
                call.ids, stamp, call.position, call.velocity, radius=call.radius,
                accel=call.accel, speed=call.speed, position_error=MARKER_ERROR,
                velocity_error=call.velocity_error, source="camera",
            )  # fmt: skip
        if not calls:
            table.update([], stamp, source="camera")


class People:
    """One recorded person: what really happened, and streams of what is sent of it.

    Args:
        path: The recording.
        placement: Of its origin in the world, homogeneous. Shape (4, 4).
        bounds: By name, pairs of acceleration in [m]/[s]² and speed in [m]/[s]; None: those of
            `armguard.people`, by part of the body.

    Attributes:
        name: Of the recording.
        rate: Frames a second.
        ends: Both ends of each body, what is missing filled in, in [m]. Shape (frames, 9, 2, 3).
        seen: The same as they were seen, markers swapped or not, NaN where hidden, in [m]. Shape
            (frames, 9, 2, 3).
        is_filled: Whether an end of a body was filled in. Shape (frames, 9).
        pace: What no body is faster than in the second after a frame, in [m]/[s]. Shape (frames,).
        streams: By name of the bounds and whether it is clean.
        jointed: Of data as they come, with joints; by name of the bounds.
        bones: How far apart this person's points are at the most, as `tied_people.BONES`, in [m].
    """

    def __init__(
        self,
        path: Path,
        placement: np.ndarray,
        bounds: Mapping[str, tuple[float, float] | None],
    ) -> None:
        recording = Recording(path, placement=placement)
        self.name, self.rate = recording.name, recording.rate
        points = recording.position
        # A swapped marker is no motion: what is not clean because of a jump, is filled in.
        motion = measure_motion(points, self.rate)
        doubted = ~motion.is_clean & np.isfinite(motion.accel) | ~motion.is_seen
        truth = points.copy()
        frames = np.arange(len(points))
        for k in range(points.shape[1]):
            good = ~doubted[:, k]
            for axis in range(3):
                truth[:, k, axis] = np.interp(frames, frames[good], points[good, k, axis])
        self.ends = np.ascontiguousarray(truth[:, ENDS])
        self.seen = np.ascontiguousarray(points[:, ENDS])
        self.is_filled = doubted[:, ENDS].any(axis=2)
        steps = np.linalg.norm(np.diff(truth, axis=0), axis=2).max(axis=1) * self.rate
        second = round(self.rate)
        padded = np.concatenate([steps, np.zeros(second + 1)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, second)
        self.pace = windows.max(axis=1)[: len(points)]
        self.bones = measure_bones(points, motion.is_clean, MARKER_ERROR)
        self.streams, self.jointed = {}, {}
        for name, pair in bounds.items():
            claim = make_claim(recording, pair)
            self.jointed[name] = Stream(recording, claim, False, joints=True)
            for clean in (False, True):
                self.streams[name, clean] = Stream(recording, claim, clean)

    def reset(self) -> None:
        """Begin a case."""

    def advance(self, since: float, dt: float, arm: Any) -> None:
        """Let them move until a time in [s], for so long; recorded people yield to no arm."""

    def frame(self, time: float) -> int:
        """The last frame at a time in [s] since it began."""
        return min(max(int(time * self.rate + 1e-6), 0), len(self.ends) - 1)

    def ends_at(self, time: float) -> np.ndarray:
        """Where the bodies really are; between frames they move straight on. Shape (9, 2, 3)."""
        frame = self.frame(time)
        share = time * self.rate - frame
        if share < 1e-3 or frame + 1 >= len(self.ends):
            return self.ends[frame]
        return (1.0 - share) * self.ends[frame] + share * self.ends[frame + 1]


def make_claim(recording: Recording, bounds: tuple[float, float] | None) -> Claim:
    """Estimate velocities and find what breaks its bounds.

    Args:
        recording: Of a person.
        bounds: Acceleration in [m]/[s]² and speed in [m]/[s] for all; None: by part of the body.
    """
    if bounds is None:
        parts = [find_bounds(body) for body in NAMES]
        pairs = [part[:2] for part in parts if part is not None]
        of_points = [BOUNDS[_PART_OF_POINT[point]][:2] for point in POINTS]
    else:
        pairs, of_points = [bounds] * len(NAMES), [bounds] * len(POINTS)
    pairs += [of_points[POINTS.index(joint.points[0])] for joint in JOINTS]
    accel, speed = np.array(pairs).T.copy()
    points, rate = recording.position, recording.rate
    velocity, errors = np.empty(points.shape), np.empty(points.shape[:2])
    for k, limits in enumerate(of_points):
        velocity[:, k : k + 1], errors[:, k : k + 1] = estimate_velocities(
            points[:, k : k + 1], rate, *limits, MARKER_ERROR
        )
    shown = np.isfinite(points[:, _SENT_ENDS]).all(axis=(2, 3))
    error = errors[:, _SENT_ENDS].max(axis=2)
    agrees = []
    for row, ends in enumerate(_SENT_ENDS):
        states = _lay_states(points[:, ends], velocity[:, ends], error[:, row], rate)
        agrees.append(
            find_agreeing(
                pack(states), shown[:, row].copy(), accel[row], speed[row], round(MEMORY * rate)
            )
        )
    return Claim(accel, speed, velocity, error, shown, np.stack(agrees, axis=1))


def _lay_states(
    points: FloatArray, velocities: FloatArray, errors: FloatArray, rate: float
) -> States:
    """All samples of one body, as rows of an obstacle table; bounds are told beside them."""
    count, corners = points.shape[:2]
    states = make_states(count, corners)
    states.points[...], states.velocities[...] = points, velocities
    states.point_count[:], states.radius[:] = corners, 0.0
    states.position_error[:], states.velocity_error[:] = MARKER_ERROR, errors
    states.stamp[:] = np.arange(count) / rate
    return states


@kernel
def find_agreeing(handle, shown, accel, speed, memory):  # type: ignore[no-untyped-def]
    """Which samples agree with their bounds and all that agreed before, in the last `memory`."""
    states = handle.content
    count, corners = states.points.shape[:2]
    agrees = np.zeros(count, dtype=np.bool_)
    last = -1
    for i in range(count):
        if not shown[i]:
            continue
        fine = True
        for k in range(corners):
            x, y, z = states.velocities[i, k]
            fine = fine and np.sqrt(x * x + y * y + z * z) <= speed + states.velocity_error[i]
        first = max(0, min(i - memory, last))
        for j in range(i - 1, first - 1, -1):
            if fine and agrees[j]:
                told = Record(states, j, 0.0, accel, speed)
                fine = body_allows(told, Record(states, i, 0.0, accel, speed)) == 0
        if fine:
            agrees[i] = True
            last = i
    return agrees
