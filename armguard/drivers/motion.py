"""Follows the commands of a shield: motions that are proved to their rest.

A motion is taken up in time, and only where it joins the one before, or where the arm rests. After
that the arm goes on along it to its end, whatever is silent. It brakes by its own means only where
the shield says that the motion is not proved any more, or where the robot is in trouble.
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
"""Between two states that an approach counts with, in [s], at most."""

REST_REACH = 0.05
"""How far a resting arm may be off a command that rests, in [rad], to take it up. The shield has
seen the arm within its tracking error, or it would say "brake"."""

QUIET = LONGEST_VELOCITY
"""After a fault no goal moves the arm before there was none for so long, in [s]: as long as the
velocity of a stream holds. Then the next one is sent by somebody who knows of the fault."""

APPROACH = 0.01
"""How fast an arm that was off a command comes to it, in [rad/s]: less than tracking errors are."""


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
        """Where in the rows of the followed motion the robot's joints are."""
        self._offset = np.zeros(len(self._names))
        """How far from the followed motion the arm is led, in [rad]."""
        self._approached_at = 0.0
        self._seen: CommandMessage | None = None
        self._sequence = 0
        self._goal: int | None = None
        """The newest one."""
        self._quiet_since = math.inf
        """When the newest goal came; inf: nothing has come."""
        self._heard_at = math.inf
        self._is_barred = True
        """Whether the newest goal is older than the end of a fault, or the beginning."""
        self._problem = ""

    def act(self, moment: Moment) -> None:
        """Follow, take up, or brake."""
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
        if np.isfinite(q).all():
            self._arm.follow(q.tolist())
        else:
            self._complain("the motion of a command is not finite: braking")
            self._drop(moment)

    def _brake(self, moment: Moment) -> None:
        """Follow nothing any more, and slow down."""
        self._followed, self._braked_at = None, moment.now
        self._arm.brake()

    def _drop(self, moment: Moment) -> None:
        """Brake, and wait for another goal."""
        if self._followed is not None:
            self._brake(moment)
        self._is_barred = True

    def _consider(self, command: CommandMessage, moment: Moment) -> None:
        """Take up a new command, or brake where the motion that is followed is not proved.

        Raises:
            MessageError: The command is malformed.
        """
        counts = self._session.latencies.counts
        counts.commands += 1
        if command.sequence < self._sequence:
            self._complain("the shield was started anew: send it a goal")
            self._drop(moment)
            self._quiet_since = math.inf
        self._sequence = command.sequence
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
                f"goals are not followed before none has come for {QUIET:g} s: pause their stream"
            )

    def _join_at_rest(
        self,
        command: CommandMessage,
        order: NDArray[np.intp],
        here: NDArray[np.float64],
        moment: Moment,
    ) -> bool:
        """Take up a command that rests near where the arm rests, so that it joins the next ones.

        An arm that has missed commands rests off the motion that the shield knows, and within its
        tracking error; there it may be led to it, slowly.
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
        """Follow a command from now on, with the offset that the arm has."""
        self._followed, self._order = command, order

    def _complain(self, problem: str) -> None:
        """Tell of a problem once."""
        if problem != self._problem:
            self._problem = problem
            self._session.link.tell(problem)
