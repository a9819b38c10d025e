"""A rival of the shield: failsafe motions on the path, verified at sampled instants.

It is sara-shield's published rule (github.com/JakobThumm/sara-shield, commits of 2024; Thumm and
Althoff, "Provably safe deep reinforcement learning for robotic manipulation in human environments",
ICRA 2022), written anew: in each step an intended motion of one step is followed by the hardest
stop on the path. Both are verified against where people can get to: spheres that grow by the lesser
of what their greatest speed, and their greatest acceleration from their measured velocity, allow.
Where that fails, the stop of the last verified motion goes on. Its own parameters are 2 m/s, and 50
m/s² for arms and 25 m/s² for heads and trunks; velocities are off by 0.1 m/s, positions by nothing
(`config/mujoco_mocap.yaml`); its stops use 10 rad/s² and 400 rad/s³
(`config/trajectory_parameters_panda.yaml`), which brakes do not guarantee.

At its best here: people are compared with the arm instant by instant, instead of all along; the arm
is its cover, as for all others; and it trusts its tracking, and that people were seen as they are.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.shield import Command, MotionLimits, Path
from armguard.shield.changes import PaceChanges
from armguard.shield.motion import AlongPath, Rest
from armguard.shield.path import TimedPath
from armguard.verdict import Level, Verdict
from scene.clearance import Leaves
from scene.recorded_people import NAMES, RADII, People
from scene.stop_rules import LATENCY, Setting

SPEED, ARM_ACCEL, TRUNK_ACCEL, VELOCITY_ERROR = 2.0, 50.0, 25.0, 0.1
OWN_BRAKING, OWN_JERK = 10.0, 400.0
"""Its own limits of Panda's stops, in [rad]/[s²] and [rad]/[s³]."""

INSTANT = 0.01
"""Between instants at which motions are verified, in [s]."""

_TRUNK = np.array([any(part in name for part in ("head", "collar", "hip")) for name in NAMES])


class FailsafeMover:
    """Moves an arm by that rule.

    Args:
        leaves: Of the arm, its own.
        limits: Of the arm's motions, its stops included.
        setting: What it has to live with.
        period: Of its steps, in [s].
        goes_on: Whether it goes on whoever is there: an arm that obeys nobody.
    """

    clean = True

    def __init__(
        self,
        leaves: Leaves,
        limits: MotionLimits,
        setting: Setting,
        period: float,
        *,
        goes_on: bool = False,
    ) -> None:
        self._goes_on = goes_on
        self.limits, self.setting = limits, setting
        self.speed_limits = np.zeros(len(RADII))
        self._leaves, self._period = leaves, period
        self._changes = PaceChanges(limits)
        self._accel = np.where(_TRUNK, TRUNK_ACCEL, ARM_ACCEL)

    @property
    def progress(self) -> float:
        """How far the arm has come on its path, of 1."""
        return 0.0 if self._path is None else min(1.0, self._place / self._path.duration)

    def begin(self, people: People, begin: float) -> None:
        """Start anew, with a recording that begins at a time in [s]."""
        self._people, self._begin = people, begin
        self._path: TimedPath | None = None
        self._place = 0.0
        self._motion: AlongPath | Rest | None = None

    def set_path(self, path: Path) -> None:
        """Follow a path from now on."""
        self._path = TimedPath(path, self.limits)

    def listen(self, since: float) -> None:
        """Take what is seen of people until a time, in [s] since the recording began."""
        people = self._people
        frame = people.frame(since - self.setting.camera)
        frames = people.streams[self.setting.bounds, self.clean].sent[frame]
        bodies = np.arange(len(RADII))
        self._ends = people.seen[frames, bodies]
        before = np.maximum(frames - 2, 0)
        elapsed = np.maximum(frames - before, 1)[:, None, None] / people.rate
        velocity = (self._ends - people.seen[before, bodies]) / elapsed
        self._velocity = np.nan_to_num(velocity)
        self._age = np.where(frames >= 0, since - frames / people.rate, math.inf)

    def step(self, since: float, q: np.ndarray, v: np.ndarray) -> Command:
        """The motion to follow from that time on."""
        now = self._begin + since
        begin = now + LATENCY
        motion = self._motion or Rest(q, now)
        is_new = False
        if self._path is not None:
            place = (0.0, 0.0, 0.0)
            if isinstance(motion, AlongPath):
                place = motion.find_place(begin)
                self._place = place[0]
            if place[0] < self._path.duration:
                going = self._changes.go_and_stop(self._path, place, begin, self._period, 1.0)
                if going is not None and (self._goes_on or self._is_safe(going, now)):
                    motion, is_new = going, True
        self._motion = motion
        times = np.append(now, np.linspace(begin, max(motion.end, begin + self._period), 40))
        if is_new:
            # Until it takes over the arm is on the one before, which it continues.
            times = times[1:]
        samples = motion.sample(times)
        return Command(
            *samples, is_new, float(times[-1]), 0.0, False, None, _NO_VERDICT, None, None
        )

    def _is_safe(self, motion: AlongPath, now: float) -> bool:
        """Whether nobody can be where the arm is, at all instants until it rests."""
        times = np.arange(motion.end, now, -INSTANT)[::-1]
        _, q, v, _ = motion.sample(np.maximum(times, now + LATENCY))
        for k, time in enumerate(times):
            self._leaves.place(q[k], v[k])
            ages = self._age + (time - now)
            by_accel = VELOCITY_ERROR * ages + 0.5 * self._accel * ages**2
            grown = np.where(self._age < math.inf, SPEED * ages, -math.inf)
            moved = self._velocity * np.where(np.isfinite(ages), ages, 0.0)[:, None, None]
            known = np.isfinite(self._age)
            by_speed = self._leaves.gaps(np.nan_to_num(self._ends), RADII) - grown
            by_motion = self._leaves.gaps(np.nan_to_num(self._ends) + moved, RADII) - by_accel
            if not (np.maximum(by_speed, by_motion)[known] > 0.0).all():
                return False
        return True


_NO_VERDICT = Verdict(0.0, 0, Level.CLEAR, math.inf, 0.0, 1.0, None, None, True, 0, (), math.inf)
