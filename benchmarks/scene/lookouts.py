"""The scene and the contestants of `bench_awareness.py`: walking balls, schedules to question.

Every schedule, whether of pairs or of obstacles, answers the same questions about its last tick.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.obstacles import Obstacles
from armguard.pairs.arm import WatchedArm
from armguard.pairs.evaluate import evaluate
from armguard.robot import JointStates, Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.settings import Settings
from scene.crowds import HEIGHT, LATENCY, OUTER, RATE, REACTION_TIME

GROUPS = 10  # of balls that are measured in turn, one in each tick
CIRCLE, PACE = (0.5, 3.0), (0.3, 1.5)  # radii [m] and speeds [m/s] of the balls' walks
JOINT_TIMEOUT = 0.05  # [s]
SETTINGS = Settings(rate=RATE, latency=LATENCY, reaction_time=REACTION_TIME, max_staleness=0.25)
HORIZON = SETTINGS.braking_delay  # [s]


class Walkers:
    """Balls that walk in circles, none nearer to the arm's axis than allowed.

    Args:
        count: How many balls.
        nearest: No centre comes nearer to the axis than this, in [m].
        seed: Of the random generator.
    """

    def __init__(self, count: int, nearest: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        self._names = [f"ball-{number}" for number in range(count)]
        walks = np.zeros((0, 4))
        while len(walks) < count:
            middle = random.uniform(-OUTER, OUTER, (4 * count, 2))
            radius, pace = random.uniform(*CIRCLE, 4 * count), random.uniform(*PACE, 4 * count)
            from_axis = np.hypot(*middle.T)
            fits = (from_axis <= OUTER) & (np.abs(from_axis - radius) >= nearest)
            walks = np.vstack([walks, np.column_stack([middle, radius, pace])[fits]])
        self._middle, self._radius, pace = walks[:count, :2], walks[:count, 2], walks[:count, 3]
        self._turning = pace / self._radius * random.choice((-1.0, 1.0), count)
        self._phase = random.uniform(0.0, 2.0 * math.pi, count)
        self._height = random.uniform(0.0, HEIGHT, count)

    def measure(self, tick: int):
        """What a tick measures: names, positions in [m] and velocities in [m]/[s], (n, 3) each."""
        rows = slice(None) if tick == 0 else slice(tick % GROUPS, None, GROUPS)
        radius, turning = self._radius[rows], self._turning[rows]
        angle = turning * (tick / RATE) + self._phase[rows]
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        middle = self._middle[rows]
        position = np.column_stack([middle[:, 0] + x, middle[:, 1] + y, self._height[rows]])
        velocity = np.column_stack([-turning * y, turning * x, np.zeros(len(x))])
        return self._names[rows], position, velocity


class PairSchedule:
    """A schedule of pair numbers, fed with contact times.

    Args:
        schedule: Empty.
        arm: Whose state is placed in each tick before this is asked to step.
        pairs: How many there are.
    """

    def __init__(self, schedule, arm: WatchedArm, pairs: int) -> None:
        self._schedule, self._state = schedule, arm.state
        schedule.insert(np.arange(pairs))
        self.times, self._nodes = np.zeros(pairs), np.zeros(pairs, dtype=np.int64)
        """Contact times in [s] of the pairs that were due last, first things first."""
        self._bounds = np.zeros(pairs, dtype=np.int8)
        self._expiry = np.full(pairs, -np.inf)
        self._looked_at = np.full(pairs, -1)
        self._number, self._now = -1, 0.0

    def step(self, tick: Tick) -> int:
        """Evaluate what is due; how many evaluations that took."""
        due = self._schedule.due()
        spent = evaluate(self._state, due, self.times, self._nodes, self._bounds)
        self._schedule.settle(self.times[: len(due)], tick.stop_time)
        self._due = due
        return spent

    def record(self, tick: Tick) -> None:
        """Remember what the step found; not timed."""
        self._number, self._now = tick.number, tick.time
        self._looked_at[self._due] = tick.number
        self._expiry[self._due] = tick.time + self.times[: len(self._due)]

    def name(self) -> int:
        """The pair that the schedule puts first."""
        return int(self._schedule.ranking()[0])

    def find_earliest(self) -> float:
        """End of the first certificate, in [s] from now."""
        return float(self._expiry.min() - self._now)

    def count_expired(self) -> int:
        """Pairs without a certificate in force or an evaluation in this tick."""
        held = (self._expiry > self._now) | (self._looked_at == self._number)
        return int(np.count_nonzero(~held))

    def count_flagged(self) -> int:
        """Pairs that the next visit might find too late."""
        return len(self._schedule.flagged())

    def last_look(self, pair: int) -> int:
        """Tick of a pair's last evaluation; -1 if there was none."""
        return int(self._looked_at[pair])


class Full(PairSchedule):
    """All pairs in each tick: what the others are held against."""

    def name(self) -> int:
        """The first of those with the least contact time."""
        return int(self.times.argmin())


class Deadline:
    """The monitor's own scheduler over obstacles, asked what `PairSchedule` is asked."""

    def __init__(self, robot: Robot, obstacles: Obstacles, make_arm) -> None:
        self._states = JointStates(robot, JOINT_TIMEOUT)
        self._scheduler = Scheduler(robot, obstacles, make_arm, self._states, SETTINGS)

    def step(self, tick: Tick) -> int:
        """Evaluate what is due; how many evaluations that took."""
        self._scheduler.follow()
        self._states.q[:], self._states.v[:] = tick.q, tick.v
        self._result = self._scheduler.evaluate_due(tick)
        return self._result.evaluated

    def record(self, tick: Tick) -> None:
        """Remember when that was; the scheduler remembers all else."""
        self._now = tick.time

    def name(self) -> int:
        """The pair whose certificate ends first."""
        return self._result.pair

    def find_earliest(self) -> float:
        """End of the first certificate, in [s] from now."""
        return self._result.expiry - self._now

    def count_expired(self) -> int:
        """Obstacles that are overdue."""
        return self._result.overdue

    def count_flagged(self) -> int:
        """None: nothing waits beyond what matters to a stop."""
        return 0

    def last_look(self, pair: int) -> int:
        """Tick of the last look at a pair's obstacle."""
        return round(self._scheduler.recall(pair).evaluated_at * RATE)
