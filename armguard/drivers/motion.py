"""Follows the commands of a shield: motions that are proved to their rest.

The driver starts a motion only in time, and only if it joins the one before or the arm is at rest.
Then the arm follows it to its end, even if the shield is silent. The arm brakes by its own means
only if the shield withdraws its proof of the motion, or the robot has a problem.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armguard.drivers.arm import REST_SPEED, ArmLostError, MotionArm
from armguard.drivers.moment import Moment
from armguard.drivers.session import Session
from armguard.messages.command import CommandMessage
from armguard.messages.incoming import MessageError
from armguard.streams.goal_intake import LONGEST_VELOCITY

WAIT = 0.01
"""Greatest time between two states that an approach uses, in [s]."""

REST_REACH = 0.05
"""Greatest distance of an arm at rest from a command at rest that it may follow, in [rad]. Within
its tracking error, the shield does not command "brake"."""

QUIET = LONGEST_VELOCITY
"""After a fault, goals must pause for this time before a goal moves the arm, in [s]: as long as the
velocity of a stream is valid. Then the sender of the next goal knows of the fault."""

APPROACH = 0.01
"""How fast an arm approaches a command that it is off, in [rad/s]: less than tracking errors."""

LONGEST_STEP = 0.02
"""Greatest time of the motion in one step of the arm, in [s]; at fast rates, two periods, or
`WAIT`. In a servo that is 0.03 s behind, such a step adds a fifth to the motion's speed."""


