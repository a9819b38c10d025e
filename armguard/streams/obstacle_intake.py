"""States of obstacles, and removals: handed to the table in the monitor's time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from armguard.exceptions import ArmguardError
from armguard.messages.batch import ObstacleBatch, read_batch
from armguard.messages.incoming import MessageError, ObstaclesMessage, RemoveMessage
from armguard.streams.intake import Intake
from armguard.streams.source_accounts import SourceAccounts
from armguard.streams.stamp_clocks import MONOTONIC, StampClock
from armguard.streams.widening import widen

_NUMBERS = ObstacleBatch._fields[1:9]
"""Fields of a batch that are numbers."""


class ObstacleIntake:
    """Takes states of obstacles, and removals.

    Args:
        intake: The table, where faults are counted, and times.
        accounts: What sources may send.
        clocks: How sources stamp; those not named here, with the monotonic clock.
        accel: Bound of obstacles that bring none and that no pattern of the table's fits, in
            [m/s²]; for sources without a clock.
        speed: Alike, in [m/s].
    """

    def __init__(
        self,
        intake: Intake,
        accounts: SourceAccounts,
        clocks: Mapping[str, StampClock],
        accel: float = math.inf,
        speed: float = math.inf,
    ) -> None:
        self._intake = intake
        self._accounts = accounts
        self._clocks = clocks
        self._bounds = accel, speed

    def take(self, message: ObstaclesMessage) -> None:
        """Tell the table of obstacles; what cannot be used is counted."""
        intake, source, sequence = self._intake, message.source, message.seq
        self._accounts.check_obstacles(message)
        clock = self._clocks.get(source, MONOTONIC)
        stamp, gap = intake.times.translate(message.stamp, clock)
        counted = False
        try:
            fields: dict[str, Any] = read_batch(message)._asdict()
            intake.check_finite(source, sequence, {name: fields[name] for name in _NUMBERS})
            window = clock.error + gap
            if window > 0.0:
                known = intake.obstacles.bounds.find(message.ids, *self._bounds)
                widen(fields, window, *known)
        except MessageError as error:
            # Handed on as it came: the table refuses it too, and so the verdict knows of it.
            fields = {name: getattr(message, name) for name in ObstacleBatch._fields}
            intake.faults.add("malformed", source, sequence, str(error))
            counted = True
        fields["stamp"] = stamp
        try:
            intake.obstacles.update(**fields)
        except ArmguardError as error:
            if not counted:
                intake.faults.add("refused", source, sequence, str(error))

    def take_removal(self, message: RemoveMessage) -> None:
        """Tell the table what has gone; what cannot be used is counted."""
        intake, source = self._intake, message.source
        # A removal that looks older than it is removes less.
        stamp, _ = intake.times.translate(message.stamp, self._clocks.get(source, MONOTONIC))
        try:
            intake.obstacles.remove(message.ids, stamp=stamp, source=source)
        except ArmguardError as error:
            intake.faults.add("refused", source, message.seq, str(error))
