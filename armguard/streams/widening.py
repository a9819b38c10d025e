"""Wider errors of obstacles whose time of measurement is not known exactly."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def widen(
    fields: dict[str, Any], window: float, known_accel: ArrayLike, known_speed: ArrayLike
) -> None:
    """Add to errors what a body can do between its stamp and its measurement.

    Args:
        fields: Of the message, as arrays or numbers; `position_error` and `velocity_error` are
            replaced.
        window: Between stamp and measurement, in [s] at most.
        known_accel: Bounds of bodies whose message gives none, in [m/s²]. Shape () or (n,).
        known_speed: Alike, in [m/s].
    """
    speed = np.asarray(known_speed if fields["speed"] is None else fields["speed"])
    accel = np.asarray(known_accel if fields["accel"] is None else fields["accel"])
    position_error = np.asarray(fields["position_error"])
    velocity_error = np.asarray(fields["velocity_error"])
    velocity = fields["velocity"]
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
        fields["position_error"] = np.where(
            position_error < 0.0, position_error, position_error + speed * window
        )
        # Without a bound on acceleration velocities do not matter, however well known.
        is_wider = ~np.asarray(is_broken) & (velocity_error >= 0.0) & (accel < math.inf)
        fields["velocity_error"] = np.where(
            is_wider, velocity_error + accel * window, velocity_error
        )
