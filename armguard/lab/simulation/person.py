"""A person who walks up to the arm, works at it with both hands and steps back out again.

The whole motion is one closed formula of time, made of polynomials, sines and cosines. Velocities
are its derivative by the complex step, Im f(t + ih) / h, which is exact to rounding
[SquireTrapp1998]_: no second formula has to be kept in step with the first, and positions and
velocities agree as the obstacle table demands (`obstacles.consistency`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.bodies import POINTS, publish_person
from armguard.lab.simulation.sources import ObstacleSink, SampledSource

Array = NDArray[np.float64]

FAR = 6.0
"""Where the person comes from and goes to, horizontally from the arm's base, in [m]."""

NEAR = 1.0
"""Where the person stands and works, horizontally from the arm's base, in [m]."""

DURATIONS = (8.0, 3600.0)
"""The shortest and longest visit, in [s]."""

_WALK, _HURRY = 1.2, 1.4  # the pace, and the quickest one, in [m/s]
_RAMP = 0.8  # to full pace and back to rest, each in [s]
_WAIT = 0.05  # shares of the duration that pass before he comes, and after he left
_LEAST_WORK = 2.5  # [s]
_REACH_SPEED = 1.3  # of the hands while they are put out and taken back, at most, in [m/s]
_REACH_TIME = 1.0  # for that, at least, in [s]

_UPPER_ARM, _FOREARM = 0.30, 0.33  # shoulder to elbow, elbow to the middle of the hand, in [m]
_LEAN = 0.12  # how far the shoulders come forward to reach, in [m]
_HANGING = (0.05, 0.35)  # angles of upper arm and forearm from straight down, in [rad]
_LOWEST, _HIGHEST = (-0.3, 0.0), (1.1, 1.6)  # bounds of hands, back and up, in [m]
_HANDS_APART = 0.12  # of the middle between them, each, in [m]

# Trunk points, relative to the feet, in [m]: forward, left, up from the base of the arm, which
# stands on a table 0.75 m high; and the share of the lean that each takes part in.
_TRUNK = {
    "head": ((0.02, 0.0, 0.88), 1.1),
    "collar": ((0.0, 0.0, 0.60), 0.9),
    "hip": ((0.0, 0.0, 0.20), 0.0),
    "left_shoulder": ((0.0, 0.19, 0.58), 1.0),
    "right_shoulder": ((0.0, -0.19, 0.58), 1.0),
}

RATE = 100.0
"""Samples a second, in [Hz]."""

_OUTWARD = np.array([0.0, -1.0, 0.0])
"""From the base of the arm to where he stands."""

