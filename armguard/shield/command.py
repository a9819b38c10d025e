"""The command of a shield, which it returns in each step."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from armguard.bounds.planned.curve import evaluate_curve
from armguard.jit.arrays import FloatArray
from armguard.verdict import Reason, Verdict


class Command(NamedTuple):
    """The motion that the arm must follow from now until it is at rest; proved as a whole."""

    times: FloatArray
    """Times of the samples, in [s] on the monitor's clock; cubic between them. Shape (n,)."""
    q: FloatArray
    """Joint positions, in [rad] or [m]. Shape (n, nv)."""
    v: FloatArray
    """Joint velocities, in [rad]/[s] or [m]/[s]. Shape (n, nv)."""
    a: FloatArray
    """Joint accelerations, in [rad]/[s²] or [m]/[s²]. Shape (n, nv)."""
    is_new: bool
    """Whether this motion is new in this step; if not, the arm must follow the one before."""
    valid_until: float
    """Time at which the arm is at rest at its end, in [s]. It may be followed until then, even
    without further messages."""
    scale: float
    """Pace along the path, or velocity as a fraction of the requested one, 0 to 1."""
    moving: bool
    """Whether the arm moves from now on."""
    stop: Literal["finish", "brake"] | None
    """BRAKE if the motion is not proved any more, because something broke its bounds. Then the
    arm must brake by its own means, if it can do so sooner than this motion does."""
    verdict: Verdict
    """Verdict of the monitor for this step."""
    reason: Reason | None
    """Why the arm is slower than requested; None: it is not."""
    contact_speed: float | None
    """Greatest speed of permitted contact on this motion, in [m]/[s]; None without contact
    limits."""
    executed: int = 0
    """Number of points of a chunk that it passes before its stop begins."""

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """State of the motion at a time; before its beginning the first one, after its end at rest.

        Args:
            time: Time in [s] on the monitor's clock.

        Returns:
            Positions in [rad] or [m], velocities per [s], accelerations per [s²]. Shape (nv,) each.
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
