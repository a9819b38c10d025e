"""Processes states and removals of obstacles: converts stamps, and updates the table.

If the time of a measurement is not known exactly, its errors are increased by the possible motion
of a body in the uncertain time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.messages.batch import ObstacleBatch, read_batch
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage
from armguard.streams.intake import Intake
from armguard.streams.source_accounts import SourceAccount

_NUMBERS = ObstacleBatch._fields[2:9]
"""Fields of a batch that are numbers, but for its stamp."""


class ObstacleIntake:
    """Takes states of obstacles, and removals.

    Args:
        intake: The table, where faults are counted, and times.
        accel: Bound of obstacles that bring none and that no pattern of the table's fits, in
            [m/s²]; for sources without a clock.
        speed: Bound on their speed, in [m/s].
    """

    def __init__(self, intake: Intake, accel: float = math.inf, speed: float = math.inf) -> None:
        self._intake = intake
        self._bounds = accel, speed

    def take(self, message: ObstaclesMessage, account: SourceAccount) -> None:
        """Tell the table of obstacles; what the table cannot use is counted.

        Raises:
            MessageError: It has more or fewer numbers than its ids ask for.
        """
        intake = self._intake
        stamp, gap = intake.times.translate(message.stamp, account.clock)
        batch = sent = read_batch(message, stamp)
        window = account.clock.error + gap
        if window > 0.0:
            batch = self._widen(batch, window)
        try:
            is_as_told = intake.obstacles.take(batch, account.limits.obstacles)
        except ArmguardError as error:
            intake.count_refused(error, batch.source, message.seq)
            is_as_told = False
        if not is_as_told:
            told = {name: getattr(sent, name) for name in _NUMBERS} | {"stamp": message.stamp}
            is_finite = intake.check_finite(sent.source, message.seq, told)
            if is_finite and not np.isfinite(batch.position_error).all():
                problem = (
                    f"speed has no bound, and stamps may be {window:.3g} s off; "
                    "expected a finite speed, or a velocity and a finite accel"
                )
                intake.faults.add("refused", sent.source, message.seq, problem)

    def take_removal(self, message: RemoveMessage, account: SourceAccount) -> None:
        """Tell the table what has gone; what cannot be used is counted."""
        intake, source = self._intake, message.source
        # A removal that looks older than it is removes less.
        stamp, _ = intake.times.translate(message.stamp, account.clock)
        try:
            intake.obstacles.remove(message.ids, stamp=stamp, source=source)
        except ArmguardError as error:
            intake.count_refused(error, source, message.seq)

    def _widen(self, batch: ObstacleBatch, window: float) -> ObstacleBatch:
        """The batch with errors for a stamp that may be off by `window` [s]."""
        accel, speed = self._intake.obstacles.bounds.find(batch.ids, *self._bounds)
        position_error, velocity_error = widen(
            window,
            accel if batch.accel is None else batch.accel,
            speed if batch.speed is None else batch.speed,
            batch.velocity,
            batch.position_error,
            batch.velocity_error,
        )
        return batch._replace(position_error=position_error, velocity_error=velocity_error)


def widen(
    window: float,
    accel: ArrayLike,
    speed: ArrayLike,
    velocity: NDArray[np.float64] | None,
    position_error: ArrayLike,
    velocity_error: ArrayLike,
) -> tuple[Any, ...]:
    """Errors of positions and velocities with what a body can do between stamp and measurement.

    Args:
        window: Between stamp and measurement, in [s] at most.
        accel: Bound on acceleration, in [m/s²]. Shape () or (n,).
        speed: Bound on speed, in [m/s]. Shape () or (n,).
        velocity: As measured, in [m/s]; None: it was not. Shape (n, 3) or (n, k, 3).
        position_error: Received position errors, in [m]. Shape () or (n,).
        velocity_error: Received velocity errors, in [m/s]. Shape () or (n,).
    """
    accel, speed = np.asarray(accel), np.asarray(speed)
    position_error, velocity_error = np.asarray(position_error), np.asarray(velocity_error)
    is_broken: Any = False
    if velocity is not None:
        fastest = np.linalg.norm(velocity, axis=-1)
        fastest = fastest.max(axis=-1) if fastest.ndim > 1 else fastest
        # Without a bound on speed it is as fast as it was measured, and what it gains.
        gained = fastest + velocity_error + np.where(accel < math.inf, accel, 0.0) * window
        speed = np.where((speed == math.inf) & (accel < math.inf), gained, speed)
        # A speed that breaks its bound must not pass because of the wider error.
        is_broken = fastest - velocity_error > speed  # NaN is for the table to refuse
        speed = np.where(is_broken, fastest + velocity_error, speed)
    with np.errstate(invalid="ignore"):
        # What is negative stays so, for the table to refuse.
        wider = np.where(position_error < 0.0, position_error, position_error + speed * window)
        # Without a bound on acceleration velocities do not matter, however well known.
        is_wider = ~np.asarray(is_broken) & (velocity_error >= 0.0) & (accel < math.inf)
        faster = np.where(is_wider, velocity_error + accel * window, velocity_error)
    return tuple(error if error.ndim else error.item() for error in (wider, faster))