_AXES = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""His forward, left and up."""

_TINY = 1e-30
"""The complex step: its square vanishes beside anything."""


class ProceduralPerson(SampledSource):
    """A person of nine bodies who arrives, reaches into the cell, works there and leaves.

    He waits 6 m away, walks up to 1 m from the arm's base, reaches towards `target` with both
    hands, works, takes his hands back and steps back out as he came, facing the arm. All speeds
    stay below 1.6 m/s and all accelerations below 8 m/s², inside the bounds that a table assumes
    of people. Waits and work stretch with the duration; he hurries in visits under 14 s, and in
    those under 12.5 s he comes from less than 6 m away: see `far`.

    The motion is twice continuously differentiable. Positions and velocities have no error.

    Args:
        seed: Decides the gait's phase and how the hands move at work.
        duration: From the start to the end of the last wait, in [s]; 8 to 3600.
        target: Where he reaches, in the world, in [m]. He reaches no further than his arms do, and
            not above his head. Shape (3,).

    Attributes:
        far: How far from the arm's base he comes from, in [m].

    Raises:
        ArmguardError: The duration is out of bounds.
    """

    def __init__(
        self,
        seed: int,
        duration: float = 20.0,
        *,
        target: ArrayLike = (0.0, -0.4, 0.35),
    ) -> None:
        if not (DURATIONS[0] <= duration <= DURATIONS[1]):
            raise ArmguardError(
                "person",
                f"cannot come and go in {duration} s",
                expected=f"{DURATIONS[0]:g} to {DURATIONS[1]:g} s",
            )
        super().__init__("person", RATE, duration)
        self._plan_visit()
        goal = np.array(target, dtype=np.float64)
        random = np.random.default_rng(seed)
        self._gait_phase = random.uniform(0.0, 2.0 * math.pi)
        self._arms = {
            side: _plan_arm(random, _AXES @ (goal - NEAR * _OUTWARD), sign)
            for side, sign in (("left", 1.0), ("right", -1.0))
        }
        self._reach_time = max(_plan_reach_time(arm["angles"]) for arm in self._arms.values())

    def sample(self, time: float) -> tuple[Array, Array]:
        """Tracked points at a time.

        Args:
            time: In [s] from the start.

        Returns:
            Positions in the world, in [m], and velocities, in [m]/[s], in the order of
            `bodies.POINTS`. Shapes (9, 3).
        """
        points = self._points(complex(time, _TINY))
        return points.real.copy(), points.imag / _TINY

    def _publish_sample(self, sink: ObstacleSink, index: int, stamp: float) -> None:
        position, velocity = self.sample(stamp)
        publish_person(sink, self.name, stamp, position, velocity, np.zeros(len(POINTS)))

    def _plan_visit(self) -> None:
        """When he walks and works, and from how far away."""
        self._wait = _WAIT * self.duration
        walking = (self.duration - 2.0 * self._wait - _LEAST_WORK) / 2.0
        distance = FAR - NEAR
        self._pace = min(max(_WALK, distance / (walking - _RAMP)), _HURRY)
        distance = min(distance, self._pace * (walking - _RAMP))
        self.far = NEAR + distance
        self._walk_time = distance / self._pace + _RAMP
        self._arrival = self._wait + self._walk_time
        self._departure = self.duration - self._arrival

    def _points(self, t: complex) -> NDArray[np.complex128]:
        """All tracked points; of a complex time, for the sake of its derivative. Shape (9, 3)."""
        arrival, arriving = _walk(t - self._wait, self._walk_time, self._pace)
        departure, departing = _walk(t - self._departure, self._walk_time, self._pace)
        walking = arriving + departing
        at_work = _rise(t - self._arrival, self._reach_time) - _rise(
            t - self._departure + self._reach_time, self._reach_time
        )
        stride = math.tau * 0.9 * t + self._gait_phase
        sway = 0.015 * walking * np.sin(stride)
        bob = 0.008 * walking * np.sin(2.0 * stride)
        forward, left, up = _AXES
        feet = (self.far - arrival + departure) * _OUTWARD + sway * left + bob * up

        points = {}
        for point, (offset, share) in _TRUNK.items():
            lean = share * _LEAN * at_work
            points[point] = feet + np.array(offset) @ _AXES + lean * forward
        for side, arm in self._arms.items():
            swing = 0.035 * arm["sign"] * walking * np.sin(stride)
            out = arm["azimuth"] @ _AXES
            point = points[f"{side}_shoulder"]
            for part, length, low, high, wobble in (
                ("elbow", _UPPER_ARM, _HANGING[0], arm["angles"][0], 0.05),
                ("hand", _FOREARM, _HANGING[1], arm["angles"][1], 0.12),
            ):
                working = wobble * np.sin(arm["frequency"] * t + arm["phase"])
                angle = low + swing + (high - low + working) * at_work
                point = point + length * (np.sin(angle) * out - np.cos(angle) * up)
                points[f"{side}_{part}"] = point
        return np.array([points[name] for name in POINTS])


def _plan_arm(random: np.random.Generator, goal: Array, sign: float) -> dict[str, Any]:
    """Angles at which an arm reaches the goal, both in the person's axes, and how it works.

    The arm moves in the upright plane through the shoulder and the goal; the elbow hangs.
    """
    offset, share = _TRUNK["left_shoulder" if sign > 0.0 else "right_shoulder"]
    shoulder = np.array(offset) + np.array([share * _LEAN, 0.0, 0.0])
    way = goal + np.array([0.0, sign * _HANDS_APART, 0.0]) - shoulder
    across = math.hypot(way[0], way[1])
    azimuth = np.array([way[0], way[1], 0.0]) / across if across > 1e-6 else np.eye(3)[0]
    shortest, longest = abs(_UPPER_ARM - _FOREARM) + 0.15, 0.97 * (_UPPER_ARM + _FOREARM)
    distance = min(max(math.hypot(across, way[2]), shortest), longest)
    aim = math.atan2(across, -way[2])
    cosine = (_UPPER_ARM**2 + distance**2 - _FOREARM**2) / (2.0 * _UPPER_ARM * distance)
    upper = aim - math.acos(cosine)
    elbow = math.acos((_UPPER_ARM**2 + _FOREARM**2 - distance**2) / (2.0 * _UPPER_ARM * _FOREARM))
    return {
        "sign": sign,
        "azimuth": azimuth,
        "angles": np.clip([upper, upper + math.pi - elbow], _LOWEST, _HIGHEST),
        "frequency": random.uniform(2.5, 4.0),
        "phase": random.uniform(0.0, math.tau),
    }


def _plan_reach_time(angles: Array) -> float:
    """How long an arm takes to come up from hanging, in [s]; twice that is within any work."""
    way = 1.1 * _LEAN + np.abs(angles - _HANGING) @ [_UPPER_ARM, _FOREARM]
    return max(_REACH_TIME, 15.0 / 8.0 * float(way) / _REACH_SPEED)


def _rise(t: complex, duration: float) -> complex:
    """From 0 at t = 0 to 1 at `duration`, twice continuously differentiable."""
    u = t / duration
    if u.real <= 0.0:
        return 0.0j
    if u.real >= 1.0:
        return 1.0 + 0.0j
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _rise_integral(t: complex, duration: float) -> complex:
    """The integral of `_rise` up to t."""
    u = t / duration
    if u.real <= 0.0:
        return 0.0j
    if u.real >= 1.0:
        return t - 0.5 * duration
    return duration * u**4 * (2.5 - 3.0 * u + u**2)


def _walk(t: complex, duration: float, pace: float) -> tuple[complex, complex]:
    """Distance walked in [m] and present share of the pace, for a walk from 0 to `duration`."""
    slowing = t - duration + _RAMP
    distance = pace * (_rise_integral(t, _RAMP) - _rise_integral(slowing, _RAMP))
    return distance, _rise(t, _RAMP) - _rise(slowing, _RAMP)
