"""What the monitor asks of a scheduler over pairs of link and obstacle.

Two schedulers keep this promise: one evaluates obstacles by their deadlines in one compiled call,
and one that lets any schedule of pair numbers decide.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.pairs.arm import WatchedArm
from armguard.robot.robot import Robot
from armguard.scheduling.timing_wheel import NOBODY


class Tick(NamedTuple):
    """One tick, as a scheduler is told of it; times in [s]."""

    number: int
    now: float
    """On the obstacles' clock."""
    time: float
    """The same since the monitor's epoch."""
    q: FloatArray
    """Joint positions, [rad] or [m]. Shape (nv,)."""
    v: FloatArray
    """Joint velocities, [rad/s] or [m/s]. Shape (nv,)."""
    arm_age: float
    """Age of the joint state; negative where it is newer than now."""
    stop_time: float
    """In which the arm surely rests."""
    refinement_threshold: float
    """What could be touched before this is refined."""
    late_stop_time: float = math.inf
    """In which the arm surely rests that brakes only when a speed scale has run out."""


class TickResult(NamedTuple):
    """What a tick's evaluations of pairs found."""

    pair: int
    """Whose certificate ends first, row × links + link; NOBODY without pairs."""
    expiry: float
    """When that is, in [s] since the monitor's epoch; inf without pairs."""
    overdue: int
    """How many have neither a certificate in force nor an evaluation in this tick, whatever the
    stop decision says; beside those that have `ended`."""
    evaluated: int
    """Evaluations spent."""
    broken: tuple[int, ...] = ()
    """Rows of obstacles that broke the bounds behind their certificates."""
    disturbed: bool = True
    """Whether there may be changes that proofs of earlier ticks do not allow for."""
    ended: int = 0
    """How many obstacles have certificates that ended and were not evaluated in this tick: overdue
    unless the stop decision is made about all of them."""


NOTHING_FOUND = TickResult(NOBODY, math.inf, 0, 0)
"""Result of a tick in which nothing was evaluated."""

AdvanceResult = tuple[int, int, float, float, TickResult | None]
"""What was found of a joint state, below 0 where it is refused, and the joint that it is refused
for, both stop times in [s], and what the tick's evaluations found; None: they are still to come."""


class Listing(NamedTuple):
    """What is most imminent, soonest first; times in [s] since the monitor's epoch."""

    rows: IntArray
    """Of obstacles. Shape (o,)."""
    row_expiry: FloatArray
    """When the first certificate of each ends. Shape (o,)."""
    pairs: IntArray
    """Row × links + link. Shape (m,)."""
    expiry: FloatArray
    """When each pair's certificate ends. Shape (m,)."""
    evaluated_at: FloatArray
    """When each was evaluated last. Shape (m,)."""
    sphere: IntArray
    """Sphere that decided each. Shape (m,)."""
    bound: IntArray
    """What each certificate rests on, an index of `BOUND_NAMES`. Shape (m,)."""
    sphere_expiry: FloatArray
    """Soonest contact of each finest sphere of the arm. Shape (s,)."""
    all_expiry: FloatArray
    """When the certificates of all pairs of the rows looked at end, in no order. Shape (n,)."""


class Unsafe(NamedTuple):
    """Answer to the question whether the arm surely rests before contact."""

    pair: int
    """A pair that might touch before, row × links + link; NOBODY if there is none."""
    evaluated: int
    """Evaluations spent."""
    left: int
    """Obstacles that were not decided about when the budget was spent; 0 if it was not."""


class PairResult(NamedTuple):
    """What is known of one pair; times in [s] since the monitor's epoch."""

    expiry: float
    """When its certificate ends."""
    evaluated_at: float
    """When it was evaluated."""
    sphere: int
    """Sphere that decided it."""
    bound: int
    """What the certificate rests on, an index of `BOUND_NAMES`."""


