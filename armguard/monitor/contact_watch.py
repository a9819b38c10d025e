"""Watches permitted contact: reports it, and stops the arm so that it does not press.

From the first tick in which a link touches a body part by its measured state, the verdict is a STOP
until the part has moved away. The proofs about all other obstacles then have one more premise: the
contact moves no joint. Each joint state tests it.
"""

from __future__ import annotations

import math

from armguard.jit.arrays import FloatArray
from armguard.robot.joints import is_prismatic
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.scheduling.timing_wheel import NOBODY
from armguard.verdict import Reason, ReasonKind, Verdict

SHOWN_FROM = 0.1
"""Duration of a contact from which on it is reported, in [s]."""


class ContactWatch:
    """Follows permitted contact from tick to tick.

    Args:
        robot: The arm.
        scheduler: Knows the pairs.
    """

    def __init__(self, robot: Robot, scheduler: Scheduler) -> None:
        self._robot = robot
        self._scheduler = scheduler
        self.reset()

    def reset(self) -> None:
        """Drop the contacts."""
        # What is marked as touched is not judged by its bounds.
        self._scheduler.arm.obstacles.table.touched[:] = False
        self._pair = NOBODY
        self._since = self._rests_at = 0.0
        self._rest: FloatArray | None = None
        self._tick: Tick | None = None
        self._possible_from = math.inf

    @property
    def is_touching(self) -> bool:
        """Whether a link touched something in the last tick."""
        return self._pair != NOBODY

    def update(self, tick: Tick, expiry: float, *, is_on_piece: bool) -> list[Reason]:
        """Reasons to stop for present contacts in a tick, after its evaluations.

        Args:
            tick: The tick.
            expiry: Expiry of the first certificate, in [s] since the epoch: until then no link
                touches anything.
            is_on_piece: Whether the arm follows a committed piece to its end, whatever verdicts
                say.
        """
        if expiry > tick.time and self._pair == NOBODY:
            return []
        pair = self._scheduler.find_touch(tick)
        if pair == NOBODY:
            self._pair, self._rest = NOBODY, None
            return []
        if self._pair == NOBODY:
            self._since, self._rests_at = tick.now, tick.now + tick.stop_time
        self._pair = pair
        link, obstacle = self._scheduler.arm.names(pair)
        # How long it has lasted is right on every clock, and the same in a replay.
        lasted = tick.now - self._since
        detail = f"for {lasted:.1f} s" if lasted >= SHOWN_FROM else ""
        reasons = [Reason(ReasonKind.IN_CONTACT, f"{link} and {obstacle}", detail)]
        if is_on_piece:
            # It rests anew where the piece ends.
            self._rest, self._rests_at = None, tick.now + tick.stop_time
        elif tick.now >= self._rests_at:
            reasons += self._check_rest(tick)
        return reasons

    def _check_rest(self, tick: Tick) -> list[Reason]:
        """A reason if a joint of the arm, which must be at rest by now, has been moved."""
        if self._rest is None:
            self._rest = tick.q.copy()
            return []
        robot = self._robot
        off = abs(tick.q - self._rest)
        beyond = off - 2.0 * robot.position_error
        worst = int(beyond.argmax())
        if beyond[worst] <= 0.0:
            return []
        return [_describe_moved(robot, worst, float(off[worst]))]

    def note_verdict(self, tick: Tick, verdict: Verdict) -> None:
        """Store the time from which contact is possible, by the verdict of a tick."""
        self._tick = tick
        self._possible_from = tick.now + verdict.contact_time

    def explains_jump(self, now: float) -> bool:
        """Whether permitted contact may have moved a joint whose state jumped."""
        if self.is_touching:
            return True
        if self._tick is None or not now >= self._possible_from:
            return False
        # The certificates of that tick: none was made since.
        found = self._scheduler.find_permitted_contact(self._tick, now - self._tick.now)
        return found.pair != NOBODY


def _describe_moved(robot: Robot, joint: int, off: float) -> Reason:
    """The reason that a contact moved a joint, by an amount in [rad] or [m]."""
    unit = "m" if is_prismatic(robot.model, 1 + joint) else "rad"
    return Reason(ReasonKind.MOVED_BY_CONTACT, robot.joints[joint], f"by {off:.3g} {unit}")