class MotionConduct:
    """Lets an arm follow the commands of one shield; see `Conduct`.

    Args:
        arm: Follows positions.
        session: That it is part of.
    """

    def __init__(self, arm: MotionArm, session: Session) -> None:
        self._arm = arm
        self._session = session
        self._names = session.options.names
        self._braked_at = math.inf
        self._followed: CommandMessage | None = None
        self._order: NDArray[np.intp] = np.arange(0)
        """Columns of the robot's joints in the rows of the followed motion."""
        self._offset = np.zeros(len(self._names))
        """Offset of the arm from the followed motion, in [rad]."""
        self._approached_at = 0.0
        period = 1.0 / max(session.options.rate, 1.0)
        self._longest_step = min(max(2.0 * period, WAIT), LONGEST_STEP)
        self._sent: tuple[float, NDArray[np.float64]] | None = None
        """When the arm was told where to be, in [s], and where, in [rad]."""
        self._seen: CommandMessage | None = None
        self._run: str | None = None
        """Of the newest command; None: there was none."""
        self._goal: int | None = None
        """The newest one."""
        self._quiet_since = math.inf
        """When the newest goal came; inf: there was none."""
        self._heard_at = math.inf
        self._is_barred = True
        """Whether the newest goal is older than the end of a fault, or the beginning."""
        self._problem = ""

    def act(self, moment: Moment) -> None:
        """Follow a motion, start a new one, or brake."""
        command = moment.command
        if moment.hindrance:
            self._drop(moment)
        if command is not None and command is not self._seen:
            self._seen = command
            try:
                self._consider(command, moment)
            except MessageError as error:
                self._complain(f"a command cannot be read: {error}")
        if not moment.is_new:
            return
        is_resting = max(map(abs, moment.state.v)) <= REST_SPEED
        is_overdue = moment.now - self._braked_at > self._session.options.stop_within
        if self._followed is None and not is_resting and is_overdue:
            raise ArmLostError("the arm does not brake")
        if self._arm.is_braking:
            return
        if self._followed is None:
            self._arm.hold()
            return
        step = APPROACH * min(moment.now - self._approached_at, WAIT)
        self._offset -= np.clip(self._offset, -step, step)
        self._approached_at = moment.now
        q = self._followed.at(moment.now)[0][self._order] + self._offset
        excess = self._find_excess(q, moment.now)
        self._offset -= excess
        q -= excess
        if not np.isfinite(q).all():
            self._complain("the motion of a command is not finite: braking")
            self._drop(moment)
        elif excess.any() and np.abs(self._offset).max() > REST_REACH:
            self._complain(
                "after a pause the arm is too far behind its motion: braking; send another goal"
            )
            self._drop(moment)
        else:
            self._sent = moment.now, q
            self._arm.follow(q.tolist())

    def _find_excess(self, q: NDArray[np.float64], now: float) -> NDArray[np.float64]:
        """By how much a position is too far for one step, in [rad]. Shape (nv,).

        In a pause of the states or of this process, the arm rests at the last position, and the
        motion goes on. If the next position were on the motion, the arm would jump to it, much
        faster than the motion is. So the arm goes on from where it is, at the motion's pace.

        Args:
            q: Position on the motion, with the present offset, in [rad]. Shape (nv,).
            now: In [s].
        """
        if self._sent is None or not now - self._sent[0] > self._longest_step:
            return np.zeros(len(q))
        sent_at, last = self._sent
        return (q - last) * (1.0 - self._longest_step / (now - sent_at))

    def _brake(self, moment: Moment) -> None:
        """End the followed motion, and slow down."""
        self._followed, self._sent, self._braked_at = None, None, moment.now
        self._arm.brake()

    def _drop(self, moment: Moment) -> None:
        """Brake, and wait for another goal."""
        if self._followed is not None:
            self._brake(moment)
        self._is_barred = True

    def _consider(self, command: CommandMessage, moment: Moment) -> None:
        """Start a new command, or brake if the followed motion is no longer proved.

        Raises:
            MessageError: The command is malformed.
        """
        counts = self._session.latencies.counts
        counts.commands += 1
        # Without the name of its run, each command can be that of another shield.
        if self._run is not None and (command.run != self._run or not command.run):
            self._complain("the shield was restarted: send it a goal")
            self._drop(moment)
            self._quiet_since = math.inf
        self._run = command.run
        self._note_goal(command, moment)
        if sorted(command.names) != sorted(self._names):
            self._complain(f"a command is for other joints: {', '.join(command.names)}")
            return
        if command.stop == "brake":
            if self._followed is not None:
                counts.stops += 1
                self._brake(moment)
            elif max(map(abs, moment.state.v)) > REST_SPEED and not self._arm.is_braking:
                # The order could not be sent, or a process before this one has left the arm so.
                self._braked_at = min(self._braked_at, moment.now)
                self._arm.brake()
            return
        is_old = command.goal is None or self._is_barred
        if moment.hindrance or self._arm.is_braking or (is_old and self._followed is None):
            return
        samples = command.read()
        is_finite = all(np.isfinite(values).all() for values in samples)
        if not (is_finite and (np.diff(samples.times) > 0.0).all()):
            raise MessageError("motion", "not finite or not rising", "numbers at times that rise")
        order = np.array([command.names.index(name) for name in self._names])
        if self._followed is not None:
            here, speeds, _ = self._followed.at(moment.now)
        elif max(map(abs, moment.state.v)) <= REST_SPEED:
            here, speeds = np.empty(len(order)), np.zeros(len(order))
            here[order] = moment.state.q
        else:
            return
        if command.joins(here, speeds, moment.now):
            if self._followed is None:
                self._offset = np.zeros(len(order))
            self._take_up(command, order, moment)
        elif not self._join_at_rest(command, order, here, moment):
            counts.missed += 1

    def _note_goal(self, command: CommandMessage, moment: Moment) -> None:
        """Note a new goal, and whether the arm may move for it."""
        # Where no command came, it is not known whether goals did.
        is_first = math.isinf(self._quiet_since) or moment.now - self._heard_at >= QUIET
        self._heard_at = moment.now
        if not (is_first or command.goal != self._goal):
            return
        was_quiet = moment.now - self._quiet_since >= QUIET
        self._goal, self._quiet_since = command.goal, moment.now
        if not self._is_barred or is_first or command.goal is None or moment.hindrance:
            return
        if was_quiet:
            self._is_barred, self._problem = False, ""
        else:
            self._complain(
                f"goals are ignored until none has arrived for {QUIET:g} s: pause their stream"
            )

    def _join_at_rest(
        self,
        command: CommandMessage,
        order: NDArray[np.intp],
        here: NDArray[np.float64],
        moment: Moment,
    ) -> bool:
        """Start a command at rest near the arm at rest, so that the arm joins later commands.

        An arm that has missed commands is at rest away from the shield's motion, within its
        tracking error. It may then approach that motion slowly.
        """
        followed = self._followed
        is_resting = followed is None or not moment.now < followed.valid_until
        if not is_resting or command.moving or not len(command.times):
            return False
        off = here - command.at(moment.now)[0]
        if not (np.abs(off).max() <= REST_REACH and moment.now <= command.take_up_by):
            return False
        if followed is None:
            self._offset = np.zeros(len(order))
        self._offset, self._approached_at = self._offset + off[order], moment.now
        self._take_up(command, order, moment)
        return True

    def _take_up(self, command: CommandMessage, order: NDArray[np.intp], moment: Moment) -> None:
        """Follow a command from now on, with the arm's present offset."""
        self._followed, self._order = command, order

    def _complain(self, problem: str) -> None:
        """Report a problem once."""
        if problem != self._problem:
            self._problem = problem
            self._session.link.tell(problem)