class Scheduler(Protocol):
    """Evaluates pairs, and knows for each until when it is safe."""

    arm: WatchedArm

    @property
    def waiting(self) -> int:
        """How many obstacles were due in the last tick and still wait, as a STOP was certain."""
        ...

    def follow(self) -> None:
        """Take in what was attached to the robot, and obstacles that came or went.

        Raises:
            ArmguardError: Another scheduler follows the table, so that news of it is lost.
        """
        ...

    def prepare_arm(self, robot: Robot) -> None:
        """Lay out an arm ahead, for a later tick in which the robot has become like this one.

        Args:
            robot: The arm with other bodies attached.
        """
        ...

    def watch_anew(self, rows: IntArray) -> None:
        """Take in which links are watched against some obstacles now, after `follow`.

        All their pairs are evaluated in this tick, as those of obstacles that have just come.

        Args:
            rows: Of obstacles that are there. Shape (r,).
        """
        ...

    def restart(self) -> None:
        """Start again with all obstacles that are there, whatever happened before."""
        ...

    def invalidate_all(self) -> None:
        """Invalidate all certificates: the arm's bounds or state have changed."""
        ...

    def advance(
        self,
        stamp: float,
        q: FloatArray,
        v: FloatArray,
        now: float,
        epoch: float,
        number: int,
        may_evaluate: bool,
    ) -> AdvanceResult:
        """Accept a joint state, and evaluate what is due if nothing else needs to be done.

        Args:
            stamp: When the state was measured, in [s].
            q: Joint positions, [rad] or [m]; plain, see `JointStates.is_plain`. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]; plain. Shape (nv,).
            now: Time of the tick, in [s].
            epoch: Since when the monitor counts time, in [s].
            number: Of the tick.
            may_evaluate: Whether nothing needs to be done between state and evaluations.
        """
        ...

    def evaluate_due(self, tick: Tick) -> TickResult:
        """Evaluate the pairs that are due, in a tick whose advance did not."""
        ...

    def prepare(self, tick: Tick) -> None:
        """Place the arm and fill its bounds for a tick, needed by its evaluations or not."""
        ...

    def watched_pairs(self) -> NDArray[np.bool_]:
        """Which pairs are watched, by row × links + link; none beyond its end. Shape (n,)."""
        ...

    def expect_evaluations(self) -> float:
        """How many evaluations a tick costs as imminent as all pairs are now."""
        ...

    def recall_stops(
        self,
        tick: Tick,
        stop_time: float,
        later: float = 0.0,
        kept_since: float | None = None,
        *,
        soon: float = 0.0,
    ) -> int:
        """Whether earlier ticks have proved already that the arm rests in time, told to stop.

        For what has no certificate that outlasts the stop, by `find_unsafe` for a time that has not
        passed.

        Args:
            tick: The tick.
            stop_time: When the arm surely rests, in [s] from the tick.
            later: When it is told to stop at the latest, in [s] from the tick.
            kept_since: As for `find_unsafe`.
            soon: What is proved for no longer than that and so much more, in [s], ends soon.

        Returns:
            PROVED; ENDING where some proof ends soon, and this tick has had nothing else to do, so
            that it may well be renewed; IN_VAIN where all that is not proved was asked a moment ago
            already; or ASKABLE, which says nothing.
        """
        ...

    def find_unsafe(
        self,
        tick: Tick,
        stop_time: float,
        *,
        within: float | None = None,
        remembers: bool = True,
        lasting: float = -1.0,
        until: float = 0.0,
        pause: float = 0.0,
        kept_since: float | None = None,
    ) -> Unsafe:
        """A pair that might touch before the arm rests, if there is one.

        Judged by the arm's table of braking, which ends at `stop_time`, for all obstacles that
        could be touched by then, or `within` a shorter time, in [s]: it is not about others. Where
        the user's budget does not suffice, a pair counts as unsafe. What is found may be asked for
        first the next time, unless `remembers` is false: then nothing changes.

        A `lasting` of 0 or more, in [s], says that the table is that of an arm that is told to stop
        at any time from this tick until so much later. Then what was proved of earlier tables for
        all that comes `until` so much later, in [s], need not be asked again; what ends soon may be
        renewed along with the rest. Obstacles that might be touched are not asked again by
        questions with a `pause` until that is over, in [s], or something newer is known of them:
        they count as unsafe.

        Where `kept_since` is given, the table is that of an arm whose joints keep to some speeds,
        as they surely have since then, in [s] since the epoch. Proofs of such tables stand by
        themselves; older ones count for nothing, and the others are of the same speeds or higher.
        """
        ...

    def list_imminent(self, time: float, *, row_limit: int, pair_limit: int) -> Listing:
        """What is most imminent at `time`, in [s] since the epoch; cheap, and the caller's own."""
        ...

    def recall(self, pair: int) -> PairResult:
        """What is known of one pair."""
        ...
