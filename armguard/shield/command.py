"""What a shield answers in each step."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from armguard.bounds.planned.curve import evaluate_curve
from armguard.jit.arrays import FloatArray
from armguard.verdict import Reason, Verdict


class Command(NamedTuple):
    """The motion that the arm is to follow from now to its rest; proved as a whole."""

    times: FloatArray
    """Of the samples, in [s] on the monitor's clock; cubic between them. Shape (n,)."""
    q: FloatArray
    """Joint positions, in [rad] or [m]. Shape (n, nv)."""
    v: FloatArray
    """Joint velocities, in [rad]/[s] or [m]/[s]. Shape (n, nv)."""
    a: FloatArray
    """Joint accelerations, in [rad]/[s²] or [m]/[s²]. Shape (n, nv)."""
    is_new: bool
    """Whether it goes on in this step; else the arm is to go on along the one before."""
    valid_until: float
    """When the arm rests at its end, in [s]: it may be followed until then, whatever is silent."""
    scale: float
    """How fast the arm goes, of what was asked for: pace along the path, or share of velocities."""
    moving: bool
    """Whether it moves from now on."""
    stop: Literal["finish", "brake"] | None
    """BRAKE where the motion is not proved any more: something broke its bounds. Then the arm is
    to brake by its own means, if it can do so sooner than this motion does."""
    verdict: Verdict
    """Of the monitor, for this step."""
    reason: Reason | None
    """Why it does not go on as fast as it was asked to; None: it does."""
    contact_speed: float | None
    """Greatest speed at which this motion could touch what may be touched, in [m]/[s]; None where
    no contact limits are stated."""
    executed: int = 0
    """How many points of a chunk it passes before its stop begins."""

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where the arm is to be at a time: as at its beginning before that, at rest after its end.

        Args:
            time: In [s] on the monitor's clock.

        Returns:
            Positions, velocities and accelerations, in [rad] or [m], and by [s] and [s²]. Shape
            (nv,) each.
        """
        if time >= self.times[-1]:
            # Exactly, whatever rounding does to the curve.
            return self.q[-1].copy(), self.v[-1].copy(), self.a[-1].copy()
        begin = float(self.times[0])
        q, v = np.empty(self.q.shape[1]), np.empty(self.q.shape[1])
        evaluate_curve(self.times - begin, self.q, self.v, time - begin, q, v)
        k = min(max(int(np.searchsorted(self.times, time)), 1), len(self.times) - 1)
        first, second = self.times[k - 1 : k + 1]
        share = min(max((time - first) / (second - first), 0.0), 1.0)
        return q, v, (1.0 - share) * self.a[k - 1] + share * self.a[k]
